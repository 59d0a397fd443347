"""Windows of a drive in which an aid agrees with a reference or not, and the stretches in which it does not.

A single interval between two scans tells little, because scans have noise and wheels slip. A window of some seconds with a
turn or some way in it tells whether an aid follows the motion. Evidence against an aid must outweigh the evidence for it
over a whole stretch before the stretch counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.types import BoolArray, FloatArray, IntArray

_SHORTEST_S, _LONGEST_S = 2.0, 12.0
_ENOUGH_TURN, _ENOUGH_WAY = 0.5, 1.0  # [rad], [m]; a window with so much motion is long enough
_TURN_OFF, _TURN_SHARE = 0.15, 0.2  # [rad]; an aid may be off by this in a window, and by this share of the turning
_TURN_NOISE = 0.03  # [rad] of an interval
_WAY_OFF, _WAY_SHARE = 0.25, 0.2  # [m]; the same for ways
_WAY_NOISE = 0.04  # [m] of an interval
_SWING = 0.4  # share of all turning or way by which single intervals may be off
_LEAST_WINDOWS = 2  # a stretch holds at least so many bad windows,
_LEAST_PART = 0.6  # which are at least this part of its evidence
_SHORT_SHARE = 0.15  # a stretch with less of the evidence is a slip, unless
_LONG_S = 15.0  # it lasts so long
_TELLING = 0.3  # [rad], [m]; a window with so much motion, and no contradiction, speaks for an aid
MOST_STRETCHES = 3
"""Stretches that are looked for."""


@dataclass(frozen=True, slots=True)
class Windows:
    """Windows of consecutive intervals: `starts` (W + 1,) are the first interval of each, and the end of the last."""

    starts: IntArray
    times: FloatArray

    def sums(self, values: FloatArray) -> FloatArray:
        """Return the sums (W, ...) of values (N, ...) of the intervals."""
        return np.add.reduceat(values, self.starts[:-1], axis=0)

    def __len__(self) -> int:
        return len(self.starts) - 1

    def span(self, first: int, last: int) -> tuple[float, float]:
        """Return the begin and end [s] of some windows."""
        return float(self.times[self.starts[first], 0]), float(self.times[self.starts[last + 1] - 1, 1])

    def members(self, first: int, last: int, count: int) -> BoolArray:
        """Return which of `count` intervals lie in some windows."""
        mask = np.zeros(count, np.bool_)
        mask[self.starts[first] : self.starts[last + 1]] = True
        return mask


def windows(times: FloatArray, turns: FloatArray, ways: FloatArray) -> Windows:
    """Return windows of intervals with begin and end `times` (N, 2) [s], by their turns (N,) [rad] and ways (N,) [m]."""
    starts, turned, driven = [0], 0.0, 0.0
    for k in range(len(times)):
        begin = times[starts[-1], 0]
        turned, driven = turned + abs(turns[k]), driven + ways[k]
        seconds = times[k, 1] - begin
        enough = seconds >= _SHORTEST_S and (turned >= _ENOUGH_TURN or driven >= _ENOUGH_WAY)
        if enough or seconds >= _LONGEST_S:
            starts.append(k + 1)
            turned, driven = 0.0, 0.0
    if starts[-1] != len(times):
        if len(starts) > 1:
            starts[-1] = len(times)
        else:
            starts.append(len(times))
    return Windows(np.array(starts, np.int64), times)


@dataclass(frozen=True, slots=True)
class WindowAgreement:
    """Which windows (W,) contradict an aid, and the weight (W,) of each as evidence; 0 where a window tells nothing."""

    bad: BoolArray
    weight: FloatArray

    @property
    def share(self) -> float:
        """Share of the evidence that speaks against the aid, 0 without evidence."""
        total = float(self.weight.sum())
        return float(self.weight[self.bad].sum()) / total if total > 0.0 else 0.0

    @property
    def evidence(self) -> float:
        """All evidence [rad] or [m]."""
        return float(self.weight.sum())


def turn_agreement(spans: Windows, aid: FloatArray, reference: FloatArray, known: BoolArray) -> WindowAgreement:
    """Return how turns (N,) [rad] of an aid agree with a reference's where both are known."""
    known = known & np.isfinite(aid)
    off = np.where(known, np.nan_to_num(aid) - reference, 0.0)
    turned = spans.sums(np.where(known, np.abs(reference), 0.0))
    count, net, swing = spans.sums(known.astype(float)), np.abs(spans.sums(off)), spans.sums(np.abs(off))
    bad = net > _TURN_OFF + _TURN_SHARE * turned
    bad |= swing > _TURN_OFF + _SWING * turned + _TURN_NOISE * count
    return WindowAgreement(bad, np.where(bad, np.clip(np.maximum(turned, net), 0.2, 3.0), np.minimum(turned, 3.0)))


def way_agreement(spans: Windows, aid: FloatArray, reference: FloatArray, known: BoolArray) -> WindowAgreement:
    """Return how ways (N, 2) [m] of an aid, in axes of the base, agree with a reference's where both are known."""
    known = known & np.isfinite(aid).all(axis=1)
    off = np.where(known[:, None], np.nan_to_num(aid) - reference, 0.0)
    driven = spans.sums(np.where(known, np.hypot(*reference.T), 0.0))
    count, net = spans.sums(known.astype(float)), np.hypot(*spans.sums(off).T)
    swing = spans.sums(np.hypot(*off.T))
    bad = net > _WAY_OFF + _WAY_SHARE * driven
    bad |= swing > _WAY_OFF + _SWING * driven + _WAY_NOISE * count
    return WindowAgreement(bad, np.where(bad, np.clip(np.maximum(driven, net), 0.3, 5.0), np.minimum(driven, 5.0)))


def stretches(found: WindowAgreement, spans: Windows) -> list[tuple[int, int]]:
    """Return the stretches (first and last window) over which evidence against an aid outweighs the evidence for it.

    They are maximal sums of the signed evidence (Kadane's algorithm), so that a window that agrees by chance does not
    end a stretch, and a slip does not begin one.
    """
    score, result = np.where(found.bad, found.weight, -2.0 * found.weight), []
    for _ in range(MOST_STRETCHES):
        best, first, last = _best_run(score)
        if best <= 0.0:
            break
        bad, weight = found.bad[first : last + 1], found.weight[first : last + 1]
        begin, end = spans.span(first, last)
        share = float(weight[bad].sum()) / max(found.evidence, 1e-9)
        score[first : last + 1] = -np.inf
        clear = bad.sum() >= _LEAST_WINDOWS and weight[bad].sum() >= _LEAST_PART * weight.sum()
        if clear and (share >= _SHORT_SHARE or end - begin >= _LONG_S):
            result.append((first, last))
    return sorted(result)


def grown(run: tuple[int, int], found: WindowAgreement) -> tuple[int, int]:
    """Return the stretch with the windows before and after it that tell nothing for the aid.

    One window that agrees beside one that does not may do so by chance.
    """
    first, last = run
    telling = ~found.bad & (found.weight >= _TELLING)
    bad = np.concatenate([found.bad, [False, False]])  # also at -1 and -2
    while first > 0 and (not telling[first - 1] or bad[first - 2]):
        first -= 1
    while last + 1 < len(telling) and (not telling[last + 1] or bad[last + 2]):
        last += 1
    return first, last


def _best_run(score: FloatArray) -> tuple[float, int, int]:
    """Return the largest sum of consecutive scores, and its first and last index."""
    best, first, last, run, begin = 0.0, 0, -1, 0.0, 0
    for k, value in enumerate(score.tolist()):
        if run <= 0.0:
            run, begin = 0.0, k
        run += value
        if run > best:
            best, first, last = run, begin, k
    return best, first, last
