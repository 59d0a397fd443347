"""Points that no scan shows, told by one program to another: near ones only, of one map, and never stale."""

from __future__ import annotations

import math

import numpy as np

from waychair.control.safety.guard import BLIND_WITHIN, WATCHED_WITHIN, Unscanned
from waychair.ros.messages.json_text import json_text, read_json_text
from waychair.runtime.rider.guard_points import SENT_BEYOND, STALE_NS, GuardPoints, ToldPoints
from waychair.types import Pose2

HERE = Pose2(2.0, 1.0, math.pi / 2)
STAIRS, SHELF, FAR = (2.0, 3.0), (1.5, 1.0), (2.0, 1.0 + WATCHED_WITHIN + SENT_BEYOND + 0.1)
WALL, FAR_WALL = (2.0, 0.5), (2.0, 1.0 - BLIND_WITHIN - SENT_BEYOND - 0.1)


def told() -> GuardPoints:
    points = Unscanned(np.array([STAIRS, FAR]), np.array([SHELF]), np.array([WALL, FAR_WALL]))
    return GuardPoints.near(7, 3, points, HERE)


def test_the_points_near_the_chair_arrive_as_it_sees_them() -> None:
    points = ToldPoints()
    points.take(read_json_text(json_text(told()), GuardPoints, "points"), 100)
    seen = points.seen_from(HERE, 3, 100 + STALE_NS)
    assert seen is not None
    np.testing.assert_allclose(seen.drops, [[2.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(seen.things, [[0.0, 0.5]], atol=1e-9)
    np.testing.assert_allclose(seen.mapped, [[-0.5, 0.0]], atol=1e-9)
    empty = GuardPoints(0, 3).unscanned()
    assert empty.drops.shape == empty.things.shape == empty.mapped.shape == (0, 2)


def test_what_is_stale_of_another_map_or_was_never_told_is_not_known() -> None:
    points = ToldPoints()
    assert points.seen_from(HERE, 3, 100) is None
    points.take(told(), 100)
    assert points.seen_from(HERE, 4, 100) is None
    assert points.seen_from(HERE, 3, 101 + STALE_NS) is None
    assert points.seen_from(HERE, 3, 99) is None  # the clock went back
