"""Shortest paths in space and time, among agents whose paths are fixed; kernels of the multi-agent solvers.

A state is (step, vertex). Its cost is its step, so it is queued once; states are queued by the least step at which the goal
can be reached over them, in buckets, the latest state of a bucket first. (D. Silver, "Cooperative pathfinding", 2005.)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.planning.fleet.agents import Numbers


class Scratch(NamedTuple):
    """Memory of searches: marks (T N,), the state before (T N,), the next state of the bucket (T N,), heads (T + 1,)."""

    marks: Numbers
    before: Numbers
    following: Numbers
    heads: Numbers
    mark: Numbers


def scratch(steps: int, vertices: int) -> Scratch:
    """Return memory for searches of at most so many steps."""
    count = steps * vertices
    return Scratch(
        np.zeros(count, np.int32),
        np.zeros(count, np.int32),
        np.zeros(count, np.int32),
        np.full(steps + 1, -1, np.int32),
        np.zeros(1, np.int32),
    )


@njit(cache=True)
def steps_to(neighbours: Numbers, goals: Numbers) -> Numbers:
    """Return the steps (A, N) from each vertex to each goal, int32; -1 where there is no way."""
    count, degree = neighbours.shape
    steps = np.full((len(goals), count), -1, np.int32)
    queue = np.empty(count, np.int32)
    for agent in range(len(goals)):
        row = steps[agent]
        row[goals[agent]] = 0
        queue[0] = goals[agent]
        first, last = 0, 1
        while first < last:
            vertex = queue[first]
            first += 1
            for side in range(degree):
                other = neighbours[vertex, side]
                if other >= 0 and row[other] < 0:
                    row[other] = row[vertex] + 1
                    queue[last] = other
                    last += 1
    return steps


@njit(cache=True)
def quickest(
    neighbours: Numbers,
    towards: Numbers,
    held: Numbers,
    start: int,
    goal: int,
    latest: int,
    turn: int,
    memory: Scratch,
    path: Numbers,
) -> int:
    """Write the quickest path of an agent into `path` (T,), and return the step at which it reaches its goal for good.

    Returns -1 if it cannot be there by the step `latest`. `towards` (N,) are the steps to the goal. `held` (T, N) is the
    agent in each vertex after each step, -1 for none. `turn` rotates the order of neighbours among equals.
    """
    steps, count = held.shape
    degree = neighbours.shape[1]
    free_from = steps
    while free_from > 0 and held[free_from - 1, goal] == -1:
        free_from -= 1
    latest = min(latest, steps - 1)
    if towards[start] < 0 or held[0, start] != -1 or free_from > latest:
        return -1
    memory.mark[0] += 1
    mark = memory.mark[0]
    least = max(towards[start], free_from)
    for bucket in range(least, latest + 1):
        memory.heads[bucket] = -1
    if least > latest:
        return -1
    memory.heads[least] = start
    memory.following[start] = -1
    memory.marks[start] = mark
    memory.before[start] = -1
    bucket = least
    while bucket <= latest:
        state = memory.heads[bucket]
        if state < 0:
            bucket += 1
            continue
        memory.heads[bucket] = memory.following[state]
        step, vertex = state // count, state % count
        if vertex == goal and step >= free_from:
            for later in range(step, steps):
                path[later] = goal
            while state >= 0:
                path[state // count] = state % count
                state = memory.before[state]
            return int(step)
        if step + 1 >= steps:
            continue
        for side in range(-1, degree):
            other = vertex if side < 0 else neighbours[vertex, (side + turn) % degree]
            if other < 0 or held[step + 1, other] != -1:
                continue
            arrival = max(step + 1 + towards[other], free_from)
            after = state - vertex + count + other
            if arrival > latest or memory.marks[after] == mark:
                continue
            meets = held[step, other]
            if side >= 0 and meets >= 0 and held[step + 1, vertex] == meets:
                continue
            memory.marks[after] = mark
            memory.before[after] = state
            memory.following[after] = memory.heads[arrival]
            memory.heads[arrival] = after
    return -1


@njit(cache=True)
def replanned(
    neighbours: Numbers,
    towards: Numbers,
    held: Numbers,
    paths: Numbers,
    arrivals: Numbers,
    order: Numbers,
    goals: Numbers,
    allowed: int,
    turn: int,
    memory: Scratch,
) -> int:
    """Take the paths of the agents in `order` (K,) out of the table and plan them anew one after the other.

    Keeps the new paths and returns their sum of arrivals if all are found and it is at most `allowed`; otherwise restores
    the old ones and returns -1. `towards` (A, N), `held` (T, N), `paths` (A, T) and `arrivals` (A,); see `quickest`. An
    arrival of -1 marks an agent without a path yet.
    """
    steps = held.shape[0]
    count = len(order)
    old = np.empty((count, steps), np.int32)
    old_arrivals = np.empty(count, np.int32)
    rest = 0
    for k in range(count):
        agent = order[k]
        old[k] = paths[agent]
        old_arrivals[k] = arrivals[agent]
        rest += towards[agent, paths[agent, 0]]
        if old_arrivals[k] >= 0:
            for step in range(steps):
                held[step, paths[agent, step]] = -1
    total, planned = 0, 0
    for k in range(count):
        agent = order[k]
        start = old[k, 0]
        rest -= towards[agent, start]
        found = quickest(
            neighbours,
            towards[agent],
            held,
            start,
            goals[agent],
            allowed - total - rest,
            turn + k,
            memory,
            paths[agent],
        )
        if found < 0:
            break
        arrivals[agent] = found
        total += found
        planned += 1
        for step in range(steps):
            held[step, paths[agent, step]] = agent
    if planned == count:
        return total
    for k in range(planned):
        agent = order[k]
        for step in range(steps):
            held[step, paths[agent, step]] = -1
    for k in range(count):
        agent = order[k]
        paths[agent] = old[k]
        arrivals[agent] = old_arrivals[k]
        if old_arrivals[k] >= 0:
            for step in range(steps):
                held[step, paths[agent, step]] = agent
    return -1
