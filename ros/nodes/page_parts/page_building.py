"""The part of a page's port for buildings of several storeys: goals with their times, and journeys of the navigator's node.

The navigator's node travels (see `Journeys`); the page asks by the topic `storey_goal` and shows what `journey` tells.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from waychair.calibration.chair_body import ChairBody
from waychair.control.guidance.practice import BEFORE
from waychair.errors import BuildingError, WaychairError
from waychair.maps.building.zone_rules import with_zones
from waychair.maps.drawn.zones import load_zones
from waychair.maps.folders.map_files import load_map
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.planning.building.pose_ends import nearest_node
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.floor import (
    Floor,
    JourneyReport,
    StoreyGoal,
    read_journey_state,
    read_storey_goal,
    storey_goal,
)
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.page_parts.page_guide import PageGuide
from waychair.ros.nodes.parts.journey_plan import known_building
from waychair.ros.nodes.worker import Worker
from waychair.runtime.pages.building_goals import goal_views
from waychair.runtime.pages.chair_port import ANSWER_S, ChairView, GoalView, PortAnswer
from waychair.runtime.pages.guiding import guided_view
from waychair.runtime.rider.sentences import sentence
from waychair.types import Pose2

MOVED_M = 1.0
"""m; the goals' times are computed anew once the chair is so far from where they were computed last."""

OVER = ("", "arrived", "failed", "refused")
"""Phases of `journey` without a journey."""

DRIVING = ("drive", "enter", "leave")
"""Phases in which the chair drives, so that its next action is that of the drive."""


@dataclass(frozen=True, slots=True)
class _Known:
    """The building of the map in use: its planner, the storey, the storey's name for people, and the chair's costmap there."""

    planner: RoutePlanner
    storey: str
    title: str
    costmap: Costmap


@dataclass(slots=True)
class _Building:
    """The folder of the map in use, what the page knows of its building, and the journey as the navigator told it last.

    `timed`: storey and pose for which the goals' times were computed.
    """

    node: ChairNode[Any]
    body: ChairBody
    worker: Worker
    folder: Path | None = None
    known: _Known | None = None
    goals: tuple[GoalView, ...] = ()
    timed: tuple[str, Pose2] | None = None
    report: JourneyReport = field(default_factory=lambda: JourneyReport(0))


class PageBuilding:
    """Goals of the building of the map in use, and journeys to them; nothing for a map of no building."""

    _site: _Building
    _guide: PageGuide

    def _listen_to_building(self, node: ChairNode[Any], body: ChairBody) -> None:
        self._site = _Building(node, body, Worker(node))
        node.at_end(self._site.worker.close)
        self._ask_for = node.publisher(topics.STOREY_GOAL)
        self._say = node.create_client(interface_type("waychair_msgs/srv/SayStorey"), "say_storey")
        node.listen(topics.JOURNEY, read_journey_state, self._take_journey, needed=False)
        self._guide = PageGuide(node, self._drive_view)
        node.listen(topics.GUIDE_TO, read_storey_goal, self._take_guide_to, needed=False)

    def _take_journey(self, report: JourneyReport) -> None:
        self._site.report = report

    def _enter_storey(self, told: Floor) -> None:
        """Load the building of a map that is in use from now on, in the worker."""
        site, folder = self._site, Path(told.map_folder)
        if not told.map_folder or folder == site.folder:
            return
        site.folder = folder

        def load() -> tuple[_Known, tuple[GoalView, ...]] | None:
            try:
                building, storey = known_building(folder)
                hgraph = with_zones(building)
                title = next((each.name or each.id for each in hgraph.storeys if each.id == storey), storey)
                costmap = costmap_from_grid(load_map(folder), site.body, zones=load_zones(folder))
                known = _Known(RoutePlanner(hgraph), storey, title, costmap)
                return known, goal_views(known.planner)
            except WaychairError:
                return None  # a map of no building, or a damaged one, of which the navigator tells

        site.worker.submit(load, self._take_building)

    def _take_building(self, found: tuple[_Known, tuple[GoalView, ...]] | None) -> None:
        known, self._site.goals = found or (None, ())
        self._site.known, self._site.timed = known, None
        self._guide.enter("" if known is None else known.storey)

    def goals(self) -> Sequence[GoalView]:
        """See `ChairPort`; times of a chair that has moved are computed anew, and shown the next time."""
        return self._site.goals

    def _time_goals(self, pose: Pose2 | None) -> None:
        """Compute the goals' times from a pose, in the worker, if the chair has moved; in the executor's thread."""
        site, known = self._site, self._site.known
        if known is None or pose is None:
            return
        before = site.timed
        if before is not None and math.dist((before[1].x, before[1].y), (pose.x, pose.y)) <= MOVED_M:
            return
        site.timed = known.storey, pose

        def timed() -> tuple[GoalView, ...]:
            try:
                start, aside = nearest_node(known.planner.hgraph, known.storey, pose, known.costmap)
                return goal_views(known.planner, start, aside)
            except WaychairError:  # the chair stands where nothing is known
                return goal_views(known.planner)

        def take(views: tuple[GoalView, ...]) -> None:
            if site.known is known:
                site.goals = views

        site.worker.submit(timed, take)

    def _is_goal(self, name: str) -> bool:
        """Return whether a name is that of a goal of the building."""
        known = self._site.known
        try:
            return known is not None and known.planner.node(name) is not None
        except BuildingError:
            return False

    def _travel(self, goal: str) -> PortAnswer:
        """Ask the navigator for a journey, and wait for its plan."""
        site, before = self._site, self._site.report
        self._ask_for(storey_goal(StoreyGoal(goal)))
        until = time.monotonic() + 0.8 * ANSWER_S
        while time.monotonic() < until:
            told = site.report
            if told is not before:
                return PortAnswer(told.phase != "refused", told.sentence)
            time.sleep(0.01)
        if before.phase == "refused":  # for the same reason, which is not told twice
            return PortAnswer(False, before.sentence)
        return PortAnswer(True, f"the way to {goal} is being planned: press Drive once its name is shown")

    def _with_journey(self, view: ChairView) -> ChairView:
        """Return a view with the storey, the journey's state, and guidance."""
        guide, stops = self._guide.shown
        if guide is None:
            return self._with_state(view)
        shown = guided_view(self._with_state(view), guide)
        return replace(shown, asks=stops) if stops and self._site.report.phase in OVER else shown

    def _with_state(self, view: ChairView) -> ChairView:
        known, told = self._site.known, self._site.report
        if known is not None:
            view = replace(view, storey=known.title)
        if told.phase in OVER:
            failed = told.phase == "failed" and not view.goal
            return replace(view, last_stop=sentence(told.sentence)) if failed else view
        if told.phase == "asked":
            return replace(view, goal=told.goal) if view.goal else view
        drives = told.phase in DRIVING and bool(view.goal)
        return replace(
            view,
            goal=told.goal,
            waits=False,
            countdown_s=view.countdown_s if drives else None,
            paused=view.paused or told.phase == "held",
            next_action=view.next_action if drives else sentence(told.sentence),
            last_stop=view.last_stop if told.phase == "held" else "",
            asks=told.asks,
        )

    def guide(self, goal: str, level: int) -> PortAnswer:
        """See `ChairPort`."""
        folder = None if self._site.known is None else self._site.folder
        return self._guide.go(folder, goal, level)

    def end_guide(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._guide.end()

    def _take_guide_to(self, asked: StoreyGoal) -> None:
        """Begin guidance by the topic, in the worker; a refusal is logged."""

        def refused(answer: PortAnswer) -> None:
            if not answer.done:
                self._site.node.get_logger().error(f"no guidance to '{asked.goal}': {answer.sentence}")

        goal = f"{asked.storey}/{asked.goal}" if asked.storey else asked.goal
        self._site.worker.submit(lambda: self.guide(goal, BEFORE), refused)

    def _drive_view(self) -> ChairView:
        """Return the chair as the page shows it, without guidance; the port does."""
        raise NotImplementedError

    def answer_storey(self, storey: str) -> PortAnswer:
        """See `ChairPort`."""
        return self._call(self._say, interface_type("waychair_msgs/srv/SayStorey").Request(storey=storey))

    def _start_in_building(self, goal: str, *, here: bool) -> PortAnswer | None:
        """Tell the nodes that the chair stands at a goal of the building, or `here` at a place of the map; None without one."""
        known = self._site.known
        if known is None:
            return None
        storey = known.storey if here else ""
        return self._call(self._say, interface_type("waychair_msgs/srv/SayStorey").Request(storey=storey, place=goal))

    def _call(self, client: Any, request: Any) -> PortAnswer:
        """Call a service of the nodes; the port does."""
        raise NotImplementedError
