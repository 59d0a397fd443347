"""Recovery: progress along the way and in a turn, and the end of backing out."""

from __future__ import annotations

import math

import numpy as np
from evaluation.scenes.tight_places import corner_scene, drive_variants

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.control.drive.recovery import (
    BACKING_LENGTH,
    BLOCKED_S,
    PROGRESS_M,
    PROGRESS_RAD,
    TURNING_TIME_S,
    Recovery,
    RecoverySettings,
)
from waychair.maps.grid.distance_field import DistanceField, distance_field, distances
from waychair.planning.body.footprint import along_arc, fits
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import Pose2, Twist

S = RecoverySettings()
TICK_NS = 50_000_000


def hall() -> DistanceField:
    return DistanceField(distances(np.zeros((200, 200), np.bool_), 0.05), 0.05, Pose2(-5.0, -5.0))


def backs(recovery: Recovery, seconds: float, turning: float, remaining: float | None) -> float | None:
    """Return the seconds of turning at this rate [rad/s] until the chair begins to back out; None if it does not."""
    for tick in range(round(seconds * 20)):
        pose = Pose2(0.0, 0.0, turning * tick / 20)
        if recovery.step(tick * TICK_NS, pose, remaining, Twist(), hall, CHAIR_A, DwaSettings()) is not None:
            return tick / 20
    return None


def test_the_chair_backs_out_of_a_turn_without_progress() -> None:
    assert backs(Recovery(S), TURNING_TIME_S + 1.0, 0.0, None) == TURNING_TIME_S
    assert backs(Recovery(S), 20.0, 2.0 * PROGRESS_RAD / TURNING_TIME_S, None) is None


def test_a_door_is_driven_through_straight_at_the_second_try() -> None:
    recovery = Recovery(S)
    for tick in range(round(20 * 3 * TURNING_TIME_S)):
        pose = Pose2(1.2 * PROGRESS_M / TURNING_TIME_S * tick / 20)
        assert recovery.step(tick * TICK_NS, pose, None, Twist(), hall, CHAIR_A, DwaSettings()) is None


def test_turning_and_driving_have_their_own_clocks() -> None:
    recovery = Recovery(S)
    assert backs(recovery, TURNING_TIME_S - 0.1, 0.0, None) is None
    assert backs(recovery, 0.1, 0.0, 3.0) is None
    assert backs(recovery, TURNING_TIME_S - 0.1, 0.0, None) is None


def test_standing_to_plan_or_waiting_for_people_is_no_turn_without_progress() -> None:
    recovery, half = Recovery(S), round(TURNING_TIME_S * 5e8)
    args = (Pose2(), None, Twist(), hall, CHAIR_A, DwaSettings())
    assert recovery.step(0, *args) is None
    recovery.leave_out_planning(half)
    assert recovery.step(3 * half - 1, *args) is None
    assert recovery.step(3 * half, *args) is not None
    recovery = Recovery(S)
    assert recovery.step(0, *args) is None
    assert recovery.step(half, *args, waits=True) is None
    assert recovery.step(3 * half - 1, *args) is None
    assert not recovery.backing


def test_backing_out_ends_after_its_distance_and_is_reported_until_then() -> None:
    recovery = Recovery(S)
    args = (None, Twist(), hall, CHAIR_A, DwaSettings())
    assert recovery.step(0, Pose2(), *args) is None
    now = round(TURNING_TIME_S * 1e9)
    assert recovery.step(now, Pose2(), *args) is not None
    assert recovery.backing
    assert recovery.step(now + TICK_NS, Pose2(-BACKING_LENGTH / 2, 0.0), *args) is not None
    assert recovery.step(now + 2 * TICK_NS, Pose2(-BACKING_LENGTH, 0.0), *args) is None
    assert not recovery.backing
    assert recovery.tries == 1


def test_at_each_try_the_chair_backs_out_farther_up_to_a_limit() -> None:
    recovery, now_ns, ways = Recovery(S), 0, []
    args = (9.0, Twist(), hall, CHAIR_A, DwaSettings())
    for _ in range(S.tries):
        assert recovery.step(now_ns, Pose2(), *args) is None
        now_ns += round(S.progress_time * 1e9)
        way = 0.0
        while recovery.step(now_ns, Pose2(-way), *args) is not None:
            way, now_ns = way + 0.01, now_ns + TICK_NS
        ways.append(way)
    np.testing.assert_allclose(ways, BACKING_LENGTH * np.minimum(np.arange(1, S.tries + 1), 4), atol=0.011)


def test_the_count_of_tries_restarts_when_the_chair_has_got_farther_than_before() -> None:
    recovery = Recovery(S)

    def step(seconds: float, remaining: float) -> bool:
        now = round(seconds * 1e9)
        return recovery.step(now, Pose2(), remaining, Twist(), hall, CHAIR_A, DwaSettings()) is not None

    assert not step(0.0, 9.0)
    assert step(S.progress_time, 9.0)
    assert step(S.progress_time + 1.0, 9.3)
    assert not step(2 * S.progress_time, 9.3)  # it has backed for as long as it may
    assert not step(2 * S.progress_time + 1.0, 8.8)
    assert step(3 * S.progress_time + 1.0, 8.8)
    assert recovery.tries == 2
    assert step(5 * S.progress_time, 8.1)
    assert not step(5 * S.progress_time + 1.0, 8.1)  # 0.7 m farther than ever before
    assert recovery.tries == 2
    step(5 * S.progress_time + 2.0, 7.7)
    assert recovery.tries == 0
    recovery.reset()
    assert recovery.begun == 2, "displays of a drive count on"


def test_a_person_who_is_near_for_a_moment_does_not_end_the_backing_out() -> None:
    walls = np.ones((200, 200), np.bool_)  # nothing is free
    shut = DistanceField(distances(walls, 0.05), 0.05, Pose2(-5.0, -5.0))
    recovery = Recovery(S)
    begun = round(S.progress_time * 1e9)

    def step(now_ns: int, field: DistanceField) -> bool:
        return recovery.step(now_ns, Pose2(), 9.0, Twist(), lambda: field, CHAIR_A, DwaSettings()) is not None

    assert not step(0, hall())
    assert step(begun, shut)
    assert step(begun + round(0.9 * BLOCKED_S * 1e9), shut)
    assert step(begun + round(1.1 * BLOCKED_S * 1e9), hall())
    assert step(begun + round(1.2 * BLOCKED_S * 1e9), shut)
    assert not step(begun + round(2.3 * BLOCKED_S * 1e9), shut)
    assert recovery.tries == 1


def test_a_chair_that_turns_less_than_commanded_comes_no_nearer_to_walls_as_it_backs_out() -> None:
    """In the corner of a narrow corridor, with front-wheel drive, a noisy pose, and 0.6 of the commanded turning."""
    body = drive_variants(CHAIR_A)["front"]
    world = corner_scene(body, 0).world
    field = distance_field(world.grid)
    rng, recovery, limits = np.random.default_rng(0), Recovery(S), DwaSettings()
    way = [
        (3.254, 0.785, 0.265),
        (3.347, 0.819, 0.375),
        (3.479, 0.878, 0.477),
        (3.587, 0.942, 0.597),
        (3.686, 1.026, 0.85),
    ]
    for x, y, theta in way:
        pose = Pose2(x, y, theta)
        assert recovery.step(0, pose, 9.0 - x, Twist(), lambda: field, body, limits) is None
    command, gaps = Twist(), []
    for tick in range(300):
        gaps.append(gap(pose, field, body))
        seen = Pose2(*(pose.array() + rng.normal(0.0, (0.003, 0.003, 0.001))))
        recovery.note_standstill(tick * TICK_NS)
        choice = recovery.step(tick * TICK_NS, seen, 0.0, command, lambda: field, body, limits)
        command = Twist() if choice is None else choice.twist
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, 0.6 * command.omega, 0.05))
    assert recovery.tries > 1
    assert min(gaps) > 0.005  # 1.5 cm are kept, less the stopping distance


def gap(pose: Pose2, field: DistanceField, body: ChairBody) -> float:
    """Return the free distance [m] round the body, to 2 mm; negative where it touches."""
    return next((k / 500 for k in range(25, -1, -1) if fits(body, k / 500, field, pose)), -math.inf)


def test_a_chair_driven_elsewhere_does_not_reverse_along_its_old_trail() -> None:
    recovery, ticks = Recovery(S), iter(range(10_000))
    args = (Twist(), hall, CHAIR_A, DwaSettings())
    for x in np.linspace(0.0, 3.0, 61).tolist():
        assert recovery.step(next(ticks) * TICK_NS, Pose2(x, 0.0, 0.0), 3.0 - x, *args) is None
    elsewhere = Pose2(3.0, 2.0, math.pi / 2)
    recovery.reset()
    backing = None
    while backing is None:
        backing = recovery.step(next(ticks) * TICK_NS, elsewhere, 3.0, *args)
    best = backing.candidates[int(np.argmax(backing.scores))]
    assert best[1] == 0.0, "straight back, the only known way without a trail"
