"""Many agents on a grid: a first valid answer at once, then better ones as long as there is time."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import count

import numpy as np

from waychair.errors import NoPath
from waychair.planning.fleet.agents import Numbers, Task, check_reachable, costs, fault
from waychair.planning.fleet.lacam import first_answer
from waychair.planning.fleet.lns import improvements, planned_in_order
from waychair.planning.fleet.space_time import steps_to

_STRAIGHT_AHEAD = 4
"""Configurations that LaCAM may look at, for each step of the longest way, before another method is tried."""

_ORDERS = 4
"""Orders of agents that are tried."""


@dataclass(frozen=True, slots=True)
class PathSolution:
    """Paths (A, T) of all agents, the least sum of costs that is possible, and the time to the first valid answer [ms]."""

    paths: Numbers
    bound: int
    first_ms: float
    valid: bool

    @property
    def sum_of_costs(self) -> int:
        return int(costs(self.paths).sum())


def solved(
    task: Task, seconds: float, seed: int = 0, progress: Callable[[float], None] = lambda share: None
) -> PathSolution:
    """Return the best paths found in so many seconds of this thread's processor time.

    `progress` is called with the share (0 to 1) of the time that has passed.

    Raises:
        NoPath: an agent cannot reach its goal, or no answer was found in time.
    """
    begun = time.thread_time()

    def has_time() -> bool:
        spent = time.thread_time() - begun
        progress(min(1.0, spent / max(seconds, 1e-9)))
        return spent < seconds

    rng = np.random.default_rng(seed)
    towards = steps_to(task.neighbours, task.goals)
    check_reachable(task, towards)
    paths = _first_paths(task, towards, rng, has_time)
    first_ms = 1e3 * (time.thread_time() - begun)
    bound = int(towards[np.arange(task.agents), task.starts].sum())
    for better in improvements(task, towards, paths, rng):
        paths = better
        if not has_time():
            break
    return PathSolution(paths, bound, first_ms, fault(task, paths) == "")


def _first_paths(task: Task, towards: Numbers, rng: np.random.Generator, has_time: Callable[[], bool]) -> Numbers:
    """Return valid paths: by LaCAM if it goes straight ahead, else one agent after the other, else by all of LaCAM."""
    straight = count(_STRAIGHT_AHEAD * int(towards[np.arange(task.agents), task.starts].max() + 1), -1)
    with suppress(NoPath):
        return first_answer(task, towards, rng, lambda: next(straight) > 0 and has_time())
    planned = planned_in_order(task, towards, rng, _ORDERS) if has_time() else None
    return first_answer(task, towards, rng, has_time) if planned is None else planned


def load_kernels() -> None:
    """Compile the kernels, or load them, before times are measured."""
    neighbours = np.array([[1, -1, -1, -1], [0, 2, 3, -1], [1, -1, -1, -1], [1, -1, -1, -1]], np.int32)
    task = Task(neighbours, np.array([0, 2], np.int32), np.array([2, 0], np.int32))
    towards, rng = steps_to(task.neighbours, task.goals), np.random.default_rng(0)
    next(improvements(task, towards, first_answer(task, towards, rng), rng))
