"""Which basins are one room: pieces of a corridor in line, bays and niches join, rooms behind a doorway do not.

The rules look at a contact's saddle against the peaks of the two basins (`share`), at how alike the peaks are, and at
the number of neighbours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waychair.maps.rooms.basins import Contacts
from waychair.types import Float32Array, FloatArray, IntArray

WIDEST_PARTING = 1.1
"""Half the widest opening [m] that parts two rooms."""

IN_LINE, ALIKE = 0.65, 1.5
"""Two basins are one corridor, cut by a pilaster or an open fire door, where the saddle is at least this share of the
lower peak and the higher peak at most this multiple of it."""

ALCOVE = 3.0
"""A wide-open basin with one neighbour is a room of its own from this area [m²]: a cubicle that faces a corridor."""

NICHE, WIDE = 2.5, 0.6
"""A basin below this area [m²] is part of its neighbour where the saddle is at least this share of its peak."""

SCRAP = 0.8
"""Less floor [m²] than a chair takes to turn is no room: it is part of the neighbour with the widest opening."""


@dataclass(slots=True)
class _Regions:
    """Joined basins: what each has become, and the sums of the roots."""

    roots: list[int]
    peaks: list[float]
    areas: list[float]
    saddles: list[dict[int, float]]

    def root(self, basin: int) -> int:
        while self.roots[basin] != basin:
            self.roots[basin] = self.roots[self.roots[basin]]
            basin = self.roots[basin]
        return basin

    def join(self, one: int, other: int) -> None:
        """Make two neighbouring roots one; the one with the higher peak stays."""
        high, low = (one, other) if self.peaks[one] >= self.peaks[other] else (other, one)
        self.roots[low] = high
        self.areas[high] += self.areas[low]
        for neighbour, saddle in self.saddles[low].items():
            del self.saddles[neighbour][low]
            if neighbour != high:
                widest = max(saddle, self.saddles[high].get(neighbour, 0.0))
                self.saddles[high][neighbour] = self.saddles[neighbour][high] = widest
        self.saddles[low] = {}


def merged_basins(peaks: Float32Array, areas: FloatArray, contacts: Contacts) -> IntArray:
    """Return (N + 1,) int64 the basin that each has become part of, itself for most.

    Args:
        peaks: (N + 1,) greatest clearance of each basin [m].
        areas: (N + 1,) floor of each basin [m²].
        contacts: the pairs of basins that touch.
    """
    saddles: list[dict[int, float]] = [{} for _ in peaks]
    for (one, other), saddle in zip(contacts.pairs.tolist(), contacts.saddles.tolist(), strict=True):
        saddles[one][other] = saddles[other][one] = saddle
    regions = _Regions(list(range(len(peaks))), peaks.tolist(), areas.tolist(), saddles)
    for belongs in (_is_one_hall, _is_scrap, _is_in_line, _is_niche):
        while _join_where(regions, belongs):
            pass
    return np.array([regions.root(basin) for basin in range(len(peaks))], np.int64)


def _join_where(regions: _Regions, belongs: Callable[[_Regions, int, int], bool]) -> bool:
    """Join every pair that a rule holds for, the widest for their size first; return whether there was one."""
    shares = [
        (saddle / min(regions.peaks[one], regions.peaks[other]), one, other)
        for one, neighbours in enumerate(regions.saddles)
        for other, saddle in neighbours.items()
        if one < other
    ]
    joined = False
    for _, one, other in sorted(shares, reverse=True):
        one, other = regions.root(one), regions.root(other)
        if one == other or other not in regions.saddles[one]:
            continue
        low, high = (one, other) if regions.areas[one] <= regions.areas[other] else (other, one)
        if belongs(regions, low, high):
            regions.join(one, other)
            joined = True
    return joined


def _share(regions: _Regions, one: int, other: int) -> float:
    return regions.saddles[one][other] / min(regions.peaks[one], regions.peaks[other])


def _is_one_hall(regions: _Regions, small: int, large: int) -> bool:
    return regions.saddles[small][large] > WIDEST_PARTING


def _is_scrap(regions: _Regions, small: int, large: int) -> bool:
    widest = max(regions.saddles[small].values())
    return regions.areas[small] < SCRAP and regions.saddles[small][large] >= widest


def _is_in_line(regions: _Regions, small: int, large: int) -> bool:
    if _is_alcove(regions, small) or _is_alcove(regions, large):
        return False
    peaks = regions.peaks[small], regions.peaks[large]
    return _share(regions, small, large) >= IN_LINE and max(peaks) <= ALIKE * min(peaks)


def _is_alcove(regions: _Regions, basin: int) -> bool:
    return len(regions.saddles[basin]) == 1 and regions.areas[basin] >= ALCOVE


def _is_niche(regions: _Regions, small: int, large: int) -> bool:
    widest = max(regions.saddles[small].values())
    if regions.areas[small] >= NICHE or regions.saddles[small][large] < widest:
        return False
    return regions.saddles[small][large] >= WIDE * regions.peaks[small]
