"""Behaviour networks (paper section 2.1.2), and the check of their wiring when it is made.

A network is a cell to the outside: it has EB, IB, RS and IS in, AB and (of one functional cell) EO out. Inside, its
innervation cell signals the Excitatory Inputs cell, the Inhibitory Inputs cell and the Activation Output cell, in this
order; if the last one's value is true, it innervates the functional cells in their declared order. Functional cells may
be networks, without limit, and a cell may belong to several networks.

Where a network is not active, no functional cell of it is, unless another active network holds it. An inhibited network
hands its inhibition on: functional cells write their `inhibited_output` (paper 3.2: IB of Free-space finding "is
directly connected to the same port of the Way finder").

A plain link reads a cell that runs earlier in the declared order; `before(name)` closes a loop.
"""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, TypeAlias

from waychair.control.behaviours.cell import (
    STORAGES,
    UNSET,
    Behaviour,
    Cell,
    Sensor,
    checked_classes,
    fits,
    members_of,
    port_source,
)
from waychair.control.behaviours.conditions import ALWAYS, NEVER, Condition, PortSource
from waychair.errors import WiringError


@dataclass(frozen=True, eq=False)
class Network:
    """A behaviour network as it is declared. `output` names the functional cell whose EO is the network's EO.

    `reset_by` resets all functional cells, or those in `cleared`. `every_ns` and `triggers`: as for `Cell`.
    """

    name: str
    cells: Sequence[Cell | Network]
    output: str = ""
    excited_by: Condition = ALWAYS
    inhibited_by: Condition = NEVER
    reset_by: Condition = NEVER
    cleared: tuple[str, ...] = ()
    every_ns: int = 0
    triggers: tuple[str, ...] = ()


Node: TypeAlias = Cell | Network


@dataclass(frozen=True, slots=True)
class Wiring:
    """A checked network. `nodes` are its cells and networks by name, in the order in which they run.

    `functions` are the behavioural functions of each cell, `parents` the networks that hold a node, `outputs` the node
    whose EO each node shows (of a network: that of its output cell; None without one), `kinds` the type of every EO,
    `effectors` the cell that writes each effector.
    """

    root: Network
    sensors: Mapping[str, Sensor]
    nodes: Mapping[str, Node]
    functions: Mapping[str, tuple[Behaviour, ...]]
    parents: Mapping[str, tuple[str, ...]]
    outputs: Mapping[str, str | None]
    kinds: Mapping[str, Any]
    effectors: Mapping[str, str] = field(default_factory=dict)

    def identity(self) -> str:
        """Return a short hash of everything that decides what the network does but the code of its functions."""
        return hashlib.sha256("\n".join(self.lines()).encode()).hexdigest()[:16]

    def lines(self) -> list[str]:
        """Return the wiring as text, a line for each fact."""
        lines = [f"sensor {sensor.name}: {type_text(sensor.kind)}" for sensor in self.sensors.values()]
        for name, node in self.nodes.items():
            lines.append(f"{'network' if isinstance(node, Network) else 'cell'} {name}")
            lines += [f"  {text}" for text in node_lines(node, self.kinds.get(name))]
            if isinstance(node, Cell):
                constants = ((each, getattr(node, each)) for each in STORAGES)
                lines += [f"  {each}: {value}" for each, value in constants if value is not None]
        return lines


def type_text(kind: Any) -> str:
    """Return a type in words."""
    return " | ".join(getattr(each, "__name__", str(each)) for each in members_of(kind))


def node_lines(node: Node, kind: Any) -> Iterator[str]:
    """Yield the ports of a cell or network in words; `kind` is the type of its EO."""
    if isinstance(node, Network):
        yield f"cells: {', '.join(each.name for each in node.cells)}"
        if node.output:
            yield f"EO: that of {node.output}"
    else:
        for port, link in node.links.items():
            source = port_source(link)
            late = f", at most {node.fresh_ns[port] / 1e9:g} s old" if port in node.fresh_ns else ""
            yield f"DI {port}: EO of {source.name}{' before' if source.before else ''}{late}"
        if kind is not None:
            yield f"EO: {type_text(kind)}"
        yield from (f"AO: {effector}" for effector in node.actions)
    if node.excited_by is not ALWAYS:
        yield f"EB: {node.excited_by}"
    if node.inhibited_by is not NEVER:
        yield f"IB: {node.inhibited_by}"
    if isinstance(node, Cell) and node.inhibited_output is not UNSET:
        yield f"EO when inhibited: {node.inhibited_output}"
    if node.reset_by is not NEVER:
        yield f"RS: {node.reset_by}{', clears ' + ', '.join(node.cleared) if node.cleared else ''}"
    if node.every_ns:
        yield f"IS: every {node.every_ns / 1e9:g} s"
    if node.triggers:
        yield f"IS: after {', '.join(node.triggers)}"


def wire(root: Network, sensors: Sequence[Sensor] = ()) -> Wiring:
    """Return a network with its wiring checked.

    Raises:
        WiringError: a name is unknown or used twice, a network contains itself or is empty, a port is unknown, a type
            does not fit, cells need each other's values within one innervation, a cell reads one that runs after it,
            or two cells write one effector. The sentence names the cells.
    """
    nodes, parents = _gathered(root)
    heard = {sensor.name: sensor for sensor in sensors}
    twice = [name for name in heard if name in nodes] or _repeated([sensor.name for sensor in sensors])
    if twice:
        raise WiringError(f"{twice[0]} is declared twice: give each sensor, cell and network a name of its own")
    functions = {name: node.functions() if isinstance(node, Cell) else () for name, node in nodes.items()}
    outputs = _outputs(nodes)
    kinds: dict[str, Any] = {sensor.name: sensor.kind for sensor in sensors}
    for name in nodes:
        shown = outputs[name]
        shown_node = None if shown is None else nodes[shown]
        if isinstance(shown_node, Cell) and shown_node.effect is not None:
            kinds[name] = functions[shown_node.name][0].gives
    check = _WiringCheck(nodes, heard, functions, kinds)
    for node in nodes.values():
        check.node(node)
    _check_order(nodes, parents, outputs, heard)
    return Wiring(root, heard, nodes, functions, parents, outputs, kinds, check.effectors)


def _repeated(names: Sequence[str]) -> list[str]:
    return [name for k, name in enumerate(names) if name in names[:k]]


def _gathered(root: Network) -> tuple[dict[str, Node], dict[str, tuple[str, ...]]]:
    """Return all nodes in the order of their first run, networks before their cells, and each one's networks."""
    nodes: dict[str, Node] = {}
    parents: dict[str, list[str]] = {root.name: []}
    path: dict[str, None] = {}
    stack: list[tuple[Node, bool]] = [(root, False)]
    while stack:
        node, leaving = stack.pop()
        if leaving:
            path.popitem()
            continue
        if node.name in path:
            chain = [*path][[*path].index(node.name) :]
            raise WiringError(f"{node.name} contains itself through {', '.join(chain)}: take it out of one of them")
        if nodes.get(node.name, node) is not node:
            raise WiringError(f"two cells are named {node.name}: give each a name of its own")
        if node.name in nodes:
            continue
        nodes[node.name] = node
        if isinstance(node, Network):
            if not node.cells:
                raise WiringError(f"the network {node.name} has no cells: give it one")
            members = [each.name for each in node.cells]
            if repeated := _repeated(members):
                raise WiringError(f"{node.name} holds {repeated[0]} twice: name it once")
            for member in members:
                parents.setdefault(member, []).append(node.name)
            path[node.name] = None
            stack.append((node, True))
            stack += [(each, False) for each in reversed(node.cells)]
    return nodes, {name: tuple(held) for name, held in parents.items()}


def _outputs(nodes: Mapping[str, Node]) -> dict[str, str | None]:
    """Return the cell whose EO each node shows.

    Raises:
        WiringError: a network's output is none of its cells.
    """
    outputs: dict[str, str | None] = {name: name for name, node in nodes.items() if isinstance(node, Cell)}
    for name in nodes:
        chain = [name]
        while chain[-1] not in outputs:
            network = nodes[chain[-1]]
            assert isinstance(network, Network)  # all cells are in `outputs`
            members = [each.name for each in network.cells]
            if not network.output:
                outputs[network.name] = None
            elif network.output not in members:
                raise WiringError(
                    f"the output {network.output} of {network.name} is none of its cells: {', '.join(members)}"
                )
            else:
                chain.append(network.output)
        outputs.update(dict.fromkeys(chain, outputs[chain[-1]]))
    return outputs


class _WiringCheck:
    """The checks of single nodes."""

    def __init__(
        self,
        nodes: Mapping[str, Node],
        sensors: Mapping[str, Sensor],
        functions: Mapping[str, tuple[Behaviour, ...]],
        kinds: Mapping[str, Any],
    ) -> None:
        self._nodes, self._sensors, self._functions, self._kinds = nodes, sensors, functions, kinds
        self.effectors: dict[str, str] = {}
        """The cell that writes each effector."""

    def node(self, node: Node) -> None:
        """Check the ports of one cell or network."""
        for role, condition in (("EB", node.excited_by), ("IB", node.inhibited_by), ("RS", node.reset_by)):
            for source in condition.sources():
                self._condition(node, role, source)
        for name in node.triggers:
            self._known(node, "its trigger", name)
            if name not in self._kinds:
                raise WiringError(f"{node.name} is triggered by {name}, which has no EO: name a cell that writes one")
        if node.every_ns < 0 or (node.every_ns and node.triggers):
            raise WiringError(f"{node.name} has a period of {node.every_ns} ns and triggers {node.triggers}: give one")
        if isinstance(node, Cell):
            self._cell(node)
            return
        members = [each.name for each in node.cells]
        if lost := [name for name in node.cleared if name not in members]:
            raise WiringError(f"{node.name} clears {lost[0]}, which is none of its cells: {', '.join(members)}")

    def _cell(self, cell: Cell) -> None:
        functions = self._functions[cell.name]
        if not functions:
            raise WiringError(f"{cell.name} has neither EO nor AO: give it a function")
        ports = {name: port for function in functions for name, port in function.ports.items()}
        for name, link in cell.links.items():
            if name not in ports:
                raise WiringError(f"{cell.name} has no port DI {name}: it has {', '.join(ports) or 'none'}")
            source = port_source(link)
            self._known(cell, f"DI {name}", source.name)
            if source.name not in self._kinds:
                raise WiringError(f"DI {name} of {cell.name} reads {source.name}, which has no EO")
            for function in functions:
                self._link(cell, name, source.name, function)
        if lost := [name for name in cell.fresh_ns if name not in ports]:
            raise WiringError(f"{cell.name} limits the age of DI {lost[0]}, which it lacks: {', '.join(ports)}")
        for effector in cell.actions:
            other = self.effectors.setdefault(effector, cell.name)
            if other != cell.name:
                raise WiringError(
                    f"{other} and {cell.name} both write the effector {effector}: leave it to one of them"
                )
        self._storage(cell, functions)
        self._inhibited_output(cell)

    def _link(self, cell: Cell, port: str, source: str, function: Behaviour) -> None:
        if port in function.ports and not fits(self._kinds[source], function.ports[port].kind):
            given, taken = type_text(self._kinds[source]), type_text(function.ports[port].kind)
            raise WiringError(
                f"DI {port} of {cell.name} takes {taken}, and {source} gives {given}: link another source"
            )

    def _storage(self, cell: Cell, functions: Sequence[Behaviour]) -> None:
        used = {name for function in functions for name in function.passes}
        if lacking := [name for name in STORAGES if name in used and getattr(cell, name) is None]:
            raise WiringError(f"the function of {cell.name} takes {lacking[0]} data, and the cell declares none")
        if cell.dynamic is not None and not is_dataclass(cell.dynamic):
            raise WiringError(f"the dynamic data of {cell.name} are no dataclass: declare one")
        known = [each.name for each in fields(cell.dynamic)] if cell.dynamic is not None else []
        if lost := [name for name in cell.cleared if name not in known]:
            raise WiringError(f"a reset of {cell.name} clears {lost[0]}, which is not in its dynamic data: {known}")
        if "effect" in used and cell.effect is None:
            raise WiringError(f"an action of {cell.name} takes its effect, and the cell has no EO")

    def _inhibited_output(self, cell: Cell) -> None:
        if cell.inhibited_output is UNSET or cell.inhibited_output is None:
            return
        if cell.effect is None:
            raise WiringError(f"{cell.name} has an output for inhibition and no EO: give it a function")
        classes = checked_classes(self._kinds[cell.name])
        if classes is not None and not isinstance(cell.inhibited_output, classes):
            wanted, given = type_text(self._kinds[cell.name]), type(cell.inhibited_output).__name__
            raise WiringError(f"the output for inhibition of {cell.name} is of type {given}, and its EO of {wanted}")

    def _condition(self, node: Node, role: str, source: PortSource) -> None:
        self._known(node, role, source.name)
        if source.port == "AB":
            if source.name in self._sensors:
                raise WiringError(f"{role} of {node.name} reads AB of the sensor {source.name}: use a threshold")
            return
        if source.name not in self._kinds:
            raise WiringError(f"{role} of {node.name} reads EO of {source.name}, which has none")
        self._number(node, role, source)

    def _number(self, node: Node, role: str, source: PortSource) -> None:
        """Check that a threshold reads a number: a path of fields, where the types tell them."""
        kinds = members_of(self._kinds[source.name])
        for step in source.of.split(".") if source.of else ():
            known = [kind for kind in kinds if is_dataclass(kind) and isinstance(kind, type)]
            if not known:
                break
            if all(step not in _attributes(kind) for kind in known):
                attributes = ", ".join(sorted(set().union(*map(_attributes, known))))
                raise WiringError(f"{role} of {node.name} reads {step} of {source.name}, which has {attributes}")
            return
        if not source.of and not any(kind in (bool, int, float, Any, object) for kind in kinds):
            kind = type_text(self._kinds[source.name])
            raise WiringError(f"{role} of {node.name} compares {source.name}, a {kind}, with a number: name a field")

    def _known(self, node: Node, role: str, name: str) -> None:
        if name in self._nodes or name in self._sensors:
            return
        near = difflib.get_close_matches(name, [*self._nodes, *self._sensors], n=1, cutoff=0.0)
        raise WiringError(f"{role} of {node.name} reads {name}, which there is not; did you mean {near[0]}?")


def _attributes(kind: Any) -> set[str]:
    """Return the fields and properties of a dataclass."""
    return {each.name for each in fields(kind)} | {
        name for name in dir(kind) if isinstance(getattr(kind, name, None), property)
    }


def _check_order(
    nodes: Mapping[str, Node],
    parents: Mapping[str, tuple[str, ...]],
    outputs: Mapping[str, str | None],
    sensors: Mapping[str, Sensor],
) -> None:
    """Refuse cells that need each other's values within one innervation, and a cell that reads one after it."""
    needs = {name: _needed(node, outputs, sensors) for name, node in nodes.items()}
    # A cell of several networks runs in the first active one; a later one may depend on what it gave there.
    loop = _loop({name: [*needs[name], *parents[name][:1]] for name in nodes})
    if loop:
        raise WiringError(
            f"{', '.join(loop)} need each other's values within one innervation: "
            "let one of them read the value before it, by `before`"
        )
    place = {name: k for k, name in enumerate(nodes)}
    for name, sources in needs.items():
        for source in sources:
            if place[source] > place[name]:
                raise WiringError(
                    f"{name} reads {source}, which runs after it: declare {source} first, or read it by `before`"
                )


def _needed(node: Node, outputs: Mapping[str, str | None], sensors: Mapping[str, Sensor]) -> list[str]:
    """Return the nodes whose values of this innervation a node reads."""
    sources = [source for each in (node.excited_by, node.inhibited_by, node.reset_by) for source in each.sources()]
    if isinstance(node, Cell):
        sources += [port_source(link) for link in node.links.values()]
    read = [source for source in sources if not source.before and source.name not in sensors]
    return [(outputs[source.name] or source.name) if source.port == "EO" else source.name for source in read]


def _loop(needs: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the names along a loop of a graph; empty if it has none."""
    done: set[str] = set()
    for start in needs:
        path, on_path, stack = list[str](), set[str](), [(start, False)]
        while stack:
            name, leaving = stack.pop()
            if leaving:
                on_path.discard(path.pop())
                done.add(name)
            elif name in on_path:
                return path[path.index(name) :]
            elif name not in done:
                path.append(name)
                on_path.add(name)
                stack.append((name, True))
                stack += [(other, False) for other in needs[name]]
    return []
