"""The glove: time to the first motor, the times of patterns, interruption, heat and nuisance limits, fuzz, silence."""

from __future__ import annotations

import os
import random
import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tests.firmware_bridge.glove.fuzzing import build_glove_fuzzer, fuzz_glove

from waychair.control.haptics.patterns import TouchVocabulary, vocabulary
from waychair.control.haptics.symbols import PRIORITY, Symbol
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.fitting import Fitting
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.glove.messages import PlayStep
from waychair.firmware_bridge.glove.program import HostGlove, LiveGlove, glove_program
from waychair.firmware_bridge.heartbeat import urgent
from waychair.firmware_bridge.transports import Reconnecting, Transport
from waychair.types import FloatArray, Json

DECISIONS = 1000
PATTERNS = 200
INTERRUPTIONS = 1000
SILENCES = 1000
COMMANDS = 1_000_000
FUZZED_BYTES = 10_000_000

FIRST_MOTOR_MS = 20.0
TIMING_MS = 2
INTERRUPTED_MS = 5
SILENCE_MS, SILENCE_SPREAD_MS = 500, 20
DUTY_MS, RUN_MS, CROWD_MS = 5000, 500, 250

MS = 1_000_000
GLOVE = layout_named("glove_3x3")


def glove(out: Path) -> Json:
    """All bars of the glove; `GLOVE_SHARE=0.01` takes a hundredth of each count.

    The time to the first motor is taken in real time over a pseudo-terminal, with real-time priority where the system
    grants it: a real glove has its own processor. All others are on the board's own clock; the times of patterns in real
    time stand beside them.
    """
    share = float(os.environ.get("GLOVE_SHARE", "1"))
    program, words = glove_program(), vocabulary("glove_3x3")
    first = _first_motor(program, _some(DECISIONS, share))
    timing = _timing(program, words)
    interruption = _interruption(program, words, _some(INTERRUPTIONS, share))
    silence = _silence(program, words, _some(SILENCES, share))
    harsh = _harsh(_some(COMMANDS, share), _some(FUZZED_BYTES, share))
    live = _live_timing(program, words, _some(PATTERNS, share))
    parts: dict[str, Json] = {
        "first_motor": first,
        "timing": timing,
        "interruption": interruption,
        "silence": silence,
        **harsh,
    }
    return {
        "passed": all(isinstance(part, dict) and bool(part["passed"]) for part in parts.values()),
        "share": share,
        "load_per_core": round(os.getloadavg()[0] / (os.cpu_count() or 1), 1),
        **parts,
        "timing_in_real_time": live,
    }


def _some(count: int, share: float) -> int:
    return max(10, round(count * share))


def _bridge(transport: Transport) -> GloveBridge:
    return GloveBridge(Reconnecting(lambda: transport), "A", GLOVE, Fitting())


class _Stepped:
    """The program in lockstep with its bridge, which ticks every 10 ms of simulated time."""

    def __init__(self, program: Path) -> None:
        self.glove = HostGlove(program)
        self.bridge = _bridge(self.glove.transport)
        self.now_ms = 0
        self.run(100)

    def run(self, ms: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
        """Return the levels (ms, 16) of the next milliseconds."""
        parts = []
        for k in range(ms):
            if (self.now_ms + k) % 10 == 0:
                self.bridge.tick((self.now_ms + k) * MS, armed=True)
            parts.append(self.glove.step(self.now_ms + k + 1).levels)
        self.now_ms += ms
        return np.concatenate(parts)

    def play(self, steps: tuple[PlayStep, ...], priority: int) -> None:
        refused = self.bridge.play(steps, priority, 500, self.now_ms * MS)
        assert not refused, refused


def _timing(program: Path, words: TouchVocabulary) -> Json:
    """Every symbol: beginnings and lengths of all vibrations against the pattern, on the board's clock."""
    stepped = _Stepped(program)
    worst = 0
    with stepped.glove:
        for symbol, pattern in words.patterns.items():
            stepped.play(pattern.steps(), PRIORITY[symbol])
            levels = stepped.run(pattern.duration_ms + pattern.gap_ms + 100)
            worst = max(worst, *_errors(levels, pattern.steps(), 0))
            stepped.run(1000)
    return {"passed": worst <= TIMING_MS, "symbols": len(words.patterns), "worst_ms": worst}


def _errors(
    levels: np.ndarray[tuple[int, int], np.dtype[np.uint8]], steps: tuple[PlayStep, ...], begin: int
) -> Iterator[int]:
    """Yield the error [ms] of each step's beginning and end; `begin` is the row in which the pattern should begin."""
    on = np.pad((levels > 0).astype(np.int8), ((1, 1), (0, 0)))
    for step in steps:
        for motor in step.motors:
            changes = np.diff(on[:, motor])
            begins, ends = np.flatnonzero(changes == 1), np.flatnonzero(changes == -1)
            if not len(begins):
                yield len(levels)
                continue
            yield int(np.abs(begins - begin).min())
            yield int(np.abs(ends - begin - step.on_ms).min())
        begin += step.on_ms + step.off_ms


def _interruption(program: Path, words: TouchVocabulary, count: int) -> Json:
    """A warning at a random moment of a random symbol: milliseconds until all motors vibrate."""
    draw = random.Random(0)
    stepped = _Stepped(program)
    waits = []
    warning = words.patterns[Symbol.WARNING].steps()
    others = [symbol for symbol in words.patterns if symbol is not Symbol.WARNING]
    with stepped.glove:
        for _ in range(count):
            symbol = draw.choice(others)
            stepped.play(words.patterns[symbol].steps(), PRIORITY[symbol])
            stepped.run(draw.randrange(1, words.patterns[symbol].duration_ms))
            stepped.play(warning, PRIORITY[Symbol.WARNING])
            levels = stepped.run(260)
            waits.append(int(np.flatnonzero((levels[:, :9] > 0).all(axis=1))[0]))
            stepped.run(900)
    return {"passed": max(waits) <= INTERRUPTED_MS, "warnings": count, "longest_ms": max(waits)}


def _silence(program: Path, words: TouchVocabulary, count: int) -> Json:
    """The computer stops at a random moment: milliseconds from its last frame to the board's own pattern."""
    draw = random.Random(1)
    waits, repeats = [], 0
    for _ in range(count):
        stepped = _Stepped(program)
        with stepped.glove:
            stepped.run(draw.randrange(1, 200))
            if draw.random() < 0.5:
                stepped.play(words.patterns[Symbol.FORWARD].steps(), 100)
            stepped.run(draw.randrange(1, 30))
            stepped.bridge.tick(stepped.now_ms * MS, armed=False)  # a change of `armed` is a frame in any case
            stepped.bridge.tick(stepped.now_ms * MS, armed=True)
            stepped.run(1)
            last = stepped.now_ms
            rows = [stepped.glove.step(last + k).levels for k in (*range(500, 3000, 500), 3000)]
            all_on = (np.concatenate(rows)[:, :9] > 0).all(axis=1)
            begins = np.flatnonzero(np.diff(np.pad(all_on.astype(np.int8), (1, 0))) == 1)
            waits.append(int(begins[0]) + 1)
            repeats = max(repeats, len(begins))
    good = all(abs(wait - SILENCE_MS) <= SILENCE_SPREAD_MS for wait in waits) and repeats == 2
    return {"passed": good, "moments": count, "shortest_ms": min(waits), "longest_ms": max(waits), "pulses": repeats}


def _harsh(commands: int, fuzzed: int) -> dict[str, Json]:
    """Random commands and fuzzed bytes into the glove's loop under sanitizers, judged by an exact account."""
    with tempfile.TemporaryDirectory() as folder:
        fuzzer = build_glove_fuzzer(Path(folder))
        ordered = fuzz_glove(fuzzer, "commands", commands, seed=0)
        random_bytes = fuzz_glove(fuzzer, "bytes", fuzzed, seed=0)
    worst = re.search(r"(\d+) commands, (\d+) ms, worst duty (\d+), run (\d+), crowd (\d+)", ordered.stdout)
    fed = re.match(r"(\d+) bytes, (\d+) edges, corpus of (\d+)", random_bytes.stdout)
    figures = [int(text) for text in worst.groups()] if worst else [0] * 5
    kept = figures[2] <= DUTY_MS and figures[3] <= RUN_MS and figures[4] <= CROWD_MS
    return {
        "heat": {
            "passed": ordered.returncode == 0 and worst is not None and kept,
            "commands": figures[0],
            "hours": round(figures[1] / 3.6e6, 1),
            "worst_duty_ms_in_10_s": figures[2],
            "longest_vibration_ms": figures[3],
            "longest_crowd_ms": figures[4],
            "complaint": _complaint(ordered),
        },
        "fuzz": {
            "passed": random_bytes.returncode == 0 and fed is not None and int(fed[1]) >= fuzzed,
            "bytes": int(fed[1]) if fed else 0,
            "edges": int(fed[2]) if fed else 0,
            "complaint": _complaint(random_bytes),
        },
    }


def _complaint(done: subprocess.CompletedProcess[str]) -> str:
    """Return why a run of the fuzzer failed: its own words, or the status of one that aborted at a broken promise."""
    if done.returncode == 0:
        return ""
    return done.stderr.strip()[:500] or f"ended with status {done.returncode} at a broken promise"


class _Live:
    """The program in real time with its bridge; records of all levels."""

    def __init__(self, program: Path, glove: LiveGlove) -> None:
        self.glove = glove
        self.bridge = _bridge(glove.transport)
        self.granted = urgent(glove.pid)

    def run(self, seconds: float, until_on: bool = False) -> list[tuple[int, bytes]]:
        """Return the records of the next seconds, or up to the first vibration."""
        found: list[tuple[int, bytes]] = []
        end = time.monotonic() + seconds
        beat = 0.0
        while time.monotonic() < end:
            if time.monotonic() >= beat:
                self.bridge.tick(time.monotonic_ns(), armed=True)
                beat = time.monotonic() + 0.02
            new = self.glove.records(0.002)
            found += new
            if until_on and any(any(levels) for _, levels in new):
                break
        return found


def _first_motor(program: Path, count: int) -> Json:
    """Milliseconds from the decision to the first vibration, in real time over a pseudo-terminal."""
    draw = random.Random(2)
    waits: list[float] = []
    with LiveGlove(program) as glove:
        live = _Live(program, glove)
        live.run(1.0)
        for k in range(count):
            live.run(0.04 + 0.04 * draw.random())
            begun = time.monotonic()
            refused = live.bridge.play((PlayStep(1 << k % 9, 195, 20, 0),), 100, 500, time.monotonic_ns())
            assert not refused, refused
            on = [ms for ms, levels in live.run(1.0, until_on=True) if any(levels)]
            waits.append(_since(on[0], begun) if on else 1000.0)
    times: FloatArray = np.array(waits)
    p99 = float(np.percentile(times, 99))
    return {
        "passed": p99 <= FIRST_MOTOR_MS,
        "decisions": count,
        "real_time_priority": live.granted,
        "median_ms": round(float(np.median(times)), 2),
        "p99_ms": round(p99, 2),
        "longest_ms": round(float(times.max()), 2),
    }


def _since(record_ms: int, begun_s: float) -> float:
    """Return the time from a moment to the end of a record's millisecond [ms]."""
    begun_ms = begun_s * 1e3
    return (record_ms - int(begun_ms) + 2**31) % 2**32 - 2**31 + 1 - begun_ms % 1.0


def _live_timing(program: Path, words: TouchVocabulary, count: int) -> Json:
    """Errors of the steps of "forward" in real time; other programs of this computer delay the glove's loop."""
    steps = words.patterns[Symbol.FORWARD].steps()
    errors: list[int] = []
    with LiveGlove(program) as glove:
        live = _Live(program, glove)
        live.run(1.0)
        for _ in range(count):
            live.bridge.play(steps, 100, 500, time.monotonic_ns())
            records = live.run(1.0)
            on = [ms for ms, levels in records if any(levels)]
            first, last = on[0], on[-1]
            levels = np.zeros(((last - first) % 2**32 + 2, 16), np.uint8)
            held = first
            for ms, row in (record for record in records if record[0] >= first):
                levels[held - first : ms - first + 1] = np.frombuffer(row, np.uint8)  # a late loop holds its levels
                held = ms
            errors += _errors(levels, steps, 0)
    return {
        "patterns": count,
        "real_time_priority": live.granted,
        "p99_ms": round(float(np.percentile(errors, 99)), 1),
        "longest_ms": max(errors),
    }
