"""One task each, all at once, in the paper's own model: nodes hold any number of chairs, sections are single file.

By the paper, the routes are planned one after the other by its network, and the nodes admit the chairs as they come
(`do_tasks`); by the coordinator, all are planned together (`coordinated_tasks`).
"""

from __future__ import annotations

import random
import time
from dataclasses import dataclass

import numpy as np

from waychair.errors import TrafficError
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.paper.admission import Asking, Tie, first_to_go
from waychair.planning.fleet.paper.baselines import PaperPreset, preset_route, reading_of
from waychair.planning.fleet.paper.goal_filters import distances_from
from waychair.planning.fleet.paper.network import NodeNetwork
from waychair.planning.fleet.section_plans import SectionPlanner, Trip
from waychair.simulation.graph_traffic.section_events import SectionEvents
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import Json

PAPER_SPEED = 0.33
"""m/s; the paper's simulation."""


@dataclass(frozen=True, slots=True)
class Instance:
    """Different starts and different goals, by name, one of each a chair."""

    starts: tuple[str, ...]
    goals: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TasksDone:
    """`delays` [s] of the chairs, the `messages` and `work` of the network, and the processor time [s] of each plan."""

    delays: tuple[float, ...]
    messages: int
    work: int
    plan_s: tuple[float, ...]


def random_instance(graph: TrafficGraph, chairs: int, seed: int) -> Instance:
    """Return random starts and goals; no chair starts at its goal.

    Raises:
        TrafficError: there are more chairs than nodes.
    """
    names = [node.name for node in graph.nodes]
    if not 1 <= chairs <= len(names):
        raise TrafficError(f"{graph.name} has {len(names)} nodes, not room for {chairs} chairs; give 1 to {len(names)}")
    draw = np.random.default_rng(seed_from_names("tasks", graph.name, chairs, seed))
    starts = draw.choice(len(names), size=chairs, replace=False)
    goals = draw.choice(len(names), size=chairs, replace=False)
    while chairs > 1 and (starts == goals).any():
        goals = draw.permutation(goals) if chairs == len(names) else draw.choice(len(names), size=chairs, replace=False)
    return Instance(tuple(names[i] for i in starts), tuple(names[i] for i in goals))


def do_tasks(
    graph: TrafficGraph, instance: Instance, preset: PaperPreset, seed: int, tie: Tie = Tie.HALF_HALF
) -> TasksDone:
    """Return what the chairs do that plan in the order of their numbers and start together."""
    dice = random.Random(seed_from_names("dice", graph.name, seed))
    network = NodeNetwork(graph, reading_of(preset))
    section = {each.name: i for i, each in enumerate(graph.sections)}
    routes: list[list[int]] = []
    plan_s: list[float] = []
    for chair, (start, goal) in enumerate(zip(instance.starts, instance.goals, strict=True)):
        began = time.process_time()
        found = preset_route(preset, network, chair, start, goal, start_s=0.0, speed=PAPER_SPEED, dice=dice)
        plan_s.append(time.process_time() - began)
        routes.append([section[name] for name in found.sections])
    finished = drive_routes(graph, instance.starts, routes, dice, tie)
    ideal = [distances_from(graph, start)[goal] for start, goal in zip(instance.starts, instance.goals, strict=True)]
    return TasksDone(
        tuple(done - free for done, free in zip(finished, ideal, strict=True)),
        network.messages.total(),
        sum(node.work for node in network.nodes.values()),
        tuple(plan_s),
    )


def coordinated_tasks(graph: TrafficGraph, planner: SectionPlanner, instance: Instance) -> TasksDone:
    """Return what the chairs do by the coordinator's plans; nobody is late, so that they drive as planned.

    The processor time is that of all plans together, for each chair.
    """
    number = {node.name: i for i, node in enumerate(graph.nodes)}
    ends = [(number[start], number[goal]) for start, goal in zip(instance.starts, instance.goals, strict=True)]
    began = time.process_time()
    found = planner.plans([Trip(start, goal, 0) for start, goal in ends])
    took_s = time.process_time() - began
    if found is None:
        raise TrafficError(f"{graph.name} has a place that no way leads to; join its parts")
    ideal = [planner.alone_ms(start, goal) for start, goal in ends]
    done = [drive[-1].until_ms if drive else 0 for drive in found.drives]
    delays = tuple(1e-3 * (arrival - alone) for arrival, alone in zip(done, ideal, strict=True))
    return TasksDone(delays, 0, 0, (took_s,) * len(ends))


def drive_routes(
    graph: TrafficGraph, starts: tuple[str, ...], routes: list[list[int]], dice: random.Random, tie: Tie
) -> list[float]:
    """Return when [s] each chair has driven its route, if the nodes admit the chairs as they come."""
    number = {node.name: i for i, node in enumerate(graph.nodes)}
    events = SectionEvents(graph, [number[start] for start in starts], speed=PAPER_SPEED)
    ahead = [list(reversed(route)) for route in routes]
    since = [0.0] * len(routes)
    finished = [0.0] * len(routes)
    waiting = {chair for chair, route in enumerate(ahead) if route}
    while True:
        _admit(events, ahead, since, waiting, dice, tie)
        left = events.next_left()
        if left is None:
            return finished
        chairs = [left]
        while (other := events.next_left(left.now_s)) is not None:  # chairs that come at the same time ask together
            chairs.append(other)
        for each in chairs:
            since[each.chair] = finished[each.chair] = each.now_s
            if ahead[each.chair]:
                waiting.add(each.chair)


def _admit(
    events: SectionEvents,
    ahead: list[list[int]],
    since: list[float],
    waiting: set[int],
    dice: random.Random,
    tie: Tie,
) -> None:
    """Let all waiting chairs go that may, one after the other, as the nodes decide."""
    while True:
        able = [chair for chair in sorted(waiting) if events.may_enter(chair, ahead[chair][-1])]
        if not able:
            return
        section = ahead[able[0]][-1]
        asking = [Asking(chair, 0, since[chair]) for chair in able if ahead[chair][-1] == section]
        chair = first_to_go(asking, tie, dice).chair
        events.enter(chair, ahead[chair].pop())
        waiting.remove(chair)


def tasks_as_json(done: list[TasksDone]) -> Json:
    """Return the means of some instances for a report."""
    delays = [delay for each in done for delay in each.delays]
    plans = [1000 * plan for each in done for plan in each.plan_s]
    chairs = sum(len(each.delays) for each in done)
    return {
        "instances": len(done),
        "mean_delay_s": float(np.mean(delays)),
        "messages_a_query": sum(each.messages for each in done) / chairs,
        "work_a_query": sum(each.work for each in done) / chairs,
        "plan_ms_p50": float(np.percentile(plans, 50)),
        "plan_ms_p99": float(np.percentile(plans, 99)),
    }
