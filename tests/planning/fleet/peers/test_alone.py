"""Alone mode: ways that are seen free, and which of two chairs backs out."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tests.planning.fleet.peers.buildings import WAYS
from tests.planning.fleet.small_traffic import traffic
from waychair.planning.fleet.peers.alone import SEEN_AHEAD, Standing, backs_out, way_by_eye
from waychair.planning.fleet.ways import ways_of

STANDINGS = st.builds(Standing, st.integers(0, 3), st.floats(0.0, 50.0), st.integers(1, 99))


@given(STANDINGS, STANDINGS)
def test_f28c_of_two_chairs_face_to_face_exactly_one_backs_out(one: Standing, other: Standing) -> None:
    if one.number != other.number:
        assert backs_out(one, other) != backs_out(other, one)


def test_f28c_the_lower_priority_backs_out_else_the_shorter_way_back_else_the_higher_number() -> None:
    assert backs_out(Standing(0, 9.0, 1), Standing(1, 2.0, 2))
    assert backs_out(Standing(0, 2.0, 1), Standing(0, 9.0, 2))
    assert backs_out(Standing(0, 2.0, 2), Standing(0, 2.1, 1))


def _resources(*names: str) -> set[int]:
    return {int(WAYS.resource[spot]) for spot, name in enumerate(WAYS.names) if name in names}


def test_a_way_leads_into_a_run_only_where_it_is_seen_free() -> None:
    start = WAYS.slots["P"][0]
    way = way_by_eye(WAYS, start, "Q", set())
    assert [WAYS.names[spot] for spot in way] == ["P-a", "a", "a-m", "m", "m-b", "b", "b-Q"]
    assert way_by_eye(WAYS, start, "Q", _resources("m-b")) == ()
    assert way_by_eye(WAYS, start, "Q", _resources("Q")) == ()
    assert way_by_eye(WAYS, start, "Q", _resources("m-c")) == way


def test_a_way_leads_round_a_section_that_is_taken() -> None:
    ring = ways_of(traffic("ring", ["P-a", "Q-b", "R-c", "a-b", "b-c", "c-a"]), 0.5)
    taken = {int(ring.resource[ring.names.index("a-b")])}
    way = way_by_eye(ring, ring.slots["P"][0], "Q", taken)
    assert [ring.names[spot] for spot in way] == ["P-a", "a", "c-a", "c", "b-c", "b", "Q-b"]
    assert 1e-3 * sum(ring.passing_ms[spot] for spot in way[:-1]) * ring.speed < SEEN_AHEAD
