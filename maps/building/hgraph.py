"""The model of a building as a hierarchical graph (H-graph): sub-maps in a tree, nodes, arcs, doorways, lifts, beacons.

After "TetraNauta" (Cagigas and others), section 2, with these readings: brothers have one parent; a node has at most four
arcs, and its tie to a lift is none; a doorway is stored once, in the parent's sub-map, and is seen from both sides: by
the parent as an arc to a sub-map node, by the child as a horizontal bridge. Sub-map nodes are therefore derived
(`submap_nodes`) and never stored.

Coordinates are metres in the frame of the node's sub-map; each sub-map has x, y, theta and scale in its parent's frame,
and the root's frame is the building's. The root has the path "", its children "ground", theirs "ground/west", and so on.
All classes are frozen; edits return new ones (`hgraph_edits`).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from waychair.maps.building.costs import CostSettings
from waychair.types import Pose2

ROOT = ""
"""The path of the root sub-map."""


class NodeKind(enum.StrEnum):
    """The five kinds of node. The text files use the values."""

    END = "end"
    """A goal: a place of the storey's map."""
    CROSS = "cross"
    """A node that connects others."""
    BRIDGE = "door"
    """Horizontal bridge: the child's side of a doorway to its parent."""
    LIFT = "lift"
    """Vertical bridge: the floor in front of a lift's door."""
    SUBMAP = "submap"
    """A whole child, as its parent sees it. Derived, never stored."""


class Origin(enum.StrEnum):
    """The author of a record; generating a graph again keeps what people made."""

    AUTO = "auto"
    HAND = "hand"


class NodeRef(NamedTuple):
    """A node's address: the path of its sub-map and its id there. Its text is `ground/west:n3`."""

    submap: str
    node: str

    def __str__(self) -> str:
        return f"{self.submap}:{self.node}"


class ArcRef(NamedTuple):
    """The address of an arc or doorway: the path of the sub-map that stores it, and its two ends as written there."""

    submap: str
    start: str
    end: str

    def __str__(self) -> str:
        return f"{self.submap}:{self.start}>{self.end}"


@dataclass(frozen=True, slots=True)
class Closure:
    """The reason why an arc, doorway or stop is closed, and the time [ns since 1970, UTC] until which; None for good."""

    reason: str
    until_ns: int | None = None

    def holds(self, now_ns: int | None) -> bool:
        """Return whether it is closed at that time; without a time, it is."""
        return self.until_ns is None or now_ns is None or now_ns < self.until_ns


@dataclass(frozen=True, slots=True)
class Node:
    """A node: its id within the sub-map, its kind, and x, y [m] in the sub-map's frame.

    `name` is a goal's name, that of its place in the storey's `places.yaml`; other nodes may have one as a landmark.
    """

    id: str
    kind: NodeKind
    x: float
    y: float
    name: str = ""
    origin: Origin = Origin.HAND


@dataclass(frozen=True, slots=True)
class Way:
    """The properties of an arc or a doorway that decide its cost; None where unknown.

    `length` [m] replaces the straight distance between the ends; `width` [m] is that of a door on it; `speed` [m/s] is
    the limit of a slow zone; `drive_s` [s] is the median of at least five measured drives and replaces the estimate;
    `price` [m] replaces everything else. A `ramp` joins sub-maps that a lift joins, too.
    """

    length: float | None = None
    width: float | None = None
    speed: float | None = None
    drive_s: float | None = None
    price: float | None = None
    one_way: bool = False
    ramp: bool = False
    closure: Closure | None = None


PLAIN = Way()
"""The way of most arcs: both ways, no door, no limit."""


@dataclass(frozen=True, slots=True)
class Arc:
    """A way between two nodes of one sub-map, by their ids; a one-way arc leads from `start` to `end`."""

    start: str
    end: str
    way: Way = PLAIN
    origin: Origin = Origin.HAND


@dataclass(frozen=True, slots=True)
class GraphDoorway:
    """A horizontal bridge, stored in the parent: from its node `start` into the child, to its node `node`.

    `child` is the last part of the child's path. A one-way doorway leads into the child, with `outwards` out of it.
    """

    start: str
    child: str
    node: str
    way: Way = PLAIN
    outwards: bool = False
    origin: Origin = Origin.HAND


@dataclass(frozen=True, slots=True)
class Beacon:
    """A tag on a wall or floor: its number, its pose in the sub-map's frame, and the node it stands for."""

    id: str
    pose: Pose2
    node: str = ""


@dataclass(frozen=True, slots=True)
class SubmapFrame:
    """A sub-map's frame in its parent's: `parent = (x, y) + scale * R(theta) * child`."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0
    scale: float = 1.0

    def point(self, x: float, y: float) -> tuple[float, float]:
        """Return a point of this frame [m, m] in the parent's frame."""
        c, s = self.scale * math.cos(self.theta), self.scale * math.sin(self.theta)
        return self.x + c * x - s * y, self.y + s * x + c * y

    def inside(self, x: float, y: float) -> tuple[float, float]:
        """Return a point of the parent's frame [m, m] in this frame."""
        dx, dy = x - self.x, y - self.y
        c, s = math.cos(self.theta) / self.scale, math.sin(self.theta) / self.scale
        return c * dx + s * dy, c * dy - s * dx

    def __matmul__(self, other: SubmapFrame) -> SubmapFrame:
        """Return the frame of `other`, which lies in this one, in this one's parent."""
        x, y = self.point(other.x, other.y)
        theta = math.remainder(self.theta + other.theta, math.tau)
        return SubmapFrame(x, y, theta, self.scale * other.scale)


@dataclass(frozen=True, slots=True)
class SubMap:
    """A part of the building: storey, wing, corridor or room, with its nodes by id, arcs, doorways and beacons.

    `storey` is the id of its storey, "" for the parent's. `source` is the text that it was read from, with its records,
    so that unchanged files are written back byte for byte; it does not count in comparisons.
    """

    path: str
    name: str = ""
    frame: SubmapFrame = SubmapFrame()
    storey: str = ""
    nodes: Mapping[str, Node] = field(default_factory=dict)
    arcs: tuple[Arc, ...] = ()
    doorways: tuple[GraphDoorway, ...] = ()
    beacons: tuple[Beacon, ...] = ()
    source: object = field(default=None, compare=False, repr=False)

    @property
    def title(self) -> str:
        """Its name for people; the last part of its path where it has none."""
        return self.name or self.path.rpartition("/")[2]


@dataclass(frozen=True, slots=True)
class Storey:
    """A storey: its id, name, height above the ground [m], and its map folder relative to the building's folder."""

    id: str
    name: str = ""
    height: float = 0.0
    map: str = ""


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop of a lift: the storey, the node in front of its door, the door's clear width [m], and its closure.

    `cabin`: the pose of the cabin's middle in the storey's map, facing the door.
    """

    storey: str
    at: NodeRef
    door_width: float | None = None
    closure: Closure | None = None
    cabin: Pose2 | None = None


@dataclass(frozen=True, slots=True)
class Lift:
    """A lift: its stops from bottom to top, cabin and door [m], and costs [m] of its own where they differ."""

    id: str
    name: str = ""
    stops: tuple[Stop, ...] = ()
    cabin_width: float | None = None
    cabin_depth: float | None = None
    door_width: float | None = None
    wait: float | None = None
    board: float | None = None
    per_storey: float | None = None


@dataclass(frozen=True, slots=True)
class HGraph:
    """A building: its name, storeys from bottom to top, sub-maps by path (parents first), lifts by id, and costs.

    `source` is the text of the general file, as in `SubMap`.
    """

    name: str
    storeys: tuple[Storey, ...] = ()
    submaps: Mapping[str, SubMap] = field(default_factory=lambda: {ROOT: SubMap(ROOT)})
    lifts: Mapping[str, Lift] = field(default_factory=dict)
    costs: CostSettings = field(default_factory=CostSettings)
    source: object = field(default=None, compare=False, repr=False)

    def children(self, path: str) -> tuple[str, ...]:
        """Return the paths of a sub-map's children."""
        return tuple(each for each in self.submaps if each and parent_path(each) == path)

    def node(self, ref: NodeRef) -> Node | None:
        """Return the node at this address, None if there is none."""
        submap = self.submaps.get(ref.submap)
        return None if submap is None else submap.nodes.get(ref.node)

    def nodes(self) -> Iterator[tuple[NodeRef, Node]]:
        """Yield all stored nodes with their addresses."""
        for path, submap in self.submaps.items():
            for node in submap.nodes.values():
                yield NodeRef(path, node.id), node

    def storey_of(self, path: str) -> str:
        """Return the id of the storey that a sub-map lies on; "" where neither it nor an ancestor names one."""
        while True:
            submap = self.submaps.get(path)
            if submap is not None and submap.storey:
                return submap.storey
            if not path:
                return ""
            path = parent_path(path)

    def frame_of(self, path: str) -> SubmapFrame:
        """Return a sub-map's frame in the building's."""
        frame = SubmapFrame()
        for each in ancestors(path):
            if each in self.submaps:
                frame = frame @ self.submaps[each].frame
        return frame

    def map_frame_of(self, path: str) -> SubmapFrame:
        """Return a sub-map's frame in its storey's map, which is the frame of the storey's uppermost sub-map."""
        storey, frame, is_inside = self.storey_of(path), SubmapFrame(), False
        for each in ancestors(path):
            if is_inside and each in self.submaps:
                frame = frame @ self.submaps[each].frame
            is_inside = is_inside or self.storey_of(each) == storey
        return frame

    def storey_frame(self, storey: str) -> SubmapFrame:
        """Return the frame of a storey's map in the building's: that of its uppermost sub-map, if it has one."""
        path = next((each for each in self.submaps if self.storey_of(each) == storey), None)
        return SubmapFrame() if path is None else self.frame_of(path)


def parent_path(path: str) -> str:
    """Return the path of the parent of a sub-map; that of the root is the root's own."""
    return path.rpartition("/")[0]


def ancestors(path: str) -> list[str]:
    """Return the paths from the root down to a sub-map, itself included."""
    parts = path.split("/") if path else []
    return ["/".join(parts[:count]) for count in range(len(parts) + 1)]


def child_path(parent: str, child: str) -> str:
    """Return the path of a child, given the last part of it."""
    return f"{parent}/{child}" if parent else child


def inner_end(submap: SubMap, doorway: GraphDoorway) -> NodeRef:
    """Return the address of a doorway's node in the child; `submap` stores the doorway."""
    return NodeRef(child_path(submap.path, doorway.child), doorway.node)


def submap_nodes(hgraph: HGraph, path: str) -> dict[str, Node]:
    """Return the sub-map nodes of a sub-map, one for each child, by the last part of the child's path.

    Each stands in the origin of its child's frame.
    """
    found = {}
    for each in hgraph.children(path):
        child = hgraph.submaps[each]
        last = each.rpartition("/")[2]
        found[last] = Node(last, NodeKind.SUBMAP, child.frame.x, child.frame.y, child.title, Origin.AUTO)
    return found


def full_name(hgraph: HGraph, ref: NodeRef) -> str:
    """Return a goal's name for people, unique in the building: titles of its sub-maps and its own, joined by `/`."""
    node = hgraph.node(ref)
    own = ref.node if node is None else node.name or node.id
    return "/".join(
        [*(hgraph.submaps[path].title for path in ancestors(ref.submap)[1:] if path in hgraph.submaps), own]
    )
