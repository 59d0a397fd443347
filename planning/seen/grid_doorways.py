"""Doorways in an occupancy grid: the grid is looked at from places all over its free floor, as a lidar would see it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.geometry import transform_points
from waychair.maps.grid.cells import occupied
from waychair.maps.grid.distance_field import distances
from waychair.planning.seen.doorway_gaps import FARTHEST, Gap, find_gaps, measure_gap
from waychair.planning.seen.doorways import NO_EVIDENCE, DoorState, Doorway, GapEvidence, Judgement, judge
from waychair.planning.seen.range_views import RangeView, view_from_grid
from waychair.planning.seen.wall_lines import straight_stretches
from waychair.types import UNKNOWN, FloatArray, OccupancyGrid, Pose2

APART, CLEAR = 0.9, 0.3
"""m; places stand this far apart, and this far from anything."""

TOGETHER, MOST_TOGETHER = 2.0, 8
"""m, places; gaps are looked for in the views from so many places within this distance of each other."""

SAME, SAME_TURN = 0.40, math.radians(25.0)
"""m, rad; a gap this near to another is the same."""

RIVAL = 0.6
"""m; two openings one behind the other, nearer than this, are one passage."""


@dataclass
class _Found:
    pose: Pose2
    width: float
    evidence: GapEvidence


def doorways_in_grid(grid: OccupancyGrid) -> tuple[Doorway, ...]:
    """Return the doorways of a grid in map, numbered from 0; whether they are open now a grid does not tell."""
    places = _places(grid)
    views = [view_from_grid(grid, place) for place in places]
    stretches = [straight_stretches(view, FARTHEST) for view in views]
    found: list[_Found] = []
    for place in places:
        away = np.hypot(*(places - place).T)
        group = [int(k) for k in np.argsort(away)[:MOST_TOGETHER] if away[k] < TOGETHER]
        if len(group) > 1:
            for gaps in find_gaps([views[k] for k in group], np.concatenate([stretches[k] for k in group])):
                for gap in gaps:
                    _add(found, gap)
    believed = []
    for one in found:
        judged = _judged(one, views)
        if not judged.against and not judged.missing:
            believed.append((judged, len(one.evidence.sights)))
    kept: list[tuple[Judgement, int]] = []
    for judged, sights in sorted(believed, key=lambda pair: -pair[0].strength):
        if not any(_same_passage(judged, other) for other, _ in kept):
            kept.append((judged, sights))
    error = grid.resolution  # a jamb lies somewhere in its cell
    return tuple(
        Doorway(k, judged.pose, judged.width, judged.width, judged.error + error, DoorState.UNKNOWN, sights=sights)
        for k, (judged, sights) in enumerate(kept)
    )


def _places(grid: OccupancyGrid) -> FloatArray:
    """Return places (P, 2) [m] in map on free floor, on a lattice, in order of row and column."""
    step = max(1, round(APART / grid.resolution))
    free = (grid.cells != UNKNOWN) & ~occupied(grid)
    clear = distances(occupied(grid), grid.resolution) > CLEAR
    rows, columns = np.nonzero((free & clear)[step // 2 :: step, step // 2 :: step])
    at = np.stack([columns, rows], axis=1) * step + step // 2 + 0.5
    return transform_points(grid.map_from_grid, (at * grid.resolution).astype(np.float64))


def _add(found: list[_Found], gap: Gap) -> None:
    """Add a gap to those found at its place, or as a new one."""
    for one in found:
        at = one.pose.inverse() @ gap.pose
        if math.hypot(at.x, at.y) < SAME and abs(math.remainder(at.theta, math.pi)) < SAME_TURN:
            one.evidence = one.evidence.with_gap(gap)
            return
    found.append(_Found(gap.pose, gap.width, NO_EVIDENCE.with_gap(gap)))


def _judged(one: _Found, views: list[RangeView]) -> Judgement:
    for view in views:
        if math.hypot(view.origin[0] - one.pose.x, view.origin[1] - one.pose.y) < FARTHEST:
            sight = measure_gap(view, one.pose, one.width)
            if sight is not None:
                one.evidence = one.evidence.with_sight(sight, one.pose)
    return judge(one.evidence, one.pose)


def _same_passage(judged: Judgement, other: Judgement) -> bool:
    at = other.pose.inverse() @ judged.pose
    return abs(at.x) < RIVAL and abs(at.y) < (judged.width + other.width) / 4
