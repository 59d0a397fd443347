"""A chair that drives backwards, with scans far apart: half of each scan is new wall beside the known ones."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.slam.test_carried import cast, torn
from waychair.slam.graph.edges import EdgeKind
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.types import FloatArray, Odometry, Pose2, SensorFrame

STEP = 1.0  # m; between two scans
LENGTH = 36.0  # m; of the drive


@pytest.fixture(scope="module")
def corridor() -> FloatArray:
    """Walls (N, 4) [m] along x, 2 m apart, with niches 0.4 m deep that look alike and lie at uneven distances."""
    rng = np.random.default_rng(5)
    walls: list[tuple[float, ...]] = []
    for side in (-1.0, 1.0):
        x = -20.0
        while x < LENGTH + 20.0:
            begin = x + float(rng.uniform(1.5, 4.0))
            end, depth = begin + float(rng.uniform(0.8, 1.4)), 1.4 * side
            walls += [(x, side, begin, side), (begin, side, begin, depth)]
            walls += [(begin, depth, end, depth), (end, depth, end, side)]
            x = end
    return np.array(walls)


def driven(corridor: FloatArray, places: FloatArray, jump: float = 0.0) -> Mapper:
    """Map the scans at places x (N,) [m], which all face along x; the odometry jumps [m] half-way, and else is exact."""
    mapper = Mapper(MapperSettings(), Pose2())
    for k, x in enumerate(places.tolist()):
        stamp = 2_000_000_000 * k
        pose = Pose2(x - float(places[0]) + (jump if 2 * k > len(places) else 0.0), 0.0, 0.0)
        scan = dataclasses.replace(cast(corridor, Pose2(x, 0.0, 0.0)), stamp_ns=stamp)
        mapper.process(SensorFrame(stamp, scan, wheels=(Odometry(stamp, pose),)))
    return mapper


def away_from(mapper: Mapper, places: FloatArray) -> float:
    """Return the largest distance [m] of a pose from its place, along the corridor."""
    return float(np.abs(mapper.result().trajectory.poses[:, 0] - (places - places[0])).max())


def test_a_chair_that_drives_backwards_does_not_slip_on_to_known_walls(corridor: FloatArray) -> None:
    places = np.arange(LENGTH, 0.0, -STEP)
    mapper = driven(corridor, places)
    assert mapper.counts["slips"] == 0
    assert torn(mapper.result()) == []
    assert away_from(mapper, places) < 0.3


def test_the_way_back_in_reverse_adds_no_key_scans(corridor: FloatArray) -> None:
    there = np.arange(0.0, LENGTH, STEP)
    places = np.concatenate([there, there[-2::-1]])
    mapper = driven(corridor, places)
    assert len(mapper.keys) <= len(there) + 1
    assert mapper.keys.kinds[EdgeKind.UNKNOWN] == 0
    assert away_from(mapper, places) < 0.3
