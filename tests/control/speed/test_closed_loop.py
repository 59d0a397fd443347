"""Speed loop and watches together: a fault stops until it is acknowledged, and doubt slows the chair on its arc."""

from __future__ import annotations

import math
from collections import deque

import pytest

from waychair.calibration.fits.dac import DEFAULT
from waychair.control.speed.closed_loop import ClosedLoop
from waychair.control.speed.kinematics import wheel_speeds_from_twist
from waychair.types import SentCommand, Twist

TICK = 50_000_000
TRACK = 0.54


def sent(twist: Twist, active: bool = True) -> SentCommand:
    """The sent speeds, by the calibration."""
    return SentCommand(0, wheel_speeds_from_twist(twist, TRACK), 0, 0, 0.0, 0.0, active)


def driven(loop: ClosedLoop, commands: list[Twist], gain: float) -> Twist:
    """Return the last twist commanded to a chair that drives `gain` times the command at once."""
    told: SentCommand | None = None
    measured = asked = Twist()
    for k, command in enumerate(commands):
        asked = loop.step(command, measured, k * TICK, told)
        told = sent(asked)
        measured = Twist(gain * asked.v, gain * asked.omega)
    return asked


def test_a_chair_that_follows_is_sent_its_commands_unchanged() -> None:
    loop = ClosedLoop(DEFAULT, TRACK)
    asked = driven(loop, [Twist(0.5, 0.2)] * 100, 1.0)
    assert (asked.v, asked.omega) == pytest.approx((0.5, 0.2), abs=0.01)
    assert (loop.fault, loop.speed_limit) == ("", math.inf)


def test_a_fault_gives_exactly_zero_until_it_is_acknowledged() -> None:
    loop = ClosedLoop(DEFAULT, TRACK)
    assert driven(loop, [Twist(0.5, 0.0)] * 100, 0.0) == Twist()
    assert "F20" in loop.fault
    for k in range(100, 140):
        assert loop.step(Twist(0.5, 0.0), Twist(), k * TICK, sent(Twist())) == Twist()
    loop.acknowledge()
    assert loop.fault == ""
    assert loop.step(Twist(0.5, 0.0), Twist(), 140 * TICK, sent(Twist())).v == pytest.approx(0.5)


def test_a_doubtful_gain_slows_the_chair_and_keeps_its_arc() -> None:
    loop = ClosedLoop(DEFAULT, TRACK)
    asked = driven(loop, [Twist(0.6, 0.0)] * 100 + [Twist(0.6, 0.3)] * 100, 0.72)
    assert loop.fault == ""
    assert loop.speed_limit == 0.3
    assert 0.72 * asked.v == pytest.approx(0.3, abs=0.01)
    assert 0.72 * asked.omega == pytest.approx(0.15, abs=0.01)


def test_without_a_driver_there_is_no_motion_and_a_riders_motion_is_no_fault() -> None:
    loop = ClosedLoop(DEFAULT, TRACK)
    for k in range(100):
        assert loop.step(None, Twist(0.9, 1.0), k * TICK, sent(Twist(), active=False)) == Twist()
    assert (loop.fault, loop.gains) == ("", (1.0, 1.0))


def most_trim(loop: ClosedLoop, late_ticks: int) -> float:
    """Return the largest trim [rad/s] of a turn to and fro, after two of them, of a chair that answers so many ticks late."""
    told: SentCommand | None = None
    on_the_way = deque([Twist()] * late_ticks)
    v = omega = most = 0.0
    for k in range(400):
        command = Twist(0.3, 0.5 * math.sin(math.tau * k / 100))
        asked = loop.step(command, Twist(v, omega), k * TICK, told)
        told = sent(asked)
        on_the_way.append(asked)
        acting = on_the_way.popleft()
        v, omega = v + 0.25 * (acting.v - v), omega + 0.25 * (acting.omega - omega)
        if k >= 200:
            most = max(most, abs(asked.omega - command.omega))
    assert loop.fault == ""
    return most


def test_a_late_answer_is_not_taken_for_a_lack_of_speed() -> None:
    in_time, late = most_trim(ClosedLoop(DEFAULT, TRACK), 1), most_trim(ClosedLoop(DEFAULT, TRACK), 8)
    assert in_time < 0.03
    assert late < 0.03  # 0.19 where the delay counts as a lack of speed
