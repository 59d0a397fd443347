"""The traffic graph of a mapped floor: the middle lines of the room that a chair has, thinned out of the grid.

The chair's room is the free cells that are at least half its width and 5 cm from everything else. Its skeleton (T. Zhang
and C. Suen, "A fast parallel algorithm for thinning digital patterns", CACM 27(3), 1984) has a node wherever lines end or
meet. A section keeps the course of its line and the clear width across it; its own clear width is the least of these, so that
doors decide the lanes. Short spurs into the corners of rooms are left out. Places of the map become refuges, each on a stub of
its own from the nearest point of the lines in sight, or on the line itself where nobody could pass a chair that stands there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from waychair.errors import TrafficError
from waychair.geometry import arc_lengths, bends, evenly_spaced
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points, coarser, inside, points_from_cells
from waychair.maps.traffic.traffic_graph import (
    LONGEST_SECTION,
    SINGLE_FILE_ROOM,
    Refuge,
    Section,
    TrafficGraph,
    TrafficNode,
    WayPoint,
    lanes_for,
)
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Place

FINEST = 0.1
"""m; a finer grid is made coarser: lines are needed to a decimetre."""

SHORTEST_SPUR = 1.0
"""m; a line that ends sooner than this beyond the room's own half width is a corner, not a way."""

FARTHEST_PLACE = 5.0
"""m; a place farther from every line is not on this floor."""

SMOOTHED = 3
"""Cells to either side over which a line is averaged: thinning leaves it jagged by a cell."""

STRAIGHT, EQUALLY_WIDE = 0.05, 0.2
"""m; a line that stays so near to a straight one is straight, and one whose clear width varies by less is equally wide."""

_Cell = tuple[int, int]
_AROUND = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))


@dataclass(frozen=True)
class _Floor:
    """The free cells (H, W) of a grid, with the room [m] on each side of them, for chairs whose maps have cells of `cell` [m]."""

    grid: OccupancyGrid
    free: BoolArray
    clear: FloatArray
    chair_width: float
    cell: float

    def point(self, cell: _Cell) -> tuple[float, float]:
        """Return a cell's middle [m] in map."""
        x, y = points_from_cells(self.grid, np.array([cell]))[0]
        return float(x), float(y)

    def in_sight(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Return whether the straight line between two points is free."""
        line = evenly_spaced(np.array([a, b]), self.grid.resolution / 2)
        cells = cells_from_points(self.grid, line)
        return bool(inside(self.grid, cells).all() and self.free[cells[:, 0], cells[:, 1]].all())


def mapped_floor_graph(
    grid: OccupancyGrid,
    places: Iterable[Place] = (),
    *,
    name: str = "floor",
    storey: str = "ground",
    chair_width: float = 0.60,
) -> TrafficGraph:
    """Return the traffic graph of a floor for chairs of a width [m].

    Raises:
        TrafficError: there is no room for the chair, or a place is too far from all of it.
    """
    cell = grid.resolution
    times = max(1, math.floor(FINEST / grid.resolution + 1e-9))
    grid = coarser(grid, times) if times > 1 else grid
    free = (grid.cells >= 0) & (grid.cells < OCCUPIED_FROM)
    padded = np.pad(free, 1).astype(np.uint8)
    clear = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] * grid.resolution
    clear = np.maximum(clear - grid.resolution / 2, 0.0)  # to the side of the nearest cell, not to its middle
    room = _largest(clear >= (chair_width + SINGLE_FILE_ROOM) / 2)
    if not room.any():
        raise TrafficError(f"{name} has no room for a chair of {chair_width:.2f} m; give a map with free floor")
    lines = _without_spurs(_lines(skeleton(room)), clear, grid.resolution)
    return _graph(_Floor(grid, free, clear, chair_width, cell), lines, list(places), name, storey)


def skeleton(mask: BoolArray) -> BoolArray:
    """Return the middle lines of a mask (H, W), one cell wide."""
    image = np.pad(mask, 1)
    changed = True
    while changed:
        changed = False
        for half in (0, 1):
            around = [np.roll(image, (-row, -column), axis=(0, 1)) for row, column in _AROUND]
            north, east, south, west = around[0], around[2], around[4], around[6]
            count = np.sum(around, axis=0)
            rises = np.sum([~a & b for a, b in zip(around, [*around[1:], around[0]], strict=True)], axis=0)
            if half == 0:
                open_side = ~(north & east & south) & ~(east & south & west)
            else:
                open_side = ~(north & east & west) & ~(north & south & west)
            gone = image & (count >= 2) & (count <= 6) & (rises == 1) & open_side
            if gone.any():
                image = image & ~gone
                changed = True
    return image[1:-1, 1:-1]


def _largest(mask: BoolArray) -> BoolArray:
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count < 2:
        return mask
    largest: BoolArray = labels == 1 + int(np.argmax(statistics[1:, cv2.CC_STAT_AREA]))
    return largest


def _neighbours(cell: _Cell, cells: set[_Cell]) -> list[_Cell]:
    """Return the neighbours on the line; a diagonal one only where no straight one joins the two."""
    row, column = cell
    straight = [(row + r, column + c) for r, c in _AROUND[::2] if (row + r, column + c) in cells]
    slanted = [
        (row + r, column + c)
        for r, c in _AROUND[1::2]
        if (row + r, column + c) in cells and (row + r, column) not in cells and (row, column + c) not in cells
    ]
    return straight + slanted


def _lines(thin: BoolArray) -> list[list[_Cell]]:
    """Return the lines between the cells where lines end or meet; a ring has one line from a cell back to it."""
    cells = {(int(row), int(column)) for row, column in np.argwhere(thin)}
    joined = {cell: _neighbours(cell, cells) for cell in cells}
    nodes = {cell for cell, others in joined.items() if len(others) != 2}
    lines: list[list[_Cell]] = []
    seen: set[frozenset[_Cell]] = set()

    def follow(start: _Cell, ahead: _Cell) -> None:
        line = [start, ahead]
        seen.add(frozenset((start, ahead)))
        while line[-1] not in nodes and line[-1] != start:
            following = [cell for cell in joined[line[-1]] if cell != line[-2]]
            if not following:
                break
            line.append(following[0])
            seen.add(frozenset(line[-2:]))
        lines.append(line)

    for start in sorted(nodes):
        for ahead in joined[start]:
            if frozenset((start, ahead)) not in seen:
                follow(start, ahead)
    followed = {cell for line in lines for cell in line}
    for cell in sorted(cells):  # rings without any node
        if cell not in followed and joined[cell]:
            follow(cell, joined[cell][0])
            followed.update(lines[-1])
    if not lines and cells:
        lines.append([min(cells)])
    return lines


def _length(line: Sequence[_Cell], resolution: float) -> float:
    return resolution * sum(math.dist(a, b) for a, b in pairwise(line))


def _without_spurs(lines: list[list[_Cell]], clear: FloatArray, resolution: float) -> list[list[_Cell]]:
    """Return the lines without those that end in a corner, and with the rest joined again where only two are left."""
    while True:
        ends: dict[_Cell, int] = {}
        for line in lines:
            for end in (line[0], line[-1]):
                ends[end] = ends.get(end, 0) + 1
        spurs = [
            line
            for line in lines
            if len(lines) > 1
            and (ends[line[0]] == 1) != (ends[line[-1]] == 1)
            and _length(line, resolution) < SHORTEST_SPUR + float(clear[line[0] if ends[line[0]] > 1 else line[-1]])
        ]
        if spurs:
            shortest = min(spurs, key=lambda line: _length(line, resolution))
            lines = [line for line in lines if line is not shortest]
        lines, merged = _merged(lines)
        if not spurs and not merged:
            return lines


def _merged(lines: list[list[_Cell]]) -> tuple[list[list[_Cell]], bool]:
    """Join two lines that meet where nothing else does; return the lines and whether any were joined."""
    at: dict[_Cell, list[int]] = {}
    for i, line in enumerate(lines):
        for end in {line[0], line[-1]}:
            at.setdefault(end, []).append(i)
    for cell in sorted(at):
        if len(at[cell]) != 2 or any(lines[i][0] == lines[i][-1] for i in at[cell]):
            continue
        one, other = (lines[i] for i in at[cell])
        one = one if one[-1] == cell else one[::-1]
        other = other if other[0] == cell else other[::-1]
        rest = [line for i, line in enumerate(lines) if i not in at[cell]]
        return [*rest, one + other[1:]], True
    return lines, False


def _graph(floor: _Floor, lines: list[list[_Cell]], places: list[Place], name: str, storey: str) -> TrafficGraph:
    cells = [cell for line in lines for cell in line]
    stubs = {place.name: _stub_of(floor, place, cells, name) for place in places}
    pieces = _pieces(lines, set(stubs.values()), floor.grid.resolution)
    names: dict[_Cell, str] = {}
    for piece in pieces:
        for end in (piece[0], piece[-1]):
            names.setdefault(end, f"n{len(names) + 1}")
    for line in lines:
        if len(line) == 1:
            names.setdefault(line[0], f"n{len(names) + 1}")
    nodes = [TrafficNode(each, *floor.point(cell), storey) for cell, each in names.items()]
    sections: list[Section] = []
    used: dict[str, int] = {}
    for piece in pieces:
        first, last = names[piece[0]], names[piece[-1]]
        used[f"{first}-{last}"] = number = used.get(f"{first}-{last}", 0) + 1
        label = f"{first}-{last}" if number == 1 else f"{first}-{last}-{number}"
        sections.append(_section(floor, piece, label, first, last))
    refuges: list[Refuge] = []
    on_line: set[str] = set()
    narrowest = floor.chair_width + SINGLE_FILE_ROOM
    for place in places:
        at = names[stubs[place.name]]
        off = math.dist(floor.point(stubs[place.name]), (place.pose.x, place.pose.y))
        if at not in on_line and _in_the_way(off, float(floor.clear[stubs[place.name]]), floor.chair_width):
            on_line.add(at)
            refuges.append(Refuge(place.name, at))
            continue
        node = f"at {place.name}"
        nodes.append(TrafficNode(node, place.pose.x, place.pose.y, storey))
        sections.append(Section(f"{at}-{node}", at, node, max(floor.grid.resolution, off), narrowest, 1))
        refuges.append(Refuge(place.name, node))
    return TrafficGraph(
        name, tuple(nodes), tuple(sections), tuple(refuges), chair_width=floor.chair_width, cell=floor.cell
    )


def _stub_of(floor: _Floor, place: Place, cells: Sequence[_Cell], name: str) -> _Cell:
    """Return the cell of the lines that is nearest to a place; of those in sight, unless a chair there is in the way of that one."""
    here = (place.pose.x, place.pose.y)
    away = np.hypot(*(points_from_cells(floor.grid, np.array(cells)) - here).T)
    order = np.argsort(away, kind="stable")
    near: list[_Cell] = [cells[k] for k in order.tolist() if away[k] <= FARTHEST_PLACE]
    if not near:
        raise TrafficError(f"place {place.name} is more than {FARTHEST_PLACE:g} m from the ways of {name}; move it")
    if _in_the_way(float(away[order[0]]), float(floor.clear[near[0]]), floor.chair_width):
        return near[0]
    return next((cell for cell in near if floor.in_sight(floor.point(cell), here)), near[0])


def _section(floor: _Floor, piece: Sequence[_Cell], name: str, start: str, end: str) -> Section:
    """Return the section along a line; its course is left out where it is straight and equally wide."""
    path = _smooth(points_from_cells(floor.grid, np.array(piece)))
    # every cell is in the chair's room; rounding may have taken a hair off
    widths = np.maximum([2.0 * float(floor.clear[cell]) for cell in piece], floor.chair_width + SINGLE_FILE_ROOM)
    along = arc_lengths(path)
    corners = [0, *bends(path, STRAIGHT), len(piece) - 1]
    kept = sorted({*corners, *bends(np.column_stack([along, widths]), EQUALLY_WIDE)})
    bent = len(kept) > 2 or abs(widths[-1] - widths[0]) > EQUALLY_WIDE
    # a change of width alone makes no corner: it lies on the straight line between two
    way = np.column_stack([np.interp(along[kept], along[corners], path[corners, axis]) for axis in (0, 1)])
    points = [WayPoint(*map(float, (*at, widths[k]))) for at, k in zip(way, kept, strict=True)]
    width = float(widths.min())
    return Section(
        name,
        start,
        end,
        length=float(arc_lengths(way)[-1]),
        width=width,
        lanes=lanes_for(width, floor.chair_width, floor.cell),
        points=tuple(points) if bent else (),
    )


def _smooth(path: FloatArray) -> FloatArray:
    """Return the path (N, 2) as running means, with its ends as they are."""
    last = len(path) - 1
    reach = [min(k, last - k, SMOOTHED) for k in range(len(path))]
    return np.array([path[k - n : k + n + 1].mean(axis=0) for k, n in enumerate(reach)])


def _in_the_way(off: float, clear: float, chair_width: float) -> bool:
    """Return whether nobody passes a chair that stands so far [m] off a line whose room is `clear` [m] on either side."""
    return clear + off - chair_width / 2 < chair_width + SINGLE_FILE_ROOM


def _pieces(lines: list[list[_Cell]], stops: set[_Cell], resolution: float) -> list[list[_Cell]]:
    """Return the lines cut at the stops, into pieces of at most 8 m, and so that no piece is a ring."""
    pieces: list[list[_Cell]] = []
    for line in lines:
        cuts = [i for i, cell in enumerate(line) if cell in stops and 0 < i < len(line) - 1]
        for first, last in zip([0, *cuts], [*cuts, len(line) - 1], strict=True):
            part = line[first : last + 1]
            if len(part) < 2:
                continue
            least = 3 if part[0] == part[-1] else 1
            count = max(least, math.ceil(_length(part, resolution) / LONGEST_SECTION - 1e-9))
            marks = np.linspace(0, len(part) - 1, count + 1).round().astype(int)
            pieces += [part[a : b + 1] for a, b in pairwise(marks) if b > a]
    return pieces


def places_on(grid: OccupancyGrid, places: Mapping[str, Place]) -> list[Place]:
    """Return the places that lie on the grid."""
    points = np.array([(place.pose.x, place.pose.y) for place in places.values()]).reshape(-1, 2)
    within = inside(grid, cells_from_points(grid, points))
    return [place for place, kept in zip(places.values(), within, strict=True) if kept]
