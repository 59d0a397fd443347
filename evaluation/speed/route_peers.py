"""Other programs' shortest ways on a building's graph, from the optional extra `peers`: routingkit-cch and rustworkx.

Both are asked one query a call, as Python programs use them; compare with `call_us` of our tables, not with many in a call.
"""

from __future__ import annotations

import time
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import NO_HEADING, TURN_UNITS, GraphArrays, Int32Array
from waychair.types import IntArray, Json

PEERS = ("routingkit_cch", "rustworkx")

_CLOSURES = 100
"""Arcs closed and opened again."""

_RUSTWORKX_QUERIES = 20
"""Queries of rustworkx: one takes tens of milliseconds."""


def missing_peers() -> list[str]:
    """Return the peers that are not installed."""
    return [name for name in PEERS if find_spec(name) is None]


def peers_measured(graph: GraphArrays, starts: Int32Array, goals: Int32Array, costs: Int32Array) -> dict[str, Json]:
    """Return a row for each installed peer: times on these queries (Q,), and answers that differ from the costs [mm]."""
    rows: dict[str, Json] = {}
    if find_spec("routingkit_cch") is not None:
        rows["routingkit_cch"] = _hierarchy(graph, starts, goals, costs)
    if find_spec("rustworkx") is not None:
        rows["rustworkx"] = _rustworkx(graph, starts[:_RUSTWORKX_QUERIES], goals[:_RUSTWORKX_QUERIES])
    return rows


def arc_states(graph: GraphArrays) -> tuple[IntArray, IntArray, IntArray]:
    """Return the transitions between arcs as a graph of its own, with turns in its costs: tails, heads, costs [mm]."""
    counts = np.diff(graph.first)[graph.head]
    tail = np.repeat(np.arange(len(graph.tail)), counts)
    begin = np.cumsum(counts) - counts
    head = graph.first[graph.head[tail]] + np.arange(len(tail)) - begin[tail]
    change = np.abs((graph.heading[head].astype(np.int64) - graph.heading[tail] + TURN_UNITS // 2) % TURN_UNITS)
    change = np.abs(change - TURN_UNITS // 2)
    turn = np.where(
        change <= TURN_UNITS // 8, 0, np.where(change <= 3 * TURN_UNITS // 8, graph.turns[0], graph.turns[1])
    )
    turn[(graph.heading[head] == NO_HEADING) | (graph.heading[tail] == NO_HEADING)] = 0
    is_open = (graph.cost[head] < CLOSED_MM) & (graph.cost[tail] < CLOSED_MM)
    return tail[is_open], head[is_open], (turn + graph.cost[head])[is_open]


def _hierarchy(graph: GraphArrays, starts: Int32Array, goals: Int32Array, costs: Int32Array) -> Json:
    """Return the figures of customisable contraction hierarchies, with costs and paths, on arc states."""
    peer: Any = import_module("routingkit_cch")
    begun = time.process_time()
    tail, head, weight = (each.tolist() for each in arc_states(graph))
    spot = graph.xy[graph.head] + 1e4 * graph.level[graph.head][:, None]  # storeys side by side
    order = peer.compute_order_inertial(len(graph.tail), tail, head, spot[:, 1].tolist(), spot[:, 0].tolist())
    hierarchy = peer.CCH(order, tail, head, False)
    ordered_s = time.process_time() - begun
    begun = time.process_time()
    metric = peer.CCHMetric(hierarchy, weight)
    customised_s = time.process_time() - begun
    query = peer.CCHQuery(metric)
    into = np.argsort(graph.head, kind="stable")
    into_first = np.searchsorted(graph.head[into], np.arange(len(graph.xy) + 1))
    ends = [
        (
            [(b, int(graph.cost[b])) for b in range(graph.first[start], graph.first[start + 1])],
            [(int(a), 0) for a in into[into_first[goal] : into_first[goal + 1]]],
        )
        for start, goal in zip(starts.tolist(), goals.tolist(), strict=True)
    ]
    times: dict[str, float] = {}
    found: list[int | None] = []
    for kind in ("cost_us", "way_us"):
        found = []
        begun = time.process_time()
        for sources, targets in ends:
            answer = query.run_multi(sources, targets)
            found.append(answer.distance)
            if kind == "way_us":
                _ = answer.node_path
            del answer  # before the next query, or the library panics
        times[kind] = 1e6 * (time.process_time() - begun) / len(ends)
    wrong = sum((CLOSED_MM if one is None else one) != other for one, other in zip(found, costs.tolist(), strict=True))
    del query  # none may live while costs change
    updater = peer.CCHMetricPartialUpdater(hierarchy)
    of_arc = np.searchsorted(np.sort(np.array(head)), np.arange(len(graph.tail) + 1))
    by_arc, changes = np.argsort(np.array(head), kind="stable"), []
    for arc in np.random.default_rng(3).choice(len(graph.tail), _CLOSURES).tolist():
        changed = by_arc[of_arc[arc] : of_arc[arc + 1]].tolist()
        begun = time.process_time()
        updater.apply(metric, dict.fromkeys(changed, CLOSED_MM))
        changes.append(time.process_time() - begun)
        updater.apply(metric, {each: weight[each] for each in changed})
    return {
        **times,
        "build_s": ordered_s + customised_s,
        "closure_median_ms": 1e3 * float(np.median(changes)),
        "closure_worst_ms": 1e3 * max(changes),
        "wrong": wrong,
    }


def _rustworkx(graph: GraphArrays, starts: Int32Array, goals: Int32Array) -> Json:
    """Return the time of rustworkx's Dijkstra, which counts no turns."""
    peer: Any = import_module("rustworkx")
    network = peer.PyDiGraph(multigraph=True)
    network.add_nodes_from(range(len(graph.xy)))
    arcs = zip(graph.tail.tolist(), graph.head.tolist(), graph.cost.tolist(), strict=True)
    network.add_edges_from([arc for arc in arcs if arc[2] < CLOSED_MM])
    begun = time.process_time()
    for start, goal in zip(starts.tolist(), goals.tolist(), strict=True):
        peer.dijkstra_shortest_path_lengths(network, start, float, goal=goal)
    return {"cost_us": 1e6 * (time.process_time() - begun) / len(starts), "turns": False}
