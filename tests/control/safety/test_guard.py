"""Caps of the rider's stick: the largest push in each direction from which the chair still stops free."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.safety.arc_clearance import MonitorSettings, stoppable_along
from waychair.control.safety.collision_monitor import Monitor
from waychair.control.safety.guard import CREEP, OVERRIDE_S, PressedOverride, Unscanned, caps_of, crept, pushes_of
from waychair.control.safety.own_bend import MOST, OwnBend
from waychair.control.safety.sight_speed import Sector, UnseenSettings
from waychair.firmware_bridge.caps import Caps, StickMotion
from waychair.firmware_bridge.line_counts import LineCounts
from waychair.planning.body.clearance import FULL_SPEED
from waychair.types import FloatArray, JoystickInput, Pose2, Scan, Twist

FAST = StickMotion(LineCounts.of(DEFAULT), 1.65, 1.2, CHAIR_A.track)
STICK = replace(FAST, swing_volts=0.45)
"""A chair whose full swing is no faster than the guard passes on."""

ALL_ROUND = (Sector(Pose2(0.25, 0.0, 0.0), math.pi, 10.0),)
AHEAD = (Sector(CHAIR_A.base_from_laser, math.radians(135), 10.0),)
UNSEEN, MONITOR = UnseenSettings(), MonitorSettings()
NOTHING = Unscanned()
FRONT, REAR, LEFT, RIGHT = range(4)


def _line(x: float) -> FloatArray:
    """A wall across the chair's way, x [m] from the axle."""
    return np.column_stack([np.full(41, x), np.linspace(-1.0, 1.0, 41)])


def _caps(
    stick: tuple[float, float] = (0.0, 0.0),
    monitored: tuple[float, ...] | None = (1.0,) * 4,
    sectors: tuple[Sector, ...] = ALL_ROUND,
    unscanned: Unscanned = NOTHING,
) -> Caps:
    pushes = pushes_of(JoystickInput(0, *stick), STICK)
    return caps_of(pushes, monitored, sectors, unscanned, STICK, CHAIR_A, MONITOR, UNSEEN)


def test_with_free_space_all_round_every_cap_is_the_full_swing() -> None:
    for stick in ((0.0, 0.0), (0.6, 0.0), (-0.7, 0.0), (0.0, 1.0), (math.nan, 0.5)):
        assert _caps(stick).each == pytest.approx((1.0,) * 4)


def test_no_push_is_faster_than_clearances_are_known_for() -> None:
    free = caps_of(pushes_of(JoystickInput(0), FAST), (1.0,) * 4, ALL_ROUND, NOTHING, FAST, CHAIR_A, MONITOR, UNSEEN)
    for forward, turn in ((free.front, 0.0), (-free.rear, 0.0), (0.0, free.left), (0.0, -free.right)):
        passed = FAST.twist(forward, turn)
        fastest = max(abs(passed.v), abs(passed.omega) * CHAIR_A.circumscribed_radius)
        assert fastest == pytest.approx(FULL_SPEED, abs=0.05)


def test_a_share_of_the_monitor_is_a_deflection_beyond_the_dead_band_and_none_is_none() -> None:
    caps = _caps(monitored=(0.5, 0.0, 1.0, 0.25))
    assert caps.rear == 0.0
    assert caps.left == 1.0
    half = STICK.twist(caps.front, 0.0)
    assert half.v == pytest.approx(0.5 * STICK.twist(1.0, 0.0).v, abs=0.02)
    assert STICK.twist(0.0, -caps.right).omega == pytest.approx(0.25 * STICK.twist(0.0, -1.0).omega, abs=0.05)
    assert caps.front > 0.5


def test_pushes_are_judged_along_the_chairs_own_bend_but_capped_by_the_stick_alone() -> None:
    """A chair that bends to the right meets a jamb that lies beside its straight way; a bend to the left leads off it."""
    jamb = np.array([[0.5 + 0.002 * k, -CHAIR_A.width / 2 - 0.02] for k in range(5)])
    fronts = {}
    for bend in (-0.16, 0.0, 0.16):
        pushes = pushes_of(JoystickInput(0, 0.3, 0.0), STICK, bend)
        assert pushes.twists[FRONT].omega == pytest.approx((STICK.bend + bend) * pushes.twists[FRONT].v)
        seen = tuple(stoppable_along(jamb, np.zeros(5, np.bool_), each, CHAIR_A, MONITOR) for each in pushes.twists)
        fronts[bend] = caps_of(pushes, seen, ALL_ROUND, NOTHING, STICK, CHAIR_A, MONITOR, UNSEEN).front
    assert fronts[0.0] == fronts[0.16] == pytest.approx(1.0)
    assert fronts[-0.16] < 0.7


def test_the_own_bend_is_learnt_from_straight_driving_alone() -> None:
    found, now_ns = OwnBend(), 0
    for turn, twist in (
        (0.3, Twist(0.2, 0.3)),
        (0.0, Twist(0.2, 0.3)),
        (0.0, Twist(0.02, 0.3)),
        (0.0, Twist(math.nan, 0.3)),
    ):
        for _ in range(7):  # a turn of the stick, the hand that has just let go, a chair at rest, numbers that are none
            now_ns += 50_000_000
            found = found.after(now_ns, turn, twist, 0.0)
    assert found.bend == 0.0
    for _ in range(60):
        now_ns += 50_000_000
        found = found.after(now_ns, 0.0, Twist(0.2, -0.04), -0.05)
    assert found.bend == pytest.approx(-0.15, abs=0.03)
    assert found.after(now_ns + 50_000_000, 0.0, Twist(0.1, -9.0), 0.0).bend >= -MOST
    assert found.after(now_ns + 50_000_000, 0.5, Twist(0.2, 0.4), 0.0).bend == found.bend


def test_the_push_that_the_stick_makes_is_judged_along_its_arc() -> None:
    pushes = pushes_of(JoystickInput(0, 0.4, 0.2), STICK)
    assert pushes.deflections == ((1.0, 0.5), (-1.0, 0.0), (1.0, 0.5), (1.0, -1.0))
    assert pushes_of(JoystickInput(0, -0.5, 0.05), STICK).deflections == (
        (1.0, 0.0), (-1.0, 0.1), (-1.0, 1.0), (-1.0, -1.0),
    )  # fmt: skip
    caps = _caps((0.4, 0.2), monitored=(0.3, 1.0, 0.3, 1.0))
    allowed = STICK.twist(caps.front, caps.left)
    full = STICK.twist(1.0, 0.5)
    assert allowed.v / full.v == pytest.approx(0.3, abs=0.03)
    assert allowed.omega / allowed.v == pytest.approx(full.omega / full.v, rel=0.1)


def test_unseen_space_and_a_lidar_that_is_not_fit_leave_the_speed_of_unseen_motion() -> None:
    caps = _caps(sectors=AHEAD)
    assert caps.front == 1.0
    assert STICK.twist(-caps.rear, 0.0).v == pytest.approx(-UNSEEN.speed, abs=0.01)
    for blind in (_caps(monitored=None), _caps(sectors=())):
        assert STICK.twist(blind.front, 0.0).v <= UNSEEN.speed + 0.01
        assert STICK.twist(-blind.rear, 0.0).v >= -UNSEEN.speed - 0.01


def test_a_drop_off_caps_its_direction_and_is_told_as_one() -> None:
    near = _caps(unscanned=Unscanned(drops=_line(CHAIR_A.front + 0.1)))
    assert STICK.twist(near.front, 0.0).v < 0.2
    assert near.drops[:2] == (True, False)
    assert near.rear == 1.0
    behind = _caps(unscanned=Unscanned(drops=_line(-CHAIR_A.rear - 0.2)))
    assert behind.drops[REAR]
    assert not behind.drops[FRONT]
    assert _caps(unscanned=Unscanned(drops=_line(CHAIR_A.front + 6.0))) == _caps()


def test_a_thing_that_only_sonars_or_camera_see_caps_and_can_be_overridden() -> None:
    caps = [_caps(unscanned=Unscanned(things=_line(CHAIR_A.front + gap))).front for gap in (0.02, 0.3, 0.8, 1.5)]
    assert caps == sorted(caps)
    assert caps[0] == 0.0
    assert not any(_caps(unscanned=Unscanned(things=_line(CHAIR_A.front + 0.1))).drops)


def test_a_wall_of_the_map_caps_where_no_sensor_looks_unless_the_chair_seems_to_stand_in_it() -> None:
    behind = Unscanned(mapped=_line(-CHAIR_A.rear - 0.03))
    assert _caps(unscanned=behind) == _caps()  # the sensors look there, and see no wall
    caps = _caps(sectors=AHEAD, unscanned=behind)
    assert (caps.front, caps.rear) == (1.0, 0.0)
    assert not any(caps.drops)
    within = Unscanned(mapped=_line(-CHAIR_A.rear + 0.01)[18:23])  # by an error of the pose
    assert _caps(sectors=AHEAD, unscanned=within) == _caps(sectors=AHEAD)
    assert _caps(monitored=None, unscanned=Unscanned(mapped=_line(CHAIR_A.front + 0.03))).front == 0.0  # a blind lidar


def test_an_override_raises_each_cap_to_a_creep_and_none_towards_a_drop_off() -> None:
    held = Caps(0.0, 0.02, 0.6, 0.0, drops=(False, False, False, True))
    raised = crept(held, JoystickInput(0, 1.0, 0.0), STICK, CHAIR_A)
    assert STICK.twist(raised.front, 0.0).v == pytest.approx(CREEP, abs=0.01)
    assert STICK.twist(-raised.rear, 0.0).v == pytest.approx(-CREEP, abs=0.01)
    assert (raised.left, raised.right, raised.drops) == (0.6, 0.0, held.drops)
    turned = crept(Caps(), JoystickInput(0, 0.0, 1.0), STICK, CHAIR_A).left
    corner = STICK.twist(0.0, turned).omega * CHAIR_A.circumscribed_radius
    assert corner == pytest.approx(CREEP, abs=0.01)


@pytest.mark.parametrize(("forward", "turn"), [(1.0, 1.0), (-1.0, 0.4), (0.3, -1.0), (0.0, 0.0), (math.nan, 1.0)])
def test_both_axes_of_an_override_share_one_creep_at_the_chairs_corner(forward: float, turn: float) -> None:
    raised = crept(Caps(), JoystickInput(0, forward, turn), STICK, CHAIR_A)
    fastest = STICK.twist(raised.front, raised.left)
    assert fastest.v + fastest.omega * CHAIR_A.circumscribed_radius == pytest.approx(CREEP, abs=0.015)


def test_an_override_ends_with_its_time_and_when_a_pushed_stick_is_let_go() -> None:
    pressed = PressedOverride.begun(7)
    end_ns = 7 + round(OVERRIDE_S * 1e9)
    rest, push = JoystickInput(0), JoystickInput(0, 0.0, -0.5)
    waiting = pressed.after(end_ns - 1, rest)
    assert waiting == pressed
    assert pressed.after(end_ns, push) is None
    held = pressed.after(8, push)
    assert held is not None
    assert held.after(9, push) == held
    assert held.after(9, rest) is None


def _seen(ahead: float) -> Monitor:
    angles = np.linspace(-2.3, 2.3, 461)
    ranges = np.where(np.abs(angles) < 0.6, ahead / np.cos(angles), 8.0).astype(np.float32)
    monitor = Monitor(CHAIR_A, MONITOR)
    monitor.see(Scan(0, ranges, -2.3, 0.01, range_max=25.0))
    return monitor


def test_the_monitor_gives_a_share_for_each_push_and_none_without_a_fit_scan() -> None:
    pushes = (Twist(0.8, 0.0), Twist(-0.8, 0.0), Twist(0.0, 0.8), Twist(0.0, -0.8))
    wall = _seen(0.6).shares(pushes, Twist(), 0)
    free = _seen(7.0).shares(pushes, Twist(), 0)
    assert wall is not None
    assert free is not None
    assert wall[FRONT] < 0.9
    assert free[FRONT] == 1.0
    assert wall[REAR] == 1.0
    assert _seen(0.6).shares(pushes, Twist(), 400_000_000) is None
    assert _seen(0.6).shares(pushes, Twist(math.nan, 0.0), 0) is None
    assert Monitor(CHAIR_A, MONITOR).shares(pushes, Twist(), 0) is None
    nearer = _seen(0.35).shares(pushes, Twist(), 0)  # a fast drive would be stopped here, and a slow push creeps on
    assert nearer is not None
    assert 0.0 < nearer[FRONT] < wall[FRONT]


def test_three_points_straight_before_the_chair_stop_a_push_however_near_to_its_sides_line() -> None:
    for inwards in (0.001, 0.004, 0.02):
        jamb = np.array([[CHAIR_A.front + 0.005, -CHAIR_A.width / 2 + inwards]] * 3)
        assert _push_at(jamb, Twist(0.3, 0.0)) == 0.0
        assert _push_at(jamb, Twist(-0.3, 0.0)) == 1.0
        behind = jamb * (-CHAIR_A.rear - 0.005, 1.0) / (CHAIR_A.front + 0.005, 1.0)
        assert _push_at(behind, Twist(-0.3, 0.0)) == 0.0


def test_a_hand_does_not_pass_a_jamb_within_the_noise_of_the_scan_and_passes_a_wider_door() -> None:
    for room, passes in ((0.002, False), (0.008, False), (0.015, True), (0.05, True)):
        jamb = np.array([[CHAIR_A.front + 0.1, -CHAIR_A.width / 2 - room]] * 3)
        assert (_push_at(jamb, Twist(0.3, 0.0)) == 1.0) is passes
        beside = np.array([[0.3, -CHAIR_A.width / 2 - room]] * 3)
        assert _push_at(beside, Twist(0.3, 0.0)) == 1.0  # a chair that stands in the door gets out of it


def test_a_chair_that_veers_towards_a_thing_close_beside_it_is_stopped_and_one_that_veers_away_is_not() -> None:
    for gap, omega, passes in ((0.006, -0.05, False), (0.006, -0.005, True), (0.006, 0.05, True), (0.009, -0.01, True)):
        beside = np.array([[0.3, -CHAIR_A.width / 2 - gap]] * 3)
        assert (_push_at(beside, Twist(0.45, omega)) > 0.0) is passes, (gap, omega)


def _push_at(points: FloatArray, push: Twist) -> float:
    return stoppable_along(points, np.zeros(len(points), np.bool_), push, CHAIR_A, MONITOR)
