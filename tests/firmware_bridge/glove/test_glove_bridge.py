"""The bridge with the shipped firmware at the other end: session, patterns, lost frames, defects, wrong gloves."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.firmware_bridge.glove.rig import spans
from waychair.control.haptics.patterns import vocabulary
from waychair.control.haptics.symbols import Symbol
from waychair.errors import BridgeError, GloveError, TransportError
from waychair.firmware_bridge.glove import glove_advice
from waychair.firmware_bridge.glove.bridge import SESSION_LOST, SILENT, GloveBridge
from waychair.firmware_bridge.glove.fitting import Fitting, tuned_gain, turned_from_answers
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.glove.messages import (
    GLOVE_LAYOUT_HASH,
    GloveRefusal,
    GloveReply,
    Hand,
    PlayRefusal,
    glove_hello,
)
from waychair.firmware_bridge.glove.program import GloveConfig, GloveInputs, HostGlove
from waychair.firmware_bridge.transports import Reconnecting, Transport

GLOVE = layout_named("glove_3x3")
WORDS = vocabulary("glove_3x3")
FORWARD = WORDS.patterns[Symbol.FORWARD].steps()
MS = 1_000_000


class Worn:
    """A rider's glove: the bridge and the program, in ticks of 10 ms; `levels` are all since the start."""

    def __init__(self, program: Path, config: GloveConfig | None = None, fitting: Fitting | None = None) -> None:
        self.glove = HostGlove(program, config)
        self.lose: list[bool] = []
        self.plugged = True
        self.cable = Reconnecting(self._connect)
        self.bridge = GloveBridge(self.cable, "A", GLOVE, fitting or Fitting())
        self.now_ms = 0
        self.inputs = GloveInputs()
        self.levels = np.zeros((0, 16), np.uint8)
        self.presses = [0, 0]

    def _connect(self) -> Transport:
        if not self.plugged:
            raise TransportError("the glove is not plugged in: plug it in")
        return Lossy(self)

    def run(self, ms: int, armed: bool = True) -> None:
        for _ in range(ms // 10):
            self.bridge.tick(self.now_ms * MS, armed)
            self.presses[0] += self.bridge.presses.repeat
            self.presses[1] += self.bridge.presses.yes
            self.now_ms += 10
            self.levels = np.concatenate([self.levels, self.glove.step(self.now_ms, self.inputs).levels])

    def play(self, symbol: Symbol, priority: int = 100, valid_ms: int = 500) -> str:
        return self.bridge.play(WORDS.patterns[symbol].steps(), priority, valid_ms, self.now_ms * MS)

    def felt(self, ms: int) -> dict[int, list[tuple[int, int]]]:
        """Run for so long; the vibrations of each motor in that time."""
        start = len(self.levels)
        self.run(ms)
        after = self.levels[start:]
        return {motor: spans(after, motor) for motor in range(16) if spans(after, motor)}


class Lossy:
    """The program's end of the cable, that loses what is written while `lose` says so, and can be unplugged."""

    def __init__(self, worn: Worn) -> None:
        self._worn = worn

    def write(self, data: bytes) -> bool:
        if self._worn.lose and self._worn.lose.pop(0):
            return True
        return self._worn.glove.transport.write(data)

    def read(self) -> bytes:
        return self._worn.glove.transport.read()

    def fileno(self) -> int:
        return self._worn.glove.transport.fileno()

    @property
    def closed(self) -> bool:
        return not self._worn.plugged or self._worn.glove.transport.closed

    def close(self) -> None:
        return None


@pytest.fixture
def worn(glove_program: Path) -> Iterator[Worn]:
    """A glove with a session."""
    rider = Worn(glove_program)
    with rider.glove:
        rider.run(100)
        yield rider


def problem(rider: Worn) -> str:
    return rider.bridge.problem(rider.now_ms * MS)


def test_a_pattern_is_felt_as_it_is_written(worn: Worn) -> None:
    assert worn.play(Symbol.FORWARD) == ""
    assert worn.felt(600) == {7: [(0, 150)], 4: [(150, 150)], 1: [(300, 150)]}
    assert worn.bridge.refusals == ()


def test_an_idle_session_stays_in_order_and_feels_of_nothing(worn: Worn) -> None:
    assert worn.felt(3000) == {}
    assert problem(worn) == ""
    assert worn.bridge.notices() == ()


def test_the_computers_death_is_felt_once_after_half_a_second(worn: Worn) -> None:
    worn.play(Symbol.FORWARD)
    worn.run(10)
    levels = np.concatenate([worn.glove.step(worn.now_ms + ms + 500).levels for ms in (0, 500, 1000, 1500, 2000)])
    silence = spans(levels, 0)
    assert [length for _, length in silence] == [200, 200]
    assert 480 <= silence[0][0] <= 500  # counted from the last frame, which is up to 10 ms older


def test_a_pattern_lost_on_the_cable_is_sent_once_more(worn: Worn) -> None:
    worn.run(20)
    worn.lose = [True]
    assert worn.play(Symbol.FORWARD) == ""
    felt = worn.felt(700)
    assert [spans_[0][1] for spans_ in felt.values()] == [150, 150, 150]
    assert 30 <= felt[7][0][0] <= 100
    worn.lose = [True] * 2
    worn.play(Symbol.FORWARD)
    assert worn.felt(700) == {}
    assert worn.bridge.refusals == ("the pattern was lost on the cable to the glove: check its plug",)


def test_a_lost_pattern_is_not_sent_when_it_is_late(worn: Worn) -> None:
    worn.run(20)
    worn.lose = [True]
    worn.play(Symbol.FORWARD, valid_ms=10)
    assert worn.felt(700) == {}
    assert "lost" in worn.bridge.refusals[0]


def test_a_glove_that_is_unplugged_and_plugged_in_again_is_greeted_again(worn: Worn) -> None:
    worn.plugged = False
    worn.run(50)
    assert "cannot be reached" in problem(worn)
    assert worn.play(Symbol.FORWARD) == problem(worn)
    worn.plugged = True
    worn.run(1500)
    assert problem(worn) == ""
    worn.play(Symbol.FORWARD)
    assert set(worn.felt(600)) == {7, 4, 1}
    worn.run(1000)
    worn.plugged = False
    worn.run(50)
    assert worn.bridge.refusals == ()  # the pattern was over


def test_a_glove_that_is_unplugged_in_a_pattern_is_told_to_have_lost_it(worn: Worn) -> None:
    worn.play(Symbol.FORWARD)
    worn.run(100)
    worn.plugged = False
    worn.run(50)
    assert worn.bridge.refusals == (SESSION_LOST,)


def test_a_glove_that_reboots_or_hangs_is_silent_until_it_is_greeted(worn: Worn) -> None:
    for defect in (GloveInputs(powered=False), GloveInputs(frozen=True)):
        worn.play(Symbol.ARRIVED)
        worn.run(50)
        worn.inputs = defect
        worn.run(400)
        assert problem(worn) == SILENT
        assert worn.bridge.refusals == (SESSION_LOST,)
        assert not worn.levels[-250:].any()  # the watchdog's 100 ms later at most
        worn.inputs = GloveInputs()
        worn.run(1500)
        assert problem(worn) == ""
        worn.play(Symbol.FORWARD)
        assert set(worn.felt(700)) == {7, 4, 1}


def test_a_dead_glove_is_told_and_plays_nothing(worn: Worn) -> None:
    worn.glove.kill()
    worn.run(400)
    assert worn.play(Symbol.WARNING, priority=200) != ""
    assert not worn.levels[-300:].any()


def test_a_symbol_that_needs_a_broken_motor_is_not_played_and_the_motor_is_named(worn: Worn) -> None:
    worn.inputs = GloveInputs(open_motors=1 << 5)
    worn.run(100)
    assert "motor 5 of the glove does not vibrate" in worn.bridge.notices()[0]
    assert worn.play(Symbol.NUDGE_RIGHT) == worn.bridge.notices()[0]
    assert worn.play(Symbol.NUDGE_LEFT) == ""
    assert set(worn.felt(700)) == {4, 3}
    worn.play(Symbol.WARNING, priority=200)
    assert set(worn.felt(500)) == {0, 1, 2, 3, 4, 6, 7, 8}
    worn.inputs = GloveInputs(shorted_motors=1 << 4)
    worn.run(100)
    assert "motor 4 of the glove is shorted" in worn.bridge.notices()[0]


def test_a_motor_that_breaks_in_the_middle_is_told_by_the_board(worn: Worn) -> None:
    worn.play(Symbol.FORWARD)
    worn.run(50)
    worn.inputs = GloveInputs(open_motors=1 << 4)
    worn.run(300)
    assert worn.bridge.refusals == (glove_advice.PLAY_REFUSALS[PlayRefusal.FAULTY],)


def test_a_glove_that_is_not_worn_is_told(worn: Worn) -> None:
    worn.inputs = GloveInputs(worn=False)
    worn.run(100)
    assert worn.play(Symbol.FORWARD) == "the glove is not worn: put it on"


def test_a_refusal_of_the_board_becomes_a_sentence(worn: Worn) -> None:
    worn.inputs = GloveInputs(temperature_c=50)
    worn.run(100)
    assert worn.play(Symbol.FORWARD) == ""
    worn.run(100)
    assert worn.bridge.refusals == ("the glove is too warm: it plays again when it has cooled down",)


def test_presses_of_the_buttons_are_counted_once(worn: Worn) -> None:
    for inputs in (GloveInputs(repeat=True), GloveInputs(), GloveInputs(repeat=True, yes=True), GloveInputs()):
        worn.inputs = inputs
        worn.run(100)
    assert worn.presses == [2, 1]


def test_garbled_bytes_are_survived_and_the_next_frame_is_heard(worn: Worn) -> None:
    worn.glove.transport.write(b"\xff\x00\x01\x02\x03\x00" + os.urandom(300).replace(b"\0", b"\1"))
    worn.run(600)
    assert problem(worn) == ""
    worn.play(Symbol.FORWARD)
    assert set(worn.felt(600)) == {7, 4, 1}


@pytest.mark.parametrize(
    ("config", "told"),
    [
        (GloveConfig("B"), "this is the glove 'B', but the rider's is 'A'"),
        (GloveConfig(layout="belt_8"), "the layout 'belt_8' with 8 motors, the rider's patterns are for 'glove_3x3'"),
        (GloveConfig(hand=Hand.LEFT), "made for the left hand, but the rider's fitting is for the right one"),
    ],
)
def test_a_wrong_glove_plays_nothing_and_is_told(glove_program: Path, config: GloveConfig, told: str) -> None:
    rider = Worn(glove_program, config)
    with rider.glove:
        rider.run(700)
        assert told in problem(rider)
        assert rider.play(Symbol.FORWARD) == problem(rider)
        assert rider.felt(700) == {}


def test_other_firmware_is_named() -> None:
    ours = glove_hello("A", 1)
    right = GloveReply(1, GLOVE_LAYOUT_HASH, 0x0100, ours.device_id, 1, 9, Hand.RIGHT, 0)
    wrong = {
        "speaks version 2": replace(right, version=2, refused=GloveRefusal.VERSION),
        "another message table": replace(right, layout_hash=1, refused=GloveRefusal.TABLE),
        "has firmware 2.1": replace(right, firmware_version=0x0201),
        "with 8 motors": replace(right, motors=8),
        "unknown layout 77": replace(right, layout=77, refused=GloveRefusal.LAYOUT),
        "unknown reason (128)": replace(right, refused=128),
        "the unknown hand": replace(right, hand=9),
    }
    assert glove_advice.reply_problem(right, ours, GLOVE, Fitting()) == ""
    for told, reply in wrong.items():
        assert told in glove_advice.reply_problem(reply, ours, GLOVE, Fitting())


def test_of_two_gloves_of_one_name_only_the_one_on_the_riders_port_is_spoken_to(glove_program: Path) -> None:
    rider, other = Worn(glove_program), HostGlove(glove_program, None)
    with rider.glove, other:
        for tick in range(140):
            rider.run(10)
            if tick == 70:
                assert rider.play(Symbol.FORWARD) == ""
            assert not other.step(rider.now_ms).levels.any()
    assert rider.levels.any()


def test_a_glove_put_on_askew_is_turned_by_the_answers_of_its_rider(glove_program: Path) -> None:
    # The glove sits an eighth to the left: its output 0 is foremost, 3 is at the front left, and so on.
    (ring,) = GLOVE.rings
    turned = turned_from_answers([0, 0, 3, 0, 0], ring)
    assert turned == 1
    rider = Worn(glove_program, fitting=Fitting(turned=(turned,)))
    with rider.glove:
        rider.run(100)
        rider.play(Symbol.FORWARD)
        assert rider.felt(900) == {8: [(0, 150)], 4: [(150, 150)], 0: [(300, 150)]}
        rider.play(Symbol.NUDGE_LEFT)
        assert rider.felt(600) == {4: [(0, 130)], 6: [(130, 130)]}


def test_gains_are_of_places_and_follow_the_turn(glove_program: Path) -> None:
    gains = tuple(255 if place != 1 else 128 for place in range(9))
    rider = Worn(glove_program, fitting=Fitting(turned=(1,), gains=gains))
    with rider.glove:
        rider.run(100)
        rider.play(Symbol.FORWARD)
        rider.run(600)
        assert rider.levels[:, 0].max() == round(195 * 128 / 255)
        assert rider.levels[:, 8].max() == 195


@pytest.mark.parametrize(
    ("answers", "told"),
    [
        ([1, 1], "2 answers"),
        ([1, 1, 4], "motor 4 is not one of the ring"),
        ([1, 7, 1, 7], "the answers name different motors"),
    ],
)
def test_answers_that_decide_nothing_are_refused(answers: list[int], told: str) -> None:
    with pytest.raises(GloveError, match=told):
        turned_from_answers(answers, GLOVE.rings[0])


def test_impossible_fittings_are_refused() -> None:
    for fitting, told in (
        (Fitting(turned=(1, 1)), "turns 2 rings"),
        (Fitting(gains=(255,) * 8), "has 8 gains"),
        (Fitting(gains=(255,) * 8 + (79,)), "gain of motor 8 is 79"),
    ):
        with pytest.raises(GloveError, match=told):
            fitting.check(GLOVE)


def test_tuning_makes_a_weak_motor_stronger_within_limits() -> None:
    assert tuned_gain(160, "weaker") == 200
    assert tuned_gain(160, "same") == 160
    assert tuned_gain(90, "stronger") == 80
    assert tuned_gain(250, "weaker") == 255
    with pytest.raises(GloveError, match="'hm' is no answer"):
        tuned_gain(160, "hm")


def test_impossible_inputs_of_the_program_are_refused(worn: Worn) -> None:
    with pytest.raises(BridgeError, match="cannot be given to the glove"):
        worn.glove.step(worn.now_ms + 1, GloveInputs(temperature_c=300))
