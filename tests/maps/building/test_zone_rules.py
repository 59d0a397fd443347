"""The rules of a map's zones along the arcs of its storey."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import NoPath
from waychair.maps.building.building import Building
from waychair.maps.building.hgraph import ArcRef, HGraph, NodeRef
from waychair.maps.building.hgraph_edits import with_way
from waychair.maps.building.hgraph_files import read_hgraph, write_hgraph
from waychair.maps.building.zone_rules import with_zones, with_zones_of
from waychair.maps.drawn.zones import Rule, Zone, save_zones
from waychair.planning.building.hierarchical import Method, RoutePlanner

BED, SHELF = NodeRef("g/ward", "e"), NodeRef("g/store", "e")


def box(rule: Rule, low: tuple[float, float], high: tuple[float, float], value: float = 0.0) -> Zone:
    """Return a rectangular zone."""
    (x, y), (u, v) = low, high
    return Zone("works", rule, np.array([(x, y), (u, y), (u, v), (x, v)]), value)


def cost(hgraph: HGraph, start: NodeRef, goal: NodeRef) -> int:
    """Return the cost between two nodes [mm]."""
    return RoutePlanner(hgraph, Method.DIJKSTRA).cost(start, goal)


def test_half_an_arc_in_a_slow_zone_costs_the_time_that_it_takes() -> None:
    # c2 to c3 are 5 m at 0.8 m/s; 2.5 m of them at 0.2 m/s take as long as 10 m
    slow = with_zones_of(two_storeys(), "g", [box(Rule.SLOW, (12.5, -1.0), (20.0, 0.2), 0.2)])
    plain = cost(two_storeys(), NodeRef("g", "c2"), NodeRef("g", "c3"))
    assert plain == 5000
    assert cost(slow, NodeRef("g", "c2"), NodeRef("g", "c3")) == pytest.approx(12_500, abs=100)
    assert cost(slow, NodeRef("1", "c2"), NodeRef("1", "c3")) == 5000


def test_a_slow_zone_and_the_limit_of_an_arc_do_not_add_up() -> None:
    limited = with_way(two_storeys(), ArcRef("g", "c2", "c3"), speed=0.4)
    slow = with_zones_of(limited, "g", [box(Rule.SLOW, (0.0, -1.0), (20.0, 1.0), 0.6)])
    assert cost(slow, NodeRef("g", "c2"), NodeRef("g", "c3")) == 10_000


@pytest.mark.parametrize(
    ("heading", "there", "back"), [(0.0, True, False), (np.pi, False, True), (np.pi / 2, True, True)]
)
def test_an_arc_in_a_one_way_zone_is_driven_along_its_heading_or_sideways(
    heading: float, there: bool, back: bool
) -> None:
    ruled = with_zones_of(two_storeys(), "g", [box(Rule.ONE_WAY, (11.0, -1.0), (14.0, 1.0), heading)])
    assert (cost(ruled, NodeRef("g", "c2"), NodeRef("g", "c3")) == 5000) is there
    assert (cost(ruled, NodeRef("g", "c3"), NodeRef("g", "c2")) == 5000) is back


def test_a_one_way_arc_against_a_one_way_zone_is_closed_with_its_reason() -> None:
    one_way = with_way(two_storeys(), ArcRef("g", "c2", "c3"), one_way=True)
    ruled = with_zones_of(one_way, "g", [box(Rule.ONE_WAY, (11.0, -1.0), (14.0, 1.0), np.pi)])
    with pytest.raises(NoPath, match="one-way zone 'works'"):
        RoutePlanner(ruled, Method.ASTAR).route(BED, SHELF)


def test_a_doorway_in_a_one_way_zone_leads_out_only() -> None:
    ruled = with_zones_of(two_storeys(), "g", [box(Rule.ONE_WAY, (9.5, 0.05), (10.5, 0.2), -np.pi / 2)])
    assert cost(ruled, BED, SHELF) == cost(two_storeys(), BED, SHELF)
    with pytest.raises(NoPath):
        RoutePlanner(ruled, Method.ASTAR).route(SHELF, BED)


def test_a_keep_out_zone_of_a_storeys_map_closes_its_arcs_and_stays_out_of_the_text_files(tmp_path: Path) -> None:
    hgraph = two_storeys()
    storeys = tuple(replace(each, map=f"maps/{each.id}") for each in hgraph.storeys)
    write_hgraph(tmp_path, replace(hgraph, storeys=storeys))
    save_zones(tmp_path / "maps" / "g", [box(Rule.KEEP_OUT, (12.0, -1.0), (13.0, 1.0))])
    building = Building(tmp_path, read_hgraph(tmp_path))
    with pytest.raises(NoPath, match="keep-out zone 'works'"):
        RoutePlanner(with_zones(building), Method.ASTAR).route(BED, SHELF)
    assert RoutePlanner(building.hgraph, Method.ASTAR).route(BED, SHELF).cost > 0
