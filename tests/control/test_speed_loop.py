"""The trim on the speeds: it removes a bias, stays within its limits, and knows nothing at rest."""

from __future__ import annotations

import math

import pytest

from waychair.control.speed_loop import SpeedLoop, SpeedLoopSettings
from waychair.types import Twist

TICK = 50_000_000


class Plant:
    """A chair that loses a dead band and a gain error on each axis, with a lag."""

    def __init__(self, gain: float, lost: float, lag: float = 0.2) -> None:
        self.gain, self.lost, self.share = gain, lost, 1 - math.exp(-0.05 / lag)
        self.twist = Twist()

    def step(self, sent: Twist) -> Twist:
        v = math.copysign(max(self.gain * abs(sent.v) - self.lost, 0.0), sent.v)
        omega = math.copysign(max(self.gain * abs(sent.omega) - self.lost, 0.0), sent.omega)
        self.twist = Twist(
            self.twist.v + self.share * (v - self.twist.v), self.twist.omega + self.share * (omega - self.twist.omega)
        )
        return self.twist


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("lost", [0.0, 0.05])
@pytest.mark.parametrize("command", [Twist(0.4, 0.2), Twist(0.06, 0.0), Twist(0.3, -0.1), Twist(-0.15, 0.2)])
def test_measured_speed_comes_to_the_command_whatever_the_calibration_got_wrong(
    gain: float, lost: float, command: Twist
) -> None:
    loop, plant = SpeedLoop(SpeedLoopSettings()), Plant(gain, lost)
    for k in range(200):
        plant.step(loop.step(command, plant.twist, k * TICK))
    assert plant.twist.v == pytest.approx(command.v, abs=0.01)
    assert plant.twist.omega == pytest.approx(command.omega, abs=0.01)


def test_a_step_is_not_overshot_by_more_than_a_tenth() -> None:
    loop, plant = SpeedLoop(SpeedLoopSettings()), Plant(1.0, 0.0)
    fastest = max(plant.step(loop.step(Twist(0.5, 0.0), plant.twist, k * TICK)).v for k in range(100))
    assert fastest < 0.55


def test_a_chair_that_is_to_stand_gets_exactly_nothing() -> None:
    loop = SpeedLoop(SpeedLoopSettings())
    for k in range(50):
        loop.step(Twist(0.3, 0.2), Twist(0.1, 0.0), k * TICK)
    assert loop.step(Twist(), Twist(0.1, 0.0), 50 * TICK) == Twist()


def test_a_chair_with_unlike_motors_is_made_to_drive_straight() -> None:
    loop, plant = SpeedLoop(SpeedLoopSettings()), Plant(1.0, 0.0)
    for k in range(200):
        sent = loop.step(Twist(0.5, 0.0), Twist(plant.twist.v, plant.twist.omega + 0.1 * plant.twist.v), k * TICK)
        plant.step(sent)
    assert plant.twist.omega == pytest.approx(-0.1 * plant.twist.v, abs=0.005)


def test_the_trim_stays_within_its_limits_and_is_forgotten_when_nobody_drives() -> None:
    settings = SpeedLoopSettings(max_v=0.1, max_omega=0.25)
    loop = SpeedLoop(settings)
    for k in range(400):
        sent = loop.step(Twist(0.5, 0.5), Twist(), k * TICK)
    assert (sent.v, sent.omega) == pytest.approx((0.6, 0.75))
    assert loop.step(None, Twist(), 400 * TICK) == Twist()
    assert loop.step(Twist(0.5, 0.5), Twist(), 401 * TICK).v == pytest.approx(0.5)


def test_measurements_that_are_not_finite_change_nothing() -> None:
    loop = SpeedLoop(SpeedLoopSettings())
    loop.step(Twist(0.5, 0.1), Twist(0.5, 0.1), 0)
    sent = loop.step(Twist(0.5, 0.1), Twist(math.nan, math.inf), TICK)
    assert (sent.v, sent.omega) == (0.5, 0.1)


def test_a_long_pause_does_not_let_the_trim_jump() -> None:
    loop = SpeedLoop(SpeedLoopSettings())
    loop.step(Twist(0.5, 0.0), Twist(), 0)
    assert loop.step(Twist(0.5, 0.0), Twist(), 10**12).v < 0.6 + 1e-9
    assert loop.step(Twist(0.5, 0.0), Twist(), 0).v < 0.6 + 1e-9  # a clock that went back
