"""Ways for all chairs at once: as the chairs can drive them, with one chair in each resource after each step."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.planning.fleet.small_traffic import traffic
from waychair.planning.fleet.granting import granted
from waychair.planning.fleet.joint_ways import joint_ways
from waychair.planning.fleet.order import Chain, Order, Request, Turn, foreseen
from waychair.planning.fleet.ways import Ways, ways_of

CLEARING_MS = 400


def ahead_only(ways: Ways) -> Ways:
    """Return the ways without those back out of a section, as for chairs that cannot turn in it."""
    before = np.repeat(np.arange(len(ways.names)), np.diff(ways.first))
    edges = set(zip(before.tolist(), ways.after.tolist(), strict=True))
    kept = np.array(
        [("-" not in ways.names[one]) or (two, one) not in edges for one, two in zip(before, ways.after, strict=True)]
    )
    first = np.searchsorted(before[kept], np.arange(len(ways.names) + 1)).astype(np.int64)
    return replace(ways, first=first, after=ways.after[kept])


AHEAD = ahead_only(ways_of(traffic("run with a bay", ["P-a", "a-b", "b-c", "c-Q", "b-B"], bays="B"), 1.0))


def face_to_face(ways: Ways) -> Order:
    """Return chair 1 on its way from P, chair 2 on its way from Q: each before the junction that leads to the bay."""
    inside = {1: spot_between(ways, "a", "b"), 2: spot_between(ways, "c", "b")}
    chains = {chair: Chain((spot,), visit=4) for chair, spot in inside.items()}
    queues = {int(ways.resource[spot]): (Turn(chair, 4),) for chair, spot in inside.items()}
    waiting = (Request(1, 1, "Q", 0), Request(2, 2, "P", 0))
    return Order(ways, chains, queues, waiting)


def spot_between(ways: Ways, start: str, end: str) -> int:
    """Return the section from one node to the other, in this direction."""
    names = {f"{start}-{end}", f"{end}-{start}"}
    from_start = after(ways, ways.names.index(start))
    return next(spot for spot in from_start if ways.names[spot] in names)


def after(ways: Ways, spot: int) -> list[int]:
    return [int(other) for other in ways.after[ways.first[spot] : ways.first[spot + 1]]]


@pytest.mark.parametrize("seed", range(20))
def test_chairs_face_to_face_leave_a_narrow_run_ahead_only(seed: int) -> None:
    order = face_to_face(AHEAD)
    assert AHEAD.names.index("a") not in after(AHEAD, order.chains[1].spots[0])
    found = list(joint_ways(order, {1: "Q", 2: "P"}, np.random.default_rng(seed)))
    assert found
    for spots, turns in found:
        assert all(two in after(AHEAD, one) for way in spots.values() for one, two in pairwise(way))
        assert {chair: AHEAD.names[way[-1]] for chair, way in spots.items()} == {1: "Q", 2: "P"}
        assert sum(AHEAD.names[way[k]] == "B" for way in spots.values() for k in range(len(way))) >= 1
        assert sorted(turn for each in turns.values() for turn in each) == sorted(
            Turn(chair, 4 + k) for chair, way in spots.items() for k in range(len(way))
        )


def test_chairs_face_to_face_are_granted_their_goals_past_each_other() -> None:
    order = granted(face_to_face(AHEAD), 1000, CLEARING_MS, np.random.default_rng(0), 3)
    assert order.waiting == ()
    assert foreseen(order, 1000, CLEARING_MS) is not None


def test_no_way_for_all_leads_through_a_closed_section() -> None:
    order = face_to_face(AHEAD)
    bay = int(AHEAD.resource[spot_between(AHEAD, "b", "B")])
    closed = Order(order.ways, order.chains, order.queues, order.waiting, frozenset({bay}))
    assert list(joint_ways(closed, {1: "Q", 2: "P"}, np.random.default_rng(0))) == []
