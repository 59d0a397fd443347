"""A discrete Bayes filter over the places in working memory and a virtual place, which means "a new place".

Between two views the chair moves along the graph: the transition model gives the neighbours of a place, by their
distance in links, the shares of a Gaussian (Angeli et al. 2008; Labbe and Michaud 2013, equations 3 and 4, with
RTAB-Map's values). Only the columns of places whose neighbourhood changed are computed again.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from numba import njit

from waychair.slam.camera.hamming_index import Int32Array
from waychair.types import FloatArray, IntArray

VIRTUAL = -1
"""Id of the virtual place."""

Links = Mapping[int, Sequence[int]]
"""Ids of the nodes linked to each node; a missing node has no links."""

PREDICTION = (
    0.1, 0.36, 0.30, 0.16, 0.062, 0.0151, 0.00255, 0.000324, 2.5e-05, 1.3e-06, 4.8e-08, 1.2e-09, 1.9e-11, 2.2e-13,
    1.7e-15, 8.5e-18, 2.9e-20, 6.9e-23,
)  # fmt: skip


"""Probabilities of the virtual place, of the place itself, and of its neighbours 1, 2, ... links away (RTAB-Map's
Bayes/PredictionLC)."""

VIRTUAL_STAYS = 0.9
"""Probability that a new place follows a new place (RTAB-Map's Bayes/VirtualPlacePriorThr)."""


class BayesFilter:
    """The belief over places. A place keeps its row of the arrays as long as it stays; row 0 is the virtual place."""

    def __init__(self, prediction: Sequence[float] = PREDICTION) -> None:
        """`prediction`: at least two positive probabilities with a sum of at most 1, as `PREDICTION`."""
        self._prediction = tuple(prediction)
        self._row_of: dict[int, int] = {}
        self._free_rows: list[int] = []
        self._neighbours: dict[int, tuple[int, ...]] = {}
        self._twins: dict[int, tuple[int, ...]] = {}
        self._belief = np.zeros(16)
        self._rows = np.zeros((16, 36), np.int32)  # column of each place: the rows that it leads to, itself first
        self._shares = np.zeros((16, 36))
        self._entries = np.zeros(16, np.int32)
        self._started = False

    @property
    def places(self) -> IntArray:
        """The ids (M,) of the places, in no particular order."""
        return np.fromiter(self._row_of, np.int64, len(self._row_of))

    def probability(self, place: int) -> float:
        """Return the probability of a place, or of `VIRTUAL`, after the last update."""
        return float(self._belief[0 if place == VIRTUAL else self._row_of[place]])

    def update(
        self, places: IntArray, likelihood: FloatArray, neighbours: Links, twins: Links | None = None
    ) -> FloatArray:
        """Return the posterior (1 + M,): the virtual place, then `places` (M,) in the order given.

        Args:
            places: ids of the nodes in working memory; new ones begin at 0, absent ones are forgotten.
            likelihood: (1 + M,) normalised, the virtual place first (`likelihood.normalised`).
            neighbours: links in time between awake nodes (short-term memory too), listed at both ends.
            twins: loop closures by appearance, listed at both ends: their nodes are one place. Leave out those by
                nearness.
        """
        self._follow(places, neighbours, twins or {})
        if len(places) == 0:
            return np.ones(1)
        rows = np.fromiter((self._row_of[int(place)] for place in places), np.int64, len(places))
        if self._started:
            prior = self._predicted(rows)
        else:
            prior, self._started = np.ones(len(places) + 1), True
        posterior = likelihood * prior
        total = posterior.sum()
        if total > 0:
            posterior = posterior / total
        else:  # a likelihood of 0 everywhere: a new place
            posterior = np.zeros(len(places) + 1)
            posterior[0] = 1.0
        self._belief[:] = 0.0
        self._belief[0], self._belief[rows] = posterior[0], posterior[1:]
        return posterior

    def transition(self, places: IntArray) -> FloatArray:
        """Return the transition matrix (1 + M, 1 + M): column j is the distribution after place j; virtual first."""
        rows = np.fromiter((self._row_of[int(place)] for place in places), np.int64, len(places))
        matrix = np.zeros((len(places) + 1, len(places) + 1))
        kept = self._belief.copy()
        for column, row in enumerate([0, *rows]):
            self._belief[:] = 0.0
            self._belief[row] = 1.0
            matrix[:, column] = self._predicted(rows)
        self._belief = kept
        return matrix

    def _predicted(self, rows: IntArray) -> FloatArray:
        shares = np.array(self._prediction)
        spare = max(0.0, 1.0 - float(shares.sum()))
        virtual = float(shares[0])
        least = (1.0 - 1e-9) * float(shares.min())
        flow = _flow(
            live=rows,
            rows=self._rows,
            shares=self._shares,
            entries=self._entries,
            belief=self._belief,
            virtual=virtual,
            spare=spare,
            least=least,
        )
        belief = self._belief
        to_virtual = virtual * belief[rows].sum() + VIRTUAL_STAYS * belief[0]
        from_virtual = (1.0 - VIRTUAL_STAYS) * belief[0] / len(rows)
        return np.concatenate([[to_virtual], flow[rows] + from_virtual])

    def _follow(self, places: IntArray, neighbours: Links, twins: Links) -> None:
        """Take over changed places and links, and compute the columns that they affect again."""
        now = {int(place) for place in places}
        entered, left = now - self._row_of.keys(), self._row_of.keys() - now
        moved = _changed(self._neighbours, neighbours) | _changed(self._twins, twins)
        if not (entered or left or moved):
            return
        touched = entered | left | moved
        # Both ends of a changed link are touched, so every path over it reaches one of them by unchanged links.
        near = self._within_reach(touched)
        self._neighbours = {node: tuple(others) for node, others in neighbours.items()}
        self._twins = {node: tuple(others) for node, others in twins.items()}
        for place in left:
            row = self._row_of.pop(place)
            self._belief[row] = 0.0
            self._free_rows.append(row)
        for place in entered:
            self._row_of[place] = self._free_rows.pop() if self._free_rows else len(self._row_of) + 1
        self._reserve(len(self._row_of) + len(self._free_rows) + 1)
        for place in near.keys() & self._row_of.keys():
            self._write_column(place)

    def _within_reach(self, start: Collection[int]) -> dict[int, int]:
        """Return the distances [links] of all nodes within the model's reach of `start`; twins are at distance 0."""
        distance: dict[int, int] = {}
        level = self._twinned(start, distance, 0)
        for d in range(1, len(self._prediction) - 1):
            ahead = [other for node in level for other in self._neighbours.get(node, ()) if other not in distance]
            level = self._twinned(ahead, distance, d)
        return distance

    def _twinned(self, nodes: Iterable[int], distance: dict[int, int], d: int) -> list[int]:
        level, stack = [], list(nodes)
        while stack:
            node = stack.pop()
            if node not in distance:
                distance[node] = d
                level.append(node)
                stack.extend(self._twins.get(node, ()))
        return level

    def _write_column(self, place: int) -> None:
        shares, row = self._prediction, self._row_of[place]
        reached = self._within_reach((place,))
        del reached[place]
        others = [(self._row_of[node], shares[d + 1]) for node, d in reached.items() if node in self._row_of]
        count = len(others) + 1
        if count > self._rows.shape[1]:
            wider = ((0, 0), (0, count))
            self._rows, self._shares = np.pad(self._rows, wider), np.pad(self._shares, wider)
        if others:
            self._rows[row, 1:count], self._shares[row, 1:count] = zip(*others, strict=True)
        # The place itself keeps the share of missing neighbours.
        absent = sum(shares[1:]) - shares[1] - float(self._shares[row, 1:count].sum())
        self._rows[row, 0], self._shares[row, 0] = row, shares[1] + max(0.0, absent)
        self._entries[row] = count

    def _reserve(self, rows: int) -> None:
        if rows > len(self._belief):
            more = max(rows, 2 * len(self._belief)) - len(self._belief)
            self._belief = np.pad(self._belief, (0, more))
            self._entries = np.pad(self._entries, (0, more))
            self._rows = np.pad(self._rows, ((0, more), (0, 0)))
            self._shares = np.pad(self._shares, ((0, more), (0, 0)))


def best_place(places: IntArray, posterior: FloatArray) -> tuple[int, float] | None:
    """Return the most probable place (among equals the newest id) and 1 - P(virtual); None without places."""
    if len(places) == 0:
        return None
    real = posterior[1:]
    return int(places[real == real.max()].max()), 1.0 - float(posterior[0])


def _changed(before: Mapping[int, tuple[int, ...]], now: Links) -> set[int]:
    gone = before.keys() - now.keys()
    return gone | {node for node, others in now.items() if before.get(node) != tuple(others)}


@njit(cache=True)
def _flow(
    live: IntArray,
    rows: Int32Array,
    shares: FloatArray,
    entries: Int32Array,
    belief: FloatArray,
    virtual: float,
    spare: float,
    least: float,
) -> FloatArray:
    """Return the belief that flows from all real places into each row.

    Each column is scaled to 1 - `virtual`. `spare`, the share that the model leaves over, is spread evenly over the
    places that a column does not name. Shares below `least`, the model's smallest, are dropped.
    """
    flow = np.zeros(len(belief))
    everywhere = 0.0
    for column in live:
        named = entries[column]
        total = 0.0
        for e in range(named):
            total += shares[column, e]
        unnamed = len(live) - named
        rest = spare / unnamed if unnamed > 0 and spare > 1e-9 else 0.0
        scale = (1.0 - virtual) / (total + rest * unnamed)
        rest *= scale
        if rest < least:
            rest = 0.0
        everywhere += rest * belief[column]
        for e in range(named):
            share = shares[column, e] * scale
            if share < least:
                share = 0.0
            flow[rows[column, e]] += (share - rest) * belief[column]
    for row in live:
        flow[row] += everywhere
    return flow
