"""When a symbol is said: priority, validity, interruption, repetition, silence."""

from __future__ import annotations

import pytest

from waychair.control.haptics.advice import AdviceMemory, Advised, advise, valid_ms
from waychair.control.haptics.patterns import vocabulary
from waychair.control.haptics.symbols import Advice, Symbol

WORDS = vocabulary("glove_3x3")
MS = 1_000_000
LATER = 3_600_000 * MS


def told(symbol: Symbol, number: int = 1, until_ms: int = 3_600_000, direction: float | None = None) -> Advice:
    return Advice(symbol, number, until_ms * MS, direction)


class Rider:
    """Advice in steps of 50 ms, and the times [ms] at which symbols were said."""

    def __init__(self) -> None:
        self.memory = AdviceMemory()
        self.now_ms = 0
        self.said: list[tuple[int, str]] = []
        self.stops: list[int] = []
        self.offers: list[int] = []

    def hold(self, *wanted: Advice, until_ms: int, asked: bool = False, reacted: bool | None = None) -> None:
        while self.now_ms < until_ms:
            done, self.memory = advise(wanted, WORDS, self.memory, self.now_ms * MS, asked=asked, reacted=reacted)
            self._note(done)
            asked = False
            self.now_ms += 50

    def _note(self, done: Advised) -> None:
        if done.say is not None:
            self.said.append((self.now_ms, done.say.symbol.value))
        if done.stop:
            self.stops.append(self.now_ms)
        if done.offer_repeat:
            self.offers.append(self.now_ms)


@pytest.fixture
def rider() -> Rider:
    return Rider()


def test_the_same_advice_is_said_once_and_repeated_once_when_it_is_ignored(rider: Rider) -> None:
    rider.hold(told(Symbol.FORWARD), until_ms=20_000)
    assert rider.said == [(0, "forward"), (3450, "forward")]
    assert rider.offers == [6900]


def test_silence_is_kept_when_nothing_is_wanted(rider: Rider) -> None:
    rider.hold(until_ms=5000)
    assert rider.said == rider.stops == rider.offers == []


def test_a_warning_interrupts_at_once_and_is_said_again_as_long_as_it_holds(rider: Rider) -> None:
    rider.hold(told(Symbol.FORWARD), until_ms=100)
    rider.hold(told(Symbol.FORWARD), told(Symbol.WARNING, 2), until_ms=4000)
    assert rider.said == [(0, "forward"), (100, "warning"), (1850, "warning"), (3600, "warning")]


def test_the_next_symbol_waits_for_the_gap_of_400_ms(rider: Rider) -> None:
    rider.hold(told(Symbol.NUDGE_LEFT, 1), until_ms=50)
    rider.hold(told(Symbol.NUDGE_LEFT, 2), until_ms=2000)
    assert rider.said == [(0, "nudge_left"), (700, "nudge_left")]  # 260 ms of pattern, 400 ms of gap, ticks of 50 ms


def test_guidance_stops_a_symbol_of_an_obstacle_and_leaves_its_gap(rider: Rider) -> None:
    rider.hold(told(Symbol.OBSTACLE_AT, 7, direction=0.5), until_ms=100)
    rider.hold(told(Symbol.FORWARD, 8), until_ms=1000)
    assert rider.said == [(0, "obstacle_at"), (500, "forward")]
    assert rider.stops == [100]


def test_obstacles_are_told_on_change_only_and_behind_everything_else(rider: Rider) -> None:
    obstacle = told(Symbol.OBSTACLE_AT, 7, direction=0.5)
    rider.hold(obstacle, told(Symbol.FORWARD, 1), until_ms=1000)
    assert rider.said == [(0, "forward")]
    rider.hold(obstacle, until_ms=8000)
    rider.hold(told(Symbol.OBSTACLE_AT, 8, direction=1.5), until_ms=9000)
    assert rider.said == [(0, "forward"), (1000, "obstacle_at"), (8000, "obstacle_at")]


def test_an_obstacle_is_told_again_when_the_rider_asks(rider: Rider) -> None:
    obstacle = told(Symbol.OBSTACLE_AT, 7, direction=0.5)
    rider.hold(obstacle, until_ms=5000)
    rider.hold(obstacle, until_ms=6000, asked=True)
    assert rider.said == [(0, "obstacle_at"), (5000, "obstacle_at")]


def test_advice_that_is_late_is_dropped(rider: Rider) -> None:
    rider.hold(told(Symbol.FORWARD, 1), until_ms=50)
    rider.hold(told(Symbol.NUDGE_LEFT, 2, until_ms=600), until_ms=2000)
    assert rider.said == [(0, "forward")]


def test_two_symbols_without_an_answer_are_followed_by_silence_until_the_rider_asks(rider: Rider) -> None:
    for number in range(1, 6):
        rider.hold(told(Symbol.NUDGE_LEFT, number), until_ms=1000 * number, reacted=False)
    assert rider.said == [(0, "nudge_left"), (1000, "nudge_left")]
    assert rider.offers == [2000]
    rider.hold(told(Symbol.NUDGE_LEFT, 6), until_ms=6000, asked=True, reacted=False)
    assert rider.said[-1] == (5000, "nudge_left")


def test_a_rider_who_reacts_is_guided_on(rider: Rider) -> None:
    for number in range(1, 6):
        rider.hold(told(Symbol.NUDGE_LEFT, number), until_ms=1000 * number)
    assert [when for when, _ in rider.said] == [0, 1000, 2000, 3000, 4000]
    assert rider.offers == []


def test_a_warning_is_said_even_to_a_rider_who_ignores_everything(rider: Rider) -> None:
    for number in range(1, 5):
        rider.hold(told(Symbol.NUDGE_LEFT, number), until_ms=1000 * number, reacted=False)
    rider.hold(told(Symbol.WARNING, 9), until_ms=4050, reacted=False)
    assert rider.said[-1] == (4000, "warning")


def test_the_time_of_validity_fits_the_message_and_is_never_negative() -> None:
    assert valid_ms(told(Symbol.FORWARD, until_ms=700), 200 * MS) == 500
    assert valid_ms(told(Symbol.FORWARD, until_ms=100), 200 * MS) == 0
    assert valid_ms(Advice(Symbol.FORWARD, 1, LATER), 0) == 65_535
