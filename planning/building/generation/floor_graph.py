"""The graph of a mapped storey: rooms as sub-maps, doors as doorways, corridors as chains of nodes, places as End nodes.

Rooms and doors come from `maps.rooms`. The chair's body decides: an arc is a way that D* Lite finds for it, with the length
of that way, and a door that it does not pass is no doorway. Corridors, and rooms with several doors that lead on, are drawn
in the storey's own sub-map; other rooms are children. `regenerated_storey` brings the sketch into a building's graph.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.maps.building.hgraph import NodeKind
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.maps.rooms.floor_rooms import FloorRooms, Room, RoomKind
from waychair.maps.rooms.openings import Opening
from waychair.planning.building.generation.joined_parts import joined_parts
from waychair.planning.building.generation.region_network import (
    MOST_ARCS,
    Region,
    ahead_of_opening,
    region_links,
    region_of,
)
from waychair.planning.building.generation.sketch_parts import SketchArc, SketchDoorway, SketchMap, SketchNode
from waychair.planning.grid.costmap import Costmap
from waychair.types import FloatArray, Place

THROUGH = 3
"""A room with so many doors to other rooms is passed through, and drawn in the storey's sub-map."""

IN_DOOR = 0.1
"""[m] The chair must be able to drive so near to the middle of a door."""

SAME = 0.5
"""[m] Nodes in front of two doors that are nearer to each other than this are one."""


@dataclass(frozen=True, slots=True)
class Sketch:
    """The graph of a storey before it has ids.

    Attributes:
        storey: nodes and arcs of the storey's own sub-map.
        rooms: those of its rooms.
        doorways: between them.
        shut: openings that this chair does not pass, with their widths [m].
        lost: places that it cannot drive to.
    """

    storey: SketchMap
    rooms: tuple[SketchMap, ...]
    doorways: tuple[SketchDoorway, ...]
    shut: tuple[Opening, ...]
    lost: tuple[str, ...]


def sketch_of(
    costmap: Costmap,
    found: FloorRooms,
    places: Mapping[str, Place],
    progress: Callable[[float], None] = lambda share: None,
) -> Sketch:
    """Return the graph of a storey.

    Args:
        costmap: of the storey's map for the chair's body.
        found: rooms and openings of the same map.
        places: the storey's places by name.
        progress: is called with the share (0 to 1) of the rooms and corridors that is done.
    """
    regions = {room.number: region_of(costmap, found.labels == room.number) for room in _drivable(found)}
    open_, shut = _passed(found, regions)
    regions = _entered(found, regions, open_)
    inner = _inner_rooms(found, regions, open_)
    at = _places_by_room(costmap, found, regions, places)
    storey = SketchMap("", (0.0, 0.0))
    hubs = {number: _Hub(storey) for number in regions if number not in inner}
    rooms: list[SketchMap] = []
    numbers: dict[int, int] = {}
    for number in sorted(inner):
        room = found.rooms[number - 1]
        numbers[number] = len(rooms)
        rooms.append(SketchMap(_title(at.get(number, [])), (float(room.centre[0]), float(room.centre[1]))))
    doorways: list[SketchDoorway] = []
    for opening in open_:
        door = storey.add(_door_node(opening))
        for number in dict.fromkeys(opening.rooms):
            if number in numbers:
                inside_ = rooms[numbers[number]].add(_door_node(opening, NodeKind.BRIDGE))
                doorways.append(SketchDoorway(door, numbers[number], inside_, opening.width))
            elif opening.is_door and len(set(opening.rooms)) == 2:
                hubs[number].meet(door, _ahead(costmap, found, opening, number), opening.width)
            else:
                hubs[number].points.append(door)
    lost = set(places)
    for done, (number, region) in enumerate(regions.items(), start=1):
        assert region is not None
        own = at.get(number, [])
        lost -= {place.name for place in own}
        if number in numbers:
            _fill_room(rooms[numbers[number]], region, own)
        else:
            hubs[number].fill(region, own, is_room=found.rooms[number - 1].kind is RoomKind.ROOM)
        progress(done / len(regions))
    kept = joined_parts(costmap, storey, rooms, doorways)
    ends = {node.name for part in (kept[0], *kept[1]) for node in part.nodes if node.role == "p"}
    return Sketch(kept[0], tuple(kept[1]), tuple(kept[2]), tuple(shut), tuple(sorted(lost | (set(places) - ends))))


@dataclass(slots=True)
class _Hub:
    """The nodes of the storey's sub-map in one corridor or hall, by index."""

    storey: SketchMap
    points: list[int] = field(default_factory=list)

    def meet(self, door: int, ahead: FloatArray, width: float) -> None:
        """Join a door to a node in front of it, that of another door where there is one."""
        nodes = self.storey.nodes
        near = [k for k in self.points if nodes[k].role == "c" and _apart(nodes[k], ahead) < SAME]
        crossing = (
            near[0] if near else self.storey.add(SketchNode("c", NodeKind.CROSS, float(ahead[0]), float(ahead[1])))
        )
        if not near:
            self.points.append(crossing)
        self.storey.arcs.append(SketchArc(door, crossing, _apart(nodes[door], ahead), width))

    def fill(self, region: Region, places: list[Place], is_room: bool) -> None:
        """Add the places, in a hall without any a goal in its middle where the chair can turn, and join all nodes."""
        self.points += [self.storey.add(_place_node(place)) for place in places]
        best = region.widest() if is_room and not places else None
        if best is not None and best[1] >= region.costmap.body.circumscribed_radius:
            self.points.append(self.storey.add(SketchNode("m", NodeKind.END, float(best[0][0]), float(best[0][1]))))
            _join(self.storey, region, self.points)
            return
        if len(self.points) == 1 and not places:
            best = region.widest()
            if best is not None:
                self.points.append(
                    self.storey.add(SketchNode("c", NodeKind.CROSS, float(best[0][0]), float(best[0][1])))
                )
        _join(self.storey, region, self.points)


def _fill_room(room: SketchMap, region: Region, places: list[Place]) -> None:
    """Add the room's places, or a goal in its middle where the chair can turn, and join them to its doors."""
    points = list(range(len(room.nodes)))
    points += [room.add(_place_node(place)) for place in places]
    best = region.widest()
    if best is not None:
        middle, clearance = best
        turns = clearance >= region.costmap.body.circumscribed_radius
        goal = not places and turns
        if goal or len(points) > 2:
            kind = NodeKind.END if goal else NodeKind.CROSS
            points.append(room.add(SketchNode("m", kind, float(middle[0]), float(middle[1]))))
    _join(room, region, points)


def _join(sketch: SketchMap, region: Region, points: list[int]) -> None:
    """Add the arcs between nodes of one region, with a node at each bend."""
    where = np.array([(sketch.nodes[k].x, sketch.nodes[k].y) for k in points]).reshape(-1, 2)
    used = np.bincount([end for arc in sketch.arcs for end in (arc.start, arc.end)], minlength=len(sketch.nodes))
    room = [max(1, MOST_ARCS - int(used[k])) for k in points]
    most = [
        2 if sketch.nodes[k].kind in (NodeKind.END, NodeKind.BRIDGE) else each
        for k, each in zip(points, room, strict=True)
    ]
    bends: list[int] = []
    joined = {frozenset((arc.start, arc.end)) for arc in sketch.arcs}
    for link in region_links(region, where, most):
        chain = [points[link.start]]
        for x, y in link.bends.tolist():
            near = [k for k in bends if _apart(sketch.nodes[k], np.array([x, y])) < SAME]
            if not near:
                near = [sketch.add(SketchNode("k", NodeKind.CROSS, x, y))]
                bends += near
            chain.append(near[0])
        chain.append(points[link.end])
        for start, end, length in zip(chain, chain[1:], link.lengths.tolist(), strict=False):
            if start != end and frozenset((start, end)) not in joined:
                joined.add(frozenset((start, end)))
                sketch.arcs.append(SketchArc(start, end, length))


def _drivable(found: FloorRooms) -> list[Room]:
    return [room for room in found.rooms if room.kind is not RoomKind.SEEN]


def _passed(found: FloorRooms, regions: Mapping[int, Region | None]) -> tuple[list[Opening], list[Opening]]:
    """Return the openings that the chair drives through, and the doors that it does not."""
    passed, shut = [], []
    for opening in found.openings:
        if opening.rooms[0] == opening.rooms[1]:
            continue  # the chain of the corridor leads through it
        sides = [regions.get(number) for number in opening.rooms]
        if any(side is None for side in sides):
            continue
        place = _drivable_point(opening, [side for side in sides if side is not None])
        if place is not None:
            passed.append(replace(opening, middle=place))
        else:
            shut.append(opening)
    return passed, shut


def _drivable_point(opening: Opening, sides: list[Region]) -> FloatArray | None:
    """Return the point of an opening nearest to its middle on which the chair can drive from both sides; None without."""
    along = opening.jambs[1] - opening.middle
    shares = np.arange(0.0, 1.0, IN_DOOR / max(opening.width / 2, IN_DOOR))
    for share in sorted({*shares.tolist(), *(-shares).tolist()}, key=abs):
        point: FloatArray = opening.middle + share * along
        if all(side.cell(point, IN_DOOR) is not None for side in sides):
            return point
    return None


def _entered(found: FloorRooms, regions: dict[int, Region | None], open_: list[Opening]) -> dict[int, Region | None]:
    """Return the regions that the chair can enter or leave, and the largest one in any case."""
    joined = {number for opening in open_ for number in opening.rooms}
    largest = max(regions, key=lambda number: found.rooms[number - 1].area, default=0)
    return {number: region for number, region in regions.items() if number in joined or number == largest}


def _inner_rooms(found: FloorRooms, regions: Mapping[int, Region | None], open_: list[Opening]) -> set[int]:
    """Return the numbers of the rooms that become sub-maps: no corridors, and not passed through."""
    doors: dict[int, int] = {}
    for opening in open_:
        for number in opening.rooms:
            doors[number] = doors.get(number, 0) + 1
    return {
        number
        for number in regions
        if found.rooms[number - 1].kind is RoomKind.ROOM and 0 < doors.get(number, 0) < THROUGH
    }


def _places_by_room(
    costmap: Costmap, found: FloorRooms, regions: Mapping[int, Region | None], places: Mapping[str, Place]
) -> dict[int, list[Place]]:
    """Return the places that the chair can drive to, by the number of their room."""
    by_room: dict[int, list[Place]] = {}
    for place in places.values():
        point = np.array([place.pose.x, place.pose.y])
        cell = cells_from_points(costmap.grid, point)
        if not inside(costmap.grid, cell)[0]:
            continue
        number = int(found.labels[tuple(cell[0])])
        region = regions.get(number)
        if region is not None and region.cell(point) is not None:
            by_room.setdefault(number, []).append(place)
    return by_room


def _ahead(costmap: Costmap, found: FloorRooms, opening: Opening, number: int) -> FloatArray:
    side = found.rooms[number - 1].centre
    across = opening.jambs[1] - opening.jambs[0]
    normal = np.array([-across[1], across[0]]) / max(float(np.hypot(*across)), 1e-9)
    for sign in (0.4, -0.4):  # a corridor round a block has its middle anywhere: its label tells the side
        cell = cells_from_points(costmap.grid, opening.middle + sign * normal)
        if inside(costmap.grid, cell)[0] and found.labels[tuple(cell[0])] == number:
            side = opening.middle + sign * normal
    return ahead_of_opening(costmap.grid, costmap.clearance.astype(np.float64), opening.middle, opening.jambs, side)


def _door_node(opening: Opening, kind: NodeKind = NodeKind.CROSS) -> SketchNode:
    return SketchNode("d", kind, float(opening.middle[0]), float(opening.middle[1]))


def _place_node(place: Place) -> SketchNode:
    return SketchNode("p", NodeKind.END, place.pose.x, place.pose.y, place.name)


def _title(places: list[Place]) -> str:
    return places[0].name if len(places) == 1 else ""


def _apart(node: SketchNode, point: FloatArray) -> float:
    return float(np.hypot(node.x - point[0], node.y - point[1]))
