"""The scans of one topic as they were meant: angles, units, limits, beam times and codes, judged over the whole recording.

A message that differs from all others is left out; a defect that all share is put right if only one reading of the fields
fits, or if the motion by odometry confirms one (`MotionWitness`). Each kind of defect gives one finding.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from waychair.errors import NoScans
from waychair.recordings.plausibility.angle_readings import AngleReading, AngleReadings, angle_readings
from waychair.recordings.plausibility.blind_sector import blind_sector
from waychair.recordings.plausibility.findings import Finding, seconds_after
from waychair.recordings.plausibility.motion_witness import MotionWitness
from waychair.recordings.plausibility.nothing_codes import codes_for_nothing, without_codes
from waychair.recordings.plausibility.own_chair import without_own_chair
from waychair.recordings.plausibility.range_readings import (
    RangeLimits,
    is_odd,
    range_limits,
    sampled_ranges,
    tried_units,
    unit_text,
)
from waychair.recordings.plausibility.repeated_scans import without_repeated
from waychair.recordings.plausibility.sweep_readings import SHORTEST, scan_interval, sweep_readings
from waychair.recordings.plausibility.told_scans import MOST_BEAMS, ToldScan
from waychair.recordings.scans import LaserMount, ascending, mirrored, without_overflow_codes
from waychair.types import Odometry, Scan

_FEW = 0.2  # share of a topic's messages up to which they are left out rather than read in another way
_MOST_ODD = 0.6  # share up to which scans that contradict themselves are read as the sound ones are
_OTHER_SWEEP = 0.5  # of the usual duration of a sweep; a scan that differs by more is of another kind
_LEAST_FULL = 5  # ranges of exactly `range_max`; fewer are measured ones
_RARE = 0.001  # share of ranges; codes that rare are not worth a word
_DRIVER = "check the lidar's driver"


@dataclass(frozen=True, slots=True)
class PlausibleScans:
    """The usable scans of one topic in their order, and the findings about it."""

    scans: tuple[Scan, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True)
class _Reading:
    """How the messages of a topic are read."""

    unit: float
    limits: RangeLimits
    duration: float | None = None  # [s] from the first beam to the last one; None: as told

    def scan(self, told: ToldScan, angles: AngleReading) -> Scan:
        """Return a scan, by ascending angle."""
        ranges = told.ranges if self.unit == 1.0 else told.ranges * np.float32(self.unit)
        told_step = told.time_increment if math.isfinite(told.time_increment) else 0.0
        scan = Scan(
            stamp_ns=told.stamp_ns,
            ranges=ranges,
            angle_min=angles.first,
            angle_step=angles.step,
            time_step=told_step if self.duration is None else self.duration / told.steps,
            range_min=self.limits.least,
            range_max=self.limits.most,
        )
        return ascending(without_overflow_codes(scan))


def plausible_scans(
    topic: str, told: Sequence[ToldScan], odometry: Sequence[Odometry] = (), mount: LaserMount | None = None
) -> PlausibleScans:
    """Return the scans of a topic as they were meant, upside-down ones not yet mirrored.

    Args:
        topic: its name, for the findings.
        told: its messages, in their order.
        odometry: by stamp; without it, contradictions that only the motion can settle keep the likeliest reading.
        mount: the lidar's mount.

    Raises:
        NoScans: no message can be used, or no reading of their angles is certain enough to make a map.
    """
    findings: list[Finding] = []
    told = without_repeated(topic, _without_huge(topic, told, findings), odometry, findings)
    if not told:
        return PlausibleScans((), tuple(findings))
    start_ns = told[0].stamp_ns
    told, angles = _with_angles(topic, told, findings)
    told, angles, ranges = _of_one_unit(topic, told, angles, findings)
    judge = _Judge(topic, told, odometry, mount or LaserMount(), findings)
    range_min, range_max = _usual_limits(told)
    likeliest = [entry.readings[0] for entry in angles]
    unit = judge.unit(ranges, range_max, likeliest)
    limits = range_limits(ranges * np.float32(unit), range_min, range_max, unit)
    if limits.text:
        findings.append(Finding("range limits", topic, limits.text, _DRIVER))
    reading = _Reading(unit, limits)
    chosen = judge.angles(angles, reading)
    told, reading = judge.beam_times(chosen, reading)
    scans = [reading.scan(scan, entry) for scan, entry in zip(told, chosen, strict=True)]
    scans, found = without_false_ranges(topic, scans, start_ns)
    return PlausibleScans(tuple(scans), (*findings, *found))


def without_false_ranges(
    topic: str, scans: Sequence[Scan], start_ns: int | None = None
) -> tuple[list[Scan], list[Finding]]:
    """Return scans without codes for nothing and without the chair itself, and findings, also about a blind sector.

    `start_ns` [ns] is the first stamp of the recording, by default that of the first scan.
    """
    cleared, codes = without_nothing_codes(topic, scans, start_ns)
    blind = blind_sector(topic, cleared)
    cleared, own = without_own_chair(topic, cleared)
    return list(cleared), [*codes, *blind, *own]


def without_nothing_codes(
    topic: str, scans: Sequence[Scan], start_ns: int | None = None
) -> tuple[list[Scan], list[Finding]]:
    """Return the scans with +inf in place of codes for "nothing seen", and a finding if there are any.

    Several ranges of exactly `range_max` are such codes without further proof.
    """
    if not scans:
        return [], []
    full = [np.isfinite(scan.ranges) & (scan.ranges == np.float32(scan.range_max)) for scan in scans]
    if sum(int(most.sum()) for most in full) < _LEAST_FULL:
        full = [np.zeros(len(scan.ranges), np.bool_) for scan in scans]
    cleared = [
        replace(scan, ranges=np.where(most, np.float32(np.inf), scan.ranges)) if most.any() else scan
        for scan, most in zip(scans, full, strict=True)
    ]
    middle = scans[len(scans) // 2]
    codes = codes_for_nothing([scan.ranges for scan in cleared], middle.angle_step, middle.range_max)
    if codes:
        cleared = [replace(scan, ranges=without_codes(scan.ranges, codes)) for scan in cleared]
    changed = [
        int(np.count_nonzero(after.ranges != before.ranges) - np.count_nonzero(np.isnan(before.ranges)))
        for before, after in zip(scans, cleared, strict=True)
    ]
    share = sum(changed) / sum(len(scan.ranges) for scan in scans)
    if share < _RARE:
        return cleared, []
    names = [f"{code:g} m" for code in codes]
    names += [f"{middle.range_max:g} m (range_max)"] if any(most.any() for most in full) else []
    first = next(index for index, count in enumerate(changed) if count)
    text = f"{share:.0%} of the ranges are {' or '.join(names)}, the lidar's code for nothing seen: no walls are drawn there"
    start_ns = scans[0].stamp_ns if start_ns is None else start_ns
    count = sum(count > 0 for count in changed)
    found = Finding("code for nothing", topic, text, "", count, (scans[first].stamp_ns - start_ns) * 1e-9)
    return cleared, [found]


def _without_huge(topic: str, told: Sequence[ToldScan], findings: list[Finding]) -> list[ToldScan]:
    """Return the scans that have between two and `MOST_BEAMS` beams."""
    kept = [scan for scan in told if 2 <= len(scan.ranges) <= MOST_BEAMS]
    _note_left_out(
        "number of beams", topic, "scans with fewer than 2 or very many beams are left out", told, kept, findings
    )
    return kept


def _with_angles(
    topic: str, told: Sequence[ToldScan], findings: list[Finding]
) -> tuple[list[ToldScan], list[AngleReadings]]:
    """Return the scans with angles, and how these can be read; a few that contradict themselves among sound ones are left out.

    Raises:
        NoScans: no scan has angles that can be read.
    """
    by_shape = {scan.shape: angle_readings(scan) for scan in told}
    entries = [by_shape[scan.shape] for scan in told]
    odd = sum(not entry.sound for entry in entries)
    if _FEW * len(told) < odd < _MOST_ODD * len(told):
        told, entries = _as_the_others(topic, told, entries, findings)
        odd = 0
    if all(not entry.readings for entry in entries):
        raise NoScans(f"{topic}: {_contradiction(told[0])}; {_DRIVER}")
    few = odd <= _FEW * len(told)
    kept = [
        (scan, entry) for scan, entry in zip(told, entries, strict=True) if entry.sound or (entry.readings and not few)
    ]
    scans = [scan for scan, _ in kept]
    text = "scans whose angles contradict their number of beams are left out"
    _note_left_out("angles", topic, text, told, scans, findings)
    return scans, [entry for _, entry in kept]


def _as_the_others(
    topic: str, told: Sequence[ToldScan], entries: list[AngleReadings], findings: list[Finding]
) -> tuple[list[ToldScan], list[AngleReadings]]:
    """Return the scans where some of a topic contradict themselves, with the angles that most of the others tell.

    They come from the same lidar. Those with another number of beams are left out: nothing tells how they were made.
    """
    usual, _ = Counter(scan.shape for scan, entry in zip(told, entries, strict=True) if entry.sound).most_common(1)[0]
    model = next((scan, entry) for scan, entry in zip(told, entries, strict=True) if scan.shape == usual)
    kept = [
        (scan, entry if entry.sound else model[1])
        for scan, entry in zip(told, entries, strict=True)
        if entry.sound or scan.steps == model[0].steps
    ]
    stamps = [scan.stamp_ns for scan in told]
    same = [k for k, entry in enumerate(entries) if not entry.sound and told[k].steps == model[0].steps]
    if same:
        text = f"{_contradiction(told[same[0]])}: the angles of the other scans are used"
        findings.append(Finding("angles", topic, text, _DRIVER, len(same), seconds_after(stamps, same[0])))
    scans = [scan for scan, _ in kept]
    text = "scans whose angles contradict their number of beams, which is not that of the others, are left out"
    _note_left_out("angles", topic, text, told, scans, findings)
    return scans, [entry for _, entry in kept]


def _contradiction(scan: ToldScan) -> str:
    return (
        f"the angles of the scans contradict each other: {len(scan.ranges)} beams, angle_min {scan.angle_min:g}, "
        f"angle_max {scan.angle_max:g}, angle_increment {scan.angle_increment:g}"
    )


def _of_one_unit(
    topic: str, told: list[ToldScan], angles: list[AngleReadings], findings: list[Finding]
) -> tuple[list[ToldScan], list[AngleReadings], np.ndarray]:
    """Return the scans without those of another unit than the others, and a sample of the ranges as told."""
    ranges = sampled_ranges(told)
    typical = float(np.median(ranges)) if len(ranges) else 0.0
    if typical <= 0.0:
        return told, angles, ranges
    kept = [index for index, scan in enumerate(told) if not is_odd(scan, typical)]
    if len(kept) < (1.0 - _FEW) * len(told):
        return told, angles, ranges
    scans = [told[index] for index in kept]
    _note_left_out("range unit", topic, "scans in another unit than the others are left out", told, scans, findings)
    return scans, [angles[index] for index in kept], ranges


def _usual_limits(told: Sequence[ToldScan]) -> tuple[float, float]:
    """Return `range_min` and `range_max` as most messages tell them."""
    return Counter((scan.range_min, scan.range_max) for scan in told).most_common(1)[0][0]


class _Judge:
    """The choice between readings of a topic's messages, by their fields and by the motion."""

    def __init__(
        self,
        topic: str,
        told: Sequence[ToldScan],
        odometry: Sequence[Odometry],
        mount: LaserMount,
        findings: list[Finding],
    ) -> None:
        self._topic, self._told, self._findings = topic, told, findings
        self._stamps = [scan.stamp_ns for scan in told]
        self._witness = MotionWitness(self._stamps, odometry, mount.base_from_laser)
        self._upside_down = mount.upside_down

    def unit(self, ranges: np.ndarray, range_max: float, angles: Sequence[AngleReading]) -> float:
        """Return the unit [m] of ranges (N,) as told.

        Raises:
            NoScans: the ranges are those of no lidar, in whatever unit.
        """
        units = tried_units(ranges, range_max)
        if not units:
            median = f"{float(np.median(ranges)):g}"
            raise NoScans(
                f"{self._topic}: the median range is {median} m, as no lidar measures in a building; {_DRIVER}"
            )
        free = RangeLimits(0.0, math.inf)
        number = self._choose([(_Reading(unit, free), angles) for unit in units])
        text = unit_text("ranges", units, number)
        if text:
            self._add("range unit", text)
        return units[number or 0]

    def angles(self, entries: Sequence[AngleReadings], reading: _Reading) -> list[AngleReading]:
        """Return the angles of each scan; where several readings fit, the motion chooses one for all.

        Raises:
            NoScans: the motion does not tell which reading is right, and a wrong one would mirror or turn the map.
        """
        odd = [index for index, entry in enumerate(entries) if not entry.sound]
        if not odd:
            return [entry.readings[0] for entry in entries]
        most = max(len(entry.readings) for entry in entries)
        by_number = [
            [entry.readings[min(number, len(entry.readings) - 1)] for entry in entries] for number in range(most)
        ]
        number = self._choose([(reading, angles) for angles in by_number])
        first = self._told[odd[0]]
        if number is None and entries[odd[0]].mirrored:
            raise NoScans(
                f"{self._topic}: {_contradiction(first)}; several readings fit, and no odometry with turns tells which: "
                f"{_DRIVER}, or record the odometry as well"
            )
        chosen = by_number[number or 0]
        confirmed = ", as the odometry confirms" if number is not None and most > 1 else ""
        self._add("angles", f"{_contradiction(first)}: {chosen[odd[0]].text}{confirmed}", odd)
        return chosen

    def beam_times(self, angles: Sequence[AngleReading], reading: _Reading) -> tuple[list[ToldScan], _Reading]:
        """Return the scans with beam times as most tell them, and the reading with the duration of a sweep, if not as told."""
        durations = np.array([scan.time_increment * scan.steps for scan in self._told])
        durations[~np.isfinite(durations)] = 0.0
        usual = float(np.median(durations))
        steps = round(float(np.median([scan.steps for scan in self._told])))
        interval = scan_interval(self._stamps)
        view = min(1.0, abs(float(np.median([entry.step for entry in angles]))) * steps / math.tau)
        readings = sweep_readings(usual / steps, steps, interval, view)
        timed = [(replace(reading, duration=sweep.duration), angles) for sweep in readings]
        number = self._choose(timed)
        chosen = readings[0]
        if number is not None:
            chosen = readings[number]
        elif len(readings) > 1 and readings[0].text:
            chosen = next(sweep for sweep in readings if sweep.duration == 0.0)
        if chosen.text:
            text = f"{_sweep_text(usual / steps, steps, interval)}: {chosen.text} ({chosen.duration:.3g} s a sweep)"
            self._add("beam times", text)
            return list(self._told), replace(reading, duration=chosen.duration)
        odd = np.flatnonzero(np.abs(durations - usual) > _OTHER_SWEEP * abs(usual) + SHORTEST).tolist()
        if odd:
            self._add(
                "beam times", f"time_increment differs from that of most scans, {usual / steps:g} s, which is used", odd
            )
        told = [
            replace(scan, time_increment=usual / scan.steps) if index in odd else scan
            for index, scan in enumerate(self._told)
        ]
        return told, reading

    def _choose(self, readings: Sequence[tuple[_Reading, Sequence[AngleReading]]]) -> int | None:
        """Return the reading that the motion confirms, if there are several and one stands out."""

        def scan(index: int, reading: _Reading, angles: Sequence[AngleReading]) -> Scan:
            read = reading.scan(self._told[index], angles[index])
            return mirrored(read) if self._upside_down else read

        return self._witness.choose([partial(scan, reading=reading, angles=angles) for reading, angles in readings])

    def _add(self, kind: str, text: str, which: Sequence[int] = ()) -> None:
        """Add a finding about all scans, or about those of some indices."""
        first_s = seconds_after(self._stamps, which[0]) if which else None
        self._findings.append(Finding(kind, self._topic, text, _DRIVER, len(which), first_s))


def _sweep_text(increment: float, steps: int, interval: float) -> str:
    return f"time_increment of {increment:g} over {steps} steps is {increment * steps:g} s, with {interval:g} s between scans"


def _note_left_out(
    kind: str, topic: str, text: str, told: Sequence[ToldScan], kept: Sequence[ToldScan], findings: list[Finding]
) -> None:
    """Add a finding about the scans that are not kept."""
    if len(kept) == len(told):
        return
    names = {id(scan) for scan in kept}
    first = next(index for index, scan in enumerate(told) if id(scan) not in names)
    at = seconds_after([scan.stamp_ns for scan in told], first)
    findings.append(Finding(kind, topic, text, _DRIVER, len(told) - len(kept), at))
