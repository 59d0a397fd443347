"""Two chairs face to face that cannot hear each other: each finds out alone, from where both stand, which one backs out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.planning.fleet.peers.meeting import gives_way, way_aside
from waychair.types import FloatArray

T = corridor_graph(load_corridors("T"), 1.2, rooms=True, bays=True)
RUNS = load_corridors("T").corridors
ERROR = st.floats(-0.15, 0.15)


def between(line: tuple[float, float, float, float], way: float) -> FloatArray:
    """Return the point (2,) [m] of a corridor at a way from its start."""
    start, end = np.array(line[:2]), np.array(line[2:])
    point: FloatArray = start + way * (end - start) / math.dist(start, end)
    return point


@given(st.sampled_from(RUNS), st.floats(0.0, 1.0), st.floats(2.0, 12.0), st.tuples(*[ERROR] * 8))
def test_f28c_never_both_of_two_back_out_and_one_does_in_the_end(
    line: tuple[float, float, float, float], share: float, apart: float, errors: tuple[float, ...]
) -> None:
    """They meet anywhere in a corridor, at junctions and doors too; each measures both points with errors of its own."""
    length = math.dist(line[:2], line[2:])
    first = share * max(length - apart, 0.0)
    here, there = between(line, first), between(line, min(first + apart, length))
    off = np.array(errors).reshape(4, 2)
    for faced in (1, 2, 3):
        one = gives_way(T, here + off[0], there + off[1], faced)
        other = gives_way(T, there + off[2], here + off[3], faced)
        if one or other:
            break
    assert one != other


@pytest.mark.parametrize("faced", [1, 2])
def test_at_a_junction_the_chair_nearer_to_a_place_aside_backs_out(faced: int) -> None:
    """The middle between two chairs in the crossbar of the T is nearest to the stem, or to a door: neither leads to one of them."""
    middle = T.node["n13"]
    west, east = np.array([middle.x - 0.2, middle.y]), np.array([middle.x + 2.0, middle.y])
    assert gives_way(T, west, east, faced)
    assert not gives_way(T, east, west, faced)


def test_the_way_aside_leads_to_the_nearest_refuge_not_past_the_other_chair() -> None:
    room = next(refuge for refuge in T.refuges if refuge.name == "room 13")
    door, inside = T.node["n13"], T.node[room.node]
    here = np.array([door.x - 1.0, door.y])
    to_room = 1.0 + math.dist((door.x, door.y), (inside.x, inside.y))
    assert way_aside(T, here, here + np.array([9.0, 0.0])) == pytest.approx(to_room)
    assert way_aside(T, here, np.array([door.x, door.y])) > to_room
    assert way_aside(T, here, here + np.array([0.3, 0.0])) > to_room
