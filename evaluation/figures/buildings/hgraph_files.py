"""The border tables on real buildings: the hospital of `graph_bwh` and the buildings of Open-RMF, from WAYCHAIR_DATA."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import GraphArrays
from waychair.maps.building.indexed import indexed
from waychair.maps.exchange.exchange import read_exchange
from waychair.planning.building.border_tables import BorderTables
from waychair.planning.building.graph_search import GraphSearch, cost_of_way
from waychair.types import Json

_SCALE = 0.1
"""[m] A pixel of CSV files, which state none."""


def real_buildings(queries: int, closures: int) -> dict[str, Json]:
    """Return a row for each building: its size, and answers that differ from Dijkstra's, before and after closures."""
    data = os.environ.get("WAYCHAIR_DATA")
    if data is None:
        return {}
    sources = [*sorted(Path(data).glob("graph_*")), *sorted((Path(data) / "rmf_buildings").glob("*.building.yaml"))]
    rows = {}
    for source in sources:
        graph = indexed(read_exchange(source, "", None, _SCALE).hgraph).graph
        name = source.name.removesuffix(".building.yaml")
        if not len(graph.tail):  # a building of doors alone, without lanes
            continue
        rows[name] = _checked(graph, queries, closures)
        print(f"  {name} {rows[name]}", flush=True)
    return rows


def _checked(graph: GraphArrays, queries: int, closures: int) -> Json:
    """Return the size, and how many costs or ways between random nodes are wrong."""
    tables, rng = BorderTables(graph), np.random.default_rng(4)
    searches, before = GraphSearch(graph), graph.cost.copy()
    wrong = _wrong(tables, searches, rng.integers(len(graph.xy), size=(queries, 2)))
    closed: list[int] = []
    for number in range(closures):
        ends = rng.integers(len(graph.xy), size=(1, 2))
        arcs = tables.way(*ends[0].tolist()).arcs
        if len(closed) > 5 or (not len(arcs) and closed):
            arc = closed.pop(int(rng.integers(len(closed))))
            tables.reprice(np.array([arc]), before[[arc]].astype(np.int64))
        elif len(arcs):
            arc = int(rng.choice(arcs))
            closed.append(arc)
            tables.reprice(np.array([arc]), np.array([CLOSED_MM]))
        wrong += _wrong(tables, searches, ends) if number % 2 == 0 else 0
    return {"nodes": len(graph.xy), "arcs": len(graph.tail), "queries": queries, "closures": closures, "wrong": wrong}


def _wrong(tables: BorderTables, searches: GraphSearch, pairs: np.ndarray) -> int:
    wrong = 0
    for start, goal in pairs.tolist():
        truth, way = searches.cost(start, goal, guided=False), tables.way(start, goal)
        wrong += not truth == way.cost == tables.cost(start, goal)
        wrong += bool(len(way.arcs)) and cost_of_way(tables.graph, way.arcs) != truth
    return wrong
