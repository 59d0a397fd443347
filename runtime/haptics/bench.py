"""A glove on the bench, in real time: play one pattern, and fit the glove to a rider by questions."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from waychair.control.haptics.patterns import STRENGTHS
from waychair.control.haptics.profile import HapticsProfile
from waychair.errors import GloveError
from waychair.firmware_bridge.glove.bridge import SESSION_LOST, GloveBridge
from waychair.firmware_bridge.glove.fitting import (
    ANSWERS_MIN,
    GAIN_MAX,
    Fitting,
    tuned_gain,
    turned_from_answers,
)
from waychair.firmware_bridge.glove.glove_advice import PLAY_CUTS
from waychair.firmware_bridge.glove.layouts import TactorLayout, layout_named
from waychair.firmware_bridge.glove.levels import MotorLevels
from waychair.firmware_bridge.glove.messages import Hand, PlayCut, PlayStep
from waychair.firmware_bridge.glove.program import GloveConfig, HostGlove, glove_program
from waychair.firmware_bridge.transports import Reconnecting, check_port, transport_from_text

READY_S = 3.0
"""Time within which a glove must answer: a greeting is repeated every half second."""

TICK_S = 0.02

PROBE_MS, PROBE_REST_MS = 300, 300
"""Vibration and rest of a motor that the rider is asked about."""

COMPARISONS = 3
"""Times that a motor is compared with the foremost one, at most."""

PRIORITY = 100

PLAYS = 3
"""Times that a pattern is begun, at most, while the glove is interrupted: a busy computer holds up a glove's program."""

INTERRUPTED = {PLAY_CUTS[PlayCut.CLOCK], SESSION_LOST}

Ask = Callable[[str], str]
"""Asks the rider a question and returns the answer."""


class Bench:
    """A glove that is ready, and the time that passes while it plays."""

    def __init__(self, bridge: GloveBridge) -> None:
        self._bridge = bridge

    def wait(self, seconds: float, until: Callable[[int], bool] = lambda now_ns: False) -> None:
        """Keep the session alive for so long, or until something holds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._bridge.tick(time.monotonic_ns(), armed=False)
            if until(time.monotonic_ns()):
                return
            time.sleep(TICK_S)

    def ready(self) -> None:
        """Wait for the glove.

        Raises:
            GloveError: it does not answer, or cannot be used.
        """
        self.wait(READY_S, lambda now_ns: self._bridge.problem(now_ns) == "")
        problem = self._bridge.problem(time.monotonic_ns())
        if problem:
            raise GloveError(problem)

    def play(self, steps: Sequence[PlayStep]) -> None:
        """Play a pattern to its end; a glove that has waited for a slow answer, and heard nothing meanwhile, is greeted anew.

        Raises:
            GloveError: the glove does not play it.
        """
        for _ in range(PLAYS):
            refusals = self._played(steps)
            if not INTERRUPTED.intersection(refusals):
                break
        if refusals:
            raise GloveError("; ".join(refusals))

    def _played(self, steps: Sequence[PlayStep]) -> tuple[str, ...]:
        """Play a pattern once; return why it was not played to its end."""
        self.ready()
        problem = self._bridge.play(steps, PRIORITY, 500, time.monotonic_ns())
        if problem:
            return (problem,)
        self.wait(0.05 + sum(step.on_ms + step.off_ms for step in steps) / 1000.0)
        return self._bridge.refusals


@contextmanager
def open_bench(port: str, profile: HapticsProfile, fitting: Fitting) -> Iterator[Bench]:
    """Open the glove on a port, with a fitting.

    Raises:
        TransportError: the port's name has no known form.
        GloveError: the glove cannot be used.
    """
    check_port(port, "--port")
    cable = Reconnecting(lambda: transport_from_text(port, "--port"))
    bench = Bench(GloveBridge(cable, profile.device_id, layout_named(profile.layout), fitting))
    try:
        bench.ready()
        yield bench
    finally:
        cable.close()


def played_levels(profile: HapticsProfile, steps: Sequence[PlayStep]) -> MotorLevels:
    """Return the levels of the outputs while the glove's program on this computer plays a pattern.

    Raises:
        BoardBuildError: the program cannot be built or started.
        GloveError: the glove does not play the pattern.
    """
    config = GloveConfig(profile.device_id, profile.layout, Hand[profile.hand.upper()])
    layout = layout_named(profile.layout)
    with HostGlove(glove_program(), config) as glove:
        bridge = GloveBridge(Reconnecting(lambda: glove.transport), profile.device_id, layout, profile.fitting())
        now_ms = 0
        for now_ms in range(0, 100, 10):
            bridge.tick(now_ms * 1_000_000, armed=False)
            glove.step(now_ms)
        problem = bridge.play(steps, PRIORITY, 500, now_ms * 1_000_000)
        if problem:
            raise GloveError(problem)
        length = sum(step.on_ms + step.off_ms for step in steps)
        parts = []
        for _ in range(length // 100 + 1):
            now_ms += 100
            parts.append(glove.step(now_ms))
            bridge.tick(now_ms * 1_000_000, armed=False)
        if bridge.refusals:
            raise GloveError("; ".join(bridge.refusals))
        return joined(parts)


def joined(parts: Sequence[MotorLevels]) -> MotorLevels:
    """Return levels that follow each other as one."""
    return MotorLevels(parts[0].first_ms, np.concatenate([part.levels for part in parts]))


def find_turn(bench: Bench, layout: TactorLayout, ask: Ask) -> tuple[int, ...]:
    """Return by how far each ring sits to the left, by asking which of its motors felt where the ring begins, such as foremost.

    The bench must be open with a straight fitting.

    Raises:
        GloveError: the answers are no numbers, or disagree.
    """
    turns = []
    for ring in layout.rings:
        answers, site = [], layout.tactors[ring[0]].site
        for k in range(ANSWERS_MIN):
            begin = (
                k * (len(ring) // 2 + 1) % len(ring)
            )  # another motor begins each round, so that order decides nothing
            order = [*ring[begin:], *ring[:begin]]
            for motor in order:
                bench.play([_probe(motor, STRENGTHS[2])])
            question = f"{site}: which of the {len(ring)} felt {layout.rings_begin}, 1 to {len(ring)}? "
            answers.append(order[_number(ask(question), len(ring)) - 1])
        turns.append(turned_from_answers(answers, ring))
    return tuple(turns)


def find_gains(bench: Bench, layout: TactorLayout, ask: Ask) -> tuple[int, ...]:
    """Return the strength of each motor, of 255, by comparing it with the foremost one.

    Raises:
        GloveError: an answer is none of weaker, same and stronger.
    """
    foremost = layout.towards(0.0)
    gains = [_START_GAIN] * len(layout.tactors)
    for motor in range(len(layout.tactors)):
        for _ in range(COMPARISONS if motor != foremost else 0):
            bench.play([_probe(foremost, STRENGTHS[2] * gains[foremost] // GAIN_MAX)])
            bench.play([_probe(motor, STRENGTHS[2] * gains[motor] // GAIN_MAX)])
            felt = ask("did the second feel weaker, same or stronger? ").strip().lower()
            if felt == "same":
                break
            gains[motor] = tuned_gain(gains[motor], felt)
    return tuple(gains)


_START_GAIN = 200
"""Gain before tuning, so that a weak motor has room upwards."""


def fit(port: str, profile: HapticsProfile, ask: Ask) -> HapticsProfile:
    """Return a profile with the turn and the gains of this rider; raises as `open_bench`, `find_turn` and `find_gains`."""
    layout = layout_named(profile.layout)
    hand = Hand[profile.hand.upper()]
    with open_bench(port, profile, Fitting(hand)) as bench:
        turned = find_turn(bench, layout, ask)
    with open_bench(port, profile, Fitting(hand, turned)) as bench:
        gains = find_gains(bench, layout, ask)
    return replace(profile, turned=turned, gains=gains)


def _probe(motor: int, strength: int) -> PlayStep:
    return PlayStep(1 << motor, strength, PROBE_MS, PROBE_REST_MS)


def _number(text: str, most: int) -> int:
    if not text.strip().isdecimal() or not 1 <= int(text) <= most:
        raise GloveError(f"'{text.strip()}' is no answer: give a number from 1 to {most}")
    return int(text)
