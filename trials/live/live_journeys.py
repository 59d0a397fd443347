"""The journeys of a live chair over the storeys of a simulated building: its maps, its graph, its goals, and its lifts.

The chair's own thread calls `step`, `begin` and what changes a journey; goals and legs are computed in the callers' threads
and by a worker, so that no tick waits for them.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.journey.building_legs import stops_without_map
from waychair.control.journey.door_view import SHUT_IN
from waychair.control.journey.journey import JourneyPhase, Leg
from waychair.control.safety.stops import Halt
from waychair.errors import BuildingError, WaychairError
from waychair.maps.building.building import Building, load_building
from waychair.maps.building.zone_rules import with_zones
from waychair.planning.building.guided_ways import GuidedWays
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.planning.building.movements import lift_title
from waychair.planning.building.pose_ends import nearest_node
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.drive_times import DriveTimes
from waychair.runtime.journeys import PRESS_AGAIN_S, StoreyMap, Traveller, TravelState
from waychair.runtime.pages.building_goals import goal_views, legs_to
from waychair.runtime.pages.chair_port import ChairView, GoalView, PortAnswer
from waychair.runtime.pages.drawing_port import NOT_ASKED
from waychair.runtime.pages.guiding import Guide, guided_chair, guided_view
from waychair.runtime.rider.habits import Habits
from waychair.runtime.rider.sentences import sentence
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import World
from waychair.trials.live.live_map import LiveMap
from waychair.trials.live.live_tags import LiveTags
from waychair.trials.travel.journeys import ToldRider, sites_of
from waychair.types import Place, Pose2

MOVED_M = 1.0
"""m; the goals' times are computed anew once the chair is so far from where they were computed last."""


@dataclass(frozen=True, slots=True)
class LiveBuilding:
    """A building to travel in: its folder's graph and maps, its levels from bottom to top, and people who ride its lifts."""

    building: Building
    levels: tuple[World, ...]
    passengers: int = 0

    def lifts(self, seed: int) -> Lifts:
        """Return its lifts, which move."""
        heights = {storey.id: storey.height for storey in self.building.hgraph.storeys}
        return Lifts(self.levels, seed, self.passengers, heights=heights)

    def maps(self) -> dict[str, LiveMap]:
        """Return the maps of its levels.

        Raises:
            WaychairError: a map cannot be read.
        """
        folders = {world.level: self.building.map_folder(world.level) for world in self.levels}
        return {level: LiveMap(folder) for level, folder in folders.items() if folder is not None}


@dataclass(slots=True)
class _Asked:
    """The goal's name of the journey under way, or of the one that waits for the rider's yes; the legs of the one that waits;
    why the last one failed.
    """

    label: str = ""
    legs: tuple[Leg, ...] = ()
    over: str = ""


class LiveJourneys:
    """A `Traveller` with the building's goals; a `Stepper` of the chair's loop."""

    def __init__(
        self,
        site: LiveBuilding,
        maps: dict[str, LiveMap],
        chair: Chair,
        lifts: Lifts,
        storey: str,
        start: Pose2,
        worker: ThreadPoolExecutor,
        habits: Habits | None = None,
    ) -> None:
        """`storey` and `start`: the chair's map now, and its pose there. `habits`: the rider's record.

        Raises:
            BuildingError: the graph cannot be compiled.
        """
        self._building, self._worker = site.building, worker
        self.maps = maps
        self._asked = _Asked()
        self._sites = sites_of(lifts, CHAIR_A)
        self._planner = RoutePlanner(with_zones(site.building))
        self._lock = threading.Lock()  # of the planner and the costmaps
        self._costmaps: dict[str, tuple[tuple[int, int], Costmap]] = {}
        self._goals: tuple[str, Pose2, tuple[GoalView, ...]] = storey, start, ()
        self._time_goals(storey, start)  # its kernels are loaded before the first tick
        self._state: TravelState | None = None
        heights = {each.id: each.height for each in site.building.hgraph.storeys}
        storeys = [_storey_map(level, known, heights[level]) for level, known in maps.items()]
        buttons = ToldRider(lifts)
        unmapped = stops_without_map(site.building.hgraph, self._sites, maps)
        self.traveller = Traveller(chair, CHAIR_A, storeys, self._sites, buttons, storey, worker, unmapped)
        self.tags = LiveTags(self._planner.hgraph, chair, self.traveller, worker)
        """The tags that the camera sees."""
        self._times = DriveTimes(
            site.building.folder, lambda: habits is not None and habits.wanted, worker, self._take_times
        )
        self._guide = Guide(lambda: chair.odom_from_base, habits, worker)
        self._pressed = Pressed(buttons)

    @property
    def under_way(self) -> bool:
        """See `Stepper`."""
        return self.traveller.under_way

    @property
    def map(self) -> LiveMap:
        """The map in use."""
        return self.maps[self.traveller.storey]

    def step(self, now_ns: int, messages: Iterable[ChairMessage], other_halts: Iterable[Halt] = ()) -> ChairState:
        """See `Stepper`."""
        before = self.map
        self._state = state = self.traveller.step(now_ns, messages, other_halts)
        if self.map is not before:  # a page asks for what has changed
            self.map.revision = before.revision + 1
            self.map.layout_revision = before.layout_revision + 1
        self.tags.step(state.chair)
        self._times.step(state.chair, self.traveller.storey)
        self._guide.step(guided_chair(state.chair), self.traveller.storey)
        if not self.under_way:
            self._pressed.press(self._guide.buttons, now_ns)
        journey = state.journey
        if journey is not None and journey.ended:
            self._asked.over = sentence(journey.why) if journey.phase is JourneyPhase.FAILED else ""
            self.traveller.drop()
        return state.chair

    def legs(self, goal: str, storey: str, pose: Pose2) -> tuple[Leg, ...]:
        """Return the legs from a pose on a storey's map to a goal of the building; any thread.

        Raises:
            BuildingError: there is no such goal, it is no place of its map, or a lift on the way has no cabin.
            NoPath, PlanningError: there is no way, or the chair does not stand on free ground.
        """
        _, place = self.place(goal)
        with self._lock:
            start, _ = nearest_node(self._planner.hgraph, storey, pose, self._costmap(storey))
            return legs_to(self._planner, self._sites, CHAIR_A, start, self._planner.node(goal), place)

    def place(self, goal: str) -> tuple[str, Place]:
        """Return the storey and the place of a goal of the building; any thread.

        Raises:
            BuildingError: there is no such goal, or it is no place of its map.
        """
        with self._lock:
            ref = self._planner.node(goal)
            hgraph = self._planner.hgraph
            node, there = hgraph.node(ref), hgraph.storey_of(ref.submap)
            place = None if node is None or there not in self.maps else self.maps[there].drawing.places.get(node.name)
            if place is None:
                raise BuildingError(f"'{goal}' is no place of its storey's map: set the place, or choose another goal")
            return there, place

    def start_at(self, storey: str, pose: Pose2, *, drives: bool) -> PortAnswer:
        """Take the rider's word for where the chair stands, unless it drives, or a journey is under way."""
        if drives or self.traveller.journey is not None:
            return PortAnswer(False, "the chair is on its way: cancel the drive first, then say where it is")
        if self.traveller.shut_in:
            return PortAnswer(False, SHUT_IN)
        title = self._title(storey)
        if not self.traveller.start_at(storey, pose):
            return PortAnswer(False, f"the map of {title} is being made ready: say it again in a moment")
        return PortAnswer(True, f"the chair localises itself there, on {title}")

    def guided_ways(self) -> GuidedWays:
        """Return the ways to guide over, of the maps as they are drawn now; any thread.

        Raises:
            BuildingError: the graph cannot be compiled.
        """
        grids = {level: known.grid for level, known in self.maps.items()}
        return GuidedWays(with_zones(self._building), grids)

    def guide(self, goal: str, level: int, now_ns: int, ways: GuidedWays) -> PortAnswer:
        """Begin step guidance to a goal over a building's ways; the rider drives.

        Raises:
            BuildingError: there is no such goal.
        """
        self._guide.go(goal, level, now_ns, ways)
        return PortAnswer(True, f"guides you to {goal}: you drive")

    def end_guide(self, now_ns: int) -> PortAnswer:
        """End step guidance."""
        was_on = self._guide.view is not None
        self._guide.end(now_ns)
        return PortAnswer(was_on, "guidance has ended" if was_on else "there is no guidance to end")

    def answer(self, storey: str, asked: Sequence[str], now_ns: int) -> PortAnswer:
        """Take the rider's word for the storey, of those that were asked for."""
        title = self._title(storey)
        if storey not in asked:
            return PortAnswer(False, NOT_ASKED)
        if self.traveller.shut_in:
            return PortAnswer(False, SHUT_IN)
        if self.traveller.journey is not None:
            self.traveller.answer(storey, now_ns)
        else:
            pose, traveller = self._guide.pose_at(storey), self.traveller
            if not (traveller.take_storey(storey, None) if pose is None else traveller.start_at(storey, pose)):
                return PortAnswer(False, f"the map of {title} is being made ready: answer again in a moment")
        return PortAnswer(True, f"this is {title}")

    def ask(self, label: str, legs: Sequence[Leg]) -> None:
        """Note the legs of the journey that waits for the rider's yes, () for a drive on this storey; prepare its maps."""
        self._asked = _Asked(label, tuple(legs))
        self.traveller.drop()
        for storey in {leg.storey for leg in legs} - {self.traveller.storey}:
            self.traveller.prepare(storey)

    def begin(self, now_ns: int) -> bool:
        """Begin the journey that waits, by the rider's yes; return whether there is one."""
        legs, self._asked.legs = self._asked.legs, ()
        if legs:
            self.traveller.go(legs, now_ns)
        return bool(legs)

    def goals(self, pose: Pose2 | None) -> tuple[GoalView, ...]:
        """Return the goals with the latest times; a worker computes them anew for a chair that has moved."""
        storey, before, views = self._goals
        if pose is not None and (
            storey != self.traveller.storey or math.dist((before.x, before.y), (pose.x, pose.y)) > MOVED_M
        ):
            self._goals = self.traveller.storey, pose, views
            self._worker.submit(self._time_goals, self.traveller.storey, pose)
        return views

    def redrawn(self, known: LiveMap) -> None:
        """Take what was drawn on a map, for the next time that the chair comes to its storey."""
        level = next(level for level, each in self.maps.items() if each is known)
        height = next(each.height for each in self._building.hgraph.storeys if each.id == level)
        self.traveller.replace_map(_storey_map(level, known, height))

    def shown(self, view: ChairView) -> ChairView:
        """Return the chair's view with its storey and the journey's state."""
        storey = self.traveller.storey
        view = guided_view(replace(view, storey=self._title(storey)), self._guide.view)
        if self._guide.at_stops and self.traveller.journey is None:
            view = replace(view, asks=self._guide.at_stops)
        state, journey = self._state, self.traveller.journey
        if state is None or journey is None:
            return replace(view, last_stop=self._asked.over) if self._asked.over else view
        drives = state.order.goal is not None and journey.phase is not JourneyPhase.HELD and not view.waits
        return replace(
            view,
            goal=self._asked.label,
            waits=False,
            paused=view.paused or journey.phase is JourneyPhase.HELD,
            next_action=view.next_action if drives else sentence(state.order.sentence),
            last_stop="" if self.under_way else view.last_stop,
            asks=state.order.ask,
        )

    def leg_label(self) -> str:
        """Return the goal of the drive under way for people: a lift, or the journey's goal."""
        journey = self.traveller.journey
        lift = "" if journey is None else journey.here.lift
        return lift_title(self._building.hgraph.lifts[lift]) if lift else self._asked.label

    def _take_times(self) -> None:
        """Plan by the times that were learnt, from the next goal on; in the worker."""
        building = load_building(self._building.folder)
        planner = RoutePlanner(with_zones(building))
        with self._lock:
            self._building, self._planner = building, planner

    def _title(self, storey: str) -> str:
        return next((each.name or each.id for each in self._building.hgraph.storeys if each.id == storey), storey)

    def _time_goals(self, storey: str, pose: Pose2) -> None:
        try:
            with self._lock:
                start, aside = nearest_node(self._planner.hgraph, storey, pose, self._costmap(storey))
                views = goal_views(self._planner, start, aside)
        except WaychairError:  # the chair stands where nothing is known: the times are unknown
            views = goal_views(self._planner)
        self._goals = storey, pose, views

    def _costmap(self, storey: str) -> Costmap:
        known = self.maps[storey]
        key, made = known.revisions, self._costmaps.get(storey)
        if made is None or made[0] != key:
            made = self._costmaps[storey] = key, costmap_from_grid(known.grid, CHAIR_A, zones=known.drawing.zones)
        return made[1]


class Pressed:
    """The lifts' buttons as somebody presses them who is told to: again after some time."""

    def __init__(self, buttons: ToldRider) -> None:
        self._buttons = buttons
        self._last: tuple[tuple[str, str] | None, int] = None, 0

    def press(self, wanted: tuple[str, str] | None, now_ns: int) -> None:
        """Press a lift's button for a storey, or none."""
        before, at = self._last
        if wanted is None:
            self._last = None, 0
        elif wanted != before or now_ns - at > PRESS_AGAIN_S * 1e9:
            self._buttons.call(*wanted)
            self._last = wanted, now_ns


def _storey_map(level: str, known: LiveMap, height: float) -> StoreyMap:
    drawn = known.drawing
    return StoreyMap(level, known.grid, drawn.places, height, drawn.zones, known.scanned())
