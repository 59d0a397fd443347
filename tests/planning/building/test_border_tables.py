"""The exact border tables, compared with Dijkstra on seeded hospitals, and kernels with plain Python."""

from __future__ import annotations

import heapq
from pathlib import Path

import numpy as np
import pytest
from evaluation.scenes.buildings.hospital import Hospital, Size, hospital

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import NO_HEADING, GraphArrays, assembled
from waychair.planning.building.border_tables import BorderTables
from waychair.planning.building.graph_search import GraphSearch, brute_force, cost_of_way
from waychair.planning.building.table_files import StaleTables, load_tables, save_tables
from waychair.planning.building.tetranauta import Tetranauta


@pytest.fixture(scope="module")
def small() -> Hospital:
    """A hospital of two storeys with loops, one-way arcs, rooms with two doors and a zoned lift."""
    return hospital(Size(3, 4, 6, 3), seed=4)


def plain_cost(graph: GraphArrays, start: int, goal: int) -> int:
    """Return the cost between two nodes, by a search over arcs written for reading."""
    best, queue = {}, [(int(graph.cost[b]), b) for b in range(graph.first[start], graph.first[start + 1])]
    heapq.heapify(queue)
    while queue and start != goal:
        cost, arc = heapq.heappop(queue)
        if arc in best or cost >= CLOSED_MM:
            continue
        best[arc] = cost
        node = int(graph.head[arc])
        if node == goal:
            return cost
        for onto in range(graph.first[node], graph.first[node + 1]):
            one, other = int(graph.heading[arc]), int(graph.heading[onto])
            change = abs((other - one + 32768) % 65536 - 32768) * 360.0 / 65536.0
            turn = 0 if NO_HEADING in (one, other) or change <= 45.0 else int(graph.turns[int(change > 135.0)])
            heapq.heappush(queue, (cost + turn + int(graph.cost[onto]), onto))
    return 0 if start == goal else CLOSED_MM


def random_pairs(graph: GraphArrays, count: int, seed: int) -> list[tuple[int, int]]:
    """Return pairs of nodes, a third of them in one sub-map."""
    rng, nodes = np.random.default_rng(seed), len(graph.xy)
    pairs = rng.integers(nodes, size=(count, 2))
    for pair in pairs[: count // 3]:
        pair[1] = rng.choice(np.flatnonzero(graph.node_submap == graph.node_submap[pair[0]]))
    return [(int(one), int(other)) for one, other in pairs]


def assert_exact(tables: BorderTables, pairs: list[tuple[int, int]]) -> None:
    """Assert that costs equal Dijkstra's as integers, and that each way's arcs add up to its cost."""
    graph, searches = tables.graph, GraphSearch(tables.graph)
    for start, goal in pairs:
        expected = searches.cost(start, goal, guided=False)
        way = tables.way(start, goal)
        assert (tables.cost(start, goal), way.cost) == (expected, expected)
        if start != goal and expected < CLOSED_MM:
            assert cost_of_way(graph, way.arcs) == expected
            assert (graph.tail[way.arcs[0]], graph.head[way.arcs[-1]]) == (start, goal)


def test_costs_equal_dijkstras_and_ways_add_up(small: Hospital) -> None:
    assert_exact(BorderTables(small.graph), random_pairs(small.graph, 300, 1))


def test_all_searches_agree_with_a_plain_one(small: Hospital) -> None:
    searches = GraphSearch(small.graph)
    for start, goal in random_pairs(small.graph, 12, 2):
        expected = plain_cost(small.graph, start, goal)
        assert searches.cost(start, goal, guided=False) == expected
        assert searches.cost(start, goal, guided=True) == expected
        assert brute_force(small.graph, start, goal)[0] == expected
        assert searches.costs_to_all(start)[goal] == expected


def test_closing_and_opening_arcs_stays_exact() -> None:
    graph = hospital(Size(2, 4, 5, 3), seed=7).graph
    tables, rng = BorderTables(graph), np.random.default_rng(3)
    before, closed = graph.cost.copy(), []
    for number in range(60):
        start, goal = random_pairs(graph, 1, 100 + number)[0]
        way = tables.way(start, goal).arcs
        if number % 3 == 2 and closed:
            arcs = closed.pop(int(rng.integers(len(closed))))
            tables.reprice(arcs, before[arcs])
        elif len(way):
            arc = rng.choice(way)
            arcs = np.array([each for each in (arc, graph.reverse[arc]) if each >= 0])
            tables.reprice(arcs, np.full(len(arcs), CLOSED_MM))
            closed.append(arcs)
        assert_exact(tables, [(start, goal), *random_pairs(graph, 4, number)])
    for arcs in closed:
        tables.reprice(arcs, before[arcs])
    assert_exact(tables, random_pairs(graph, 50, 5))


def test_repaired_tables_equal_new_ones() -> None:
    graph = hospital(Size(2, 3, 4, 2), seed=9).graph
    tables = BorderTables(graph)
    for arc in range(0, len(graph.tail), 37):
        tables.reprice(np.array([arc]), np.array([3 * int(graph.cost[arc]) + 1]))
        fresh = BorderTables(graph)
        assert np.array_equal(tables.tables.numbers, fresh.tables.numbers)


def test_a_room_that_can_be_entered_only_is_no_way_out() -> None:
    ends = np.array([(0, 1), (1, 0), (0, 2), (2, 3), (3, 2), (1, 4), (4, 1)], np.int32)  # 2 and 3 are the trap
    submaps, none = np.array([0, 0, 1, 1, 2], np.int32), np.zeros(7, np.bool_)
    xy, parent = np.arange(10.0).reshape(5, 2), np.array([-1, 0, 0], np.int32)
    graph, _ = assembled(
        submaps, xy, np.zeros(5, np.int32), parent, ends, np.full(7, 9, np.int32), none, np.zeros(2, np.int32)
    )
    tables = BorderTables(graph)
    assert_exact(tables, [(one, other) for one in range(5) for other in range(5)])
    assert tables.costs(np.array([3, 4, 4]), np.array([4, 3, 0])).tolist() == [CLOSED_MM, 36, 18]


def test_an_impossible_cost_is_refused(small: Hospital) -> None:
    tables = BorderTables(small.graph)
    with pytest.raises(ValueError, match="costs must lie in"):
        tables.reprice(np.array([0]), np.array([-1]))


def test_tables_come_back_from_their_file_and_refuse_another_graphs(small: Hospital, tmp_path: Path) -> None:
    tables, path = BorderTables(small.graph), tmp_path / "tables.bin"
    save_tables(path, tables.tables, "key")
    loaded = BorderTables(small.graph, load_tables(path, "key"))
    pairs = random_pairs(small.graph, 50, 6)
    assert [loaded.cost(*pair) for pair in pairs] == [tables.cost(*pair) for pair in pairs]
    with pytest.raises(StaleTables, match="tables of another graph"):
        load_tables(path, "other")
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(StaleTables, match="is damaged"):
        load_tables(path, "key")
    with pytest.raises(StaleTables, match="there are no tables"):
        load_tables(tmp_path / "none.bin", "key")


@pytest.mark.parametrize("brothers", [True, False])
def test_the_papers_trajectories_find_ways_a_little_longer_than_the_shortest(brothers: bool) -> None:
    made = hospital(Size(3, 4, 6, 3), seed=2)
    preset, searches, rng = Tetranauta(made.graph, brothers), GraphSearch(made.graph), np.random.default_rng(1)
    found = best = 0
    for start, goal in rng.choice(made.goals, (60, 2)).tolist():
        way, least = preset.way(start, goal), searches.cost(start, goal, guided=False)
        assert way.cost >= least
        if start != goal:
            assert (made.graph.tail[way.arcs[0]], made.graph.head[way.arcs[-1]]) == (start, goal)
        found, best = found + way.cost, best + least
    assert found <= 1.0069 * best  # the paper's worst; 1.0042 here


def test_searches_past_rooms_enter_only_the_first_and_the_last(small: Hospital) -> None:
    graph, searches, rng = small.graph, GraphSearch(small.graph), np.random.default_rng(2)
    is_leaf = ~np.isin(np.arange(len(graph.parent)), graph.parent)
    for start, goal in rng.choice(small.goals, (40, 2)).tolist():
        way = searches.way_past_rooms(start, goal)
        entered = set(graph.node_submap[graph.head[way.arcs]].tolist())
        entered -= {int(graph.node_submap[start]), int(graph.node_submap[goal])}
        assert not is_leaf[list(entered)].any()
        assert way.cost >= searches.cost(start, goal, guided=False)
