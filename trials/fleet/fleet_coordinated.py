"""Hours of several chairs among people in the paper's model, by the coordinator: all are planned together, as often as it helps.

The coordinator plans anew when a chair has a new task, and while a chair at a node waits for another one, which people may have
held up. Where all chairs are equal and the corridors have no ring, plans change nothing but the order at sections. There the
first to come goes first, as at the paper's nodes: of two chairs that meet, neither could go before the other with less delay
in all, and the plans' foresight among people was 1 % worse (60 seeds of an hour on T, I and 2bconR).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from waychair.errors import TrafficError
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.section_plans import SectionOrder, SectionPlanner, SectionUse, Trip
from waychair.simulation.graph_traffic.crowd import Crowd, CrowdModel, RightOfWay
from waychair.simulation.scene.seeds import seed_from_names
from waychair.trials.fleet.fleet_graph import FleetHours, free_times, goal_nodes, next_goal, start_nodes, task_streams

NO_SECTION = -1
"""A permit for none."""

HELD_UP_S = 15.0
"""s; a chair before a section in which somebody comes towards it is taken to stand for so long: people walk 8 m in 13 s."""

_TOP = 4.0
"""Weight of the lateness of a chair of top priority beside that of a routine chair."""

_STANDS_S = 0.25
"""s; a chair that may go on and has not moved for so long is held up by people."""

_AGAIN_S = 0.25
"""s between two plans for chairs that wait for others."""


class _Task(NamedTuple):
    """A chair's goal, the times [s] when it began and that it takes alone, and how long it had stood for people by then."""

    goal: int
    began_s: float
    ideal_s: float
    stood_s: float


def coordinated_hours(
    graph: TrafficGraph,
    *,
    chairs: int,
    people: int,
    rule: RightOfWay,
    hours: float,
    seed: int,
    model: CrowdModel | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> FleetHours:
    """Return what some chairs do for some hours by the coordinator, with the starts and people of `fleet_hours`.

    By the flexible rule, chair 0 has top priority. `progress` is called with the share (0 to 1) of the hours that has passed.

    Raises:
        TrafficError: there are more chairs than places to be, or another number is impossible.
    """
    model = model or CrowdModel()
    random = np.random.default_rng(seed_from_names("fleet", graph.name, seed))
    goals = goal_nodes(graph)
    starts = start_nodes(graph, goals, chairs, random)
    tasks = task_streams(graph, chairs, seed)
    top = (0,) if rule is RightOfWay.FLEXIBLE else ()
    keeps_order = len(graph.sections) >= len(graph.nodes) or bool(top)  # of a ring, in a graph of one part
    crowd = Crowd(
        graph,
        starts,
        people,
        rule,
        seed,
        top=top,
        permits=keeps_order,
        tells_entries=True,
        tells_last_entry=True,
        model=model,
    )
    run = _Run(graph, crowd, model.chair_speed, top, FleetHours.of(chairs, hours), keeps_order)
    end_s = hours * 3600.0
    while crowd.now < end_s - 1e-6:
        for chair, when in crowd.arrived():
            run.begin(chair, when, next_goal(tasks[chair], goals, crowd.node_of(chair)))
        crowd.entered()
        run.direct()
        crowd.run(end_s)
        progress(min(1.0, crowd.now / end_s))
    return run.result.ended(crowd)


class _Run:
    """The chairs of one run: their tasks, the plan and its order."""

    def __init__(
        self,
        graph: TrafficGraph,
        crowd: Crowd,
        speed: float,
        top: tuple[int, ...],
        result: FleetHours,
        keeps_order: bool,
    ) -> None:
        """Without `keeps_order` the nodes admit whoever comes first."""
        self.result = result
        self._crowd = crowd
        self._speed = speed
        self._free_s = free_times(crowd.indexed, speed)
        self._planner = SectionPlanner(crowd.indexed, speed, self._free_s)
        self._order = SectionOrder(crowd.indexed)
        self._top = top
        self._keeps_order = keeps_order
        self._tasks: dict[int, _Task] = {}
        self._begun: dict[int, int] = {}
        self._plan_after_s = 0.0
        self._at_goal: set[int] = set()

    def begin(self, chair: int, when_s: float, goal: int) -> None:
        """Let a chair that has arrived begin its next task."""
        now_s, stood_s = self._crowd.now, float(self._crowd.waited[chair, 0])
        if chair in self._tasks:
            old = self._tasks[chair]
            self.result.done(chair, when_s - old.began_s, old.ideal_s, stood_s - old.stood_s, self._speed)
        ideal_s = float(self._free_s[self._crowd.node_of(chair), goal])
        self._tasks[chair] = _Task(goal, now_s, ideal_s, stood_s)
        self._at_goal.add(chair)

    def direct(self) -> None:
        """Plan anew where that is due, and let the chairs enter their next sections in the order of the plan."""
        if self._at_goal:
            self._plan()
        if not self._keeps_order:
            return
        is_blocked = self._admit()
        if is_blocked and self._crowd.now >= self._plan_after_s:
            self._plan()
            self._admit()

    def _admit(self) -> bool:
        """Permit all that may go on; return whether one at a node must wait for another."""
        is_blocked = False
        asking = set(self._crowd.asking())
        for chair in self._tasks:
            begun, _ = self._crowd.progress(chair)
            while self._begun[chair] < begun:
                self._order.left(chair)
                self._begun[chair] += 1
            section = self._order.following(chair)
            if section is None:
                continue
            if self._order.before(chair, section) is None:
                self._crowd.permit(chair, section)
            else:
                is_blocked |= chair in asking
        return is_blocked

    def _held_up_s(self, chair: int) -> float:
        """Return how long [s] people have held up a chair at a node that may go on; 0 if they do not."""
        crowd, section = self._crowd, self._order.following(chair)
        if chair in self._at_goal or crowd.section_of(chair) >= 0 or section is None:
            return 0.0
        return 0.0 if self._order.before(chair, section) is not None else crowd.standing_s(chair)

    def _plan(self) -> None:
        """Plan all chairs anew from where they are."""
        crowd = self._crowd
        now_ms = round(1e3 * crowd.now)
        trips: list[Trip] = []
        busy: list[SectionUse] = []
        for chair, task in self._tasks.items():
            section = crowd.section_of(chair)
            stood_s = self._held_up_s(chair)
            ready_ms = now_ms + round(1e3 * max(stood_s, HELD_UP_S)) if stood_s >= _STANDS_S else now_ms
            if section >= 0:
                _, left_s = crowd.progress(chair)
                ready_ms = now_ms + max(round(1e3 * left_s), 0)
                busy.append(SectionUse(section, crowd.direction_of(chair), now_ms, ready_ms))
            trips.append(Trip(crowd.next_node(chair), task.goal, ready_ms, _TOP if chair in self._top else 1.0))
        found = self._planner.plans(trips, busy)
        if found is None:
            raise TrafficError("a chair has a goal to which no way leads; join the parts of the graph")
        drives = dict(zip(self._tasks, found.drives, strict=True))
        self._order.set(drives)
        for chair, drive in drives.items():
            sections = [use.section for use in drive]
            if chair in self._at_goal:
                crowd.give(chair, sections)
            else:
                crowd.turn_off(chair, sections)
            if self._keeps_order:
                crowd.permit(chair, NO_SECTION)
            self._begun[chair] = crowd.progress(chair)[0]
        self._at_goal.clear()
        self._plan_after_s = crowd.now + _AGAIN_S
