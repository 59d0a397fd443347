"""A building as one plain graph in a single text file, for robots that know no hierarchy: with or without trajectories.

    graph name=Clinic
    node id=g/ward:e x=10 y=3.25 storey=g kind=end name="Bed g"
    arc from=g/ward:d to=g/ward:e cost_mm=3000
    way from=g/ward:e to=g/store:e cost_mm=21550 via=g/ward:d,g:c2,g:c3,g/store:d
    end

Coordinates are metres in the building's frame, arcs are directed, costs whole millimetres of straight driving; closed arcs
are left out. A lift's cabin at a storey is the node `@LIFT:STOREY`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from waychair.errors import BuildingError
from waychair.files import read_text, write_text
from waychair.geometry import MAX_COORDINATE
from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.hgraph import HGraph, NodeRef
from waychair.maps.building.indexed import IndexedGraph
from waychair.maps.building.records import END, line_of, records


@dataclass(frozen=True, slots=True)
class PlainNode:
    """A node: its id, x, y [m] in the building's frame, storey, kind and name."""

    id: str
    x: float
    y: float
    storey: str
    kind: str
    name: str = ""


@dataclass(frozen=True, slots=True)
class PlainArc:
    """A directed arc, and its cost [mm of straight driving]."""

    start: str
    end: str
    cost: int


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A way that was found in advance: its ends, its cost [mm] and the nodes between."""

    start: str
    end: str
    cost: int
    via: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PlainGraph:
    """A graph without hierarchy."""

    name: str
    nodes: tuple[PlainNode, ...]
    arcs: tuple[PlainArc, ...]
    trajectories: tuple[Trajectory, ...] = ()


def plain_graph(hgraph: HGraph, built: IndexedGraph, trajectories: Iterable[Trajectory] = ()) -> PlainGraph:
    """Return a building without its hierarchy; `built` are its arrays."""
    graph, nodes = built.graph, []
    for index, ref in enumerate(built.refs):
        node, (x, y) = hgraph.node(ref), graph.xy[index].tolist()
        storey = ref.node if node is None else hgraph.storey_of(ref.submap)
        nodes.append(
            PlainNode(str(ref), x, y, storey, "cabin" if node is None else str(node.kind), node.name if node else "")
        )
    ends = zip(graph.tail.tolist(), graph.head.tolist(), graph.cost.tolist(), strict=True)
    arcs = [
        PlainArc(str(built.refs[one]), str(built.refs[other]), cost) for one, other, cost in ends if cost < CLOSED_MM
    ]
    return PlainGraph(hgraph.name, tuple(nodes), tuple(arcs), tuple(trajectories))


def trajectory(refs: Iterable[NodeRef], cost: int) -> Trajectory:
    """Return a trajectory through these nodes at this cost [mm]."""
    names = [str(ref) for ref in refs]
    return Trajectory(names[0], names[-1], cost, tuple(names[1:-1]))


def plain_text(graph: PlainGraph) -> str:
    """Return the text of a plain graph."""
    lines = [line_of("graph", [("name", graph.name)])]
    for node in graph.nodes:
        place = [("x", float(node.x)), ("y", float(node.y)), ("storey", node.storey or None)]
        lines.append(line_of("node", [("id", node.id), *place, ("kind", node.kind), ("name", node.name or None)]))
    lines += [line_of("arc", [("from", arc.start), ("to", arc.end), ("cost_mm", arc.cost)]) for arc in graph.arcs]
    for each in graph.trajectories:
        ends = [("from", each.start), ("to", each.end), ("cost_mm", each.cost)]
        lines.append(line_of("way", [*ends, ("via", ",".join(each.via) or None)]))
    return "\n".join([*lines, END, ""])


def plain_from_text(path: Path, text: str) -> PlainGraph:
    """Return a plain graph from its text.

    Raises:
        BuildingError: a line is broken, doubled or names a node that is not there; the message names file and line.
    """
    name, nodes, arcs, ways = "", {}, [], []
    for record in records(path, text):
        if record.kind == "graph":
            name = record.text("name")
        elif record.kind == "node":
            x, y = (record.number_of(key, -MAX_COORDINATE, MAX_COORDINATE) for key in ("x", "y"))
            key = record.text("id")
            if key in nodes:
                raise record.error(f"there is a node '{key}' already: give it another id")
            nodes[key] = PlainNode(key, x, y, record.text("storey", ""), record.text("kind"), record.text("name", ""))
        elif record.kind in ("arc", "way"):
            start, end = record.text("from"), record.text("to")
            via = tuple(each for each in record.text("via", "").split(",") if each)
            for key in (start, end, *via):
                if key not in nodes:
                    raise record.error(f"there is no node '{key}' above this line: add it, or correct its id")
            cost = int(record.number_of("cost_mm", 0, CLOSED_MM))
            if record.kind == "arc":
                arcs.append(PlainArc(start, end, cost))
            else:
                ways.append(Trajectory(start, end, cost, via))
        else:
            raise record.error(f"'{record.kind}' is no kind of record here: write graph, node, arc, way")
    return PlainGraph(name, tuple(nodes.values()), tuple(arcs), tuple(ways))


def read_plain(path: Path) -> PlainGraph:
    """Return the plain graph of a file; raises as `plain_from_text`."""
    return plain_from_text(path, read_text(path, BuildingError))


def write_plain(path: Path, graph: PlainGraph) -> None:
    """Write a plain graph, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(path, plain_text(graph))
