"""Agents on a graph of unit steps: the task, its paths, and a check of paths that shares no code with the solvers.

The rules are those of the multi-agent path finding (MAPF) benchmark, R. Stern et al., SoCS 2019: at each step every agent
moves to a neighbouring vertex or waits; no two agents are in one vertex after a step, none exchange their vertices in
one, and an agent may enter a vertex in the step in which another leaves it. An agent stays at its goal for good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from waychair.errors import NoPath, TaskError
from waychair.types import BoolArray

Numbers: TypeAlias = npt.NDArray[np.int32]
"""Numbers of vertices, agents or steps."""

NONE = -1
"""No vertex, or no agent."""


@dataclass(frozen=True, slots=True)
class Task:
    """Agents that are to go from `starts` (A,) to `goals` (A,) over a graph.

    `neighbours` (N, D) int32 are the vertices beside each vertex, filled with -1.
    """

    neighbours: Numbers
    starts: Numbers
    goals: Numbers

    @property
    def agents(self) -> int:
        return len(self.starts)


def neighbours_of_cells(free: BoolArray) -> tuple[Numbers, Numbers]:
    """Return the four neighbours (N, 4) of each free cell (H, W), and the number (H, W) of each cell, -1 if not free."""
    numbers: Numbers = np.full(free.shape, NONE, np.int32)
    numbers[free] = np.arange(np.count_nonzero(free), dtype=np.int32)
    framed = np.pad(numbers, 1, constant_values=NONE)
    sides = (framed[:-2, 1:-1], framed[1:-1, :-2], framed[1:-1, 2:], framed[2:, 1:-1])
    return np.column_stack([side[free] for side in sides]).astype(np.int32), numbers


def task_of_cells(free: BoolArray, starts: Sequence[tuple[int, int]], goals: Sequence[tuple[int, int]]) -> Task:
    """Return the task of agents on cells (H, W), with starts and goals as (row, column) of free cells.

    Raises:
        TaskError: two agents have the same start or the same goal.
    """
    neighbours, numbers = neighbours_of_cells(free)
    for name, cells in (("start", starts), ("goal", goals)):
        first: dict[tuple[int, int], int] = {}
        for agent, cell in enumerate(cells, start=1):
            if cell in first:
                raise TaskError(
                    f"agents {first[cell]} and {agent} have the same {name}, column {cell[1]}, row {cell[0]}: "
                    f"give each agent a {name} of its own"
                )
            first[cell] = agent
    begins, ends = (np.array([numbers[cell] for cell in cells], np.int32) for cells in (starts, goals))
    return Task(neighbours, begins, ends)


def check_reachable(task: Task, towards: Numbers) -> None:
    """Refuse a task in which an agent cannot reach its goal even alone; `towards` (A, N) are the steps to the goals.

    Raises:
        NoPath: the message names the agent.
    """
    alone = towards[np.arange(task.agents), task.starts]
    if (alone < 0).any():
        agent = int(np.argmin(alone)) + 1
        raise NoPath(f"agent {agent} cannot reach its goal even alone: give it a goal in its own part of the map")


def costs(paths: Numbers) -> Numbers:
    """Return for each path (A, T) the steps until it stands at its end for good."""
    moved = paths != paths[:, -1:]
    last = paths.shape[1] - np.argmax(moved[:, ::-1], axis=1)
    return np.where(moved.any(axis=1), last, 0).astype(np.int32)


def fault(task: Task, paths: Numbers) -> str:
    """Return the first rule that paths (A, T) break, as a sentence, or an empty text if they are valid.

    `paths[a, t]` is the vertex of agent a after t steps.
    """
    if len(paths) != task.agents or paths.shape[1] < 1:
        return f"there are {len(paths)} paths for {task.agents} agents"
    for name, wanted, found in (("start", task.starts, paths[:, 0]), ("goal", task.goals, paths[:, -1])):
        for number in np.flatnonzero(wanted != found).tolist():
            return f"agent {number + 1} is not at its {name}"
    beside = {(int(v), int(w)) for v, row in enumerate(task.neighbours) for w in row if w != NONE}
    for step in range(paths.shape[1]):
        now = paths[:, step].tolist()
        owners: dict[int, int] = {}
        for agent, vertex in enumerate(now, start=1):
            if vertex in owners:
                return f"agents {owners[vertex]} and {agent} are in one vertex after step {step}"
            owners[vertex] = agent
        if step == 0:
            continue
        before = paths[:, step - 1].tolist()
        moves = {(v, w): agent for agent, (v, w) in enumerate(zip(before, now, strict=True), start=1) if v != w}
        for (v, w), agent in moves.items():
            if (v, w) not in beside:
                return f"agent {agent} jumps in step {step}"
            if (w, v) in moves:
                return f"agents {agent} and {moves[w, v]} exchange their vertices in step {step}"
    return ""
