"""Random small tasks of several agents, and plain references of the solvers' kernels."""

from __future__ import annotations

from collections import deque

import numpy as np

from waychair.planning.fleet.agents import Task, neighbours_of_cells
from waychair.types import BoolArray, FloatArray, IntArray


def random_cells(rng: np.random.Generator, height: int, width: int, solid: float) -> BoolArray:
    """Return cells (H, W) of which about the share `solid` is not free."""
    return np.asarray(rng.random((height, width)) >= solid)


def random_task(rng: np.random.Generator, height: int, width: int, agents: int, solid: float = 0.2) -> Task | None:
    """Return a task on random cells in which each agent can reach its goal alone; None if the draw gave none."""
    neighbours, _ = neighbours_of_cells(random_cells(rng, height, width, solid))
    if len(neighbours) < agents:
        return None
    starts = rng.choice(len(neighbours), agents, replace=False).astype(np.int32)
    goals = rng.choice(len(neighbours), agents, replace=False).astype(np.int32)
    if any(plain_steps(neighbours, int(g))[s] < 0 for s, g in zip(starts, goals, strict=True)):
        return None
    return Task(neighbours, starts, goals)


def tasks(seed: int, count: int, height: int, width: int, agents: int) -> list[Task]:
    """Return so many random tasks."""
    rng = np.random.default_rng(seed)
    found: list[Task] = []
    while len(found) < count:
        task = random_task(rng, height, width, agents)
        if task is not None:
            found.append(task)
    return found


def beside(neighbours: IntArray, vertex: int) -> list[int]:
    return [int(other) for other in neighbours[vertex] if other >= 0]


def plain_steps(neighbours: IntArray, goal: int) -> list[int]:
    """Return the steps from each vertex to the goal, -1 where there is no way."""
    steps = [-1] * len(neighbours)
    steps[goal] = 0
    queue = deque([goal])
    while queue:
        vertex = queue.popleft()
        for other in beside(neighbours, vertex):
            if steps[other] < 0:
                steps[other] = steps[vertex] + 1
                queue.append(other)
    return steps


def plain_quickest(neighbours: IntArray, held: IntArray, start: int, goal: int) -> int:
    """Return the earliest step of arrival for good among fixed paths, by trying all vertices step by step; -1 if none."""
    reached = {start} if held[0, start] == -1 else set()
    for step in range(len(held)):
        if goal in reached and (held[step:, goal] == -1).all():
            return step
        if step + 1 == len(held):
            break
        reached = {
            other
            for vertex in reached
            for other in [vertex, *beside(neighbours, vertex)]
            if held[step + 1, other] == -1
            and not (held[step, other] >= 0 and held[step + 1, vertex] == held[step, other])
        }
    return -1


def with_lanes(rng: np.random.Generator, task: Task) -> tuple[Task, IntArray]:
    """Return the task with one lane between any two vertices, and the room (N,) of each vertex.

    A lane is a vertex in each direction, which share a room. About half of them can be left backwards as well. Each agent
    that can starts in a lane beside its start.
    """
    count = len(task.neighbours)
    after: list[list[int]] = [[] for _ in range(count)]
    rooms = list(range(count))
    for one in range(count):
        for other in (each for each in beside(task.neighbours, one) if each > one):
            may_back = rng.random() < 0.5
            room = max(rooms) + 1
            for start, end in ((one, other), (other, one)):
                after[start].append(len(after))
                after.append([end, start] if may_back else [end])
                rooms.append(room)
    table = np.full((len(after), max(map(len, after))), -1, np.int32)
    for vertex, others in enumerate(after):
        table[vertex, : len(others)] = others
    starts = task.starts.copy()
    for agent, start in enumerate(starts.tolist()):
        free = [lane for lane in after[start] if rooms[lane] not in {rooms[other] for other in starts}]
        starts[agent] = free[0] if free else start
    return Task(table, starts, task.goals), np.array(rooms, np.int32)


def plain_steps_along(neighbours: IntArray, goals: IntArray) -> IntArray:
    """Return the steps (A, N) from each vertex to each goal over one-way neighbours, -1 where there is no way."""
    before = np.full((len(neighbours), len(neighbours)), -1, np.int32)
    for vertex in range(len(neighbours)):
        before[beside(neighbours, vertex), vertex] = vertex
    return np.array([plain_steps(before, goal) for goal in goals.tolist()], np.int32)


def plain_configuration(
    task: Task, rooms: IntArray, towards: IntArray, order: list[int], forced: list[int], noise: FloatArray
) -> list[int]:
    """Return the next vertex of each agent from its start by PIBT as published, recursively; empty if it finds none."""
    then: dict[int, int] = {}
    owner: dict[int, int] = {}
    now = task.starts.tolist()
    held_by = {int(rooms[vertex]): agent for agent, vertex in enumerate(now)}
    sides = task.neighbours.shape[1]

    def may(agent: int, vertex: int) -> bool:
        other = held_by.get(int(rooms[vertex]))
        exchanges = other not in (None, agent) and other in then and rooms[then[other]] == rooms[now[agent]]
        return int(rooms[vertex]) not in owner and not exchanges

    def take(agent: int, vertex: int) -> None:
        then[agent] = vertex
        owner[int(rooms[vertex])] = agent

    def place(agent: int) -> bool:
        options = [(side, int(task.neighbours[now[agent], side])) for side in range(sides)]
        options = [option for option in options if option[1] >= 0 and towards[agent, option[1]] >= 0]
        options.append((sides, now[agent]))
        options.sort(
            key=lambda option: (
                towards[agent, option[1]] + noise[agent, option[0]] + 0.5 * (int(rooms[option[1]]) in held_by)
            )
        )
        for _, vertex in options:
            if may(agent, vertex):
                take(agent, vertex)
                other = held_by.get(int(rooms[vertex]))
                if other is None or other in then or place(other):
                    return True
        take(agent, now[agent])
        return False

    for agent, vertex in enumerate(forced):
        if vertex >= 0:
            if not may(agent, vertex):
                return []
            take(agent, vertex)
    for agent in order:
        if agent not in then and not place(agent):
            return []
    return [then[agent] for agent in range(len(now))]


def can_be_solved(task: Task, rooms: IntArray) -> bool:
    """Return whether any sequence of joint steps leads all agents to their goals; tries all of them."""
    start, goal = tuple(task.starts.tolist()), tuple(task.goals.tolist())
    known, queue = {start}, deque([start])
    while queue:
        now = queue.popleft()
        if now == goal:
            return True
        partial: list[tuple[int, ...]] = [()]
        for agent, vertex in enumerate(now):
            partial = [
                (*then, other)
                for then in partial
                for other in [vertex, *beside(task.neighbours, vertex)]
                if not any(
                    rooms[then[k]] == rooms[other]
                    or (rooms[then[k]] == rooms[vertex] and rooms[now[k]] == rooms[other])
                    for k in range(agent)
                )
            ]
        for then in partial:
            if then not in known:
                known.add(then)
                queue.append(then)
    return False
