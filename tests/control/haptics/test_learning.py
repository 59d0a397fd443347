"""Learning a rider from symbols and motion that are made here."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from waychair.control.haptics.course import tolerated_error
from waychair.control.haptics.guide_numbers import MOST_TOLERANT
from waychair.control.haptics.learning import KEPT, PRIOR, RiderLearner
from waychair.control.haptics.rider import LIMITS, SEEN_TO_OBEY, RiderModel
from waychair.control.haptics.symbols import Symbol
from waychair.types import Twist

TICK_S = 0.05


def taught(
    learner: RiderLearner, lag_s: float, nudge: float, swivel: float, veer: float, rounds: int, wrong: float = 0.0
) -> None:
    """Let a rider of these figures answer rounds of: forward, two nudges, rest, a turn, rest; some nudges are ignored."""
    rng, now = np.random.default_rng(3), 0.0
    for number in range(rounds):
        drives, turns = (1.0, 8.0), (12.0, 15.0)
        side = 1.0 if number % 2 else -1.0
        ignored = rng.random() < wrong
        said = {
            0.5: (Symbol.FORWARD, 0.45),
            4.0: (Symbol.NUDGE_LEFT if side > 0.0 else Symbol.NUDGE_RIGHT, 0.26),
            7.5: (Symbol.WARNING, 0.25),
            10.0: (Symbol.SWIVEL_LEFT if side > 0.0 else Symbol.SWIVEL_RIGHT, 0.448),
            14.0: (Symbol.WARNING, 0.25),
        }
        drives = 0.95 + lag_s, 7.75 + lag_s
        turns = 10.448 + lag_s, 14.25 + lag_s
        nudged = 4.26 + lag_s, 4.46 + lag_s
        for tick in range(400):
            at = round(tick * TICK_S, 2)
            v = 0.3 if drives[0] <= at < drives[1] else 0.0
            omega = veer if v else side * swivel if turns[0] <= at < turns[1] else 0.0
            if nudged[0] <= at + TICK_S / 2 < nudged[1] and not ignored:
                omega += side * nudge / 0.2
            now_ns = round((now + at) * 1e9)
            if at in said:
                learner.note_said(said[at][0], now_ns, said[at][1], Twist(v, omega))
            learner.note_motion(now_ns, Twist(v, omega))
        now += 20.0


def test_lag_nudge_swivel_and_veer_are_found_within_the_bars() -> None:
    learner = RiderLearner()
    taught(learner, 0.85, math.radians(4.5), 0.7, 0.03, rounds=20)
    assert abs(learner.model.lag_s - 0.85) < 0.08
    assert abs(learner.model.nudge - math.radians(4.5)) < math.radians(1.0)
    assert abs(learner.model.swivel - 0.7) < 0.05
    assert abs(learner.model.veer_per_m - 0.1) < 0.03


def test_symbols_without_an_answer_do_not_spoil_the_figures_but_are_counted() -> None:
    learner = RiderLearner()
    taught(learner, 0.65, math.radians(4.0), 0.5, 0.0, rounds=20, wrong=0.3)
    assert abs(learner.model.nudge - math.radians(4.0)) < math.radians(1.0)
    assert sum(count for (_, done), count in learner.answers().items() if done == "nothing") > 0


def test_a_rider_who_mixes_symbols_up_is_known_by_the_share_and_tolerated_more() -> None:
    learners = RiderLearner(), RiderLearner()
    for learner, right in zip(learners, (1.0, 0.6), strict=True):
        for k in range(20):
            done = "left" if k < 20 * right else "forward"
            learner.note_answer(Symbol.SWIVEL_LEFT, done, 0.7)
        learner.note_answer(Symbol.NUDGE_LEFT, "nothing", None)  # a nudge is not judged: the chair's veer may hide it
    sure, unsure = (learner.model for learner in learners)
    assert sure.sure == pytest.approx((20 + PRIOR * SEEN_TO_OBEY) / (20 + PRIOR))
    assert unsure.sure == pytest.approx((12 + PRIOR * SEEN_TO_OBEY) / (20 + PRIOR))
    tolerated = [tolerated_error(each, 0.3, 0.05) for each in (sure, unsure)]
    assert tolerated[0] == tolerated_error(RiderModel(), 0.3, 0.05)
    assert 1.5 * tolerated[0] < tolerated[1] <= MOST_TOLERANT * tolerated[0]


@pytest.mark.parametrize(("lasts_s", "learnt"), [(0.2, 0.5), (1.5, 0.8)])
def test_the_rate_of_a_turn_counts_only_if_it_was_held_long_enough_to_be_full(lasts_s: float, learnt: float) -> None:
    learner = RiderLearner(RiderModel(swivel=0.5))
    for number in range(12):
        learner.note_said(Symbol.SWIVEL_LEFT, number * 6_000_000_000, 0.45, Twist())
        for tick in range(120):
            at = tick * TICK_S
            turned = min(max(at - 1.1, 0.0), lasts_s)
            omega = min(1.0, turned / 0.4) * 0.8 if at < 1.1 + lasts_s else 0.0
            learner.note_motion(number * 6_000_000_000 + round(at * 1e9), Twist(0.0, omega))
    assert learner.model.swivel == pytest.approx(learnt)


def test_nothing_outside_the_limits_is_learnt_and_a_motion_without_numbers_is_ignored() -> None:
    learner = RiderLearner()
    taught(learner, 0.65, math.radians(60.0), 4.0, 0.5, rounds=10)
    for tick in range(100):
        learner.note_motion(tick, Twist(math.nan, math.inf))
    for name, (low, high) in LIMITS.items():
        assert low <= getattr(learner.model, name) <= high


def test_a_reset_forgets_the_rider_and_the_export_is_plain() -> None:
    learner = RiderLearner(RiderModel(lag_s=0.7))
    taught(learner, 0.9, math.radians(4.0), 0.5, 0.0, rounds=8)
    exported = learner.exported()
    assert exported["figures"]["lag_s"] != 0.7
    assert len(exported["values"]["lag_s"]) >= 8
    learner.reset()
    assert learner.model == RiderModel(lag_s=0.7)
    assert not learner.answers()


def told_forward(learner: RiderLearner, speeds: Callable[[float], float]) -> None:
    """Tell FORWARD at rest at 0 s; `speeds` is the chair's speed [m/s] at a time after the pattern's end [s]."""
    learner.note_said(Symbol.FORWARD, 0, 0.45, Twist(0.0, 0.0))
    for tick in range(60):
        learner.note_motion(round(tick * TICK_S * 1e9), Twist(speeds(tick * TICK_S - 0.45), 0.0))


def test_the_lag_of_a_chair_that_speeds_up_slowly_is_that_of_its_way() -> None:
    learner = RiderLearner()
    told_forward(learner, lambda after_s: 0.3 * min(max(after_s - 0.5, 0.0) / 0.8, 1.0))
    assert learner.values()["lag_s"] == pytest.approx([0.9], abs=0.03)


def test_a_chair_that_moves_before_any_driver_can_react_teaches_no_lag() -> None:
    learner = RiderLearner()
    told_forward(learner, lambda after_s: 0.3 if after_s > 0.0 else 0.0)
    assert learner.values()["lag_s"] == []
    assert learner.answers()[Symbol.FORWARD.value, "forward"] == 1


def test_what_was_known_before_counts_until_there_are_enough_values_which_are_restored_whole() -> None:
    learner = RiderLearner()
    learner.restore({"lag_s": [1.0] * (PRIOR + 1)}, {})
    assert RiderModel().lag_s < learner.model.lag_s <= 1.0
    values = {"lag_s": [0.5] * 12 + [1.0] * (KEPT - 12)}
    learner.restore(values, {})
    assert learner.model.lag_s == 1.0
    assert learner.values()["lag_s"] == values["lag_s"]


def test_the_veer_is_learnt_although_the_driver_is_nudged_all_the_time() -> None:
    learner = RiderLearner()
    lag_s = learner.model.lag_s
    due = [2.0 + 0.7 * k for k in range(10)]  # nudges to the left against a chair that pulls to the right
    for tick in range(240):
        at = tick * TICK_S
        if at == 0.0:
            learner.note_said(Symbol.FORWARD, 0, 0.45, Twist(0.0, 0.0))
        if any(abs(at - begin) < 1e-6 for begin in due):
            learner.note_said(Symbol.NUDGE_LEFT, round(at * 1e9), 0.26, Twist(0.25, -0.03))
        drives = at > 0.45 + lag_s
        nudged = any(0.0 <= at - begin - 0.26 - lag_s < 0.2 for begin in due)
        omega = (-0.03 + (0.15 if nudged else 0.0)) if drives else 0.0
        learner.note_motion(round(at * 1e9), Twist(0.25 if drives else 0.0, omega))
    assert learner.model.veer_per_m == pytest.approx(-0.12, abs=0.02)
    assert learner.model.nudge == pytest.approx(0.03, abs=0.01)
