"""The evidence about the aids of a drive: the scans, windows of time, and the findings so far."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from waychair.slam.odometry.aid_findings import AidFinding, AidPart, AidState, Cause
from waychair.slam.odometry.aid_series import ScanSeries, correlation
from waychair.slam.odometry.aid_windows import WindowAgreement, Windows, grown, stretches, turn_agreement, way_agreement
from waychair.types import BoolArray, FloatArray

ENOUGH_TURN = 1.2
"""Least turning [rad] that tells about an aid."""

GOOD = 0.15
"""Share of contradicting evidence up to which a corrected aid agrees."""

LEAST_CORRELATION = 0.8
"""Least correlation of an aid that can be corrected with the scans."""

LEAST_DELAY_S = 0.15
"""A smaller delay [s] does no harm."""

NEAR = 0.12
"""A factor this near (relative) a known one is that one, if the aid then agrees: scans that blur turns measure less."""

DELAYS_S = np.arange(-2.0, 2.01, 0.1)
"""Delays [s] that are tried."""

DEGREES = 180.0 / math.pi
KNOWN_FACTORS = (-1.0, DEGREES, -DEGREES, 1.0 / DEGREES, 1000.0, 0.001, 100.0, 0.01, 1e6, 0.3048, 1 / 0.3048, 0.0254)
"""Factors of units and signs."""

_STANDS = 0.05  # share of the true motion below which an aid stands still
_STUCK = 0.005  # relative spread of a rate that does not change


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch: its intervals (N,), and its begin and end [s], None where no evidence lies before or after it.

    An aid that is left out is so with the window before and after, `around`: the fault may begin or end in them.
    """

    inside: BoolArray
    since_s: float | None
    until_s: float | None
    around: tuple[float, float] = (-math.inf, math.inf)


@dataclass(slots=True)
class Evidence:
    """The inputs, and the findings so far."""

    scans: ScanSeries
    spans: Windows
    known_turn: BoolArray
    known_way: BoolArray
    findings: list[AidFinding] = field(default_factory=list)

    @property
    def turns(self) -> FloatArray:
        return self.scans.motions[:, 2]

    def turn(self, told: FloatArray) -> WindowAgreement:
        return turn_agreement(self.spans, told, self.turns, self.known_turn)

    def way(self, told: FloatArray) -> WindowAgreement:
        return way_agreement(self.spans, told, self.scans.motions[:, :2], self.known_way)

    def runs(self, found: WindowAgreement) -> list[Stretch]:
        """Return the stretches in which an aid is not right as it is."""
        last = len(self.spans) - 1
        result = []
        for run in stretches(found, self.spans):
            begin, end = self.spans.span(*run)
            whole = grown(run, found)
            since, until = (None if whole[0] == 0 else begin), (None if whole[1] == last else end)
            around = self.spans.span(max(whole[0] - 1, 0), min(whole[1] + 1, last))
            bounds = (-math.inf if since is None else around[0]), (math.inf if until is None else around[1])
            result.append(Stretch(self.spans.members(*whole, len(self.turns)), since, until, bounds))
        return result

    def whole(self) -> Stretch:
        """Return the stretch of the whole recording."""
        return Stretch(np.ones(len(self.turns), np.bool_), None, None)

    def add(self, part: AidPart, state: AidState, cause: Cause, run: Stretch | None, **values: float) -> None:
        since, until = (None, None) if run is None else (run.since_s, run.until_s)
        self.findings.append(AidFinding(part, state, cause, since, until, **values))  # type: ignore[arg-type]


def unlike(told: FloatArray, size: float, true: float) -> Cause:
    """Return the look of an aid that cannot be corrected, from its rates: nothing, one value, or something else."""
    finite = told[np.isfinite(told)]
    if not len(finite):
        return Cause.MISSING
    if size < _STANDS * true or not finite.any():
        return Cause.NOTHING
    usual = float(np.median(finite))
    spread = float(np.median(np.abs(finite - usual)))  # robust against the turns before it stuck
    if spread > _STUCK * abs(usual) + 1e-9:
        return Cause.UNLIKE
    return Cause.STUCK if usual else Cause.NOTHING


def factors(fitted: float, sigma: float) -> list[float]:
    """Return the factors that a fitted one may stand for, the most likely first: known ones near it, then itself."""
    near = max(NEAR, 3.0 * sigma / max(abs(fitted), 1e-9))
    return [*(known for known in (1.0, *KNOWN_FACTORS) if abs(fitted / known - 1.0) <= near), fitted]


def delay_of(evidence: Evidence, turns_at: Callable[[float], FloatArray]) -> float:
    """Return the delay [s] of an aid's stamps, 0 unless it is certain: its turns then agree twice as well."""
    known = evidence.known_turn
    if np.abs(evidence.turns[known]).sum() < ENOUGH_TURN:
        return 0.0

    def off(late: float) -> tuple[float, float]:
        turns = turns_at(late)
        both = known & np.isfinite(turns)
        if both.sum() < 10:
            return math.inf, 0.0
        return float(np.abs(turns - evidence.turns)[both].mean()), correlation(turns, evidence.turns, both)

    now, agreed = off(0.0)
    if agreed > 0.97:
        return 0.0
    values = [off(float(late)) for late in DELAYS_S]
    best = int(np.argmax([value[1] for value in values]))
    delay = float(DELAYS_S[best])
    if (
        abs(delay - 0.5 * evidence.scans.sweep_s) < LEAST_DELAY_S
        or values[best][0] > 0.5 * now
        or values[best][1] < 0.9
    ):
        return 0.0
    tried = delay + np.arange(-0.1, 0.11, 0.02)
    finer = min(tried, key=lambda late: off(float(late))[0])
    return round(float(finer) - 0.5 * evidence.scans.sweep_s, 2)
