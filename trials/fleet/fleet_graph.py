"""Hours of several chairs on a traffic graph with people about: the paper's simulation, and ours beside it.

Every chair gets a random task as soon as it has done the one before: another node, or another refuge where the graph has
some. The delay of a task is the time it took less the time of the shortest way with nobody about. Tasks that are under way
at the end are not counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from waychair.errors import TrafficError
from waychair.maps.traffic.indexed_traffic import IndexedTraffic
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.maps.traffic.well_formed import refuse_pieces
from waychair.planning.fleet.paper.plan_fwpp import (
    Conflicts,
    PlannedRoute,
    commit,
    label_of,
    no_commitments,
    plan_route,
    put_off,
)
from waychair.simulation.graph_traffic.crowd import Crowd, CrowdModel, RightOfWay
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import FloatArray, IntArray, Json

LOCKED_UP_S = 300.0
"""s; longer than that without a movement of any chair is a lock-up, as in the spec's trials."""


WORTH_TURNING_S = 1.0
"""s; a chair under way takes another route only if that is better by more, so that rounding does not turn it about."""

_NO_LABELS = np.zeros(0)


class FleetRoutePlanner(Protocol):
    """Plans the routes of the chairs of one run."""

    def route(self, chair: int, start: int, goal: int, now_s: float) -> PlannedRoute:
        """Return a chair's route; the planner remembers it for the others until the chair asks again."""

    def again(
        self, chair: int, section: int, start: int, goal: int, now_s: float, left_s: float
    ) -> PlannedRoute | None:
        """Return a better route from node `start` for a chair that will leave `section` there in `left_s`, if there is one."""

    def put_off(self, chair: int, begun: int, node_s: float) -> None:
        """Hear that a chair will have driven the first `begun` moves of its route at a time of day [s]."""


class PaperPlanner:
    """Plan-FWPP with one reading of its conflicts: each chair plans against the others' commitments.

    It does so when it sets out and, by `again`, under way.
    """

    def __init__(
        self, graph: IndexedTraffic, chairs: int, speed: float, conflicts: Conflicts, top: Iterable[int]
    ) -> None:
        self._graph, self._conflicts = graph, conflicts
        self._durations = graph.seconds(speed)
        self._closed = np.zeros(len(graph.length), dtype=np.int64)
        self._commitments = no_commitments(chairs, len(graph.first))
        self._commitments.priority[list(top)] = 1

    def route(self, chair: int, start: int, goal: int, now_s: float) -> PlannedRoute:
        """Return a chair's route and commit the chair to it.

        Raises:
            TrafficError: no way leads there.
        """
        route = plan_route(
            self._graph,
            self._durations,
            self._closed,
            chair,
            start,
            goal,
            now_s,
            self._commitments,
            self._conflicts,
        )
        if route is None:
            raise TrafficError(f"no way leads from node {start} to node {goal}")
        commit(self._graph, self._commitments, chair, route, now_s, self._durations)
        return route

    def again(
        self, chair: int, section: int, start: int, goal: int, now_s: float, left_s: float
    ) -> PlannedRoute | None:
        """Return a better route from node `start` for a chair that will leave `section` there in `left_s`; -1: it is there.

        None: the route that it has is not worse by `WORTH_TURNING_S`. The nodes stay committed for the chair's section.
        """
        at_s = now_s + left_s
        own = self._commitments
        count = int(own.moves[chair])
        ahead = own.nodes[chair, : count + 1].tolist()
        begun = ahead.index(start) if start in ahead else count
        old = PlannedRoute(
            own.sections[chair, begun:count].copy(), own.nodes[chair, begun : count + 1].copy(), _NO_LABELS
        )
        route = plan_route(self._graph, self._durations, self._closed, chair, start, goal, at_s, own, self._conflicts)
        cost = label_of(self._graph, self._durations, chair, old, at_s, own, self._conflicts)
        if route is None or cost <= route.labels[-1] + WORTH_TURNING_S:
            return None
        if section >= 0:
            ends = self._graph.ends[section]
            whole = PlannedRoute(
                np.concatenate(([section], route.sections)),
                np.concatenate(([ends[0] + ends[1] - start], route.nodes)),
                np.concatenate(([0.0], route.labels + left_s)),
            )
            commit(self._graph, own, chair, whole, now_s, self._durations)
        else:
            commit(self._graph, own, chair, route, now_s, self._durations)
        return route

    def put_off(self, chair: int, begun: int, node_s: float) -> None:
        """Hear that a chair will have driven the first `begun` moves of its route at a time of day [s]."""
        put_off(self._commitments, chair, begun, node_s)


@dataclass(slots=True)
class FleetHours:
    """The result of one run.

    Attributes:
        delays: s of each task that was done, by chair.
        chair_delays: s of the same tasks without the time in which the chair stood for people: the delay by other chairs.
        metres: m of the shortest way of the same tasks, by chair.
        waited: (C, 2) s that each chair stood for people and for chairs.
        queued: (S, 2) s that chairs stood on or before each section, for people and for chairs.
        people_waited: mean s an hour that a person stood for chairs.
        longest_standstill: s, the longest time without a movement of any chair.
    """

    hours: float
    delays: list[list[float]]
    chair_delays: list[list[float]]
    metres: list[list[float]]
    waited: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    queued: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    people_waited: float = 0.0
    longest_standstill: float = 0.0

    @classmethod
    def of(cls, chairs: int, hours: float) -> FleetHours:
        """Return the result of a run that begins."""
        return cls(hours, [[] for _ in range(chairs)], [[] for _ in range(chairs)], [[] for _ in range(chairs)])

    def done(self, chair: int, took_s: float, ideal_s: float, stood_s: float, speed: float) -> None:
        """Take down a task that took a chair so long, of which it stood for people for `stood_s`."""
        self.delays[chair].append(took_s - ideal_s)
        self.chair_delays[chair].append(took_s - ideal_s - stood_s)
        self.metres[chair].append(ideal_s * speed)

    def ended(self, crowd: Crowd) -> FleetHours:
        """Return the result with what the crowd has counted by the end."""
        self.waited, self.queued = crowd.waited, crowd.queued
        self.people_waited = crowd.people_held_up / self.hours
        self.longest_standstill = crowd.longest_standstill
        return self

    @property
    def mean_delay(self) -> float:
        """The mean delay [s] of all tasks that were done; not a number without any."""
        return mean([delay for chair in self.delays for delay in chair])

    @property
    def locked_up(self) -> bool:
        """Whether no chair moved for five minutes."""
        return self.longest_standstill >= LOCKED_UP_S


def fleet_hours(
    graph: TrafficGraph,
    *,
    chairs: int,
    people: int,
    rule: RightOfWay,
    hours: float,
    seed: int,
    conflicts: Conflicts = Conflicts.READ,
    model: CrowdModel | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> FleetHours:
    """Return what some chairs do for some hours by the paper's protocol; by the flexible rule chair 0 has top priority.

    `progress` is called with the share (0 to 1) of the hours that has passed.

    Raises:
        TrafficError: there are more chairs than places to be, or another number is impossible.
    """
    model = model or CrowdModel()
    random = np.random.default_rng(seed_from_names("fleet", graph.name, seed))
    goals = goal_nodes(graph)
    starts = start_nodes(graph, goals, chairs, random)
    tasks = task_streams(graph, chairs, seed)
    top = (0,) if rule is RightOfWay.FLEXIBLE else ()
    tells = conflicts is not Conflicts.NONE
    crowd = Crowd(graph, starts, people, rule, seed, top=top, tells_entries=tells, model=model)
    planner = PaperPlanner(crowd.indexed, chairs, model.chair_speed, conflicts, top)
    free_way = free_times(crowd.indexed, model.chair_speed)
    result = FleetHours.of(chairs, hours)
    began, ideal, goal_of = np.zeros(chairs), np.full(chairs, -1.0), [-1] * chairs
    stood = np.zeros(chairs)
    while crowd.now < hours * 3600.0 - 1e-6:
        for chair, when in crowd.arrived():
            stood_now = float(crowd.waited[chair, 0])
            if ideal[chair] >= 0.0:
                took = when - float(began[chair])
                result.done(chair, took, float(ideal[chair]), stood_now - float(stood[chair]), model.chair_speed)
            stood[chair] = stood_now
            here = crowd.node_of(chair)
            goal = next_goal(tasks[chair], goals, here)
            under_way = [other for other in range(chairs) if other != chair and ideal[other] >= 0.0]
            _tell_progress(crowd, planner, under_way)
            route = planner.route(chair, here, goal, crowd.now)
            crowd.give(chair, [int(section) for section in route.sections])
            began[chair], ideal[chair], goal_of[chair] = crowd.now, free_way[here, goal], goal
            if chair in top and conflicts is not Conflicts.NONE:
                _search_again(crowd, planner, [other for other in under_way if other not in top], goal_of)
        entered = crowd.entered()
        if entered:
            _tell_progress(crowd, planner, range(chairs))
            _search_again(crowd, planner, entered, goal_of)
        crowd.run(hours * 3600.0)
        progress(min(1.0, crowd.now / (hours * 3600.0)))
    return result.ended(crowd)


def _search_again(crowd: Crowd, planner: FleetRoutePlanner, chairs: Iterable[int], goals: Sequence[int]) -> None:
    """Let chairs under way search again, for the paper asks for the prediction of conflicts while they drive, too."""
    for chair in chairs:
        node = crowd.next_node(chair)
        if node != goals[chair]:
            _, left_s = crowd.progress(chair)
            section = crowd.section_of(chair)
            route = planner.again(chair, section, node, goals[chair], crowd.now, max(left_s, 0.0))
            if route is not None:
                crowd.turn_off(chair, [int(each) for each in route.sections])


def _tell_progress(crowd: Crowd, planner: FleetRoutePlanner, chairs: Iterable[int]) -> None:
    """Let the nodes hear how late the chairs under way are."""
    for chair in chairs:
        begun, left_s = crowd.progress(chair)
        planner.put_off(chair, begun, crowd.now + left_s)


def goal_nodes(graph: TrafficGraph) -> IntArray:
    """Return the nodes that chairs go to: the refuges' ones, or all of a graph without refuges."""
    wanted = [i for i, node in enumerate(graph.nodes) if not graph.refuges or node.name in graph.refuge_at]
    return np.array(wanted, dtype=np.int64)


def start_nodes(graph: TrafficGraph, goals: IntArray, chairs: int, random: np.random.Generator) -> list[int]:
    """Return different nodes to start from.

    Raises:
        TrafficError: there are fewer places than chairs, no second place to go to, or no way between two.
    """
    if chairs < 1:
        raise TrafficError(f"{chairs} chairs are impossible; give 1 or more")
    if len(goals) < 2:
        raise TrafficError(f"{graph.name} has {len(goals)} place to go to; a chair needs two")
    if chairs > len(goals):
        raise TrafficError(f"{graph.name} has places for {len(goals)} chairs, not for {chairs}; give fewer chairs")
    refuse_pieces(graph, [graph.nodes[goal].name for goal in goals])
    return [int(node) for node in random.choice(goals, size=chairs, replace=False)]


def task_streams(graph: TrafficGraph, chairs: int, seed: int) -> list[np.random.Generator]:
    """Return a random stream of tasks for each chair, so that every planner gets the same tasks."""
    return [np.random.default_rng(seed_from_names("fleet tasks", graph.name, seed, chair)) for chair in range(chairs)]


def next_goal(stream: np.random.Generator, goals: IntArray, here: int) -> int:
    """Return a random goal that is not the node where the chair is."""
    goal = here
    while goal == here:
        goal = int(stream.choice(goals))
    return goal


def free_times(graph: IndexedTraffic, speed: float) -> FloatArray:
    """Return the time (N, N) [s] of the shortest way between all nodes with nobody about (Floyd, Warshall)."""
    nodes = len(graph.first) - 1
    times = np.full((nodes, nodes), np.inf)
    np.fill_diagonal(times, 0.0)
    durations = graph.seconds(speed)
    for node in range(nodes):
        for section, _, ahead in graph.leaving[graph.first[node] : graph.first[node + 1]]:
            times[node, ahead] = min(times[node, ahead], durations[section])
    for via in range(nodes):
        times = np.minimum(times, times[:, via, None] + times[None, via, :])
    return times


def mean(values: Sequence[float]) -> float:
    """Return the mean; not a number of none."""
    return float(np.mean(values)) if len(values) else float("nan")


def hours_as_json(result: FleetHours) -> Json:
    """Return a run's figures for a report."""
    return {
        "hours": result.hours,
        "tasks": sum(len(chair) for chair in result.delays),
        "mean_delay_s": result.mean_delay,
        "delay_s_by_chair": [mean(chair) for chair in result.delays],
        "waited_for_people_s": result.waited[:, 0].tolist(),
        "waited_for_chairs_s": result.waited[:, 1].tolist(),
        "people_waited_s_per_hour": result.people_waited,
        "longest_standstill_s": result.longest_standstill,
        "locked_up": result.locked_up,
    }
