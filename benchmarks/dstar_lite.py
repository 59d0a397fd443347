"""D* Lite's replanning against A* from scratch: medians and ratios of times taken in one run.

Protocol: queries from the longer half of a scenario; walk five cells, change the map, replan, ten times over. Changes
are k random cells of the 41 x 41 window round the chair that flip, or a bar of nine cells across the path d cells ahead
that closes. Queries whose way is lost are left. Run as `python benchmarks/dstar_lite.py [MAP ...]`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from acceptance.dstar_lite import DATA, bar_across, read_map

from waychair.errors import NoPath
from waychair.planning.dstar_lite import DStarLite
from waychair.planning.grid_graph import Cell, Prices
from waychair.planning.grid_search import search
from waychair.types import IntArray

MAPS = ("den312d", "ost003d", "brc202d", "16room_003", "64room_005", "Paris_1_512", "maze512-16-3", "real_intel")
QUERIES, REPLANS, STRIDE, WINDOW = 5, 10, 5, 20
Change = Callable[[Prices, IntArray, np.random.Generator], IntArray]


def toggle(count: int) -> Change:
    """Flip `count` random cells near the chair."""

    def cells(prices: Prices, path: IntArray, rng: np.random.Generator) -> IntArray:
        near = path[0] + rng.integers(-WINDOW, WINDOW + 1, (count, 2))
        chosen: IntArray = np.unique(near[((near >= 0) & (near < prices.shape)).all(axis=1)], axis=0)
        return chosen

    return cells


def closure(ahead: int) -> Change:
    """Close the free cells of a bar across the path."""

    def cells(prices: Prices, path: IntArray, rng: np.random.Generator) -> IntArray:
        bar = bar_across(path, ahead, prices.shape)
        return bar[prices[tuple(bar.T)] > 0]

    return cells


CHANGES = {
    "k=1": toggle(1),
    "k=5": toggle(5),
    "k=20": toggle(20),
    "k=100": toggle(100),
    "closure d=8": closure(8),
    "closure d=40": closure(40),
}


def queries(name: str) -> list[tuple[Cell, Cell]]:
    """Starts and goals, evenly from the longer half of a scenario."""
    lines = [line.split("\t") for line in (DATA / "movingai" / f"{name}.map.scen").read_text().split("\n")[1:] if line]
    chosen = [lines[i] for i in np.linspace(len(lines) // 2, len(lines) - 1, QUERIES).astype(int)]
    return [((int(q[5]), int(q[4])), (int(q[7]), int(q[6]))) for q in chosen]


def walk(prices: Prices, start: Cell, goal: Cell, change: Change, seed: int) -> list[tuple[float, float]]:
    """Seconds of (replanning, A* from scratch) after each change on one way."""
    rng = np.random.default_rng(seed)
    planner = DStarLite(prices, goal, start)
    planner.replan()
    times = []
    for _ in range(REPLANS):
        path = planner.path()
        if len(path) < 2 * STRIDE:
            break
        start = (int(path[STRIDE, 0]), int(path[STRIDE, 1]))
        cells = change(prices, path[STRIDE:], rng)
        cells = cells[~((cells == start) | (cells == goal)).all(axis=1)]
        new = np.where(prices[tuple(cells.T)] > 0, 0, 1000).astype(np.int32)
        prices[tuple(cells.T)] = new
        try:
            begun = time.perf_counter()
            planner.move_start(start)
            planner.update(cells, new)
            cost = planner.replan()
            replanned = time.perf_counter()
            scratch = search(prices, start, goal)
            times.append((replanned - begun, time.perf_counter() - replanned))
        except NoPath:
            break
        if cost != scratch.cost:
            raise AssertionError(f"D* Lite found {cost}, A* {scratch.cost}")
    return times


def main(names: list[str]) -> None:
    """Print one row a map: the ratio of mean times A* / D* Lite and D* Lite's median [ms] for each kind of change."""
    sys.stdout.write("A*/D* Lite (ratio of mean times), D* Lite median ms\n")
    sys.stdout.write(f"{'map':20s}" + "".join(f"{label:>18s}" for label in CHANGES) + "\n")
    for name in names:
        prices = read_map(DATA / "movingai" / f"{name}.map")
        row = f"{name:20s}"
        for change in CHANGES.values():
            runs = [walk(prices.copy(), s, g, change, i) for i, (s, g) in enumerate(queries(name))]
            times = np.array([pair for run in runs for pair in run])
            if len(times) == 0:
                row += f"{'-':>18s}"
                continue
            ratio = times[:, 1].mean() / times[:, 0].mean()
            row += f"{ratio:9.1f}x {1e3 * np.median(times[:, 0]):7.3f}"
        sys.stdout.write(row + "\n")


if __name__ == "__main__":
    main(sys.argv[1:] or list(MAPS))
