"""Large neighbourhood search: valid paths of many agents become shorter, a few agents at a time.

Each round takes a few agents out, plans them anew one after the other in a random order, and keeps the result unless the
sum of costs grew. The kinds of neighbourhood compete by their success. (J. Li et al., "Anytime multi-agent path finding
via large neighborhood search", IJCAI 2021.)
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from waychair.planning.fleet.agents import NONE, Numbers, Task, costs
from waychair.planning.fleet.space_time import replanned, scratch
from waychair.types import FloatArray

SLACK = 8
"""Steps beyond the latest arrival so far that a new path may take."""

_MOST_AGENTS = 12
"""Agents of the largest neighbourhood."""

_FORGETTING = 0.01
"""Share of the last round in a neighbourhood's weight (Li et al.)."""


def improvements(task: Task, towards: Numbers, paths: Numbers, rng: np.random.Generator) -> Iterator[Numbers]:
    """Yield paths (A, T) after each round, never worse than before and always valid; ends when no sum can be smaller.

    `towards` (A, N) are the steps to the goals, `paths` (A, T) a valid answer.
    """
    search = _Search(task, towards, paths, rng)
    while search.sum_of_costs > search.bound:
        search.round()
        yield search.paths


def planned_in_order(task: Task, towards: Numbers, rng: np.random.Generator, tries: int) -> Numbers | None:
    """Return paths (A, T) planned one agent after the other, those with the longest ways first; None if that fails.

    Each further try takes a more random order.
    """
    alone = towards[np.arange(task.agents), task.starts]
    steps = 2 * int(alone.max()) + task.agents + SLACK
    vertices = len(task.neighbours)
    memory = scratch(steps, vertices)
    for attempt in range(tries):
        held = np.full((steps, vertices), NONE, np.int32)
        paths = np.repeat(task.starts[:, None], steps, axis=1).astype(np.int32)
        arrivals = np.full(task.agents, -1, np.int32)
        order = np.argsort(-alone * (1.0 + attempt * rng.random(task.agents)), kind="stable").astype(np.int32)
        most = steps * task.agents
        found = replanned(task.neighbours, towards, held, paths, arrivals, order, task.goals, most, attempt % 4, memory)
        if found >= 0:
            return paths[:, : int(arrivals.max()) + 1]
    return None


class _Search:
    """Paths with the table (T, N) of the agents in each vertex, and the weights of the kinds of neighbourhood."""

    def __init__(self, task: Task, towards: Numbers, paths: Numbers, rng: np.random.Generator) -> None:
        self.task, self.towards, self.rng = task, towards, rng
        self.alone = towards[np.arange(task.agents), task.starts]
        self.bound = int(self.alone.sum())
        steps = max(paths.shape[1], int(self.alone.max()) + 1) + SLACK
        self.paths: Numbers = np.pad(paths, ((0, 0), (0, steps - paths.shape[1])), mode="edge").astype(np.int32)
        self.arrivals = costs(self.paths).astype(np.int32)
        vertices = len(task.neighbours)
        self.held = np.full((steps, vertices), NONE, np.int32)
        for agent, path in enumerate(self.paths):
            self.held[np.arange(steps), path] = agent
        self.memory = scratch(steps, vertices)
        self.weights: FloatArray = np.ones(3)
        self.skipped: set[int] = set()

    @property
    def sum_of_costs(self) -> int:
        return int(self.arrivals.sum())

    def round(self) -> None:
        """Plan one neighbourhood anew."""
        kind = int(self.rng.choice(3, p=self.weights / self.weights.sum()))
        size = min(self.task.agents, int(self.rng.integers(2, _MOST_AGENTS + 1)))
        agents = (self._delayed, self._near, self._random)[kind](size)
        before = int(self.arrivals[agents].sum())
        gain = before - self.plan(agents, before)
        self.weights[kind] += _FORGETTING * (max(gain, 0) - self.weights[kind])
        self.weights[kind] = max(self.weights[kind], 0.01)

    def plan(self, agents: Numbers, allowed: int) -> int:
        """Plan agents anew in a random order, if their sum of arrivals then is at most `allowed`; return their sum."""
        turn = int(self.rng.integers(4))
        found = replanned(
            self.task.neighbours,
            self.towards,
            self.held,
            self.paths,
            self.arrivals,
            self.rng.permutation(agents).astype(np.int32),
            self.task.goals,
            allowed,
            turn,
            self.memory,
        )
        return allowed if found < 0 else int(found)

    def _random(self, size: int) -> Numbers:
        return self.rng.choice(self.task.agents, size, replace=False).astype(np.int32)

    def _delayed(self, size: int) -> Numbers:
        """Return an agent that is delayed, and those in its way: met on shorter ways from points of its path."""
        delays = self.arrivals - self.alone
        delays[list(self.skipped)] = 0
        if not delays.any():
            self.skipped.clear()
            delays = self.arrivals - self.alone
        agent = int(np.argmax(delays + self.rng.random(len(delays)) * 0.5))
        self.skipped.add(agent)
        chosen = {agent}
        for _ in range(10):
            self._walk(agent, size, chosen)
            if len(chosen) >= size:
                break
            agent = int(self.rng.choice(list(chosen)))
        return np.array(sorted(chosen), np.int32)

    def _walk(self, agent: int, size: int, chosen: set[int]) -> None:
        """Walk at random from a point of an agent's path towards its goal in less time; collect the agents met."""
        latest = int(self.arrivals[agent])
        step = int(self.rng.integers(latest + 1))
        vertex = int(self.paths[agent, step])
        towards = self.towards[agent]
        while len(chosen) < size:
            options = [vertex, *(int(other) for other in self.task.neighbours[vertex] if other != NONE)]
            options = [other for other in options if step + 1 + towards[other] < latest]
            if not options:
                return
            other = options[int(self.rng.integers(len(options)))]
            there, swapped = int(self.held[step + 1, other]), int(self.held[step, other])
            if there not in (NONE, agent):
                chosen.add(there)
            if swapped not in (NONE, agent) and swapped == self.held[step + 1, vertex]:
                chosen.add(swapped)
            step, vertex = step + 1, other

    def _near(self, size: int) -> Numbers:
        """Return agents that come by a random crossing or its surroundings."""
        agent = int(self.rng.integers(self.task.agents))
        seeds = self.paths[agent, : int(self.arrivals[agent]) + 1]
        region = {int(self.rng.choice(seeds))}
        chosen = {agent}
        for _ in range(8):
            met = np.unique(self.held[:, list(region)])
            met = met[met != NONE]
            if len(met) >= size:
                return np.unique([*self.rng.choice(met, size - 1, replace=False), agent]).astype(np.int32)
            chosen.update(met.tolist())
            region |= {int(other) for vertex in region for other in self.task.neighbours[vertex] if other != NONE}
        return np.array(sorted(chosen), np.int32)
