"""A page's joystick: silence lets go, and an interrupted push does not resume by itself."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.control.drive.steering import HELD_AT_REST_S, Steering, SteeringSettings
from waychair.types import Twist

S = 1_000_000_000
SETTINGS = SteeringSettings()
AXES = st.floats(-2.0, 2.0)


@given(AXES, AXES)
def test_it_never_asks_for_more_than_a_slow_walking_speed(forward: float, turn: float) -> None:
    steering = Steering()
    steering.push(forward, turn, 0)
    twist = steering.twist(0)
    assert -SETTINGS.reverse <= twist.v <= SETTINGS.speed
    assert abs(twist.omega) <= SETTINGS.turn
    assert math.copysign(1.0, twist.v) == math.copysign(1.0, forward) or twist.v == 0.0


def test_silence_lets_go() -> None:
    steering = Steering()
    steering.push(1.0, 0.0, 0)
    assert steering.twist(round(0.3 * S)) == Twist(SETTINGS.speed, 0.0)
    assert steering.twist(round(0.3 * S) + 1) == Twist()


def test_the_chair_is_held_at_rest_for_a_while_and_then_released() -> None:
    steering = Steering()
    steering.push(1.0, 0.0, 0)
    steering.let_go(S)
    assert (steering.counts(S), steering.twist(S)) == (True, Twist())
    steering.push(1.0, 0.0, 0)
    steering.let_go(0)
    stays = round(HELD_AT_REST_S * S)
    assert steering.counts(stays)
    assert not steering.counts(stays + 1)


@pytest.mark.parametrize(("forward", "turn"), [(math.nan, 0.0), (0.0, math.inf), (-math.inf, math.nan)])
def test_a_push_that_is_not_a_number_lets_go(forward: float, turn: float) -> None:
    steering = Steering()
    steering.push(1.0, 0.0, 0)
    assert not steering.push(forward, turn, 1)
    assert steering.twist(1) == Twist()


@pytest.mark.parametrize("gap_ms", [100, 400, 2000])
def test_an_interrupted_push_counts_again_only_after_a_release(gap_ms: int) -> None:
    steering = Steering()
    assert steering.push(1.0, 0.0, 0)
    steering.end()
    now_ns = 0
    for _ in range(10):  # also over gaps of the network
        now_ns += gap_ms * S // 1000
        assert not steering.push(1.0, 0.0, now_ns)
        assert not steering.counts(now_ns)
    steering.let_go(now_ns)
    assert not steering.counts(now_ns)
    assert steering.push(1.0, 0.0, now_ns + S)
    assert steering.twist(now_ns + S).v == SETTINGS.speed


def test_a_new_page_steers_after_another_one_died() -> None:
    steering = Steering()
    steering.push(1.0, 0.0, 0)
    steering.end()
    assert steering.push(1.0, 0.0, 3 * S)


@given(st.lists(st.tuples(st.sampled_from(["push", "let_go", "end", "wait"]), st.integers(0, S)), max_size=30))
def test_after_an_end_nothing_is_commanded_before_a_fresh_push(acts: list[tuple[str, int]]) -> None:
    steering, now_ns, ended = Steering(), 0, False
    for act, wait_ns in acts:
        now_ns += wait_ns
        if act == "push":
            ended = ended and not steering.push(1.0, 0.0, now_ns)
        elif act == "let_go":
            steering.let_go(now_ns)
        elif act == "end":
            steering.end()
            ended = True
        assert not (ended and steering.counts(now_ns))
        assert steering.counts(now_ns) or steering.twist(now_ns) == Twist()
