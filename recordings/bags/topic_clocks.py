"""Stamps of the topics of a bag, compared with each other and with the times of recording.

A topic may have a clock of its own (a lidar that counts from its start, a board without a set clock), single odd stamps,
stamps that repeat or are cut to whole seconds, or none. All messages have a time of recording, which is late by the way of
a message and by the sweep that it waits for, but hardly by seconds. Stamps are put right by it where they cannot be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.recordings.plausibility.findings import Finding
from waychair.types import BoolArray, IntArray

_OTHER_CLOCK_NS = 2_000_000_000  # a topic that is further from the others has another clock
_ODD_NS = 500_000_000  # a stamp out of order that is further off is odd
_FEW = 0.3  # share of a topic's stamps up to which they are odd ones
_REPEATS = 0.02  # share of stamps that repeat from which they are no times of their messages
_FROZEN = 0.9  # share of stamps that repeat from which a clock stands still, and tells nothing
_REPEATED = "messages have the stamp of the one before: the times of recording are used"
_NO_STAMP = "messages have no stamp: their time of recording is used"
_LEAST = 5  # messages of a topic; fewer tell nothing about its clock


@dataclass(frozen=True, slots=True)
class TopicTimes:
    """The times of a topic's messages in the order of recording: `stamps` and `logs` (N,) [ns].

    `unstamped` (N,) messages have no stamp; `waits_ns` is the time from a stamp to the end of what the message holds.
    """

    topic: str
    stamps: IntArray
    logs: IntArray
    unstamped: BoolArray
    waits_ns: int = 0


def plausible_stamps(topics: Sequence[TopicTimes]) -> tuple[list[IntArray], list[Finding]]:
    """Return the stamps (N,) [ns] of each topic, put right where they cannot be, and a finding for each defect."""
    findings: list[Finding] = []
    behind = [_behind(times) for times in topics]
    frozen = [own is not None and _repeated(times).mean() > _FROZEN for times, own in zip(topics, behind, strict=True)]
    alive = [own if not still else None for own, still in zip(behind, frozen, strict=True)]
    usual = _usual(topics, alive if any(own is not None for own in alive) else behind)
    mended = []
    for times, own, still in zip(topics, behind, frozen, strict=True):
        if usual is None or own is None:
            if times.unstamped.any():
                findings.append(_found(times, _NO_STAMP, times.unstamped))
            mended.append(times.stamps)
            continue
        if still:
            findings.append(_found(times, _REPEATED, _repeated(times)))
            mended.append(times.logs - usual - times.waits_ns)
            continue
        stamps = times.stamps.copy()
        expected = usual + times.waits_ns
        if times.unstamped.all():
            findings.append(_found(times, _NO_STAMP, times.unstamped))
            mended.append(times.logs - expected)
            continue
        if abs(own - usual) > _OTHER_CLOCK_NS:
            step = own - expected
            way = "before" if step > 0 else "after"
            text = (
                f"the stamps are {abs(step) * 1e-9:.1f} s {way} those of the other topics, as of a clock that was never set: "
                "they are moved by the time of recording"
            )
            findings.append(Finding("clock", times.topic, text, "set its clock, or stamp its messages on arrival"))
            stamps += step
        mended.append(_without_repeats(times, _without_odd(times, stamps, findings), findings))
    return mended, findings


def _behind(times: TopicTimes) -> int | None:
    """Return by how much [ns] the time of recording is usually behind the stamp; None where it cannot be told."""
    stamped = ~times.unstamped
    known = times.logs > 0
    if len(times.stamps) < _LEAST or not known.all() or times.logs[-1] - times.logs[0] <= 0:
        return None
    if not stamped.any():
        return 0
    return int(np.median(times.logs[stamped] - times.stamps[stamped]))


def _usual(topics: Sequence[TopicTimes], behind: Sequence[int | None]) -> int | None:
    """Return by how much [ns] stamps of most topics are behind, without waiting; of equal parties the one nearer to now."""
    told = [
        own - times.waits_ns
        for times, own in zip(topics, behind, strict=True)
        if own is not None and not times.unstamped.all()
    ]
    if not told:
        return 0 if any(own is not None for own in behind) else None
    parties = [[other for other in told if abs(other - own) <= _OTHER_CLOCK_NS] for own in told]
    best = max(parties, key=lambda party: (len(party), -abs(float(np.median(party)))))
    return int(np.median(best))


def _without_odd(times: TopicTimes, stamps: IntArray, findings: list[Finding]) -> IntArray:
    """Return the stamps with those that are far from their neighbours, and the missing ones, between these by recording."""
    off = times.logs - stamps
    off = off - int(np.median(off[~times.unstamped]))
    backward = np.concatenate([[False], np.diff(stamps) < 0])
    out_of_order = backward | np.concatenate([backward[1:], [False]])
    near = out_of_order | np.concatenate([[False], np.diff(stamps) > _OTHER_CLOCK_NS])
    odd = (np.abs(off) > _ODD_NS) & near & ~times.unstamped
    if odd.sum() > _FEW * len(odd):
        odd[:] = False
    if odd.any():
        text = "stamps that lie seconds beside those of the messages before and after: the time of recording is used"
        findings.append(_found(times, text, odd))
    if times.unstamped.any():
        findings.append(_found(times, _NO_STAMP, times.unstamped))
    wrong = odd | times.unstamped
    if not wrong.any():
        return stamps
    shift = np.interp(times.logs[wrong], times.logs[~wrong], (times.logs - stamps)[~wrong].astype(np.float64))
    mended = stamps.copy()
    mended[wrong] = times.logs[wrong] - np.rint(shift).astype(np.int64)
    return mended


def _without_repeats(times: TopicTimes, stamps: IntArray, findings: list[Finding]) -> IntArray:
    """Return the stamps by the time of recording where many of them repeat."""
    repeated = _repeated(times)
    if repeated.sum() <= _REPEATS * len(stamps):
        return stamps
    findings.append(_found(times, _REPEATED, repeated))
    # a stamp that is repeated, or cut to whole seconds, is too early: the least delay is the true one
    return times.logs - int(np.percentile(times.logs - stamps, 5))


def _repeated(times: TopicTimes) -> BoolArray:
    """Return which messages (N,) have the stamp of the one before, but were recorded later: not merely written twice."""
    same = np.diff(times.stamps) == 0
    later = np.diff(times.logs) > 1_000_000
    return np.concatenate([[False], same & later]) if len(times.stamps) else np.zeros(0, np.bool_)


def _found(times: TopicTimes, text: str, which: BoolArray) -> Finding:
    first = int(np.argmax(which))
    at = (int(times.logs[first]) - int(times.logs[0])) * 1e-9
    return Finding("stamps", times.topic, text, "check the clock of its driver", int(which.sum()), at)
