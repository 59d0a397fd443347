"""A traffic graph as a text file: one record a line, names in quotes where they hold a space.

    traffic-graph 1
    graph "north wing" chair_width 0.6 revision 3 cell 0.05
    node n1 ground 3.0 27.0 1
    section n1-n2 n1 n2 length 8.0 width 1.2 lanes 1 both delay 0.0 lift -
    way n1-n2 3.0 27.0 1.2 7.0 28.0 1.5 11.0 27.0 1.2
    refuge "room 1" room1 slots 1 place own owner -
    lift north lobby0 lobby1

A node has its storey, x, y [m] and capacity; a section its two nodes, then `both` ways or `one_way`. A `way` is the course of the
section before it, where that is not straight: x, y and clear width [m] of each point. A refuge has its node and kind, then `own` (for the chair whose goal it is) or `waiting` (for any chair). `#` begins a comment.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from waychair.errors import TrafficError
from waychair.files import is_file, os_error_text, read_text, write_text
from waychair.maps.traffic.traffic_graph import (
    CELL,
    Refuge,
    RefugeKind,
    Section,
    TrafficGraph,
    TrafficLift,
    TrafficNode,
    WayPoint,
)

FIRST_LINE = "traffic-graph 1"
_HEAD = "NAME chair_width WIDTH revision NUMBER cell SIDE"
NONE = "-"


def traffic_text(graph: TrafficGraph) -> str:
    """Return a graph as text that `traffic_from_text` reads back as an equal graph."""
    return "\n".join(_lines(graph)) + "\n"


def traffic_from_text(text: str, source: str = "the traffic graph") -> TrafficGraph:
    """Return the graph of a text.

    Raises:
        TrafficError: the text is no traffic graph or an impossible one; the message names `source`, line and remedy.
    """
    lines = text.splitlines()
    if not lines or lines[0].strip() != FIRST_LINE:
        raise TrafficError(f"{source} is no traffic graph: its first line must be `{FIRST_LINE}`")
    head: tuple[str, float, int, float] | None = None
    nodes: list[TrafficNode] = []
    sections: list[Section] = []
    refuges: list[Refuge] = []
    lifts: list[TrafficLift] = []
    records: dict[str, Callable[[list[str]], None]] = {
        "node": lambda words: nodes.append(_node(words)),
        "section": lambda words: sections.append(_section(words)),
        "way": lambda words: sections.append(_with_way(sections.pop() if sections else None, words)),
        "refuge": lambda words: refuges.append(_refuge(words)),
        "lift": lambda words: lifts.append(TrafficLift(words[0], tuple(words[1:]))),
    }
    for number, line in enumerate(lines[1:], start=2):
        try:
            words = shlex.split(line, comments=True)
            if not words:
                continue
            if words[0] == "graph":
                head = _head(words[1:])
            elif words[0] in records:
                records[words[0]](words[1:])
            else:
                known = ", ".join(("graph", *records))
                raise ValueError(f"'{words[0]}' is no record; give one of {known}")
        except (ValueError, IndexError) as problem:
            raise TrafficError(f"{source}, line {number}: {problem}") from None
    if head is None:
        raise TrafficError(f"{source} has no line `graph {_HEAD}`; add it")
    try:
        return TrafficGraph(
            head[0],
            tuple(nodes),
            tuple(sections),
            tuple(refuges),
            tuple(lifts),
            chair_width=head[1],
            revision=head[2],
            cell=head[3],
        )
    except TrafficError as problem:
        raise TrafficError(f"{source}: {problem}") from None


def read_traffic(path: Path) -> TrafficGraph:
    """Return the graph of a file.

    Raises:
        TrafficError: there is no such file, or it is no traffic graph.
    """
    if not is_file(path, TrafficError):
        raise TrafficError(f"there is no traffic graph at {path}; give the path of its text file")
    return traffic_from_text(read_text(path, TrafficError), str(path))


def write_traffic(path: Path, graph: TrafficGraph) -> None:
    """Write a graph to a file, as a whole or not at all.

    Raises:
        TrafficError: the file cannot be written.
    """
    try:
        write_text(path, traffic_text(graph))
    except OSError as problem:
        raise TrafficError(f"{path} cannot be written: {os_error_text(problem)}") from None


def _lines(graph: TrafficGraph) -> Iterator[str]:
    yield FIRST_LINE
    quote = shlex.quote
    yield f"graph {quote(graph.name)} chair_width {graph.chair_width!r} revision {graph.revision} cell {graph.cell!r}"
    for node in graph.nodes:
        yield f"node {quote(node.name)} {quote(node.storey)} {float(node.x)!r} {float(node.y)!r} {node.capacity}"
    for section in graph.sections:
        names = " ".join(quote(word) for word in (section.name, section.start, section.end))
        ways = "one_way" if section.one_way else "both"
        lift = NONE if section.lift is None else quote(section.lift)
        yield (
            f"section {names} length {float(section.length)!r} width {float(section.width)!r} "
            f"lanes {section.lanes} {ways} delay {float(section.delay_s)!r} lift {lift}"
        )
        if section.points:
            yield " ".join(
                ("way", quote(section.name), *(repr(float(value)) for point in section.points for value in point))
            )
    for refuge in graph.refuges:
        use = "waiting" if refuge.waiting else "own"
        owner = NONE if refuge.owner is None else refuge.owner
        yield f"refuge {quote(refuge.name)} {quote(refuge.node)} slots {refuge.slots} {refuge.kind.value} {use} owner {owner}"
    for cabin in graph.lifts:
        yield " ".join(("lift", quote(cabin.name), *(quote(stop) for stop in cabin.stops)))


def _fields(words: list[str], form: str) -> list[str]:
    """Return the words at the capital letters of a form; the others must stand as they are."""
    pattern = form.split()
    if len(words) != len(pattern) or any(
        not part.isupper() and part != word for word, part in zip(words, pattern, strict=True)
    ):
        raise ValueError(f"'{' '.join(words)}' does not read `{form}`")
    return [word for word, part in zip(words, pattern, strict=True) if part.isupper()]


def _head(words: list[str]) -> tuple[str, float, int, float]:
    """Return name, chair's width, revision and cell of a graph; the cell may be left out."""
    given = words if len(words) > 5 else [*words, "cell", str(CELL)]
    name, width, revision, cell = _fields(given, _HEAD)
    return name, float(width), int(revision), float(cell)


def _node(words: list[str]) -> TrafficNode:
    name, storey, x, y, capacity = _fields(words, "NAME STOREY X Y CAPACITY")
    return TrafficNode(name, float(x), float(y), storey, int(capacity))


def _section(words: list[str]) -> Section:
    form = "NAME START END length LENGTH width WIDTH lanes LANES WAYS delay SECONDS lift LIFT"
    name, start, end, length, width, lanes, ways, delay, lift = _fields(words, form)
    one_way = {"both": False, "one_way": True}.get(ways)
    if one_way is None:
        raise ValueError(f"'{ways}' is neither both nor one_way")
    return Section(
        name,
        start,
        end,
        float(length),
        float(width),
        int(lanes),
        one_way,
        float(delay),
        None if lift == NONE else lift,
    )


def _with_way(section: Section | None, words: list[str]) -> Section:
    """Return the section with its way."""
    name, values = words[0], [float(word) for word in words[1:]]
    if section is None or section.name != name:
        raise ValueError(f"the way of {name} does not follow its section; put it there")
    if len(values) % 3 or len(values) < 6:
        raise ValueError(f"the way of {name} has {len(values)} numbers; give x, y and width of two points or more")
    return replace(section, points=tuple(WayPoint(*values[k : k + 3]) for k in range(0, len(values), 3)))


def _refuge(words: list[str]) -> Refuge:
    name, node, slots, kind, use, owner = _fields(words, "NAME NODE slots SLOTS KIND USE owner OWNER")
    if use not in ("own", "waiting"):
        raise ValueError(f"'{use}' is neither own nor waiting")
    kinds = {each.value: each for each in RefugeKind}
    if kind not in kinds:
        raise ValueError(f"'{kind}' is no kind of refuge; give one of {', '.join(kinds)}")
    number = None if owner == NONE else int(owner)
    return Refuge(name, node, int(slots), kinds[kind], use == "waiting", number)
