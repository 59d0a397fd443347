"""A behaviour network as text and as a picture (SVG): cells in their running order, links by port.

Data links are thin, excitatory links green and dashed, inhibitory ones red and dashed, actuator links thick.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from waychair.control.behaviours.cell import Cell, port_source
from waychair.control.behaviours.cell_network import Network, Node, Wiring, node_lines
from waychair.control.behaviours.conditions import Condition
from waychair.errors import BehaviourError

_WIDE, _HIGH, _GAP_X, _GAP_Y, _MARGIN = 190, 44, 70, 26, 24
"""px; a box, the gaps between boxes, and the margin."""

_BOW = 50
"""px; room beside the last column for links between its boxes."""

_ROWS = 10
"""Boxes in a column."""

_COLOURS = {"DI": "#444444", "EB": "#1a7f37", "IB": "#c62828", "RS": "#7b1fa2", "AO": "#0b57d0"}


def network_of(wiring: Wiring, name: str | None) -> Network:
    """Return the named network, or the whole.

    Raises:
        BehaviourError: there is no network of this name.
    """
    if name is None:
        return wiring.root
    node = wiring.nodes.get(name)
    if not isinstance(node, Network):
        networks = ", ".join(each for each, node in wiring.nodes.items() if isinstance(node, Network))
        raise BehaviourError(f"there is no network {name}: choose among {networks}")
    return node


def network_text(wiring: Wiring, name: str | None = None) -> str:
    """Return a network with all its cells and ports as indented text; raises as `network_of`."""
    lines, shown = list[str](), set[str]()
    stack: list[tuple[Node, int]] = [(network_of(wiring, name), 0)]
    while stack:
        node, depth = stack.pop()
        indent = "  " * depth
        again = node.name in shown
        lines.append(f"{indent}{node.name}{' (as above)' if again else ''}")
        if again:
            continue
        shown.add(node.name)
        texts = node_lines(node, wiring.kinds.get(node.name))
        lines += [f"{indent}    {text}" for text in texts if not text.startswith("cells: ")]
        if isinstance(node, Network):
            stack += [(each, depth + 1) for each in reversed(node.cells)]
    return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class _Box:
    """A cell, network, sensor or effector in the picture; `kind` is one of these."""

    name: str
    kind: str
    column: int
    row: int

    @property
    def x(self) -> int:
        return _MARGIN + self.column * (_WIDE + _GAP_X)

    @property
    def y(self) -> int:
        return _MARGIN + self.row * (_HIGH + _GAP_Y)


@dataclass(frozen=True, slots=True)
class _Arrow:
    begin: str
    end: str
    port: str


def network_picture(wiring: Wiring, name: str | None = None) -> str:
    """Return one network as an SVG picture: its functional cells, and the sensors, cells and effectors linked to them.

    Raises:
        BehaviourError: there is no network of this name.
    """
    network = network_of(wiring, name)
    inside = [each.name for each in network.cells]
    arrows = list(_arrows(wiring, network))
    boxes = _placed(wiring, inside, arrows)
    width = max(box.x for box in boxes.values()) + _WIDE + _MARGIN + _BOW
    height = max(box.y for box in boxes.values()) + _HIGH + _MARGIN + 22
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    font = 'font-family="sans-serif" font-size="13"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} {font} role="img" aria-label="{escape(network.name)}">',
        f"<title>{escape(network.name)}</title>",
        f'<rect width="{width}" height="{height}" fill="white"/>',
        "<defs>",
        *(
            f'<marker id="{port}" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" '
            f'markerUnits="userSpaceOnUse" orient="auto"><path d="M0 0L8 4L0 8z" fill="{colour}"/></marker>'
            for port, colour in _COLOURS.items()
        ),
        "</defs>",
        *(_arrow_svg(boxes, arrow) for arrow in arrows),
        *(_box_svg(box) for box in boxes.values()),
        _legend_svg(height),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _arrows(wiring: Wiring, network: Network) -> Iterator[_Arrow]:
    """Yield the links into the functional cells, each pair of boxes and port once, and those to the effectors."""
    shown: set[_Arrow] = set()
    inside = {each.name for each in network.cells}
    for member in network.cells:
        for part in _parts(member):
            for source, port in _sources(part):
                begin = _visible(wiring, source, inside)
                arrow = _Arrow(begin, member.name, port)
                if begin != member.name and arrow not in shown:
                    shown.add(arrow)
                    yield arrow
            if isinstance(part, Cell):
                yield from (_Arrow(member.name, effector, "AO") for effector in part.actions)


def _parts(node: Node) -> Iterator[Node]:
    """Yield a node and all nodes in it."""
    stack: list[Node] = [node]
    while stack:
        each = stack.pop()
        yield each
        if isinstance(each, Network):
            stack += reversed(each.cells)


def _sources(node: Node) -> Iterator[tuple[str, str]]:
    if isinstance(node, Cell):
        yield from ((port_source(link).name, "DI") for link in node.links.values())
    conditions: tuple[tuple[str, Condition], ...] = (
        ("EB", node.excited_by),
        ("IB", node.inhibited_by),
        ("RS", node.reset_by),
    )
    for port, condition in conditions:
        yield from ((source.name, port) for source in condition.sources())


def _visible(wiring: Wiring, name: str, inside: set[str]) -> str:
    """Return the box that shows a source: the functional cell that holds it, or the source itself."""
    queue, seen = [name], set[str]()
    while queue:
        each = queue.pop(0)
        if each in inside:
            return each
        if each not in seen:
            seen.add(each)
            queue += wiring.parents.get(each, ())
    return name


def _placed(wiring: Wiring, inside: Sequence[str], arrows: Sequence[_Arrow]) -> dict[str, _Box]:
    outside = list(dict.fromkeys(arrow.begin for arrow in arrows if arrow.begin not in inside))
    effectors = list(dict.fromkeys(arrow.end for arrow in arrows if arrow.port == "AO"))
    boxes: dict[str, _Box] = {}
    column = 0
    for names, kinds in ((outside, None), (list(inside), None), (effectors, "effector")):
        for k, name in enumerate(names):
            kind = kinds or ("sensor" if name in wiring.sensors else "cell")
            if kind == "cell" and isinstance(wiring.nodes[name], Network):
                kind = "network"
            if kind != "effector" and name not in inside and name in wiring.nodes:
                kind = "outside"
            boxes[name] = _Box(name, kind, column + k // _ROWS, k % _ROWS)
        column += -(-len(names) // _ROWS) if names else 0
    return boxes


_FILLS = {
    "sensor": ("#fff8e1", "#b08900"),
    "cell": ("#e8f0fe", "#0b57d0"),
    "network": ("#d2e3fc", "#0b57d0"),
    "outside": ("#f1f3f4", "#5f6368"),
    "effector": ("#e6f4ea", "#1a7f37"),
}


def _box_svg(box: _Box) -> str:
    fill, line = _FILLS[box.kind]
    double = (
        f'<rect x="{box.x + 3}" y="{box.y + 3}" width="{_WIDE - 6}" height="{_HIGH - 6}" rx="5" fill="none" '
        f'stroke="{line}"/>'
        if box.kind == "network"
        else ""
    )
    return (
        f'<rect x="{box.x}" y="{box.y}" width="{_WIDE}" height="{_HIGH}" rx="7" fill="{fill}" stroke="{line}"/>'
        f"{double}"
        f'<text x="{box.x + _WIDE / 2:g}" y="{box.y + _HIGH / 2 + 4:g}" text-anchor="middle"'
        f'{_fitted(box.name)} fill="#202124">{escape(box.name)}</text>'
    )


def _fitted(name: str) -> str:
    """Return the attribute of a smaller font where a name is too long for its box."""
    most = (_WIDE - 16) / 7
    return f' font-size="{13 * most / len(name):.1f}"' if len(name) > most else ""


def _arrow_svg(boxes: dict[str, _Box], arrow: _Arrow) -> str:
    begin, end = boxes[arrow.begin], boxes[arrow.end]
    colour = _COLOURS[arrow.port]
    shift = {"DI": 0, "EB": -8, "IB": 8, "RS": 12, "AO": 0}[arrow.port]
    y0, y1 = begin.y + _HIGH / 2 + shift, end.y + _HIGH / 2 + shift
    if begin.column == end.column:  # round the side, so that no box is crossed
        x = begin.x + _WIDE
        bow = 20 + 10 * min(abs(begin.row - end.row), 5)
        path = f"M{x} {y0:g}C{x + bow} {y0:g} {x + bow} {y1:g} {x} {y1:g}"
    elif begin.column < end.column:
        x0, x1 = begin.x + _WIDE, end.x
        path = f"M{x0} {y0:g}C{x0 + _GAP_X / 2:g} {y0:g} {x1 - _GAP_X / 2:g} {y1:g} {x1} {y1:g}"
    else:
        x0, x1 = begin.x, end.x + _WIDE
        path = f"M{x0} {y0:g}C{x0 - _GAP_X / 2:g} {y0:g} {x1 + _GAP_X / 2:g} {y1:g} {x1} {y1:g}"
    dash = ' stroke-dasharray="6 4"' if arrow.port in ("EB", "IB", "RS") else ""
    thick = 3 if arrow.port == "AO" else 1.4
    return (
        f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{thick}"{dash} marker-end="url(#{arrow.port})"/>'
    )


_LEGEND = (
    ("DI", "data (EO to DI)"),
    ("EB", "excitation"),
    ("IB", "inhibition"),
    ("RS", "reset"),
    ("AO", "actuator"),
)


def _legend_svg(height: int) -> str:
    parts, x, y = [], _MARGIN, height - 16
    for port, words in _LEGEND:
        dash = ' stroke-dasharray="6 4"' if port in ("EB", "IB", "RS") else ""
        thick = 3 if port == "AO" else 1.4
        parts.append(
            f'<path d="M{x} {y - 4}h26" stroke="{_COLOURS[port]}" stroke-width="{thick}"{dash} '
            f'marker-end="url(#{port})"/><text x="{x + 32}" y="{y}" font-size="11" fill="#444444">{words}</text>'
        )
        x += 50 + 7 * len(words)
    return "".join(parts)
