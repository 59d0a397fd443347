"""The parts of a storey's graph before it has ids: nodes and arcs of the storey's sub-map and of its rooms, doorways."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.maps.building.hgraph import NodeKind


@dataclass(frozen=True, slots=True)
class SketchNode:
    """A node: its kind, place [m] in map, name, and `role`, the letter that its id begins with."""

    role: str
    kind: NodeKind
    x: float
    y: float
    name: str = ""


@dataclass(frozen=True, slots=True)
class SketchArc:
    """An arc between two nodes by index, with its length [m], and the width [m] of a door on it."""

    start: int
    end: int
    length: float
    width: float | None = None


@dataclass(slots=True)
class SketchMap:
    """Nodes and arcs of the storey's sub-map or of one room; `middle` [m] tells rooms apart.

    `title` is the name of the room's only place, "" if it has none or several.
    """

    title: str
    middle: tuple[float, float]
    nodes: list[SketchNode] = field(default_factory=list)
    arcs: list[SketchArc] = field(default_factory=list)

    def add(self, node: SketchNode) -> int:
        """Add a node and return its index."""
        self.nodes.append(node)
        return len(self.nodes) - 1


@dataclass(frozen=True, slots=True)
class SketchDoorway:
    """A doorway: the node of the storey's sub-map, the room's index, its node, and the clear width [m]."""

    start: int
    room: int
    node: int
    width: float
