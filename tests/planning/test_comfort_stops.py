"""Comfortable stops: with limited jerk, within the free distance, on the same arc."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from waychair.planning.window.motion_limits import (
    PERIOD,
    CommandedMotion,
    DwaSettings,
    braking_hard,
    motion_after,
    slowing_speed,
    stopping,
    towards,
    towards_each,
)
from waychair.types import Twist

PROMPT = DwaSettings(reaction_time=0.0)


@given(st.floats(0.0, 3.0), st.floats(0.0, 0.5))
@settings(max_examples=100, deadline=None)
def test_the_speed_before_a_slow_place_leaves_the_distance_for_half_the_braking_and_jerk(
    way: float, end: float
) -> None:
    """Against the profile itself: the acceleration goes down by the jerk, stays, and comes back, in fine steps."""
    a, jerk, speed = DwaSettings().braking / 2, DwaSettings().jerk / 2, slowing_speed(way, end, DwaSettings())
    down = speed - end
    ramp = min(a / jerk, math.sqrt(max(down, 0.0) / jerk))
    level = max(down - jerk * ramp**2, 0.0) / a
    times = np.linspace(0.0, 2 * ramp + level, 20001)
    slowing = jerk * np.minimum(np.minimum(times, ramp), times[-1] - times)
    v = speed - np.concatenate([[0.0], np.cumsum((slowing[1:] + slowing[:-1]) / 2 * np.diff(times))])
    assert v[-1] == pytest.approx(end, abs=1e-4)
    assert np.trapezoid(v, times) == pytest.approx(way, abs=1e-3)
    assert slowing_speed(-way, end, DwaSettings()) == pytest.approx(end)


@given(st.floats(0.02, 0.8), st.floats(-0.8, 0.8), st.floats(-1.5, 0.0))
@settings(max_examples=60, deadline=None)
def test_a_comfortable_stop_keeps_its_arc_and_ends_at_rest_with_limited_jerk(v: float, omega: float, a: float) -> None:
    command, motion, accelerations = Twist(v, omega), CommandedMotion(Twist(a)), [a]
    for _ in range(200):
        following = stopping(command, PROMPT, motion)
        motion, before, command = motion_after(motion, command, following, PROMPT), command, following
        assert 0.0 <= command.v <= before.v
        assert command.v * omega == pytest.approx(command.omega * v, abs=1e-6)
        accelerations.append((command.v - before.v) / PERIOD)
    assert abs(command.v) < 1e-3
    if abs(v) / PROMPT.braking >= abs(omega) / PROMPT.alpha and a == 0.0:
        # a fifth for the last step of a tick
        assert np.abs(np.diff(accelerations)).max() <= 1.2 * PROMPT.jerk * PERIOD


@given(st.floats(0.05, 0.8), st.floats(-0.2, 0.0))
@settings(max_examples=60, deadline=None)
def test_after_hard_braking_the_chair_backs_out_no_faster_than_allowed(v: float, target: float) -> None:
    command, motion, slowest = Twist(v), CommandedMotion(), 0.0
    for tick in range(200):
        following = braking_hard(command, PROMPT) if tick < 6 else towards(command, Twist(target), PROMPT, motion)
        motion, command = motion_after(motion, command, following, PROMPT), following
        slowest = min(slowest, command.v)
    assert slowest >= target - 0.01
    assert command.v == pytest.approx(target, abs=0.01)


@pytest.mark.parametrize("share", [0.95, 0.9, 0.85])
@pytest.mark.parametrize("wanted", [Twist(0.8, 0.0), Twist(0.4, 0.4), Twist(0.0, 0.8)])
def test_a_briefly_limited_command_soon_recovers_and_causes_no_stop(share: float, wanted: Twist) -> None:
    """The collision monitor limits it at once, by more than the jerk could recover in time."""
    cut = Twist(share * wanted.v, share * wanted.omega)
    motion, command = motion_after(CommandedMotion(), wanted, cut, PROMPT), cut
    shares = []
    for _ in range(50):
        following = towards(command, wanted, PROMPT, motion)
        motion, command = motion_after(motion, command, following, PROMPT), following
        shares.append((command.v + command.omega) / (wanted.v + wanted.omega))
    assert min(shares) > share - 0.65
    assert min(shares) > 0.2
    assert shares[-1] > 0.99


@given(st.floats(0.0, 0.4), st.floats(0.0, 0.8), st.floats(-1.5, 0.0))
def test_hard_braking_does_not_continue_into_reverse(v: float, target: float, a: float) -> None:
    assert towards(Twist(v), Twist(target), PROMPT, CommandedMotion(Twist(a))).v >= 0.0
    assert towards(Twist(-v), Twist(-target), PROMPT, CommandedMotion(Twist(-a))).v <= 0.0


def most_eased(left: float, change: float) -> float:
    """Return the greatest step after which steps, each smaller by the change, stay within the remaining distance."""
    low, high = 0.0, left
    for _ in range(60):
        step = (low + high) / 2
        goes = np.maximum(step - change * np.arange(math.ceil(step / change) + 1), 0.0).sum()
        low, high = (step, high) if goes <= left else (low, step)
    return low


def plainly_towards(command: Twist, target: Twist, acceleration: Twist | None) -> Twist:
    """A plain reference of `towards`: a straight line to the limits, with the change of acceleration within the jerk
    limit."""
    s, after = PROMPT, []
    faster = s.acceleration if command.v == 0 or (target.v - command.v) * command.v > 0 else s.braking
    times = abs(target.v - command.v) / faster, abs(target.omega - command.omega) / s.alpha
    share = PERIOD / max(*times, PERIOD)
    now = (None, None) if acceleration is None else (acceleration.v, acceleration.omega)
    for begin, end, a, jerk in zip(
        (command.v, command.omega), (target.v, target.omega), now, (s.jerk, s.alpha_jerk), strict=True
    ):
        if a is None:
            after.append(begin + share * (end - begin))
            continue
        most = most_eased(abs(end - begin), jerk * PERIOD**2) / PERIOD
        wanted = float(np.clip(share * (end - begin) / PERIOD, -most, most))
        after.append(begin + PERIOD * float(np.clip(wanted, a - jerk * PERIOD, a + jerk * PERIOD)))
    way = command.v if command.v != 0 else target.v
    if acceleration is not None and after[0] * way <= 0:
        after[0] = 0.0
    return Twist(*after)


SPEEDS = st.one_of(st.just(0.0), st.floats(-0.8, 0.8))


@given(SPEEDS, SPEEDS, st.lists(st.tuples(SPEEDS, SPEEDS), max_size=5), st.none() | st.tuples(SPEEDS, SPEEDS))
@example(0.0, 0.0, [(0.0, 0.0625)], (0.0, 0.5))
@settings(max_examples=200, deadline=None)
def test_steps_towards_many_targets_equal_a_plain_reference(
    v: float, omega: float, targets: list[tuple[float, float]], accelerations: tuple[float, float] | None
) -> None:
    command, now = Twist(v, omega), None if accelerations is None else Twist(*accelerations)
    motion = None if now is None else CommandedMotion(now)
    found = towards_each(command, np.array(targets).reshape(-1, 2), PROMPT, motion)
    assert len(found) == len(targets)
    for step, target in zip(found.tolist(), targets, strict=True):
        one, plain = towards(command, Twist(*target), PROMPT, motion), plainly_towards(command, Twist(*target), now)
        assert step == [one.v, one.omega]
        assert step == pytest.approx([plain.v, plain.omega], abs=1e-12)
