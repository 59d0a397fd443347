"""Two chairs face to face that cannot hear each other: both find out alone, from the point between them, which one backs out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.maps.traffic.corridors import CorridorPlan, corridor_graph
from waychair.planning.fleet.peers.meeting import gives_way, is_before, meeting_at

GRAPH = corridor_graph(CorridorPlan("straight", (30.0, 6.0), ((3.0, 3.0, 27.0, 3.0),)), 1.2, rooms=True)


@given(st.floats(4.0, 26.0), st.floats(-0.15, 0.15), st.booleans())
def test_f28c_exactly_one_of_two_backs_out_wherever_they_meet(x: float, off: float, again: bool) -> None:
    """Each measures the middle with an error, of up to 15 cm here; ways that differ by less than 0.5 m count as equal."""
    mine, theirs = (meeting_at(GRAPH, np.array([at, 3.0])) for at in (x, x + off))
    if mine.section != theirs.section:
        return
    clear = abs(mine.before - mine.beyond)
    if 0.2 < clear < 0.8 and not again:
        return  # within the error of a tie: the next round decides by the side alone
    here = [is_before(GRAPH, mine.section, np.array([x, 3.0]), np.array([x + side, 3.0])) for side in (-4.0, 4.0)]
    assert here[0] != here[1]
    assert gives_way(mine, here[0], again) != gives_way(theirs, here[1], again)


def test_the_side_with_the_shorter_way_to_a_place_aside_backs_out() -> None:
    section = max(GRAPH.sections, key=lambda each: each.length)
    start, end = (np.array([GRAPH.node[name].x, GRAPH.node[name].y]) for name in (section.start, section.end))
    near_start = meeting_at(GRAPH, start + 0.2 * (end - start))
    assert near_start.section == section.name
    assert near_start.before + near_start.beyond >= section.length
    if near_start.before + 0.5 < near_start.beyond:
        assert gives_way(near_start, before=True, again=False)
        assert not gives_way(near_start, before=False, again=False)


@pytest.mark.parametrize("again", [False, True])
def test_of_two_equal_ways_the_side_of_the_end_backs_out(again: bool) -> None:
    section = GRAPH.sections[0]
    middle = meeting_at(GRAPH, np.array([GRAPH.node[section.start].x, GRAPH.node[section.start].y]))
    equal = middle._replace(before=3.0, beyond=3.2)
    assert gives_way(equal, before=False, again=again)
    assert not gives_way(equal, before=True, again=again)
