"""A drive of 200 m round a building with odometry that drifts far away, or with none: the map is right, or the report tells."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest

from tests.slam.test_carried import away_from, cast, way
from waychair.offline.mapping_report import torn_warnings
from waychair.slam.graph.edges import EdgeKind
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.types import FloatArray, Odometry, Pose2, SensorFrame

WIDTH, DEPTH, HALF = 60.0, 40.0, 1.25  # m; of the middle line of corridors round a block, and half their breadth
ROUND = way((5, 0), (WIDTH, 0), (WIDTH, DEPTH), (0, DEPTH), (0, 0), (WIDTH, 0), (WIDTH, 20))
BARE = "do not show how far the chair drove along bare walls"


def corridors(bare: bool) -> FloatArray:
    """Return the walls (W, 4) [m] of corridors round a block, with cupboards every few metres; two sides may have none."""
    walls: list[tuple[float, ...]] = []
    for out in (-HALF, HALF):
        left, low, right, high = out, out, WIDTH - out, DEPTH - out
        walls += [(left, low, right, low), (right, low, right, high)]
        walls += [(right, high, left, high), (left, high, left, low)]
    rng = np.random.default_rng(4)
    for side, length in enumerate((WIDTH, DEPTH, WIDTH, DEPTH)):
        along = 3.0
        while along < length - 4:
            if not (bare and side % 2 == 0 and 6 < along < length - 6):
                broad, deep, wall = rng.uniform(0.4, 1.2), rng.uniform(0.15, 0.5), rng.choice([-1, 1])
                far, near = HALF * wall, (HALF - deep) * wall
                corners = [(along, far), (along, near), (along + broad, near), (along + broad, far)]
                walls += [(*laid(side, *a), *laid(side, *b)) for a, b in pairwise(corners)]
            along += rng.uniform(2.0, 5.0)
    return np.array(walls, float)


def laid(side: int, along: float, out: float) -> tuple[float, float]:
    """Return the point [m] so far along a side of the block and so far out of its corridor's middle."""
    return ((along, out), (WIDTH + out, along), (along, DEPTH + out), (out, along))[side]


def mapped(walls: FloatArray, poses: Iterable[Pose2], bias: float | None) -> tuple[MapperResult, FloatArray, Pose2]:
    """Return the map of a drive, its true poses (N, 3), and where the odometry, which turns by `bias` [rad/m], ends."""
    mapper, odometry, truth = Mapper(MapperSettings(), Pose2()), Pose2(), list[Pose2]()
    for k, pose in enumerate(poses):
        step = truth[-1].inverse() @ pose if truth else Pose2()
        stamp, wheels = 200_000_000 * k, ()
        if bias is not None:
            odometry = odometry @ Pose2(step.x, step.y, step.theta + bias * math.hypot(step.x, step.y))
            wheels = (Odometry(stamp, odometry),)
        mapper.process(SensorFrame(stamp, dataclasses.replace(cast(walls, pose), stamp_ns=stamp), wheels=wheels))
        truth.append(pose)
    mapper.end_searches()
    return mapper.result(), np.array([pose.array() for pose in truth]), odometry


@pytest.mark.nightly
@pytest.mark.parametrize(("bias", "off", "most"), [(-0.015, 75.0, 0.6), (None, 0.0, 1.0)])
def test_a_round_of_200_m_closes_though_the_odometry_ends_75_m_off_or_is_none(
    bias: float | None, off: float, most: float
) -> None:
    """Without odometry, other cupboards along the corridors give 0.3 to 1.0 m."""
    result, truth, odometry = mapped(corridors(bare=False), ROUND, bias)
    end = ROUND[0].inverse() @ ROUND[-1]
    assert bias is None or math.hypot(odometry.x - end.x, odometry.y - end.y) > off
    assert any(edge.kind is EdgeKind.LOOP for edge in result.edges)
    assert away_from(result, truth).max() < most
    assert torn_warnings(result) == []


@pytest.mark.nightly
def test_a_round_of_200_m_that_ends_soon_after_its_return_is_closed() -> None:
    soon = way((5, 0), (WIDTH, 0), (WIDTH, DEPTH), (0, DEPTH), (0, 0), (12, 0))
    result, truth, _ = mapped(corridors(bare=False), soon, -0.015)
    assert any(edge.kind is EdgeKind.LOOP for edge in result.edges)
    assert away_from(result, truth).max() < 0.3


@pytest.mark.nightly
def test_without_odometry_bare_corridors_of_200_m_are_told() -> None:
    result, truth, _ = mapped(corridors(bare=True), ROUND, None)
    assert away_from(result, truth).max() > 5.0  # the scans do not show the way along them
    assert any(BARE in warning for warning in torn_warnings(result))


@pytest.mark.parametrize(("bare", "bias"), [(True, None), (True, -0.015), (False, None)])
def test_a_bare_corridor_is_told_only_where_there_is_no_odometry(bare: bool, bias: float | None) -> None:
    result, _, _ = mapped(corridors(bare), way((15, 0), (40, 0)), bias)
    assert any(BARE in warning for warning in torn_warnings(result)) == (bare and bias is None)
