"""The driver who feels the motors: reactions, hand, patience."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.simulation.rider.played import LEARNT, WORDS, PlainGlove
from waychair.errors import ConfigError
from waychair.simulation.rider.blind_driver import ANSWERS, BlindDriver, DriverModel
from waychair.simulation.rider.driver_presets import DRIVERS, driver_named
from waychair.simulation.rider.hand import HandModel
from waychair.simulation.rider.skin import SkinModel

STEADY = DriverModel(
    skin=SkinModel(common=1e-3, single=1.0, timing=0.02),
    hand=HandModel(spread=0.0, bias=0.0, wander=0.0, drift=0.0),
    reaction_spread_s=0.0,
    startle_spread_s=0.0,
)


def sticks(
    said: dict[float, str], until_s: float, model: DriverModel = STEADY, seed: int = 0
) -> dict[float, tuple[float, float]]:
    """Return the stick (forward, turn) by time [s] with symbols said at times [s], on the tick."""
    driver, glove = BlindDriver(WORDS.layout, LEARNT, model, seed), PlainGlove()
    found = {}
    for tick in range(1, round(until_s / 0.05) + 1):
        at = round(tick * 0.05, 2)
        if at in said:
            glove.play(LEARNT[said[at]])
        stick = driver.step(tick * 50_000_000, glove.step(tick * 50))
        found[at] = stick.forward, stick.turn
    return found


def test_a_driver_pushes_ahead_a_reaction_after_the_end_of_forward_and_not_before() -> None:
    found = sticks({0.1: "forward"}, 2.0)
    ends = 0.05 + 0.45  # the glove has played since the last tick
    assert all(stick == (0.0, 0.0) for at, stick in found.items() if at < ends + 0.45)
    assert found[1.6][0] == pytest.approx(STEADY.hand.forward, abs=0.01)


@pytest.mark.parametrize(("symbol", "side"), [("swivel_left", 1.0), ("swivel_right", -1.0)])
def test_a_swivel_is_a_turn_alone_to_its_side(symbol: str, side: float) -> None:
    forward, turn = sticks({0.1: symbol}, 2.0)[2.0]
    assert abs(forward) < 1e-6
    assert turn == pytest.approx(side * STEADY.hand.swivel, abs=0.01)


def test_a_nudge_is_short_and_leaves_the_drive_ahead_as_it_was() -> None:
    found = sticks({0.1: "forward", 1.5: "nudge_left"}, 3.5)
    turns = [at for at, (_, turn) in found.items() if turn > 0.05]
    assert 0.1 <= turns[-1] - turns[0] <= 0.4
    assert found[3.5][1] == pytest.approx(0.0, abs=0.01)
    assert found[3.5][0] == pytest.approx(STEADY.hand.forward, abs=0.01)


def test_a_driver_lets_go_at_a_warning_and_after_three_seconds_of_silence() -> None:
    assert sticks({0.1: "forward", 2.0: "warning"}, 3.2)[3.2][0] == 0.0
    silent = sticks({0.1: "forward"}, 5.0)
    assert silent[3.8][0] > 0.2
    assert silent[4.6][0] == 0.0


def test_the_same_seed_moves_the_stick_alike_and_another_one_differently() -> None:
    said = {0.1: "forward", 1.5: "nudge_left"}
    default = DRIVERS["default"]
    assert sticks(said, 3.0, default, 1) == sticks(said, 3.0, default, 1)
    assert sticks(said, 3.0, default, 1) != sticks(said, 3.0, default, 2)


def test_an_older_driver_reacts_later_and_an_unknown_one_is_refused_by_name() -> None:
    assert driver_named("older").reaction_s > driver_named("default").reaction_s
    with pytest.raises(ConfigError, match=r"'oldest'.*older"):
        driver_named("oldest")


def test_a_driver_who_tries_pushes_ahead_after_a_rest_and_the_papers_directions_move_the_stick_both_ways() -> None:
    found = sticks({}, 12.0, replace(STEADY, tries_s=4.0))
    assert all(stick == (0.0, 0.0) for at, stick in found.items() if at < 4.0)
    assert found[5.0][0] > 0.2
    assert found[7.5] == (0.0, 0.0)  # nobody has said anything
    assert found[12.0][0] > 0.2
    left, back = ANSWERS["go front-left"], ANSWERS["go rear-right"]
    assert (left.forward > 0.5, left.turn > 0.5, back.forward < -0.5, back.turn < -0.5) == (True,) * 4
