"""LaCAM: a first answer for many agents in milliseconds, and a repair of any situation that has a way out.

The search goes depth-first over configurations (the vertices of all agents). Each is followed by one that PIBT chooses;
where that leads nowhere, constraints on single agents are added one by one, so that every successor is tried in the
end: the search finds an answer if there is one. (K. Okumura, "LaCAM: search-based algorithm for quick multi-agent
pathfinding", AAAI 2023; PIBT: K. Okumura et al., Artificial Intelligence 310, 2022.)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from waychair.errors import NoPath
from waychair.planning.fleet.agents import Numbers, Task
from waychair.types import FloatArray

_RESTART = 0.001
"""Probability of going on from the start instead of a configuration met again; it leads out of large dead ends (Okumura)."""


@njit(cache=True)
def _may_enter(
    agent: int, vertex: int, rooms: Numbers, now: Numbers, then: Numbers, at_now: Numbers, at_then: Numbers
) -> bool:
    """Return whether nobody else goes to a vertex's room, and nobody comes from there to the room in which the agent is."""
    room = rooms[vertex]
    other = at_now[room]
    if at_then[room] >= 0:
        return False
    return bool(other < 0 or other == agent or then[other] < 0 or rooms[then[other]] != rooms[now[agent]])


@njit(cache=True)
def _placed(
    first: int,
    neighbours: Numbers,
    rooms: Numbers,
    now: Numbers,
    then: Numbers,
    at_now: Numbers,
    at_then: Numbers,
    prices: FloatArray,
) -> bool:
    """Choose the next vertex of an agent, and of those it pushes aside, which inherit its priority.

    Returns False if the agent must stay where another one wants to go. `prices` (A, D + 1) of the neighbours and of
    waiting become infinite once tried. (A stack of its own: compiled recursion does not survive numba's cache.)
    """
    degree = neighbours.shape[1]
    stack = np.empty(len(now), np.int32)
    stack[0], depth = first, 1
    while depth > 0:
        agent = stack[depth - 1]
        side = np.argmin(prices[agent])
        if prices[agent, side] == np.inf:  # nothing is left to try: it stays, and its pusher tries the next vertex
            then[agent] = now[agent]
            at_then[rooms[now[agent]]] = agent
            depth -= 1
            continue
        prices[agent, side] = np.inf
        vertex = now[agent] if side == degree else neighbours[now[agent], side]
        if not _may_enter(agent, vertex, rooms, now, then, at_now, at_then):
            continue
        then[agent] = vertex
        at_then[rooms[vertex]] = agent
        other = at_now[rooms[vertex]]
        if other < 0 or then[other] >= 0:  # all that were pushed have a place now
            return True
        stack[depth] = other
        depth += 1
    return False


@njit(cache=True)
def _prices(
    neighbours: Numbers, rooms: Numbers, towards: Numbers, now: Numbers, at_now: Numbers, noise: FloatArray
) -> FloatArray:
    """Return for each agent the price (A, D + 1) of each neighbour and of waiting: steps to go, and less if it is empty."""
    count, degree = len(now), neighbours.shape[1]
    prices = np.full((count, degree + 1), np.inf)
    for agent in range(count):
        for side in range(degree + 1):
            vertex = now[agent] if side == degree else neighbours[now[agent], side]
            if vertex >= 0 and towards[agent, vertex] >= 0:
                prices[agent, side] = towards[agent, vertex] + noise[agent, side] + 0.5 * (at_now[rooms[vertex]] >= 0)
    return prices


@njit(cache=True)
def next_configuration(
    neighbours: Numbers,
    rooms: Numbers,
    towards: Numbers,
    now: Numbers,
    order: Numbers,
    forced: Numbers,
    at_now: Numbers,
    at_then: Numbers,
    noise: FloatArray,
) -> Numbers:
    """Return the vertices (A,) of all agents after the next step, as PIBT chooses them; empty if it finds none.

    `rooms` (N,), `towards` (A, N), `now` (A,), agents in falling priority `order` (A,), `forced` (A,) the vertex that an
    agent must take, -1 for a free choice; `noise` (A, D + 1) below 0.5 breaks ties. `at_now` and `at_then`, one for each
    room, are scratch filled with -1, and so again afterwards.
    """
    count = len(now)
    then = np.full(count, -1, np.int32)
    sound = True
    for agent in range(count):
        at_now[rooms[now[agent]]] = agent
    for agent in range(count):
        vertex = forced[agent]
        if vertex < 0:
            continue
        if not _may_enter(agent, vertex, rooms, now, then, at_now, at_then):
            sound = False
            break
        then[agent] = vertex
        at_then[rooms[vertex]] = agent
    if sound:
        prices = _prices(neighbours, rooms, towards, now, at_now, noise)
        for agent in order:
            if then[agent] < 0 and not _placed(agent, neighbours, rooms, now, then, at_now, at_then, prices):
                sound = False
                break
    for agent in range(count):
        at_now[rooms[now[agent]]] = -1
        at_then[rooms[now[agent]]] = -1
        if then[agent] >= 0:
            at_then[rooms[then[agent]]] = -1
    return then if sound else then[:0]


@dataclass(slots=True)
class _Node:
    """A configuration (A,), how it was reached, priorities (A,), and the constraints that are still to be tried.

    A constraint is a tuple of (agent, vertex) pairs.
    """

    now: Numbers
    before: _Node | None
    priorities: FloatArray
    order: Numbers
    untried: deque[tuple[tuple[int, int], ...]] = field(default_factory=lambda: deque([()]))


def first_answer(
    task: Task,
    towards: Numbers,
    rng: np.random.Generator,
    may_go_on: Callable[[], bool] = lambda: True,
    rooms: Numbers | None = None,
) -> Numbers:
    """Return paths (A, T) of all agents, valid and not yet short.

    `towards` (A, N) are the steps to the goals, -1 for a vertex that an agent must not enter. `rooms` (N,) numbers the room
    of each vertex, of which several may share one, such as both directions of a corridor: after each step there is one agent
    in a room, and no two exchange their rooms in one. By default each vertex is a room of its own.

    Raises:
        NoPath: there is no answer at all, or `may_go_on` said no before one was found; the message says which.
    """
    count, vertices = task.agents, len(task.neighbours)
    degree = task.neighbours.shape[1]
    rooms = np.arange(vertices, dtype=np.int32) if rooms is None else rooms
    at_now, at_then = (np.full(int(rooms.max()) + 1, -1, np.int32) for _ in range(2))
    far = towards[np.arange(count), task.starts] / (vertices + 1.0)
    start = _Node(task.starts, None, far, _falling(far))
    known = {task.starts.tobytes(): start}
    opened = [start]
    while opened:
        node = opened[-1]
        if np.array_equal(node.now, task.goals):
            return _paths(node)
        if not may_go_on():
            raise NoPath("no answer for all agents was found in time: give more seconds or fewer agents")
        if not node.untried:
            opened.pop()
            continue
        forced = np.full(count, -1, np.int32)
        constraint = node.untried.popleft()
        for agent, vertex in constraint:
            forced[agent] = vertex
        if len(constraint) < count:
            agent = int(node.order[len(constraint)])
            vertex = int(node.now[agent])
            options = [int(other) for other in task.neighbours[vertex] if other >= 0 and towards[agent, other] >= 0]
            for option in rng.permutation([*options, vertex]).tolist():
                node.untried.append((*constraint, (agent, option)))
        noise = rng.random((count, degree + 1)) * 0.4
        found = next_configuration(
            task.neighbours, rooms, towards, node.now, node.order, forced, at_now, at_then, noise
        )
        if len(found) == 0:
            continue
        key = found.tobytes()
        again = known.get(key)
        if again is None:
            arrived = found == task.goals
            priorities = np.where(arrived, node.priorities % 1.0, node.priorities + 1.0)
            known[key] = _Node(found, node, priorities, _falling(priorities))
            opened.append(known[key])
        else:
            opened.append(start if rng.random() < _RESTART else again)
    raise NoPath("there is no way in which all agents reach their goals: remove an agent or give another goal")


def _falling(priorities: FloatArray) -> Numbers:
    """Return the agents (A,) from the highest priority to the lowest."""
    return np.argsort(-priorities, kind="stable").astype(np.int32)


def _paths(node: _Node) -> Numbers:
    """Return the paths (A, T) that lead to a configuration."""
    configurations = [node.now]
    while node.before is not None:
        node = node.before
        configurations.append(node.now)
    return np.array(configurations[::-1], np.int32).T.copy()
