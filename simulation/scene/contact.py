"""Exact contact and exact distance between the chair's rectangle, solid obstacles and people.

Obstacles are upright boxes, so both are closed-form: contact by separating axes, distance from the corners of one box
to the other. People are discs.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.simulation.scene.boxes import Bins, bin_range, bins_from_boxes, nearest_points, touch
from waychair.simulation.scene.moving import SlidingLeaf, boxes_of
from waychair.simulation.scene.scene import Block, PersonState, Pit
from waychair.types import FloatArray, Pose2

LOWEST, HIGHEST = 0.03, 1.20
"""Heights [m]: a chair rolls over blocks that end below LOWEST and passes under blocks that begin above HIGHEST."""


class ContactKind(enum.Enum):
    """The kinds of contact of one chair: an obstacle, a person, or a fall; that of two chairs is a `ChairContact`."""

    SOLID = "solid"
    PERSON = "person"
    FALL = "fall"


@dataclass(frozen=True, slots=True)
class Contact:
    """One contact of the chair at (x, y) [m, map], at `speed` [m/s] over the ground."""

    stamp_ns: int
    kind: ContactKind
    x: float
    y: float
    speed: float


@dataclass(frozen=True, slots=True)
class ChairContact:
    """One contact of two chairs, by their numbers, at (x, y) [m, map], with the `speeds` [m/s] of both before it."""

    stamp_ns: int
    chairs: tuple[int, int]
    x: float
    y: float
    speeds: tuple[float, float]


class SolidBoxes(NamedTuple):
    """The obstacles of a level as boxes (N, 6) (see `boxes.py`) and their bins."""

    boxes: FloatArray
    bins: Bins


def solid_from_blocks(
    blocks: Iterable[Block], pits: Iterable[Pit] = (), leaves: Iterable[SlidingLeaf] = ()
) -> SolidBoxes:
    """Return the blocks that a chair can hit, the pits as if a wall stood round them, and last the closed leaves."""
    solid: list[Block | Pit] = [block for block in blocks if block.low < HIGHEST and block.high > LOWEST]
    boxes = boxes_of([*solid, *pits, *(leaf.block(0.0) for leaf in leaves)])
    return SolidBoxes(boxes, bins_from_boxes(boxes))


def move_leaves(solid: SolidBoxes, leaves: Sequence[Block]) -> None:
    """Put the leaves of `solid_from_blocks` where these blocks are."""
    if leaves:
        solid.boxes[-len(leaves) :] = boxes_of(leaves)


def in_contact(solid: SolidBoxes, body: ChairBody, map_from_base: Pose2) -> bool:
    """Return whether the chair's rectangle and a box share a point."""
    return bool(_touches(solid, *_outline(body, map_from_base)))


def clearance(solid: SolidBoxes, body: ChairBody, map_from_base: Pose2) -> float:
    """Return the smallest distance [m] from the chair's rectangle to a box: 0 in contact, +inf without boxes."""
    if in_contact(solid, body, map_from_base):
        return 0.0
    return float(_nearest(solid, *_outline(body, map_from_base))[0])


def nearest_point(solid: SolidBoxes, body: ChairBody, map_from_base: Pose2) -> tuple[float, float]:
    """Return the point [m, map] of the obstacles that is nearest to the chair's rectangle.

    In contact it is a corner of either rectangle near the other; (nan, nan) without obstacles.
    """
    _, x, y = _nearest(solid, *_outline(body, map_from_base))
    return float(x), float(y)


def nearest_person(body: ChairBody, map_from_base: Pose2, people: Iterable[PersonState]) -> tuple[float, float, float]:
    """Return the distance [m] to the nearest person's disc, 0 in contact, and that person's position [m, map].

    +inf and (nan, nan) without people.
    """
    x, y, c, s, half_length, half_width = _outline(body, map_from_base)
    best, best_x, best_y = math.inf, math.nan, math.nan
    for person in people:
        dx, dy = person.pose.x - x, person.pose.y - y
        beyond_end = max(abs(dx * c + dy * s) - half_length, 0.0)
        beyond_side = max(abs(dy * c - dx * s) - half_width, 0.0)
        distance = math.hypot(beyond_end, beyond_side) - person.radius
        if distance < best:
            best, best_x, best_y = distance, person.pose.x, person.pose.y
    return max(best, 0.0), best_x, best_y


def person_distance(body: ChairBody, map_from_base: Pose2, people: Iterable[PersonState]) -> float:
    """Return the smallest distance [m] from the chair to a person's disc: 0 in contact, +inf without people."""
    return nearest_person(body, map_from_base, people)[0]


def box_of(body: ChairBody, map_from_base: Pose2) -> FloatArray:
    """Return the chair's rectangle as a box (6,), see `boxes.py`."""
    return np.array(_outline(body, map_from_base))


def _outline(body: ChairBody, map_from_base: Pose2) -> tuple[float, float, float, float, float, float]:
    """Return the chair's rectangle as a box; the base's origin is not its middle."""
    c, s = math.cos(map_from_base.theta), math.sin(map_from_base.theta)
    ahead = (body.front - body.rear) / 2
    return (
        map_from_base.x + ahead * c,
        map_from_base.y + ahead * s,
        c,
        s,
        body.length / 2,
        body.width / 2,
    )


@njit(cache=True, nogil=True)
def _touches(solid: SolidBoxes, x: float, y: float, c: float, s: float, half_length: float, half_width: float) -> bool:
    bins, box = solid.bins, np.array([x, y, c, s, half_length, half_width])
    reach_x = half_length * abs(c) + half_width * abs(s)
    reach_y = half_length * abs(s) + half_width * abs(c)
    first_col, last_col = bin_range(x - bins.x, reach_x, bins.side, bins.cols)
    first_row, last_row = bin_range(y - bins.y, reach_y, bins.side, bins.rows)
    for row in range(first_row, last_row + 1):
        for number in range(row * bins.cols + first_col, row * bins.cols + last_col + 1):
            for k in range(bins.starts[number], bins.starts[number + 1]):
                if touch(box, solid.boxes[bins.items[k]]):
                    return True
    return False


@njit(cache=True, nogil=True)
def _nearest(
    solid: SolidBoxes, x: float, y: float, c: float, s: float, half_length: float, half_width: float
) -> tuple[float, float, float]:
    """Return distance [m] and point of the nearest box, by doubling the search radius; +inf and nan without boxes."""
    bins, box = solid.bins, np.array([x, y, c, s, half_length, half_width])
    radius = math.hypot(half_length, half_width)
    left, low = x - bins.x, y - bins.y
    best, best_x, best_y = math.inf, math.nan, math.nan
    look = bins.side
    while True:
        reach = radius + look
        first_col, last_col = bin_range(left, reach, bins.side, bins.cols)
        first_row, last_row = bin_range(low, reach, bins.side, bins.rows)
        for row in range(first_row, last_row + 1):
            for number in range(row * bins.cols + first_col, row * bins.cols + last_col + 1):
                for k in range(bins.starts[number], bins.starts[number + 1]):
                    distance, px, py = nearest_points(box, solid.boxes[bins.items[k]])
                    if distance < best:
                        best, best_x, best_y = distance, px, py
        everything = last_col - first_col == bins.cols - 1 and last_row - first_row == bins.rows - 1
        if best <= look or everything:
            return best, best_x, best_y
        look *= 2.0
