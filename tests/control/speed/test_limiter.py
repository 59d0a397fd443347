"""The limiter: speeds change within the profile, brakes are never delayed, and arcs are kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.control.safety.stops import Braking
from waychair.control.speed.limiter import PROFILES, Limiter, LimiterSettings
from waychair.types import FloatArray, Twist

TICK = 50_000_000
DT = 0.05
NORMAL = PROFILES["normal"]
SPEEDS = st.floats(-1.5, 1.5)


class Riding:
    """A limiter and its commands so far, (N, 2) [m/s, rad/s]."""

    def __init__(self, settings: LimiterSettings | None = None) -> None:
        self.limiter = Limiter(settings)
        self.now_ns = 0
        self._commands: list[tuple[float, float]] = [(0.0, 0.0)]

    def run(
        self,
        v: float,
        omega: float,
        ticks: int,
        cap: float = math.inf,
        share: float = 1.0,
        braking: Braking | None = None,
    ) -> FloatArray:
        """Return its commands of these ticks, preceded by the last one before."""
        for _ in range(ticks):
            self.now_ns += TICK
            twist = self.limiter.step(Twist(v, omega), self.now_ns, cap, share, braking)
            self._commands.append((twist.v, twist.omega))
        return np.array(self._commands[-ticks - 1 :])


@pytest.mark.parametrize("name", list(PROFILES))
def test_a_start_keeps_to_acceleration_and_jerk_and_reaches_the_speed_without_overshoot(name: str) -> None:
    s = PROFILES[name]
    v = Riding(s).run(3.0, 0.0, 120)[:, 0]
    acceleration = np.diff(v) / DT
    assert acceleration.max() <= s.acceleration + 1e-9
    assert np.abs(np.diff(acceleration) / DT).max() <= 1.2 * s.jerk  # a fifth for the last step of a tick
    assert v.max() <= s.max_speed + 1e-9
    assert v[-1] == pytest.approx(s.max_speed)


@given(st.lists(st.tuples(SPEEDS, SPEEDS, st.floats(0.0, 1.0)), min_size=1, max_size=30))
def test_no_command_is_beyond_the_limits_for_any_target(asked: list[tuple[float, float, float]]) -> None:
    riding, s = Riding(), NORMAL
    for v, omega, share in asked:
        (before, turned), (after, turn) = riding.run(v, omega, 1, share=share)
        assert abs(after) <= s.max_speed + 1e-9
        assert abs(turn) <= s.max_omega + 1e-9
        assert abs(after - before) <= s.emergency * DT + 1e-9
        if abs(after) > abs(before) and after * before >= 0.0:
            assert abs(after) - abs(before) <= s.acceleration * DT + 1e-9
        if abs(turn) > abs(turned) and turn * turned >= 0.0:
            assert abs(turn) - abs(turned) <= s.alpha * DT + 1e-8


@pytest.mark.parametrize("forward", [1.0, -1.0])
@pytest.mark.parametrize("name", list(PROFILES))
def test_after_a_turn_on_the_spot_a_chair_starts_no_harder_than_from_standstill(name: str, forward: float) -> None:
    riding, s = Riding(PROFILES[name]), PROFILES[name]
    turned = riding.run(0.0, 3.0, 60)
    assert turned[-1, 1] == pytest.approx(s.max_omega)
    driven = forward * riding.run(forward * 3.0, 0.0, 60)[:, 0]
    assert np.diff(driven).max() <= s.acceleration * DT + 1e-9
    assert driven[-1] > 0.4


@pytest.mark.parametrize("name", list(PROFILES))
def test_a_straight_drive_turns_into_a_curve_no_harder_than_on_the_spot(name: str) -> None:
    riding, s = Riding(PROFILES[name]), PROFILES[name]
    riding.run(0.4, 0.0, 80)
    turning = riding.run(0.4, 0.5, 60)[:, 1]
    assert np.diff(turning).max() <= s.alpha * DT + 1e-8
    assert turning[-1] == pytest.approx(0.5)


@given(st.floats(0.1, 0.8), st.floats(-0.8, 0.8))
def test_a_steady_command_settles_on_its_own_arc_within_the_lateral_acceleration(v: float, omega: float) -> None:
    end_v, end_omega = Riding().run(v, omega, 120)[-1]
    assert abs(end_v * end_omega) <= NORMAL.lateral + 1e-9
    assert end_v * omega == pytest.approx(end_omega * v, abs=1e-9)
    if abs(v * omega) < NORMAL.lateral:
        assert end_v == pytest.approx(v)


@given(st.floats(0.0, 0.7))
def test_a_brake_of_the_planner_is_not_delayed(slower: float) -> None:
    riding = Riding()
    before = riding.run(0.8, 0.0, 80)[-1, 0]
    after = riding.run(max(slower, before - NORMAL.braking * DT), 0.0, 1)[-1, 0]
    assert after == pytest.approx(max(slower, before - NORMAL.braking * DT))


def test_a_speed_cap_is_approached_with_limited_jerk_and_kept() -> None:
    riding = Riding()
    riding.run(0.8, 0.2, 80)
    v = riding.run(0.8, 0.2, 60, cap=0.3)[:, 0]
    acceleration = np.diff(v) / DT
    assert acceleration.min() >= -NORMAL.braking - 1e-9
    assert np.abs(np.diff(acceleration) / DT).max() <= 1.2 * NORMAL.jerk
    assert v[-1] == pytest.approx(0.3)
    assert riding.run(0.8, 0.2, 20, cap=0.3)[:, 0].max() <= 0.3 + 1e-9


def test_a_share_of_a_single_tick_costs_no_jolt() -> None:
    riding = Riding()
    riding.run(0.8, 0.2, 80)
    v = np.concatenate(
        [riding.run(0.8, 0.2, ticks, share=share)[1:, 0] for ticks, share in ((5, 1.0), (1, 0.85), (5, 1.0))]
    )
    assert np.abs(np.diff(v, 2) / DT**2).max() <= 2.0 * NORMAL.jerk + 1e-9  # down in one tick, and up again in the next
    assert v.min() >= 0.79


@given(st.floats(0.05, 0.95))
def test_a_lasting_share_is_kept_and_a_command_is_never_a_quarter_faster_once_brakes_can_hold_it(share: float) -> None:
    riding = Riding()
    riding.run(0.6, 0.0, 80)
    v = riding.run(0.6, 0.0, 60, share=share)[1:, 0]
    assert v[-1] == pytest.approx(share * 0.6, abs=1e-6)
    hardest = 0.6 - NORMAL.emergency * DT * np.arange(1, len(v) + 1)
    assert (v <= np.maximum(1.25 * share * 0.6, hardest) + 1e-9).all()


def test_no_share_at_all_brakes_as_an_emergency() -> None:
    riding = Riding()
    riding.run(0.8, 0.0, 80)
    v = riding.run(0.8, 0.0, 20, share=0.0)[:, 0]
    assert v[1] == pytest.approx(v[0] - NORMAL.emergency * DT)
    assert v[-1] == 0.0


def test_a_comfortable_stop_has_limited_jerk_and_keeps_the_arc() -> None:
    riding = Riding()
    riding.run(0.8, 0.4, 80)
    commands = riding.run(0.0, 0.0, 80, braking=Braking.COMFORT)
    acceleration = np.diff(commands[:, 0]) / DT
    assert acceleration.min() >= -NORMAL.braking - 1e-9
    assert np.abs(np.diff(acceleration) / DT).max() <= 1.2 * NORMAL.jerk
    moving = commands[commands[:, 0] > 1e-6]
    assert np.ptp(moving[:, 1] / moving[:, 0]) < 1e-9
    assert not riding.limiter.moving


def test_an_emergency_brakes_at_once_and_as_hard_as_a_rider_tolerates() -> None:
    riding = Riding()
    riding.run(0.8, 0.0, 80)
    v = riding.run(0.8, 0.0, 12, braking=Braking.EMERGENCY)[:, 0]
    assert np.diff(v)[0] / DT == pytest.approx(-NORMAL.emergency)
    assert v[-1] == 0.0
    assert np.count_nonzero(v[1:]) <= math.ceil(0.8 / NORMAL.emergency / DT)


def test_letting_go_is_zero_at_once() -> None:
    riding = Riding()
    riding.run(0.8, 0.0, 80)
    assert riding.run(0.8, 0.0, 1, braking=Braking.RELEASE)[-1].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e6, -3.01])
def test_f5_a_command_that_is_not_a_number_or_impossibly_large_is_an_emergency(bad: float) -> None:
    riding = Riding()
    before = riding.run(0.8, 0.0, 80)[-1, 0]
    for v, omega in ((bad, 0.0), (0.5, bad)):
        after = riding.run(v, omega, 1)[-1]
        assert np.isfinite(after).all()
        assert after[0] == pytest.approx(before - NORMAL.emergency * DT)
        before = after[0]


def test_a_long_pause_allows_no_larger_step_than_that_of_two_ticks() -> None:
    riding = Riding()
    riding.run(0.8, 0.0, 3)
    before = riding.limiter.command.v
    riding.now_ns += 10**10
    assert riding.run(0.8, 0.0, 1)[-1, 0] - before <= 2 * NORMAL.acceleration * DT


@pytest.mark.parametrize("braking", [None, *Braking])
def test_a_clock_that_goes_back_makes_no_speed_larger(braking: Braking | None) -> None:
    riding = Riding()
    before, _ = riding.run(0.5, 0.3, 80)[-1]
    riding.now_ns -= 10**9
    v, omega = riding.run(0.8, 0.3, 1, braking=braking)[-1]
    assert 0.0 <= v <= before + 1e-9
    assert abs(omega) <= 0.3 + 1e-9
