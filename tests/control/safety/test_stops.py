"""The table of stops: complete, in plain words, and consistent with the board's advice."""

from __future__ import annotations

import pytest

from waychair.control.safety.stops import STOPS, Braking, Halt, Severity, board_halt, gravest, halt, halt_as_told
from waychair.firmware_bridge.advice import FAULT_ADVICE, HOST_FAULTS
from waychair.firmware_bridge.protocol import BoardFault


@pytest.mark.parametrize("stop_id", list(STOPS))
def test_every_stop_has_a_plain_sentence_and_a_remedy(stop_id: str) -> None:
    stop = STOPS[stop_id]
    assert stop.id == stop_id == stop_id.lower()
    for words in (stop.sentence, stop.remedy):
        assert len(words.split()) >= 2
        assert words[0].islower() or words.split()[0] in ("Stop", "IMU")
        assert not words.endswith(".")
        assert ":" not in words


def test_ids_are_unique() -> None:
    assert len({stop.id for stop in STOPS.values()}) == len(STOPS)
    assert len({stop.sentence for stop in STOPS.values()}) == len(STOPS)


@pytest.mark.parametrize("fault", list(FAULT_ADVICE))
def test_every_fault_of_the_board_is_a_stop_with_its_own_text_and_only_a_reset_clears_the_grave_ones(
    fault: BoardFault,
) -> None:
    halted = board_halt(FAULT_ADVICE[fault])
    assert halted.text == FAULT_ADVICE[fault] == f"{halted.stop.sentence}: {halted.stop.remedy}"
    assert halted.stop.severity is (Severity.ENDS if fault in HOST_FAULTS else Severity.LATCHES)
    assert halted.stop.braking is Braking.RELEASE


def test_other_errors_of_the_board_are_shown_unchanged() -> None:
    halted = board_halt("the cable to the board was lost: plug it in")
    assert (halted.stop.id, halted.text) == ("board_unusable", "the cable to the board was lost: plug it in")


def test_a_halt_shows_its_figures_between_the_sentence_and_the_remedy() -> None:
    assert halt("tilt", "9 degrees").text == "the floor is too steep (9 degrees): drive to level ground by joystick"
    assert halt_as_told("disobeys", "it stands: push it").text == "it stands: push it"


def test_the_gravest_halt_wins_and_the_first_among_equals() -> None:
    lost, blind, stuck = halt("lost"), halt("lidar_blind"), halt("disobeys")
    assert gravest([lost, blind]) == lost
    assert gravest([lost, blind, stuck]) == stuck
    assert gravest(list[Halt]()) is None
