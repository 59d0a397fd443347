"""Paths of many agents: valid, never worse with time, found whenever there are any; kernels equal plain references."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from tests.planning.fleet.grids import (
    can_be_solved,
    plain_configuration,
    plain_quickest,
    plain_steps,
    plain_steps_along,
    random_cells,
    tasks,
    with_lanes,
)
from waychair.errors import NoPath, TaskError
from waychair.planning.fleet.agents import (
    Numbers,
    Task,
    check_reachable,
    costs,
    fault,
    neighbours_of_cells,
    task_of_cells,
)
from waychair.planning.fleet.lacam import first_answer, next_configuration
from waychair.planning.fleet.lns import improvements, planned_in_order
from waychair.planning.fleet.solving import solved
from waychair.planning.fleet.space_time import quickest, scratch, steps_to

CORRIDOR = task_of_cells(np.ones((1, 4), bool), [(0, 0), (0, 3)], [(0, 3), (0, 0)])


def test_steps_to_goals_equal_a_plain_search() -> None:
    neighbours, _ = neighbours_of_cells(random_cells(np.random.default_rng(1), 9, 7, 0.35))
    goals = np.arange(0, len(neighbours), 5, dtype=np.int32)
    assert steps_to(neighbours, goals).tolist() == [plain_steps(neighbours, goal) for goal in goals.tolist()]


def test_the_quickest_path_among_fixed_ones_equals_a_plain_search_and_keeps_the_rules() -> None:
    for number, task in enumerate(tasks(2, 60, 4, 5, 5)):
        rng = np.random.default_rng(number)
        towards = steps_to(task.neighbours, task.goals)
        others = Task(task.neighbours, task.starts[1:], task.goals[1:])
        paths = planned_in_order(others, towards[1:], rng, 3)
        if paths is None:
            continue
        paths = np.pad(paths, ((0, 0), (0, 6)), mode="edge")
        held = np.full((paths.shape[1], len(task.neighbours)), -1, np.int32)
        for agent, path in enumerate(paths):
            held[np.arange(len(path)), path] = agent
        path = np.empty(paths.shape[1], np.int32)
        start, goal = int(task.starts[0]), int(task.goals[0])
        room = scratch(*held.shape)
        found = quickest(task.neighbours, towards[0], held, start, goal, 99, number, room, path)
        assert found == plain_quickest(task.neighbours, held, start, goal)
        if found >= 0:
            assert fault(task, np.vstack([path[None], paths])) == ""
            assert costs(path[None])[0] == found
            assert quickest(task.neighbours, towards[0], held, start, goal, found - 1, 0, room, path) == -1


def test_the_next_configuration_equals_pibt_as_published() -> None:
    for number, (task, rooms) in enumerate(roomy(3, 60, 4, 4, 6)):
        rng = np.random.default_rng(number)
        towards = plain_steps_along(task.neighbours, task.goals)
        order, noise = rng.permutation(6).astype(np.int32), rng.random((6, task.neighbours.shape[1] + 1)) * 0.4
        forced = np.full(6, -1, np.int32)
        if number % 2:
            forced[order[0]] = max(task.neighbours[task.starts[order[0]]])
        empty = np.full(len(task.neighbours), -1, np.int32), np.full(len(task.neighbours), -1, np.int32)
        found = next_configuration(task.neighbours, rooms, towards, task.starts, order, forced, *empty, noise)
        assert found.tolist() == plain_configuration(task, rooms, towards, order.tolist(), forced.tolist(), noise)
        assert all((table == -1).all() for table in empty)


def test_lacam_finds_an_answer_exactly_where_there_is_one() -> None:
    solvable = 0
    for task, rooms in [*roomy(4, 20, 2, 4, 3)[::2], *roomy(6, 60, 1, 4, 2), *roomy(7, 20, 2, 3, 3)]:
        towards = plain_steps_along(task.neighbours, task.goals)
        if can_be_solved(task, rooms):
            paths = first_answer(task, towards, np.random.default_rng(0), rooms=rooms)
            assert fault(task, paths) == ""
            assert fault_of_rooms(rooms[paths]) == ""
            solvable += 1
        else:
            with pytest.raises(NoPath, match="no way in which all agents reach their goals"):
                first_answer(task, towards, np.random.default_rng(0), rooms=rooms)
    assert 30 < solvable < 80


def roomy(seed: int, count: int, height: int, width: int, agents: int) -> list[tuple[Task, Numbers]]:
    """Return so many random tasks with the rooms of their vertices; every second one has lanes between its cells."""
    rng = np.random.default_rng(seed)
    plain = tasks(seed, count, height, width, agents)
    return [
        with_lanes(rng, task) if number % 2 else (task, np.arange(len(task.neighbours), dtype=np.int32))
        for number, task in enumerate(plain)
    ]


def fault_of_rooms(rooms: Numbers) -> str:
    """Return a step after which two agents (A, T) are in one room, or have exchanged theirs, as a text; empty if none."""
    for step, now in enumerate(rooms.T.tolist()):
        if len(set(now)) < len(now):
            return f"one room after step {step}"
        moves = set(zip(rooms[:, step - 1].tolist(), now, strict=True)) if step else set()
        if any(one != other and (other, one) in moves for one, other in moves):
            return f"exchanged in step {step}"
    return ""


def test_paths_only_get_shorter_and_stay_valid_and_equal_seeds_give_equal_paths() -> None:
    task = tasks(5, 1, 12, 12, 30)[0]
    towards = steps_to(task.neighbours, task.goals)
    first = first_answer(task, towards, np.random.default_rng(0))
    last = int(costs(first).sum())
    for paths in islice(improvements(task, towards, first, np.random.default_rng(1)), 60):
        assert fault(task, paths) == ""
        assert costs(paths).sum() <= last
        last = int(costs(paths).sum())
    assert last < costs(first).sum()
    again = list(islice(improvements(task, towards, first, np.random.default_rng(1)), 60))[-1]
    assert np.array_equal(paths, again)


def test_agents_alone_in_their_way_get_their_shortest_paths_and_the_search_ends() -> None:
    task = task_of_cells(np.ones((3, 5), bool), [(0, 0), (2, 4)], [(0, 4), (2, 0)])
    found = solved(task, 60.0)
    assert (found.sum_of_costs, found.bound, found.valid) == (8, 8, True)


def test_the_check_names_every_broken_rule() -> None:
    cells = np.ones((2, 2), bool)  # vertices 0 1 above 2 3
    task = task_of_cells(cells, [(0, 0), (0, 1)], [(1, 0), (1, 1)])
    assert fault(task, np.array([[0, 2], [1, 3]])) == ""
    assert fault(task, np.array([[0, 2]])) == "there are 1 paths for 2 agents"
    assert fault(task, np.array([[1, 2], [0, 3]])) == "agent 1 is not at its start"
    assert fault(task, np.array([[0, 2], [1, 1]])) == "agent 2 is not at its goal"
    assert fault(task, np.array([[0, 1, 0, 2], [1, 1, 1, 3]])) == "agents 1 and 2 are in one vertex after step 1"
    assert fault(task, np.array([[0, 2], [1, 3]])[:, [0, 1]]) == ""
    across = replace(task, goals=np.array([3, 2], np.int32))
    assert fault(across, np.array([[0, 3], [1, 2]])) == "agent 1 jumps in step 1"
    swap = replace(task, goals=np.array([1, 0], np.int32))
    assert fault(swap, np.array([[0, 1], [1, 0]])) == "agents 1 and 2 exchange their vertices in step 1"


def test_tasks_that_cannot_be_are_refused_with_the_agents_number() -> None:
    cells = np.array([[True, True, False, True]])
    with pytest.raises(TaskError, match="agents 1 and 2 have the same start, column 0, row 0"):
        task_of_cells(cells, [(0, 0), (0, 0)], [(0, 1), (0, 3)])
    with pytest.raises(TaskError, match="agents 1 and 2 have the same goal, column 1, row 0"):
        task_of_cells(cells, [(0, 0), (0, 1)], [(0, 1), (0, 1)])
    apart = task_of_cells(cells, [(0, 0), (0, 1)], [(0, 1), (0, 3)])
    with pytest.raises(NoPath, match="agent 2 cannot reach its goal even alone"):
        check_reachable(apart, steps_to(apart.neighbours, apart.goals))
    with pytest.raises(NoPath, match="no way in which all agents reach their goals"):
        solved(CORRIDOR, 5.0)
