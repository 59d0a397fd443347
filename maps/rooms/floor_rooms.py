"""Rooms, corridors and the openings between them, from the occupancy grid of a storey.

Furniture that stands free is set aside, the remaining floor is flooded into basins of clearance, basins that are one
room are joined, and the narrowest places between rooms are measured. Unknown cells belong to no room.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from waychair.maps.grid.cells import OCCUPIED_FROM, occupied, points_from_cells
from waychair.maps.grid.distance_field import near_distances
from waychair.maps.rooms.basins import Basins, Labels, basins_of, clearance_from_walls, contacts_of
from waychair.maps.rooms.furniture import furniture_islands
from waychair.maps.rooms.merging import SCRAP, merged_basins
from waychair.maps.rooms.openings import Opening, openings_between
from waychair.types import BoolArray, FloatArray, OccupancyGrid

JOINED_FROM = 0.9
"""Two basins whose saddle is at least this share of the lower peak are one: cells make the clearance of a straight
corridor waver by a few per cent."""

WIDEST_OPENING = 1.3
"""Half the widest opening [m] that is looked at."""

LEAST_AREA = 0.25
"""Less floor [m²] than this is not numbered at all: specks beside walls and between beams."""

LONG, DOORS_OF_CORRIDOR, HALL = 3.5, 3, 2.0
"""A corridor is at least this many times as long as it is wide, as measured by `Room.elongation`, has at least so many
openings, and is nowhere farther from its walls than this [m]: a wider one is a hall."""

BESIDE = 0.15
"""[m] The rim of a room counts as its wall up to this distance from an occupied cell."""

SEEN_THROUGH = 0.5
"""Where more of the rim than this is unknown, the floor was seen from afar only, such as through a window."""


class RoomKind(enum.Enum):
    """The use of a part of the floor."""

    ROOM = "room"
    CORRIDOR = "corridor"
    SEEN = "seen"
    """Floor seen from afar, or too small for a chair: no room to go to."""


@dataclass(frozen=True, slots=True)
class Room:
    """A part of the floor.

    Attributes:
        number: its label, from 1.
        kind: room, corridor, or floor that was only seen.
        area: floor with the furniture on it [m²].
        centre: (2,) [m] in map, the point that is farthest from walls.
        clearance: distance of the centre from the nearest wall [m].
        elongation: its area by the square of four times its mean clearance, also round corners: the length by the width
            of a long corridor, 2.2 for a square.
        unknown_rim: share of its rim that is unknown.
    """

    number: int
    kind: RoomKind
    area: float
    centre: FloatArray
    clearance: float
    elongation: float
    unknown_rim: float


@dataclass(frozen=True, slots=True)
class FloorRooms:
    """The rooms of a storey.

    Attributes:
        labels: (H, W) int32, the number of each cell's room; 0 for walls and unknown cells.
        rooms: in order of their numbers, `rooms[k]` has number k + 1.
        openings: doors and wider openings.
        furniture: (H, W) cells that were set aside; occupied ones count as floor of their room.
    """

    labels: Labels
    rooms: tuple[Room, ...]
    openings: tuple[Opening, ...]
    furniture: BoolArray

    @property
    def doors(self) -> tuple[Opening, ...]:
        """The openings that are as wide as doors."""
        return tuple(opening for opening in self.openings if opening.is_door)


def rooms_of_grid(grid: OccupancyGrid) -> FloorRooms:
    """Return the rooms, corridors and openings of a grid.

    Free cells are those that are known and not occupied. A map with cells of 5 cm or less is measured best: at 10 cm
    a door is measured 10 cm wrong.
    """
    known = grid.cells >= 0
    free = known & (grid.cells < OCCUPIED_FROM)
    furniture = furniture_islands(free, grid.resolution)
    walls = ~free & ~furniture
    clearance = clearance_from_walls(walls, grid.resolution)
    basins = basins_of(clearance, grid.resolution, JOINED_FROM, WIDEST_OPENING)
    numbers = _room_numbers(basins, known, grid.resolution)
    labels = np.where(known, numbers[basins.labels], np.int32(0))
    openings = openings_between(basins, numbers, walls, grid)
    return FloorRooms(labels, _rooms(labels, basins, known, openings, grid), openings, furniture)


def _room_numbers(basins: Basins, known: BoolArray, resolution: float) -> Labels:
    """Return (N + 1,) int32 the number, from 1, of the room that each basin is part of; 0 for specks and the unknown."""
    sizes: FloatArray = np.bincount(basins.labels.ravel(), minlength=len(basins.peaks)) * np.float64(resolution**2)
    become = merged_basins(basins.peaks, sizes, contacts_of(basins.labels, basins.clearance))
    floor = np.bincount(become[basins.labels[known]], minlength=len(basins.peaks)) * resolution**2
    floor[0] = 0.0
    large = np.flatnonzero(floor >= LEAST_AREA)
    numbers = np.zeros(len(basins.peaks), np.int32)
    numbers[large] = np.arange(1, len(large) + 1)
    return numbers[become]


def _rooms(
    labels: Labels, basins: Basins, known: BoolArray, openings: tuple[Opening, ...], grid: OccupancyGrid
) -> tuple[Room, ...]:
    count = int(labels.max())
    cells = np.flatnonzero(labels)
    which = labels.ravel()[cells]
    size = np.bincount(which, minlength=count + 1)
    breadth = 4 * np.bincount(which, basins.clearance.ravel()[cells], minlength=count + 1) / np.maximum(size, 1)
    long = size * grid.resolution**2 / np.maximum(breadth, grid.resolution) ** 2
    rim = _unknown_rims(labels, known | _beside_walls(grid), count)
    by_clearance = np.lexsort((basins.clearance.ravel()[cells], which))
    farthest = cells[by_clearance[np.cumsum(size[1:]) - 1]] if count else cells
    centres = points_from_cells(grid, np.column_stack(np.divmod(farthest, labels.shape[1])))
    exits = np.zeros(count + 1, np.int64)
    for opening in openings:
        if opening.rooms[0] != opening.rooms[1]:
            exits[list(opening.rooms)] += 1
    rooms = []
    for number in range(1, count + 1):
        area = float(size[number]) * grid.resolution**2
        clearance = float(basins.clearance.ravel()[farthest[number - 1]])
        if rim[number] > SEEN_THROUGH or area < SCRAP:
            kind = RoomKind.SEEN
        elif long[number] >= LONG and exits[number] >= DOORS_OF_CORRIDOR and clearance <= HALL:
            kind = RoomKind.CORRIDOR
        else:
            kind = RoomKind.ROOM
        centre = centres[number - 1]
        rooms.append(Room(number, kind, area, centre, clearance, float(long[number]), float(rim[number])))
    return tuple(rooms)


def _beside_walls(grid: OccupancyGrid) -> BoolArray:
    """Return the cells (H, W) within `BESIDE` of an occupied one."""
    result: BoolArray = near_distances(occupied(grid), grid.resolution, 2 * BESIDE) <= BESIDE
    return result


def _unknown_rims(labels: Labels, known: BoolArray, count: int) -> FloatArray:
    """Return (N + 1,) the share of unknown cells among the cells that touch each room and belong to none.

    An unknown cell beside a wall is none: walls that a lidar saw have gaps and specks.
    """
    unknown, rim = np.zeros(count + 1), np.zeros(count + 1)
    height, width = labels.shape
    padded, beside = np.pad(labels, 1), np.pad(known, 1)
    for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        shifted = np.s_[1 + down : 1 + down + height, 1 + right : 1 + right + width]
        edge = (labels > 0) & (padded[shifted] == 0)
        rim += np.bincount(labels[edge], minlength=count + 1)
        unknown += np.bincount(labels[edge], ~beside[shifted][edge], minlength=count + 1)
    result: FloatArray = unknown / np.maximum(rim, 1)
    return result
