"""The paper's signals as PLAY: on change, again after a while, the warning at once, and within the board's limits."""

from __future__ import annotations

import math

import pytest

from waychair.control.behaviours.commands import Move, Signal, SignalKind
from waychair.control.behaviours.glove import GloveLayout
from waychair.control.behaviours.presets import preset_network
from waychair.control.behaviours.runtime import Runtime
from waychair.control.behaviours.sonar import Obstacle
from waychair.control.haptics.paper_preset import PaperMemory, paper_advice, paper_play
from waychair.firmware_bridge.glove.messages import ON_MAX_MS

MS = 1_000_000
STATIC = GloveLayout((0.0, math.pi / 2))
WARNING = Signal(SignalKind.WARNING, "no way is free")
AHEAD = Signal(SignalKind.DIRECTION, "door", Move.GO, 0.0)
LEFT = Signal(SignalKind.DIRECTION, "door", Move.GO, math.pi / 2)


def masks(signal: Signal) -> list[int]:
    """Motors of each step."""
    play = paper_play(signal, STATIC)
    return [] if play is None else [step.mask for step in play.steps]


def test_the_papers_codes_become_steps_of_the_same_motors() -> None:
    assert masks(AHEAD) == [1 << 7, 1 << 4, 1 << 1]
    assert masks(Signal(SignalKind.DIRECTION, "", Move.SWIVEL, -1.0)) == [1 << 1, 1 << 5, 1 << 7, 1 << 3]
    assert masks(WARNING) == [0b1_1111_1111]
    immediate, far = int(Obstacle.IMMEDIATE), int(Obstacle.FAR)
    assert masks(Signal(SignalKind.SPACE, "", classes=(far, immediate))) == [1 << 3]
    assert masks(Signal(SignalKind.SPACE, "", classes=(far, far))) == []


@pytest.mark.parametrize("k", range(8))
def test_every_direction_fits_the_board(k: int) -> None:
    play = paper_play(Signal(SignalKind.DIRECTION, "", Move.GO, k * math.pi / 4 - math.pi + 0.01), STATIC)
    assert play is not None
    assert all(0 < step.on_ms <= ON_MAX_MS and step.strength > 0 for step in play.steps)


def _said(signals: list[tuple[int, Signal]], until_ms: int) -> list[int]:
    """Times [ms] at which something was played, in ticks of 50 ms; each signal holds from its time on."""
    memory, times = PaperMemory(), []
    for now_ms in range(0, until_ms, 50):
        signal = [each for since, each in signals if since <= now_ms][-1]
        play, memory = paper_advice(signal, STATIC, memory, now_ms * MS)
        if play is not None:
            times.append(now_ms)
    return times


def test_a_signal_is_sent_once_and_again_after_a_while() -> None:
    assert _said([(0, AHEAD)], 6000) == [0, 2450, 4900]


def test_another_signal_leaves_the_gap_and_a_warning_leaves_none() -> None:
    assert _said([(0, AHEAD), (100, LEFT)], 2000) == [0, 850]
    assert _said([(0, AHEAD), (100, WARNING)], 2000) == [0, 100]


def test_the_signal_of_the_papers_network_is_played_as_its_own_tactor_code() -> None:
    done = Runtime(preset_network("paper", {})).innervate(0)
    signal, code = done.ports["encode_packet"].eo, done.actions["vibrotactors"]
    play = paper_play(signal, STATIC)
    assert play is not None
    assert [step.mask for step in play.steps] == [sum(1 << k for k in each.tactors) for each in code.stimuli]
    assert [step.on_ms for step in play.steps] == [each.milliseconds for each in code.stimuli]
