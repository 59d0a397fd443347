"""Corridors as centre lines, and the floor plans of `floorplans/*.yaml` that are made of them.

    name: T
    size: [30, 30]
    corridors:
      - [3, 27, 27, 27]
      - [15, 3, 15, 27]
    nodes: {"10": [3, 4]}        # optional: nodes with names of their own

A corridor is x0, y0, x1, y1 [m], along x or y. Nodes lie at its ends, at crossings, at the named points, and so that no
section is longer than 8 m. The width is no part of the file: the caller gives it.

Eight plans are those of the paper on harmonic navigation of several robotic wheelchairs over a wireless visual sensor
network. Their names, numbers of circles and 30 m are the paper's. Its Figures 7 and 8 were not to be had, so that the
lengths are our choice.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import msgspec

from waychair.errors import TrafficError
from waychair.files import is_file, read_bytes
from waychair.maps.traffic.traffic_graph import (
    CELL,
    LONGEST_SECTION,
    Refuge,
    RefugeKind,
    Section,
    TrafficGraph,
    TrafficNode,
    lanes_for,
)
from waychair.maps.traffic.well_formed import refuse_pieces

FLOOR_PLANS = Path(__file__).resolve().parent / "floorplans"
"""Folder of the shipped floor plans."""

NARROW = 1.2
"""m; width in which one chair drives and a person squeezes past a standing one."""

BETWEEN_ROOMS = 3
"""m; least distance between the doors of two rooms."""

ROOM_DEPTH = 1.0
"""m; from a corridor's centre line to the chair's place in a room beside it, as in the cell map."""

_LARGEST = 1000.0
"""m; longest side of a plan; beyond it the number is damaged."""

Point = tuple[float, float]
Line = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class CorridorPlan:
    """A floor of corridors: `size` [m] from the origin, `corridors` as centre lines, `nodes` with names of their own."""

    name: str
    size: Point
    corridors: tuple[Line, ...]
    nodes: Mapping[str, Point] = field(default_factory=dict)


class _PlanFile(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    size: tuple[float, float]
    corridors: list[Line]
    nodes: dict[str, Point] = {}  # msgspec copies it


def floor_plan_names() -> tuple[str, ...]:
    """Return the names of the shipped floor plans."""
    return tuple(sorted(path.stem for path in FLOOR_PLANS.glob("*.yaml")))


def load_corridors(name_or_path: str | Path) -> CorridorPlan:
    """Return a shipped floor plan by its name, or that of a YAML file.

    Raises:
        TrafficError: there is no such plan, or the file is damaged or impossible; the message names the corridor.
    """
    path = FLOOR_PLANS / f"{name_or_path}.yaml"
    if not path.is_file():
        path = Path(name_or_path)
        if not is_file(path, TrafficError):
            known = ", ".join(floor_plan_names())
            raise TrafficError(
                f"there is no floor plan '{name_or_path}'; give the path of a YAML file or one of {known}"
            )
    try:
        plan = msgspec.yaml.decode(read_bytes(path, TrafficError), type=_PlanFile)
    except msgspec.MsgspecError as problem:
        raise TrafficError(
            f"{path} is no floor plan: {problem}; give name, size and corridors as in {FLOOR_PLANS}"
        ) from None
    try:
        return checked_plan(CorridorPlan(plan.name, plan.size, tuple(plan.corridors), plan.nodes))
    except TrafficError as problem:
        raise TrafficError(f"{path}: {problem}") from None


def checked_plan(plan: CorridorPlan) -> CorridorPlan:
    """Return the plan if it is possible.

    Raises:
        TrafficError: a size or a corridor is impossible; the message names it and says what to do.
    """
    width, height = plan.size
    if not (0 < width <= _LARGEST and 0 < height <= _LARGEST):
        raise TrafficError(f"size {width:g} x {height:g} m is impossible; give sides above 0 and up to {_LARGEST:g} m")
    if not plan.corridors:
        raise TrafficError(f"plan {plan.name} has no corridors; give at least one")
    for line in plan.corridors:
        x0, y0, x1, y1 = line
        shown = f"corridor {x0:g} {y0:g} {x1:g} {y1:g}"
        if not all(math.isfinite(value) for value in line):
            raise TrafficError(f"{shown} has a value that is not finite; give metres")
        if not all(0 <= x <= width and 0 <= y <= height for x, y in ((x0, y0), (x1, y1))):
            raise TrafficError(f"{shown} leaves the plan of {width:g} x {height:g} m; move it inside")
        if x0 == x1 and y0 == y1:
            raise TrafficError(f"{shown} has no length; give two different ends")
        if x0 != x1 and y0 != y1:
            raise TrafficError(f"{shown} lies at an angle; give it along x or y")
    for name, point in plan.nodes.items():
        if not any(lies_on(line, point) for line in plan.corridors):
            raise TrafficError(f"node {name} at {point[0]:g} {point[1]:g} lies on no corridor; move it onto one")
    return plan


def corridor_graph(
    plan: CorridorPlan,
    width: float = NARROW,
    *,
    chair_width: float = 0.60,
    cell: float = CELL,
    rooms: bool = False,
    bays: bool = False,
) -> TrafficGraph:
    """Return the traffic graph of a plan whose corridors are `width` wide [m], for chairs whose maps have cells of `cell` [m].

    With `rooms`, rooms of one slot hang on the corridors at the places of the cell map; with `bays`, any chair may step
    aside into them. Without, there are no refuges, as in the paper, where every node is a possible goal.

    Raises:
        TrafficError: no chair fits in the width, or the corridors are in pieces.
    """
    lanes = lanes_for(width, chair_width, cell)
    if not (math.isfinite(width) and lanes > 0):
        raise TrafficError(
            f"a corridor of {width:g} m has no room for a chair of {chair_width:.2f} m; give a larger width"
        )
    doors = room_doors(plan) if rooms else {}
    stops: dict[Point, str | None] = {}
    segments = list(dict.fromkeys(_segments(plan, [door for door, _ in doors.values()])))
    for start, end in segments:
        stops[start] = stops[end] = None
    names = {point: name for name, point in plan.nodes.items()}
    numbers = iter(range(1, len(stops) + 1))
    for point in sorted(stops, key=lambda place: (place[1], place[0])):
        stops[point] = names.get(point) or f"n{next(numbers)}"
    nodes = [TrafficNode(str(stops[x, y]), x, y) for x, y in sorted(stops, key=lambda place: (place[1], place[0]))]
    sections = [
        Section(f"{stops[start]}-{stops[end]}", str(stops[start]), str(stops[end]), math.dist(start, end), width, lanes)
        for start, end in segments
    ]
    refuges: list[Refuge] = []
    for room, (door, place) in doors.items():
        at = str(stops[door])
        nodes.append(TrafficNode(room, *place))
        sections.append(Section(f"{at}-{room}", at, room, ROOM_DEPTH, width, 1))
        refuges.append(Refuge(room, room, waiting=bays, kind=RefugeKind.BAY if bays else RefugeKind.PLACE))
    graph = TrafficGraph(plan.name, tuple(nodes), tuple(sections), tuple(refuges), chair_width=chair_width, cell=cell)
    refuse_pieces(graph)
    return graph


def room_doors(plan: CorridorPlan) -> dict[str, tuple[Point, Point]]:
    """Return the door on the centre line and the place inside of each room, by its name.

    Rooms lie beside whole metres of the corridors, where they touch one corridor only; their doors are at least 3 m apart.
    A corridor whose centre line is not on whole metres has none.
    """
    cells = corridor_cells(plan)
    rooms: dict[str, tuple[Point, Point]] = {}
    chosen: list[tuple[int, int]] = []
    for x, y in sorted(cells, key=lambda cell: (cell[1], cell[0])):
        if not any(lies_on(line, (x, y)) for line in plan.corridors):
            continue
        for dx, dy in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            room = (x + dx, y + dy)
            inside = 0 <= room[0] < plan.size[0] and 0 <= room[1] < plan.size[1]
            if not inside or room in cells or _beside(room, cells) != 1:
                continue
            if any(math.dist(room, other) < BETWEEN_ROOMS for other in chosen):
                continue
            chosen.append(room)
            rooms[f"room {len(chosen)}"] = ((float(x), float(y)), (float(room[0]), float(room[1])))
    return rooms


def corridor_cells(plan: CorridorPlan) -> set[tuple[int, int]]:
    """Return the 1 m cells (x, y) that the centre lines pass; a cell's middle is the point of its whole metres."""
    cells: set[tuple[int, int]] = set()
    for line in plan.corridors:
        x0, y0, x1, y1 = (round(value) for value in line)
        steps = abs(x1 - x0) + abs(y1 - y0)
        for step in range(steps + 1):
            along = step / steps if steps else 0.0
            cells.add((round(x0 + (x1 - x0) * along), round(y0 + (y1 - y0) * along)))
    return cells


def _beside(cell: tuple[int, int], cells: set[tuple[int, int]]) -> int:
    return sum((cell[0] + dx, cell[1] + dy) in cells for dx, dy in ((0, 1), (1, 0), (0, -1), (-1, 0)))


def _segments(plan: CorridorPlan, doors: Iterable[Point]) -> list[tuple[Point, Point]]:
    """Return the pieces between neighbouring nodes, each from its lower to its upper end."""
    ends = [point for line in plan.corridors for point in ((line[0], line[1]), (line[2], line[3]))]
    points = [*ends, *plan.nodes.values(), *doors]
    found: list[tuple[Point, Point]] = []
    for line in plan.corridors:
        crossings = [point for other in plan.corridors if (point := _crossing(line, other)) is not None]
        here = sorted({point for point in (*points, *crossings) if lies_on(line, point)})
        for start, end in pairwise(here):
            pieces = math.ceil(math.dist(start, end) / LONGEST_SECTION - 1e-9)
            cuts = [
                (start[0] + (end[0] - start[0]) * i / pieces, start[1] + (end[1] - start[1]) * i / pieces)
                for i in range(pieces + 1)
            ]
            found.extend(pairwise(cuts))
    return found


def _crossing(one: Line, other: Line) -> Point | None:
    """Return where a corridor along x meets one along y, if they do; None for parallel ones."""
    if (one[0] == one[2]) == (other[0] == other[2]):
        return None
    upright, level = (one, other) if one[0] == one[2] else (other, one)
    point = (upright[0], level[1])
    return point if lies_on(upright, point) and lies_on(level, point) else None


def lies_on(line: Line, point: Sequence[float]) -> bool:
    """Return whether a point [m] is on a centre line."""
    x0, y0, x1, y1 = line
    return min(x0, x1) <= point[0] <= max(x0, x1) and min(y0, y1) <= point[1] <= max(y0, y1)
