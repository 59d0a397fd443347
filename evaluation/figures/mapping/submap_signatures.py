"""Signatures of submaps: would one find the submap that the chair is in sooner than the order by distance?

A signature is a few numbers by which two views of a place are alike whatever the heading. Three are measured: the shares of
surface points by distance (the ring key of scan context, Kim and Kim, IROS 2018), the distances to the nearest surface in all
directions in ascending order, and the same by direction, compared in all turns.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from evaluation.figures.mapping.carried import LOGS, mapper_over
from evaluation.figures.mapping.logs import DATA
from waychair.recordings.recording import read_recording
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.scan.submap_search import SubmapPyramids, SubmapRound
from waychair.types import FloatArray, Json, Pose2

SUBMAP, QUERY, APART = 40, 15, 100
"""Key scans of a submap and of the view that is searched for, as in the mapper, and between the two at least."""

NEAR, DRIFT = 1.5, 8.0
"""m; a submap with a key scan so near shows the place; standard deviation of the map's error in each direction."""

RADIUS, RINGS, DIRECTIONS, CELL, MOST = 10.0, 20, 36, 0.1, 0.7
"""m and numbers; surfaces beyond the radius do not count, points are thinned to the cell [m], differences are cut at the last."""

EVERY = 7
"""key scans between two queries."""

MOST_DEARER = 1.05
"""times the time of the cheapest order."""

Signature: TypeAlias = tuple[FloatArray, ...]
"""Shares by ring (R,), logarithms of the nearest distances in ascending order (D,), and by direction (D,)."""


@dataclass(frozen=True, slots=True)
class _Query:
    """The points (N, 2) [m, base] of a view, the first key scans of all submaps, and of those that show the place.

    `away` [m]: the distances of the submaps on a map that is wrong; `chance` orders them by chance.
    """

    points: FloatArray
    submaps: tuple[int, ...]
    right: frozenset[int]
    away: Mapping[int, float]
    chance: Mapping[int, float]


def submap_signatures(out: Path) -> Json:
    """For each order: how often a submap that shows the place comes first, how many are searched before it, and the time of a round.

    A round searches all submaps, because a place counts only if the view fits nowhere else; a good order makes it cheaper. The order by
    distance, which the mapper uses, passes if no other is cheaper by more than 5 %. `SIGNATURE_LOGS=intel` takes other logs.
    """
    rows, passed = list[Json](), True
    for name in os.environ.get("SIGNATURE_LOGS", "intel,aces,infinite_corridor").split(","):
        found = list(_rows(name))
        times = {row["order"]: row["round_ms"] for row in found}
        passed = passed and times["distance"] <= MOST_DEARER * min(times.values())
        print(*found, sep="\n", flush=True)
        rows += found
    return {"passed": passed, "rows": rows}


def _rows(name: str) -> Iterator[Json]:
    recording = read_recording(DATA / LOGS[name])
    mapper = mapper_over(recording, recording.frames)
    mapper.result()
    keys, known = mapper.keys, dict[int, list[Signature]]()
    queries = list(_queries(keys))
    # of a submap each, since one cache would not hold all
    pyramids = [SubmapPyramids() for _ in range(0, len(keys), SUBMAP)]
    scored = [_scores(keys, query, known) for query in queries]
    for order in scored[0]:
        ranks, spent = [], []
        for query, scores in zip(queries, scored, strict=True):
            inorder = sorted(query.submaps, key=scores[order].__getitem__)
            ranks.append(min(k for k, submap in enumerate(inorder) if submap in query.right))
            spent.append(_round_s(keys, query.points, inorder, pyramids))
        yield {
            "log": name,
            "order": order,
            "queries": len(queries),
            "submaps": round(float(np.mean([len(query.submaps) for query in queries])), 1),
            "first": round(float(np.mean(np.array(ranks) == 0)), 2),
            "searched_before": round(float(np.mean(ranks)), 1),
            "searched_before_p90": float(np.quantile(ranks, 0.9)),
            "round_ms": round(1e3 * float(np.mean(spent)), 1),
        }


def _queries(keys: KeyGraph) -> Iterator[_Query]:
    rng = np.random.default_rng(0)
    for node in range(APART + SUBMAP, len(keys), EVERY):
        submaps = tuple(range(0, node - APART, SUBMAP))
        error = rng.normal(0.0, DRIFT, 2)
        away = {first: _least_away(keys, first, node, np.zeros(2)) for first in submaps}
        right = frozenset(first for first in submaps if away[first] < NEAR)
        if right and len(submaps) > len(right):
            off = {first: _least_away(keys, first, node, error) for first in submaps}
            chance = dict(zip(submaps, rng.random(len(submaps)).tolist(), strict=True))
            view = keys.joined_points(range(node - QUERY + 1, node + 1), keys.pose(node), CELL)
            yield _Query(view.points, submaps, right, off, chance)


def _least_away(keys: KeyGraph, first: int, node: int, error: FloatArray) -> float:
    """Return the distance [m] from a key scan to the nearest one of a submap, on a map that is wrong by `error`."""
    gaps = keys.poses[first : first + SUBMAP, :2] - keys.poses[node, :2] - error
    return float(np.hypot(*gaps.T).min())


def _scores(keys: KeyGraph, query: _Query, known: dict[int, list[Signature]]) -> dict[str, Mapping[int, float]]:
    """Return, for each order, the figure by which it sorts the submaps, the least first."""
    own = _signature(query.points, np.zeros(3))
    scores: dict[str, Mapping[int, float]] = {}
    for which, order in enumerate(("rings", "nearest, ascending", "nearest by direction")):
        turns = DIRECTIONS if order == "nearest by direction" else 1
        turned = np.array([np.roll(own[which], k) for k in range(turns)])
        unlike = {}
        for first in query.submaps:
            there = np.array([each[which] for each in _signatures(keys, first, known)])
            unlike[first] = float(np.minimum(np.abs(there[:, None] - turned[None]), MOST).mean(axis=2).min())
        scores[order] = unlike
    return {**scores, "distance": query.away, "chance": query.chance}


def _signatures(keys: KeyGraph, first: int, known: dict[int, list[Signature]]) -> list[Signature]:
    """Return the signatures at all key scans of a submap."""
    if first not in known:
        members = range(first, first + SUBMAP)
        points = keys.joined_points(members, Pose2(), CELL).points
        known[first] = [_signature(points, keys.poses[node]) for node in members]
    return known[first]


def _signature(points: FloatArray, pose: FloatArray) -> Signature:
    """Return the three signatures of surface points (N, 2) as seen from a pose (3,)."""
    away = points - pose[:2]
    ranges, bearings = np.hypot(*away.T), np.mod(np.arctan2(away[:, 1], away[:, 0]) - pose[2], math.tau)
    rings = np.histogram(ranges, bins=np.linspace(0.0, RADIUS, RINGS + 1))[0] / max(1, (ranges < RADIUS).sum())
    nearest = np.full(DIRECTIONS, RADIUS)
    towards = (bearings / math.tau * DIRECTIONS).astype(np.int64) % DIRECTIONS
    np.minimum.at(nearest, towards, np.minimum(ranges, RADIUS))
    profile = np.log(nearest + 3.0 * CELL)
    return rings, np.sort(profile), profile


def _round_s(keys: KeyGraph, points: FloatArray, submaps: Sequence[int], pyramids: Sequence[SubmapPyramids]) -> float:
    """Return the time [s] of a search of all submaps in this order, with their pyramids at hand."""
    whole, spent = SubmapRound(points, [(first, np.arange(first, first + SUBMAP)) for first in submaps]), 0.0
    while whole.waiting:
        first, members = whole.waiting[0]
        at_hand = pyramids[first // SUBMAP]
        at_hand.pyramid(first, keys.store, keys.poses, members)
        started = time.process_time()
        whole.search(keys.store, keys.poses, at_hand)
        spent += time.process_time() - started
    return spent
