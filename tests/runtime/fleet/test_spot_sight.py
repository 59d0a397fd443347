"""Whether a chair sees a spot of its building free."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.runtime.fleet.test_fleet_member import PLAN
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.traffic.corridors import corridor_graph
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.spot_sight import SpotSight
from waychair.simulation.plan.corridor_world import corridor_world
from waychair.types import FloatArray, Pose2, Scan

GRAPH = corridor_graph(PLAN, 1.2, rooms=False, bays=False)
WAYS = ways_of(GRAPH, 0.5)
GRID = corridor_world(PLAN, 1.2, rooms=False).grid
BEAMS = 720
AT = Pose2(4.5, 3.0, 0.0)


def scan_along(things: FloatArray, reach: float = 12.0) -> Scan:
    """Return a scan from `AT` of the corridor's two walls, at y = 2.4 and 3.6, and of discs x, y, radius [m].

    Beams beyond the reach [m] meet nothing; with a negative one they are invalid.
    """
    angles = -math.pi + np.arange(BEAMS) * math.tau / BEAMS
    laser = AT @ CHAIR_A.base_from_laser
    across = np.abs(np.sin(angles))
    ranges = 0.6 / np.maximum(across, 1e-9)
    ranges = np.where(ranges > abs(reach), np.inf if reach > 0 else np.nan, ranges)
    for x, y, radius in things:
        away, bearing = math.hypot(x - laser.x, y - laser.y), math.atan2(y - laser.y, x - laser.x)
        off = np.abs(away * np.sin(angles - bearing))
        hit = (off < radius) & (np.cos(angles - bearing) > 0)
        ranges = np.where(hit, np.minimum(ranges, away * np.cos(angles - bearing) - radius), ranges)
    return Scan(0, ranges.astype(np.float32), -math.pi, math.tau / BEAMS, 0.0, 0.05, 30.0)


def spot_ahead() -> int:
    """Return the spot of the section east of the chair, eastwards."""
    sight = SpotSight(WAYS, GRID, CHAIR_A)
    ahead = [
        spot
        for spot, place in enumerate(sight._places)
        if place.section is not None and 4.5 < place.points[0][0] < 13.0 and place.points[-1][0] > place.points[0][0]
    ]
    return ahead[0]


@pytest.mark.parametrize(
    ("things", "reach", "free"),
    [
        (np.zeros((0, 3)), 12.0, True),
        (np.array([[0.5, 3.0, 0.3]]), 12.0, True),
        (np.array([[12.0, 3.0, 0.3]]), 12.0, False),
        (np.array([[12.0, 3.3, 0.15]]), 12.0, False),
        (np.zeros((0, 3)), -7.0, False),
    ],
    ids=["empty", "a person behind", "a person in it", "somebody at its wall", "out of sight"],
)
def test_a_section_is_free_where_the_lidar_looks_into_it_and_sees_nothing_but_the_map(
    things: FloatArray, reach: float, free: bool
) -> None:
    sight = SpotSight(WAYS, GRID, CHAIR_A)
    spot = spot_ahead()
    assert not sight.is_free(spot)
    sight.look(scan_along(things, reach), AT)
    assert sight.is_free(spot) is free
    assert (int(WAYS.resource[spot]) in sight.taken) == (not free and reach > 0.0)
