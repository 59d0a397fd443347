"""Readings of a scan's angles: as told, in degrees, exchanged, or from one another where they contradict each other.

Beam i points at `angle_min + i * angle_increment`; `angle_max` says the same again. The three fit together in sound
messages, up to two steps: drivers disagree whether a full turn counts its first beam twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.recordings.plausibility.told_scans import ToldScan

_SLACK = 2.5  # steps by which angle_max may be off
_FULL_TURN = 1.02 * math.tau  # rad; the widest view, with rounding
_SINGLE = 1e-5  # relative error of fields of 32 bits, and of degrees typed as such


@dataclass(frozen=True, slots=True)
class AngleReading:
    """The first beam's angle and the step [rad]; `text` says how the fields are read, empty for as told."""

    first: float
    step: float
    text: str = ""


@dataclass(frozen=True, slots=True)
class AngleReadings:
    """All readings that fit a scan, the likeliest first; with `mirrored`, a wrong choice turns or mirrors the map."""

    readings: tuple[AngleReading, ...]
    mirrored: bool = False

    @property
    def sound(self) -> bool:
        """Return whether the fields fit together as they are."""
        return len(self.readings) == 1 and not self.readings[0].text


def angle_readings(scan: ToldScan) -> AngleReadings:
    """Return how the angles of a scan can be read; without a reading, the scan cannot be used."""
    first, last, step, steps = scan.angle_min, scan.angle_max, scan.angle_increment, scan.steps
    if steps < 1 or not math.isfinite(first):
        return AngleReadings(())
    width, ends = step * steps, last - first
    told = AngleReading(first, step)
    has_step, has_ends = math.isfinite(step) and step != 0.0, math.isfinite(last) and ends != 0.0
    if not has_step:
        return _from_ends(first, ends, steps) if has_ends else AngleReadings(())
    narrow = abs(width) <= _FULL_TURN + abs(step)
    if narrow and (not has_ends or _fit(width, ends, step, math.tau)):
        return AngleReadings((told,))
    degrees = math.radians(abs(width)) <= _FULL_TURN + math.radians(abs(step))
    if not narrow and degrees and (not has_ends or _fit(width, ends, step, 360.0)):
        return _one(math.radians(first), math.radians(step), "angles are in degrees")
    if narrow and has_ends and abs(ends) > _FULL_TURN and _fit(width, math.radians(ends), step, math.tau):
        return _one(math.radians(first), step, "angle_min and angle_max are in degrees")
    if not narrow and degrees and has_ends and _fit(math.radians(width), ends, math.radians(step), math.tau):
        return _one(first, math.radians(step), "angle_increment is in degrees")
    if narrow and has_ends and _fit(width, -ends, step, 0.0):
        exchanged = AngleReading(last, step, "angle_min and angle_max are exchanged")
        backwards = AngleReading(first, -step, "angle_increment has the wrong sign")
        as_told = AngleReading(first, step, "angle_max is wrong, and left out of account")
        return AngleReadings((exchanged, backwards, as_told), mirrored=True)
    by_ends = _from_ends(first, ends, steps).readings if has_ends else ()
    if narrow:
        as_told = AngleReading(first, step, "angle_max does not fit, and is left out of account")
        return AngleReadings((as_told, *by_ends))
    if by_ends:
        return AngleReadings(by_ends)
    if degrees:
        return _one(math.radians(first), math.radians(step), "angles are in degrees")
    return AngleReadings(())


def _from_ends(first: float, ends: float, steps: int) -> AngleReadings:
    """Return the readings in which the beams are spread evenly from angle_min to angle_max."""
    text = "angle_increment does not fit the number of beams, which are spread from angle_min to angle_max"
    if abs(ends) <= _FULL_TURN:
        return _one(first, ends / steps, text)
    if abs(math.radians(ends)) <= _FULL_TURN:
        return _one(math.radians(first), math.radians(ends) / steps, f"{text}, in degrees")
    return AngleReadings(())


def _one(first: float, step: float, text: str) -> AngleReadings:
    return AngleReadings((AngleReading(first, step, text),))


def _fit(width: float, ends: float, step: float, turn: float) -> bool:
    """Return whether two widths are the same but for the slack, or for a full turn if that is given."""
    slack = _SLACK * abs(step) + _SINGLE * abs(width)
    off = abs(width - ends)
    return off <= slack or (turn > 0.0 and abs(off - turn) <= slack)
