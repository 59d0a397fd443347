"""A* and Dijkstra against a plain Python reference and against known optimal costs."""

from __future__ import annotations

import heapq
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import NoPath
from waychair.planning.grid.dstar_lite import DStarLite
from waychair.planning.grid.grid_graph import Cell, Prices
from waychair.planning.grid.grid_search import search, shortest_cost


def plain_step(prices: Prices, here: Cell, dr: int, dc: int) -> int | None:
    """The cost model in plain Python."""
    r, c = here[0] + dr, here[1] + dc
    if not (0 <= r < prices.shape[0] and 0 <= c < prices.shape[1]):
        return None
    if not (prices[here] and prices[r, c] and prices[here[0], c] and prices[r, here[1]]):
        return None
    both = int(prices[here]) + int(prices[r, c])
    return 7071 * both // 1000 if dr and dc else 10_000 * both // 2000


def plain_dijkstra(prices: Prices, start: Cell, goal: Cell) -> int | None:
    best = {start: 0}
    queue = [(0, start)] if prices[start] else []
    while queue:
        cost, here = heapq.heappop(queue)
        if here == goal:
            return cost
        if cost > best[here]:
            continue
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                step = plain_step(prices, here, dr, dc) if dr or dc else None
                there = (here[0] + dr, here[1] + dc)
                if step is not None and cost + step < best.get(there, 1 << 62):
                    best[there] = cost + step
                    heapq.heappush(queue, (cost + step, there))
    return None


def random_prices(rng: np.random.Generator, shape: tuple[int, int], blocked: float) -> Prices:
    free = rng.choice([1000, 1000, 2000, 9000], shape) if rng.random() < 0.5 else np.full(shape, 1000)
    return np.where(rng.random(shape) < blocked, 0, free).astype(np.int32)


def path_cost(prices: Prices, path: np.ndarray[tuple[int, int], np.dtype[np.int64]]) -> int:
    total = 0
    for (r0, c0), (r1, c1) in zip(path[:-1].tolist(), path[1:].tolist(), strict=True):
        step = plain_step(prices, (r0, c0), r1 - r0, c1 - c0)
        assert step is not None
        assert max(abs(r1 - r0), abs(c1 - c0)) == 1
        total += step
    return total


@given(st.integers(0, 2**32 - 1), st.integers(1, 14), st.integers(1, 14), st.floats(0.0, 0.5))
@settings(max_examples=80, deadline=None)
def test_all_searches_find_the_cost_of_the_plain_reference(seed: int, height: int, width: int, blocked: float) -> None:
    rng = np.random.default_rng(seed)
    prices = random_prices(rng, (height, width), blocked)
    start = (int(rng.integers(height)), int(rng.integers(width)))
    goal = (int(rng.integers(height)), int(rng.integers(width)))
    expected = plain_dijkstra(prices, start, goal)
    for informed in (True, False):
        if expected is None:
            with pytest.raises(NoPath, match="not connected"):
                shortest_cost(prices, start, goal, informed=informed)
        else:
            assert shortest_cost(prices, start, goal, informed=informed) == expected
            path = search(prices, start, goal, informed=informed).cells
            assert (tuple(path[0]), tuple(path[-1])) == (start, goal)
            assert path_cost(prices, path) == expected


def test_the_heuristic_saves_work() -> None:
    prices = np.full((60, 60), 1000, np.int32)
    informed, blind = search(prices, (30, 5), (30, 50)), search(prices, (30, 5), (30, 50), informed=False)
    assert informed.cost == blind.cost == 450_000
    assert informed.pops < blind.pops / 10


def read_map(path: Path) -> Prices:
    rows = path.read_text().splitlines()[4:]
    free = np.array([[letter in ".GS" for letter in row] for row in rows])
    return np.where(free, 1000, 0).astype(np.int32)


MAPS = [
    "16room_003",
    "64room_005",
    "Berlin_1_256",
    "Paris_1_512",
    "arena",
    "brc202d",
    "den312d",
    "maze512-16-3",
    "ost003d",
    "random512-20-3",
    "real_aces",
    "real_freiburg-079",
    "real_freiburg-101",
    "real_intel",
    "real_seattle",
]


@pytest.mark.parametrize("name", MAPS)
def test_benchmark_maps_are_solved_at_their_known_optimal_cost(data_dir: Path, name: str) -> None:
    """Moving AI Lab maps and real buildings; the integer costs allow 1e-4 relative (14142 for sqrt(2) * 10000)."""
    prices = read_map(data_dir / "movingai" / f"{name}.map")
    lines = (data_dir / "movingai" / f"{name}.map.scen").read_text().split("\n")
    queries = [line.split("\t") for line in lines[1:] if line]
    for i in np.linspace(0, len(queries) - 1, 30).astype(int):
        _, _, _, _, x0, y0, x1, y1, optimum = queries[i]
        start, goal = (int(y0), int(x0)), (int(y1), int(x1))
        cost = DStarLite(prices, goal, start).replan() if i % 2 else shortest_cost(prices, start, goal)
        assert math.isclose(cost / 10_000, float(optimum), rel_tol=1e-4, abs_tol=1e-4)
