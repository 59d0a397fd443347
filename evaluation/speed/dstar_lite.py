"""D* Lite's replanning compared with A* from scratch: ratios of processor times of one run.

Protocol: ten queries, evenly chosen from the longer half of a scenario. Ten times per query: walk five cells, change
the map, replan. A change flips k random cells of the 41 x 41 window round the chair, or closes a bar of nine cells
across the path d cells ahead and opens it again after the answer. Changes that leave no path do not count.
D* Lite finishes all its replans first, then A* gets the same questions, so that neither finds the other's data in the
caches.
Run as `python -m evaluation.speed.dstar_lite [MAP ...]`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from waychair.errors import NoPath
from waychair.maps.grid.moving_ai import ScenarioQuery, load_free_cells, load_queries
from waychair.planning.grid.dstar_lite import DStarLite
from waychair.planning.grid.grid_graph import FREE_PRICE, Cell, Prices
from waychair.planning.grid.grid_search import shortest_cost
from waychair.types import FloatArray, IntArray

DATA = (
    Path(os.environ.get("WAYCHAIR_DATA", Path(__file__).resolve().parents[1].parent / "shared" / "data")) / "movingai"
)
QUERIES, REPLANS, STRIDE, WINDOW = 10, 10, 5, 20
Change = Callable[[Prices, IntArray, np.random.Generator], IntArray]


@dataclass(frozen=True, slots=True)
class Replans:
    """Processor times [s] of the replans: of D* Lite and A* (N,), and of D* Lite after each reopening (M,)."""

    replanned: FloatArray
    scratch: FloatArray
    reopened: FloatArray

    @property
    def ratio(self) -> float:
        """The mean time of A* over that of D* Lite."""
        return float(self.scratch.mean() / self.replanned.mean())


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
        free: IntArray = bar[prices[tuple(bar.T)] > 0]
        return free

    return cells


CHANGES = {
    "k=1": toggle(1),
    "k=5": toggle(5),
    "k=20": toggle(20),
    "k=100": toggle(100),
    "closure d=8": closure(8),
    "closure d=40": closure(40),
}


def read_prices(name: str) -> Prices:
    """Return the prices (H, W) of a benchmark map."""
    return np.where(load_free_cells(DATA / f"{name}.map"), FREE_PRICE, 0).astype(np.int32)


def map_names() -> list[str]:
    """Return the names of all benchmark maps."""
    return sorted(path.stem for path in DATA.glob("*.map"))


def long_queries(name: str) -> list[ScenarioQuery]:
    """Return queries, evenly chosen from the longer half of a scenario."""
    queries = load_queries(DATA / f"{name}.map.scen")
    return [queries[i] for i in np.linspace(len(queries) // 2, len(queries) - 1, QUERIES).astype(int)]


def bar_across(path: IntArray, ahead: int, shape: tuple[int, ...]) -> IntArray:
    """Return the bar (N, 2) of nine cells across a path, `ahead` cells down it."""
    i = min(max(ahead, 1), len(path) - 2)
    along = path[i + 1] - path[i - 1]
    cells = path[i] + np.arange(-4, 5)[:, None] * np.sign([-along[1], along[0]])
    inside: IntArray = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    return inside


def replans(name: str, kind: str) -> Replans:
    """Measure all replans of one kind of change on one map.

    Raises:
        AssertionError: the two planners disagree about a cost.
    """
    prices = read_prices(name)
    replanned: list[float] = []
    scratch: list[float] = []
    reopened: list[float] = []
    for seed, query in enumerate(long_queries(name)):
        questions, back = _walk(prices.copy(), query, kind, np.random.default_rng(seed))
        times = _asked_anew(prices.copy(), query, questions)
        replanned += [question.seconds for question in questions if question.cost is not None]
        scratch += [s for s, question in zip(times, questions, strict=True) if question.cost is not None]
        reopened += back
    return Replans(np.array(replanned), np.array(scratch), np.array(reopened))


@dataclass(frozen=True, slots=True)
class _Question:
    """A start, changed cells (N, 2) with prices before and after, and D* Lite's answer and processor time [s]."""

    start: Cell
    cells: IntArray
    before: Prices
    after: Prices
    cost: int | None
    seconds: float
    kept: bool


def _walk(
    prices: Prices, query: ScenarioQuery, kind: str, rng: np.random.Generator
) -> tuple[list[_Question], list[float]]:
    """Walk one query with D* Lite; return its questions and the processor times [s] of undoing the changes."""
    planner = DStarLite(prices, query.goal, query.start)
    planner.replan()
    questions: list[_Question] = []
    back: list[float] = []
    while len(questions) < REPLANS and len(path := planner.path()) >= 2 * STRIDE:
        start = (int(path[STRIDE, 0]), int(path[STRIDE, 1]))
        cells = CHANGES[kind](prices, path[STRIDE:], rng)
        cells = cells[~((cells == start) | (cells == query.goal)).all(axis=1)]
        before = prices[tuple(cells.T)]
        after = np.where(before > 0, 0, FREE_PRICE).astype(np.int32)
        begun = time.thread_time()
        planner.move_start(start)
        planner.update(cells, after)
        cost = _answer(planner.replan)
        seconds = time.thread_time() - begun
        kept = cost is not None and not kind.startswith("closure")
        questions.append(_Question(start, cells, before, after, cost, seconds, kept))
        if kept:
            prices[tuple(cells.T)] = after
        else:
            begun = time.thread_time()
            planner.update(cells, before)
            planner.replan()
            back.append(time.thread_time() - begun)
    return questions, back


def _asked_anew(prices: Prices, query: ScenarioQuery, questions: list[_Question]) -> list[float]:
    """Return A*'s processor time [s] for each question."""
    times = []
    for question in questions:
        prices[tuple(question.cells.T)] = question.after
        begun = time.thread_time()
        cost = _answer(partial(shortest_cost, prices, question.start, query.goal))
        times.append(time.thread_time() - begun)
        if cost != question.cost:
            raise AssertionError(f"D* Lite found {question.cost}, A* {cost}")
        if not question.kept:
            prices[tuple(question.cells.T)] = question.before
    return times


def _answer(asked: Callable[[], int]) -> int | None:
    """Return the cost, or None if there is no path."""
    try:
        return asked()
    except NoPath:
        return None


def main(names: list[str]) -> None:
    """Print a row per map: the ratio of mean times A* / D* Lite, and D* Lite's median [ms], of each kind of change."""
    print("A*/D* Lite (ratio of mean times), D* Lite median ms")
    print(f"{'map':20s}" + "".join(f"{label:>18s}" for label in CHANGES))
    for name in names:
        row = f"{name:20s}"
        for kind in CHANGES:
            done = replans(name, kind)
            row += (
                f"{done.ratio:9.1f}x {1e3 * np.median(done.replanned):7.3f}" if len(done.replanned) else f"{'-':>18s}"
            )
        print(row, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or map_names())
