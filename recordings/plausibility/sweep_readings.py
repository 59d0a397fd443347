"""The time that a sweep takes, from `time_increment` and the time between scans.

A sweep cannot last longer than the time to the next scan. Where it does, `time_increment` is in another unit, or is the
time of the whole scan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

SHORTEST, LONGEST = 0.002, 1.0
"""Shortest and longest sweep [s] of a lidar; a shorter one bends nothing."""

_SLACK = 1.1  # a sweep may last so much longer than the time to the next scan, by jitter
_UNITS = {1e-9: "nanoseconds", 1e-6: "microseconds", 1e-3: "milliseconds"}
_WHOLE = 0.5  # of the time between scans; the usual least duration of a sweep
_QUICK_SHARE = 0.3  # of the time in which the lidar turns that far; a shorter sweep is asked about
_QUICK = 0.01  # s; the least duration where scans were left out of the recording


@dataclass(frozen=True, slots=True)
class SweepReading:
    """The duration [s] of a sweep from the first beam to the last one, negative for the other way round.

    `text` says how the field is read, empty for as told.
    """

    duration: float
    text: str = ""


def scan_interval(stamps_ns: Sequence[int]) -> float:
    """Return the median time [s] between scans; 0 if there is only one."""
    steps = np.diff(np.array(stamps_ns, np.int64))
    steps = steps[steps > 0]
    return float(np.median(steps)) * 1e-9 if len(steps) else 0.0


def sweep_readings(increment: float, steps: int, interval: float, view: float) -> tuple[SweepReading, ...]:
    """Return how `time_increment` can be read, the likeliest first; the first is without text if the field may be right.

    Args:
        increment: the field; [s] if it is sound.
        steps: from the first beam to the last one.
        interval: [s] between scans; 0 if unknown.
        view: share of a full turn that the beams cover.
    """
    duration = increment * steps
    longest = min(_SLACK * interval, LONGEST) if interval > 0.0 else LONGEST
    if max(SHORTEST, _QUICK_SHARE * view * interval) <= duration <= longest:
        return (SweepReading(duration),)
    instant = SweepReading(0.0, "time_increment is left out of account")
    turning = (
        SweepReading(view * interval, "a sweep is taken to last as long as the lidar turns") if interval else instant
    )
    if 0.0 <= duration <= longest or abs(duration) < SHORTEST:
        # a camera's or a simulator's scan, a recording without every scan, or a field that was never filled in
        backwards = replace(turning, duration=-turning.duration)
        return (SweepReading(duration), turning, backwards) if interval else (SweepReading(duration),)
    if abs(duration) <= longest:  # negative
        forwards = SweepReading(-duration, "the sign of time_increment is wrong")
        return (instant, forwards, SweepReading(duration, "the first beam is the last in time"))
    possible = [SweepReading(abs(duration) * unit, f"time_increment is in {name}") for unit, name in _UNITS.items()]
    possible.append(SweepReading(abs(increment), "time_increment is the time of the whole scan"))
    for least in (max(_WHOLE * view * interval, SHORTEST), _QUICK):
        fitting = tuple(reading for reading in possible if least <= reading.duration <= longest)
        if fitting:
            return fitting if len(fitting) == 1 else (*fitting, instant, turning)
    return (instant, turning)
