"""The speed loop: it corrects errors of a calibration, holds a line, and learns nothing from useless data."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.fits.axis_model import AxisModel, AxisSide
from waychair.calibration.fits.dac import DEFAULT
from waychair.calibration.fits.fitted_dac import DeadBand, FittedDac
from waychair.calibration.fits.stopping import StopTable
from waychair.control.speed.axis_response import AxisResponse
from waychair.control.speed.kinematics import wheel_speeds_from_twist
from waychair.control.speed.speed_loop import ChairResponse, SpeedLoop, SpeedLoopSettings, chair_response
from waychair.types import SentCommand, Twist

TICK = 50_000_000
TRACK = 0.54
RESPONSE = AxisResponse(0.0, 0.2, doubt_s=0.0)
RESPONSES = ChairResponse(RESPONSE, RESPONSE)
SETTINGS = SpeedLoopSettings(brake_s=0.0)


def sent(twist: Twist, active: bool = True) -> SentCommand:
    """The sent speeds, by the calibration."""
    return SentCommand(0, wheel_speeds_from_twist(twist, TRACK), 0, 0, 0.0, 0.0, active)


class Plant:
    """A chair that loses a dead band and a gain error on each axis, with a lag; `skew` turns it as it drives."""

    def __init__(self, gain: float = 1.0, lost: float = 0.0, skew: float = 0.0, limit: float = math.inf) -> None:
        self.gain, self.lost, self.skew, self.limit = gain, lost, skew, limit
        self.share = 1 - math.exp(-0.05 / 0.2)
        self.driven, self.mean = Twist(), Twist()
        self.y = self.theta = 0.0

    def sent(self, asked: Twist) -> SentCommand:
        """Return the twist after the limits of the axes."""
        return sent(Twist(max(-self.limit, min(self.limit, asked.v)), asked.omega))

    def step(self, asked: Twist) -> Twist:
        """Mean twist over a tick."""
        before, wanted = self.driven, Twist(max(-self.limit, min(self.limit, asked.v)), asked.omega)
        v, omega = (
            math.copysign(max(self.gain * abs(value) - self.lost, 0.0), value) for value in (wanted.v, wanted.omega)
        )
        self.driven = Twist(before.v + self.share * (v - before.v), before.omega + self.share * (omega - before.omega))
        mean_v, mean_omega = 0.5 * (before.v + self.driven.v), 0.5 * (before.omega + self.driven.omega)
        self.mean = Twist(mean_v, mean_omega + self.skew * mean_v)
        self.theta += 0.05 * self.mean.omega
        self.y += 0.05 * self.mean.v * math.sin(self.theta)
        return self.mean


@pytest.mark.parametrize("gain", [0.75, 1.0, 1.4])
@pytest.mark.parametrize("lost", [0.0, 0.05])
@pytest.mark.parametrize("command", [Twist(0.4, 0.2), Twist(0.06, 0.0), Twist(0.3, -0.1), Twist(-0.15, 0.2)])
def test_the_measured_speed_reaches_the_command_despite_errors_of_the_calibration(
    gain: float, lost: float, command: Twist
) -> None:
    loop, plant = SpeedLoop(SETTINGS, response=RESPONSES), Plant(gain, lost)
    for k in range(200):
        plant.step(loop.step(command, plant.mean, k * TICK))
    assert plant.mean.v == pytest.approx(command.v, abs=0.01)
    assert plant.mean.omega == pytest.approx(command.omega, abs=0.01)


def test_a_step_that_the_chair_follows_as_calibrated_is_sent_unchanged() -> None:
    loop, plant = SpeedLoop(SETTINGS, response=RESPONSES), Plant()
    command = Twist(0.5, 0.4)
    asked = []
    for k in range(100):
        asked.append(loop.step(command, plant.mean, k * TICK))
        plant.step(asked[-1])
    assert max(abs(twist.v - 0.5) for twist in asked) < 0.06
    assert max(abs(twist.omega - 0.4) for twist in asked) < 0.06


def test_a_chair_that_shall_stand_gets_exactly_zero() -> None:
    loop = SpeedLoop(SETTINGS, response=RESPONSES)
    for k in range(50):
        loop.step(Twist(0.3, 0.2), Twist(0.1, 0.0), k * TICK)
    for k in range(50, 90):
        assert loop.step(Twist(), Twist(0.1, 0.05), k * TICK) == Twist()


@pytest.mark.parametrize("v", [0.5, -0.5])
def test_a_chair_with_unequal_motors_returns_to_its_line(v: float) -> None:
    loop, plant, trimless = SpeedLoop(SETTINGS, response=RESPONSES), Plant(skew=0.11), Plant(skew=0.11)
    for k in range(500):
        plant.step(loop.step(Twist(v, 0.0), plant.mean, k * TICK))
        trimless.step(Twist(v, 0.0))
    assert abs(plant.y) < 0.005
    assert abs(plant.theta) < 0.005
    assert abs(trimless.y) > 1.0


def test_a_commanded_curve_is_not_corrected() -> None:
    loop, plant = SpeedLoop(SETTINGS, response=RESPONSES), Plant()
    for k in range(100):
        plant.step(loop.step(Twist(0.5, 0.3), plant.mean, k * TICK))
    heading = plant.theta
    for k in range(100, 200):
        plant.step(loop.step(Twist(0.5, 0.0), plant.mean, k * TICK))
    assert plant.theta - heading == pytest.approx(0.3 * 0.2, abs=0.02)  # the rest of the lag's response


def test_the_trim_stays_within_its_limits_and_is_reset_when_nothing_drives() -> None:
    loop = SpeedLoop(dataclasses.replace(SETTINGS, max_trim_v=0.1, max_trim_omega=0.25), response=RESPONSES)
    for k in range(400):
        asked = loop.step(Twist(0.5, 0.5), Twist(), k * TICK)
    assert (asked.v, asked.omega) == pytest.approx((0.6, 0.75))
    assert loop.step(None, Twist(), 400 * TICK) == Twist()
    assert loop.step(Twist(0.5, 0.5), Twist(), 401 * TICK).v == pytest.approx(0.5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_trim_learnt_at_speed_never_drives_the_chair_against_its_command(sign: float) -> None:
    loop, plant = SpeedLoop(SETTINGS, response=RESPONSES), Plant(gain=0.8)
    for k in range(100):
        plant.step(loop.step(Twist(sign * 0.8, 0.0), plant.mean, k * TICK))
    for k in range(100, 140):
        asked = loop.step(Twist(-sign * 0.02, 0.0), plant.mean, k * TICK)
        assert sign * asked.v <= 0.0
        plant.step(asked)


def test_the_integral_does_not_wind_up_at_the_end_of_an_axis() -> None:
    loop, plant = SpeedLoop(SETTINGS, response=RESPONSES), Plant(limit=0.6)
    told = None
    for k in range(200):
        asked = loop.step(Twist(0.9, 0.0), plant.mean, k * TICK, told)
        told = plant.sent(asked)
        plant.step(asked)
    assert asked.v < 0.95
    for k in range(200, 240):
        asked = loop.step(Twist(0.3, 0.0), plant.mean, k * TICK, told)
        told = plant.sent(asked)
        plant.step(asked)
    assert plant.mean.v == pytest.approx(0.3, abs=0.02)


def test_commands_leave_room_for_trims_on_the_same_arc() -> None:
    loop = SpeedLoop(SETTINGS, response=dataclasses.replace(RESPONSES, top_v=0.5, top_omega=1.0))
    asked = loop.step(Twist(0.9, 0.6), Twist(), 0)
    assert asked.v == pytest.approx(0.45)
    assert asked.omega / asked.v == pytest.approx(0.6 / 0.9)


def test_in_the_dead_band_nothing_is_learnt_from_a_coasting_chair() -> None:
    loop = SpeedLoop(SETTINGS, response=RESPONSES)
    asked = [loop.step(Twist(0.01, 0.0), Twist(0.1, 0.0), k * TICK, sent(Twist())).v for k in range(90)]
    assert asked[89] == pytest.approx(asked[60], abs=1e-3)
    assert asked[89] > 0.01 - SETTINGS.max_trim_v + 0.05


def test_in_the_dead_band_a_standing_chair_is_pushed_after_its_brake_had_time_to_open() -> None:
    loop = SpeedLoop(SpeedLoopSettings(), response=RESPONSES)
    asked = [loop.step(Twist(0.02, 0.0), Twist(), k * TICK, sent(Twist()) if k else None).v for k in range(60)]
    assert max(asked[:13]) == 0.02
    assert asked[-1] > 0.025


@pytest.mark.parametrize("brake", [0.2, 0.5])
def test_a_brake_that_opens_late_causes_no_windup_and_the_chair_starts_gently(brake: float) -> None:
    loop, plant = SpeedLoop(SpeedLoopSettings(), response=RESPONSES), Plant()
    asked = []
    for k in range(100):
        asked.append(loop.step(Twist(0.4, 0.0), plant.mean, k * TICK))
        assert loop.waiting == (k * 0.05 < brake + 0.05)
        if k * 0.05 >= brake:
            plant.step(asked[-1])
    assert max(abs(twist.v - 0.4) for twist in asked) < 0.05


def test_a_chair_that_does_not_start_is_pushed_in_the_end() -> None:
    loop = SpeedLoop(SpeedLoopSettings(), response=RESPONSES)
    for k in range(40):
        asked = loop.step(Twist(0.1, 0.0), Twist(), k * TICK)
    assert not loop.waiting
    assert asked.v > 0.2


def test_after_a_reversal_the_turn_trim_waits_until_the_casters_have_swung_round() -> None:
    loop, plant = SpeedLoop(SETTINGS, response=RESPONSES), Plant()
    now = 0
    for _ in range(60):
        now += TICK
        plant.step(loop.step(Twist(0.4, 0.2), plant.mean, now))
    assert not loop.casters_swing
    backwards = 0.0
    swung = False
    for _ in range(60):
        now += TICK
        mean = plant.step(loop.step(Twist(-0.4, 0.2), plant.mean, now))
        backwards += max(0.0, -mean.v) * 0.05
        swung = swung or loop.casters_swing
        assert not (loop.casters_swing and backwards > 0.5)
    assert swung
    assert not loop.casters_swing


def test_a_chair_that_stands_after_a_reversal_is_pushed_out_of_its_dead_band_before_its_casters_swing() -> None:
    loop, now = SpeedLoop(SETTINGS, response=RESPONSES), 0
    for v in (0.3, -0.3):
        for _ in range(10):
            now += TICK
            loop.step(Twist(v, 0.0), Twist(v, 0.0), now)
    assert loop.casters_swing
    for _ in range(60):
        now += TICK
        asked = loop.step(Twist(0.0, 0.1), Twist(), now)
    assert loop.casters_swing
    assert asked.omega > 0.3


@given(st.sampled_from([math.nan, math.inf, -math.inf]), st.sampled_from([math.nan, 0.0, math.inf]))
def test_measurements_that_are_not_finite_change_nothing(v: float, omega: float) -> None:
    loop = SpeedLoop(SETTINGS, response=RESPONSES)
    loop.step(Twist(0.5, 0.1), Twist(0.5, 0.1), 0)
    asked = loop.step(Twist(0.5, 0.1), Twist(v, omega), TICK)
    assert (asked.v, asked.omega) == (0.5, 0.1)


def test_a_command_that_is_not_finite_is_passed_to_the_bridge_to_refuse_and_is_not_kept() -> None:
    loop = SpeedLoop(SETTINGS, response=RESPONSES)
    assert math.isnan(loop.step(Twist(math.nan, 0.0), Twist(0.3, 0.0), 0).v)
    assert loop.step(Twist(0.3, 0.0), Twist(0.3, 0.0), TICK).v == pytest.approx(0.3, abs=0.05)


def test_a_long_pause_does_not_let_the_trim_jump() -> None:
    loop = SpeedLoop(SETTINGS, response=RESPONSES)
    loop.step(Twist(0.1, 0.0), Twist(0.1, 0.0), 0)
    assert loop.step(Twist(0.1, 0.0), Twist(0.05, 0.0), 10**12).v < 0.2
    assert loop.step(Twist(0.1, 0.0), Twist(0.05, 0.0), 0).v < 0.2  # a clock that went back


@given(
    st.lists(
        st.tuples(
            st.sampled_from([None, Twist(), Twist(0.4, 0.0), Twist(-0.3, 0.5), Twist(2.0, -3.0)]),
            st.floats(-3.0, 3.0),
            st.floats(-6.0, 6.0),
            st.integers(0, 10**9),
        ),
        max_size=40,
    )
)
def test_for_any_measurement_the_trim_is_bounded_and_rest_gives_zero(
    ticks: list[tuple[Twist | None, float, float, int]],
) -> None:
    loop, now, told = SpeedLoop(SETTINGS, response=RESPONSES), 0, None
    for command, v, omega, later in ticks:
        now += later
        asked = loop.step(command, Twist(v, omega), now, told)
        told = sent(asked)
        if command is None or command == Twist():
            assert asked == Twist()
        else:
            assert abs(asked.v) <= abs(command.v) + SETTINGS.max_trim_v + 1e-9
            assert abs(asked.omega) <= abs(command.omega) + SETTINGS.max_trim_omega + 1e-9


def test_the_loop_takes_its_delays_lags_ramps_and_reach_from_the_calibration() -> None:
    forward = AxisModel(delay_s=0.4, lag_s=0.15, ramp=0.9)
    side = AxisSide(gain=2.5, limit=2.0)
    turn = AxisModel(sign=-1, above=side, below=side, delay_s=0.07, lag_s=0.2, ramp=3.0)
    stops = StopTable(speeds=(0.2, 0.8), distances=(0.1, 0.5), delay_s=0.12)
    found = chair_response(FittedDac(forward=forward, turn=turn), stops)
    assert chair_response(DeadBand(FittedDac(forward=forward, turn=turn)), stops) == found
    assert found.forward == AxisResponse(0.12, 0.15, 0.9, doubt_s=0.0)
    assert found.turn == AxisResponse(0.07, 0.2, 3.0, doubt_s=0.0)
    assert found.top_v == pytest.approx(0.98 * 1.4)
    assert found.top_omega == pytest.approx(0.98 * 2.0)
    assert chair_response(FittedDac()).forward == AxisResponse()
    assert chair_response(DEFAULT) == ChairResponse()
