"""The skin: from the motors' levels, millisecond by millisecond, to the places and times that a person feels.

A felt place is the true one with two errors: one common to a whole pattern (where on the hand it is) and one of each burst.
Their sum makes a person read two of nine static places on the back of the wrist (Chen et al., EuroHaptics 2008). A sequence is
read better, because the common error drops out of its direction (95 % at gaps above 400 ms: Niwa et al., World Haptics
2009). Sooner after the last pattern, the error of each burst is larger (masking: Enriquez and MacLean 2008; by how much is
an assumption).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.firmware_bridge.glove.layouts import TactorLayout
from waychair.firmware_bridge.glove.levels import MotorLevels
from waychair.firmware_bridge.glove.messages import PlayStep
from waychair.types import FloatArray

ENDED_MS = 130
"""ms; after so long a silence a pattern is over. Pauses within a pattern are shorter."""

PAUSE_MS = 30
"""ms; a shorter rest is not felt as a pause."""

LEAST_MS = 20
"""ms; a shorter burst is not felt."""

WIDE = 3
"""Motors at once, from which on a person feels no place but the whole hand (Wang et al. 2018: right answers fall by number)."""

UNMASKED_MS = 400
"""ms; a gap from which on the last pattern does not mask (Niwa et al. 2009)."""


@dataclass(frozen=True, slots=True)
class SkinModel:
    """What a person feels. Errors in mm, one sigma, on the skin of the site.

    `common` is shared by all bursts of a pattern, `single` is of each. `masked` is added to `single`, as a share of it, by a
    pattern that comes at once after the last. `timing` is the error of a duration, as a share. `threshold` is the least
    level that is felt, of 255.
    """

    common: float = 10.8
    single: float = 13.5
    masked: float = 0.8
    timing: float = 0.15
    threshold: int = 40

    def single_after(self, gap_ms: float) -> float:
        """Return the error of a burst [mm] when the last pattern ended so long ago."""
        return self.single * (1.0 + self.masked * max(0.0, 1.0 - gap_ms / UNMASKED_MS))


@dataclass(frozen=True, slots=True)
class FeltBurst:
    """A burst: its site and place [mm], whether it is felt all over, its duration [ms], and the pause [ms] before it."""

    site: str
    x: float
    y: float
    wide: bool
    on_ms: float
    pause_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class RawBurst:
    """Motors that vibrated at once, from a millisecond to before another one."""

    motors: tuple[int, ...]
    from_ms: int
    to_ms: int


class Skin:
    """The skin under one device; it gathers the levels into patterns and draws the errors of each."""

    def __init__(self, layout: TactorLayout, model: SkinModel, rng: np.random.Generator) -> None:
        self._layout, self._model, self._rng = layout, model, rng
        self._bursts: list[RawBurst] = []
        self._on: tuple[tuple[int, ...], int] | None = None
        self._last_ms: int | None = None  # end of the latest vibration
        self._gap_ms = math.inf  # before the present pattern
        self.ended_ms = 0
        """The end of the latest pattern that was returned."""

    def feel(self, levels: MotorLevels) -> list[FeltBurst] | None:
        """Take in the levels of some milliseconds; return the pattern that ended within them, None without one."""
        felt = levels.levels >= self._model.threshold
        ended: list[FeltBurst] | None = None
        change = np.flatnonzero((felt[1:] != felt[:-1]).any(axis=1)) + 1 if len(felt) > 1 else np.zeros(0, np.int64)
        for first, after in zip([0, *change.tolist()], [*change.tolist(), len(felt)], strict=True):
            if after <= first:
                continue
            found = self._take(
                tuple(np.flatnonzero(felt[first]).tolist()), levels.first_ms + first, levels.first_ms + after
            )
            ended = found or ended
        return ended

    def _take(self, motors: tuple[int, ...], from_ms: int, to_ms: int) -> list[FeltBurst] | None:
        """Take in a stretch of time with the same motors; return the pattern that it ends."""
        if self._on is not None and self._on[0] != motors:
            self._close(from_ms)
        if motors:
            if self._on is None:
                if not self._bursts:
                    self._gap_ms = math.inf if self._last_ms is None else from_ms - self._last_ms
                self._on = motors, from_ms
            self._last_ms = to_ms
            return None
        if not self._bursts or self._last_ms is None or to_ms - self._last_ms < ENDED_MS:
            return None
        felt = self._felt()
        self.ended_ms, self._bursts = self._last_ms, []
        return felt

    def _close(self, at_ms: int) -> None:
        assert self._on is not None
        motors, since = self._on
        self._on = None
        if at_ms - since < LEAST_MS:
            return
        if len(motors) >= WIDE and self._bursts and len(self._bursts[-1].motors) < WIDE:
            self._bursts = []  # a vibration all over wipes out the pattern that it interrupts
        self._bursts.append(RawBurst(motors, since, at_ms))

    def _felt(self) -> list[FeltBurst]:
        model, rng = self._model, self._rng
        common, single = rng.normal(0.0, model.common, 2), model.single_after(self._gap_ms)
        stretch = 1.0 + model.timing * rng.standard_normal()
        return felt_bursts(
            self._layout, self._bursts, stretch, common + rng.normal(0.0, single, (len(self._bursts), 2))
        )


def felt_bursts(
    layout: TactorLayout, bursts: Sequence[RawBurst], stretch: float = 1.0, errors: FloatArray | None = None
) -> list[FeltBurst]:
    """Return bursts as they are felt with these errors (B, 2) [mm] and this stretch of all durations."""
    felt, before = list[FeltBurst](), None
    for k, burst in enumerate(bursts):
        tactors = [layout.tactors[motor] for motor in burst.motors if motor < len(layout.tactors)]
        if not tactors:
            continue
        x = float(np.mean([tactor.x_mm for tactor in tactors]))
        y = float(np.mean([tactor.y_mm for tactor in tactors]))
        dx, dy = (0.0, 0.0) if errors is None else errors[k].tolist()
        pause = 0.0 if before is None else float(burst.from_ms - before)
        wide = len(tactors) >= WIDE
        felt.append(FeltBurst(tactors[0].site, x + dx, y + dy, wide, (burst.to_ms - burst.from_ms) * stretch, pause))
        before = burst.to_ms
    return felt


def bursts_of(steps: Sequence[PlayStep]) -> list[RawBurst]:
    """Return the bursts of a pattern as the board plays it."""
    bursts, at = list[RawBurst](), 0
    for step in steps:
        bursts.append(RawBurst(step.motors, at, at + step.on_ms))
        at += step.on_ms + step.off_ms
    return bursts


class Recogniser:
    """A trained person: which learnt symbol a felt pattern is most likely to be (maximum likelihood)."""

    def __init__(self, layout: TactorLayout, learnt: dict[str, tuple[PlayStep, ...]], model: SkinModel) -> None:
        self._girths, self._model = layout.girths, model
        self._known = {name: _Shape(felt_bursts(layout, bursts_of(steps))) for name, steps in learnt.items()}

    def recognise(self, felt: Sequence[FeltBurst]) -> str | None:
        """Return the name of the likeliest symbol; None if the pattern is like none of them."""
        shape = _Shape(felt)
        best = max(self._known, key=lambda name: self.likelihood(shape, self._known[name]), default=None)
        if best is None or self.likelihood(shape, self._known[best]) < _UNLIKE:
            return None
        return best

    def likelihood(self, felt: _Shape, known: _Shape) -> float:
        """Return the log likelihood of a felt pattern under a learnt one, without constants."""
        if felt.wide != known.wide:
            return -math.inf
        rhythm = -_MISCOUNTED * abs(felt.pulses - known.pulses)
        took = (felt.took_ms - known.took_ms) / (self._model.timing * known.took_ms)
        rhythm -= 0.5 * took * took
        if felt.wide:
            return rhythm
        rhythm -= _MOVED * (felt.moves != known.moves)
        shares = felt.shares if len(felt.sites) >= len(known.sites) else known.shares  # rest and motion feel different
        sites = felt.sites_at(shares)
        elsewhere = sum(a != b for a, b in zip(sites, known.sites_at(shares), strict=True))
        apart = felt.places_at(shares) - known.places_at(shares)
        for k, site in enumerate(sites):
            if site in self._girths:
                apart[k, 1] = math.remainder(apart[k, 1], self._girths[site])
        single, common = self._model.single**2, self._model.common**2
        count = len(apart)
        squares = float((apart**2).sum()) / single
        together = float((apart.sum(axis=0) ** 2).sum()) * common / (single * (single + count * common))
        return rhythm - _SURE * elsewhere - 0.5 * (squares - together)


_SURE, _MISCOUNTED, _MOVED, _UNLIKE = 12.0, 8.0, 2.0, -14.0
"""Log likelihoods: of a mistake that hardly anybody makes (which wrist), of one pulse miscounted, of the onset of
another motor within a pulse missed, and the least one with which a person believes to have understood. Assumptions."""


class _Shape:
    """A pattern for comparison: places (B, 2), shares of its time in the middle of each burst, pulses, duration."""

    def __init__(self, bursts: Sequence[FeltBurst]) -> None:
        self.sites = [burst.site for burst in bursts]
        self.places = np.array([[burst.x, burst.y] for burst in bursts])
        self.wide = any(burst.wide for burst in bursts)
        self.pulses = sum(burst.pause_ms >= PAUSE_MS for burst in bursts) + 1
        self.moves = len({(burst.site, burst.x, burst.y) for burst in bursts}) > 1 and self.pulses < len(bursts)
        on = np.array([burst.on_ms for burst in bursts])
        pauses = np.array([burst.pause_ms for burst in bursts])
        ends = np.cumsum(on + pauses)
        self.took_ms = float(ends[-1])
        self.shares = (ends - on / 2) / self.took_ms
        self._edges = ends / self.took_ms

    def _at(self, shares: FloatArray) -> list[int]:
        """Return the indices of the bursts at shares of the pattern's time."""
        return [min(int(k), len(self.sites) - 1) for k in np.searchsorted(self._edges, shares)]

    def places_at(self, shares: FloatArray) -> FloatArray:
        """Return the places (N, 2) at shares of the pattern's time."""
        return self.places[self._at(shares)]

    def sites_at(self, shares: FloatArray) -> list[str]:
        """Return the sites at shares of the pattern's time."""
        return [self.sites[k] for k in self._at(shares)]
