"""Times of the methods on random goals of one graph, each answer compared with Dijkstra's."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from waychair.errors import BuildingError
from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array
from waychair.maps.building.hgraph import HGraph, NodeKind
from waychair.maps.building.indexed import IndexedGraph
from waychair.planning.building.border_tables import BorderTables
from waychair.planning.building.graph_search import ArcWay, GraphSearch, cost_of_way
from waychair.planning.building.tetranauta import Tetranauta

SEED = 7


BenchProgress = Callable[[str, float], None]
"""A callback with the name of a method and the share (0 to 1) of its queries that is done."""

_PARTS = 50
"""Parts of the queries after which progress is told; telling it is not timed."""


def bench(
    hgraph: HGraph, built: IndexedGraph, queries: int, progress: BenchProgress = lambda method, share: None
) -> list[dict[str, object]]:
    """Return a row for each method: mean_us and path_us a query, length_ratio and cost_ratio to Dijkstra, wrong costs
    (those of the paper's methods are its price, no fault), bytes_per_node and build_s of its data.

    Raises:
        BuildingError: the building has fewer than two goals.
    """
    ends = [index for ref, index in built.index.items() if (node := hgraph.node(ref)) and node.kind is NodeKind.END]
    if len(ends) < 2:
        raise BuildingError("there are fewer than two goals: add End nodes before timing routes between them")
    rng = np.random.default_rng(SEED)
    starts, goals = (rng.choice(np.array(ends, np.int32), queries) for _ in range(2))
    return bench_graph(built.graph, starts, goals, progress)


def bench_graph(
    graph: GraphArrays,
    starts: Int32Array,
    goals: Int32Array,
    progress: BenchProgress = lambda method, share: None,
) -> list[dict[str, object]]:
    """Return the rows of `bench` for these queries (Q,) on a graph."""
    progress("making the tables", 0.0)
    begun = time.perf_counter()
    tables = BorderTables(graph)
    build_s = time.perf_counter() - begun
    searches = GraphSearch(graph)
    tables.costs(starts[:1], goals[:1])  # loads the kernels
    tables.ways(starts[:1], goals[:1])
    truth, truth_us = _timed(partial(searches.way, guided=False), starts, goals, partial(progress, "dijkstra"))
    guided, guided_us = _timed(partial(searches.way, guided=True), starts, goals, partial(progress, "astar"))
    begun = time.perf_counter()
    costs = tables.costs(starts, goals)
    mean_us = 1e6 * (time.perf_counter() - begun) / len(starts)
    begun = time.perf_counter()
    tables.ways(starts, goals)
    path_us = 1e6 * (time.perf_counter() - begun) / len(starts)
    found, _ = _timed(tables.way, starts, goals, partial(progress, "tables"))
    wrong = sum(way.cost != int(cost) for way, cost in zip(found, costs, strict=True))
    size = tables.nbytes / len(graph.xy)
    begun = time.perf_counter()
    preset = Tetranauta(graph)
    preset_s = time.perf_counter() - begun
    printed, printed_us = _timed(preset.way, starts, goals, partial(progress, "tetranauta"))
    past, past_us = _timed(searches.way_past_rooms, starts, goals, partial(progress, "tetranauta-without-tables"))
    rows = [
        _row("dijkstra", graph, truth, truth, truth_us, truth_us),
        _row("astar", graph, guided, truth, guided_us, guided_us),
        _row("tetranauta-without-tables", graph, past, truth, past_us, past_us),
        {
            **_row("tetranauta", graph, printed, truth, printed_us, printed_us),
            "bytes_per_node": round(preset.nbytes / len(graph.xy), 1),
            "build_s": round(preset_s, 4),
        },
    ]
    row = _row("tables", graph, found, truth, mean_us, path_us)
    row["wrong"] = int(row["wrong"]) + wrong  # type: ignore[call-overload]
    return [*rows, {**row, "bytes_per_node": round(size, 1), "build_s": round(build_s, 4)}]


def _timed(
    way: Callable[[int, int], ArcWay], starts: Int32Array, goals: Int32Array, progress: Callable[[float], None]
) -> tuple[list[ArcWay], float]:
    """Return all ways, and the mean time of one [us]."""
    pairs = list(zip(starts.tolist(), goals.tolist(), strict=True))
    way(*pairs[0])
    found: list[ArcWay] = []
    took = 0.0
    for part in np.array_split(np.arange(len(pairs)), min(_PARTS, len(pairs))):
        asked = pairs[part[0] : part[-1] + 1]
        begun = time.perf_counter()
        found += [way(*pair) for pair in asked]
        took += time.perf_counter() - begun
        progress(len(found) / len(pairs))
    return found, 1e6 * took / len(pairs)


def _row(
    name: str, graph: GraphArrays, found: list[ArcWay], truth: list[ArcWay], mean_us: float, path_us: float
) -> dict[str, object]:
    both = [(way, right) for way, right in zip(found, truth, strict=True) if right.cost < CLOSED_MM]
    wrong = sum(way.cost != right.cost for way, right in zip(found, truth, strict=True))
    wrong += sum(len(way.arcs) > 0 and cost_of_way(graph, way.arcs) != way.cost for way, _ in both)
    lengths = [sum(_length(graph, way) for way in ways) for ways in zip(*both, strict=True)] if both else [1.0, 1.0]
    costs = [sum(way.cost for way in ways) for ways in zip(*both, strict=True)] if both else [1, 1]
    return {
        "method": name,
        "mean_us": round(mean_us, 3),
        "path_us": round(path_us, 3),
        "length_ratio": round(lengths[0] / max(lengths[1], 1e-9), 6),
        "cost_ratio": round(costs[0] / max(costs[1], 1), 6),
        "wrong": int(wrong),
        "bytes_per_node": 0.0,
        "build_s": 0.0,
    }


def _length(graph: GraphArrays, way: ArcWay) -> float:
    return float(np.hypot(*(graph.xy[graph.head[way.arcs]] - graph.xy[graph.tail[way.arcs]]).T).sum())
