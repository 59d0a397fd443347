"""The bar: D* Lite's cost equals Dijkstra's in 1,000 random closures, most of them across the current path.

Run as `python benchmarks/acceptance/dstar_lite.py [OUT.json]`; on the Intel Research Lab floor of the recordings
(`WAYCHAIR_DATA`) where they are, else on a random map.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from waychair.errors import NoPath
from waychair.files import write_json
from waychair.planning.dstar_lite import DStarLite
from waychair.planning.grid_graph import Cell, Prices
from waychair.planning.grid_search import search
from waychair.types import IntArray, Json

CHECKS = 1000
STEPS_PER_QUERY = 20
DATA = Path(os.environ.get("WAYCHAIR_DATA", Path(__file__).resolve().parents[2].parent / "shared" / "data"))


def run(out: Path) -> Json:
    """Check `CHECKS` closures and reopenings, write the counts to a JSON file and return them.

    Each query walks from a random start to a random goal; at each step the chair moves three cells on, then a bar of
    nine cells across its path closes (or, one time in four, an earlier one opens), then both planners are asked.
    """
    name, prices = _floor()
    rng = np.random.default_rng(2005)
    counts = {"closures": 0, "reopenings": 0, "without_a_way": 0, "wrong": 0}
    while counts["closures"] < CHECKS:
        _walk(prices.copy(), rng, counts)
    checks = counts["closures"] + counts["reopenings"]
    report = {"map": name, "cells": prices.size, "checks": checks, **counts, "passed": counts["wrong"] == 0}
    write_json(out, report)
    return report


def read_map(path: Path) -> Prices:
    """(H, W) prices of a Moving AI map: `.`, `G` and `S` are free."""
    rows = path.read_text(encoding="ascii").splitlines()[4:]
    free = np.array([[letter in ".GS" for letter in row] for row in rows])
    return np.where(free, 1000, 0).astype(np.int32)


def bar_across(path: IntArray, ahead: int, shape: tuple[int, ...]) -> IntArray:
    """(N, 2) nine cells across a path, `ahead` cells down it."""
    i = min(max(ahead, 1), len(path) - 2)
    along = path[i + 1] - path[i - 1]
    cells = path[i] + np.arange(-4, 5)[:, None] * np.sign([-along[1], along[0]])
    inside: IntArray = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    return inside


def _floor() -> tuple[str, Prices]:
    path = DATA / "movingai" / "real_intel.map"
    if path.is_file():
        return path.stem, read_map(path)
    rng = np.random.default_rng(1)
    return "random 300x300, 20 % blocked", np.where(rng.random((300, 300)) < 0.2, 0, 1000).astype(np.int32)


def _walk(prices: Prices, rng: np.random.Generator, counts: dict[str, int]) -> None:
    """One query with its closures and reopenings."""
    free = np.argwhere(prices > 0)
    start, goal = (tuple(map(int, cell)) for cell in free[rng.integers(len(free), size=2)])
    planner = DStarLite(prices, goal, start)
    closed: list[IntArray] = []
    for _ in range(STEPS_PER_QUERY):
        cost = _cost(planner)
        if closed and (cost is None or rng.random() < 0.25):
            cells, price = closed.pop(int(rng.integers(len(closed)))), 1000
            counts["reopenings"] += 1
        elif cost is not None and len(path := planner.path()) > 20:
            start = (int(path[3, 0]), int(path[3, 1]))
            planner.move_start(start)
            cells = bar_across(path[3:], int(rng.integers(2, len(path) - 6)), prices.shape)
            cells = cells[(prices[tuple(cells.T)] > 0) & ~((cells == start) | (cells == goal)).all(axis=1)]
            price = 0
            closed.append(cells)
            counts["closures"] += 1
        else:
            return
        prices[tuple(cells.T)] = price
        planner.update(cells, np.full(len(cells), price, np.int32))
        cost, expected = _cost(planner), _dijkstra(prices, start, goal)
        counts["wrong"] += cost != expected
        counts["without_a_way"] += expected is None


def _cost(planner: DStarLite) -> int | None:
    try:
        return planner.replan()
    except NoPath:
        return None


def _dijkstra(prices: Prices, start: Cell, goal: Cell) -> int | None:
    try:
        return search(prices, start, goal, informed=False).cost
    except NoPath:
        return None


if __name__ == "__main__":
    report = run(Path(sys.argv[1] if len(sys.argv) > 1 else "out/dstar_lite.json"))
    sys.stdout.write("\n".join(f"{key}: {value}" for key, value in report.items()) + "\n")
    sys.exit(0 if report["passed"] else 1)
