"""The global planner: from a costmap, a start and a goal to a path in map, searched on cells and cut into legs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, setting
from waychair.errors import (
    GoalOccupied,
    NoPath,
    PlanningError,
)
from waychair.geometry import evenly_spaced, transform_points
from waychair.maps.grid.cells import cells_from_points, cells_where, inside
from waychair.planning.body.clearance import HARD, NARROW, STRAIGHT_DOOR
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import Costmap, check_free_space
from waychair.planning.grid.grid_graph import Cell
from waychair.planning.grid.refused_gaps import RefusedGap, refused_on, with_dear_gaps
from waychair.planning.grid.smoothing import pull_taut, round_corners
from waychair.planning.harmonic.harmonic_field import HarmonicSettings
from waychair.planning.harmonic.laplace_solvers import HasTime
from waychair.planning.route.grid_planner import GridPlanner, grid_planner, prepared
from waychair.planning.route.keep_right import KeepRightSettings, kept_right
from waychair.planning.route.legs import DoorPassage, PathLeg, joined_legs
from waychair.planning.route.path_ends import goal_cell, start_cell
from waychair.planning.route.rooms import rooms_beside
from waychair.planning.route.tight_doors import tight_doors
from waychair.planning.route.way_making import way_legs
from waychair.planning.seen.forecast import (
    ExpectedPeople,
    ForecastSettings,
    arrival,
    predicted_occupancy,
    with_forecast,
)
from waychair.planning.window.motion_limits import DwaSettings
from waychair.resumable import CELLS_PER_STEP, Resumable, finished, in_time_slices
from waychair.types import FloatArray, IntArray, Path, Pose2


@dataclass(frozen=True, slots=True)
class PlannerSettings(Settings):
    """Which planner searches the cells, and how a path is made of them."""

    planner: str = setting("dstar-lite", "", "planner on the grid: dstar-lite, astar, dijkstra or harmonic")
    harmonic: HarmonicSettings = field(default_factory=HarmonicSettings)
    forecast: ForecastSettings = field(default_factory=ForecastSettings)
    keep_right: KeepRightSettings = field(default_factory=KeepRightSettings)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        grid_planner(self.planner)


SPACING = 0.1
"""[m] Distance of a path's poses."""

START_REACH = 0.3
"""[m] Largest distance of the path's first cell from a start that is too close to a wall."""

ROUNDING = 10
"""Smoothing passes over the corners."""


def plan(
    costmap: Costmap,
    start: Pose2,
    goal: Pose2,
    settings: PlannerSettings = PlannerSettings(),
    check_footprint: bool = True,
) -> Path:
    """Return a path in map from a start to a goal, planned from scratch; raises as `GlobalPlanner.replan`."""
    return GlobalPlanner(goal, settings, check_footprint).replan(costmap, start)


def check_goal(costmap: Costmap, body: ChairBody, goal: Pose2, start: Pose2 | None = None) -> None:
    """Refuse a goal at which the whole chair, turned to the goal's heading, would touch something.

    A place that is proposed instead can be reached from the `start`, if that is given.

    Raises:
        NoFreeSpace, GoalOutsideMap, GoalOccupied.
    """
    check_free_space(costmap)
    goal_cell(costmap, goal, start)
    if not fits(body, HARD, costmap.field, goal):
        raise GoalOccupied(
            f"the chair does not fit at the goal ({goal.x:.2f}, {goal.y:.2f}) with the heading {goal.theta:.2f} rad; "
            "turn the heading or choose a place with more room"
        )


_MOST_REFUSED = 4
"""Lines of one plan that are tried: each may take a search for a multi-point turn."""


_LIMITS = DwaSettings()


class GlobalPlanner:
    """A planner to one goal that keeps its search state, so that replanning only searches where something changed."""

    def __init__(
        self,
        goal: Pose2,
        settings: PlannerSettings = PlannerSettings(),
        check_footprint: bool = True,
        limits: DwaSettings = _LIMITS,
    ) -> None:
        """Without `check_footprint` the path is made for the half width only. `limits` tell how long a way takes."""
        self.goal = goal
        self.settings = settings
        self._limits = limits
        self._check_footprint = check_footprint
        self.cost = 0
        self._side = 1.0  # where the chair passes people: 1.0 on the usual side, -1.0 on the other
        self._costmap: Costmap | None = None
        self._search: GridPlanner | None = None
        self._refused: list[RefusedGap] = []
        self.legs: tuple[PathLeg, ...] = ()
        self.valid_from_anywhere = False

    @property
    def pops(self) -> int:
        """Number of cells taken from the queue since the search began, a measure of the work."""
        return self._search.pops if self._search is not None else 0

    def replan(self, costmap: Costmap, start: Pose2) -> Path:
        """Return a path in map from the start to the goal over the present costmap; `legs` says how to drive it.

        Headings are the body's; the last one is the goal's. At two poses in one place the chair stops and turns to the
        heading of the second. With the geometry of the last costmap, the search only repairs the effect of changed
        cells; another geometry begins a new search.

        Raises:
            NoFreeSpace, StartOutsideMap, StartOccupied, GoalOutsideMap, GoalOccupied, NoPath.
            MapTooLarge, NotConverged: by the harmonic planner.
        """
        return finished(self.replan_resumably(costmap, lambda: start))

    def replan_resumably(
        self, costmap: Costmap, start: Callable[[], Pose2], among_people: bool = False, has_time: HasTime | None = None
    ) -> Resumable[Path]:
        """Do `replan` in bounded parts: the harmonic field, then the line over the cells, its band, and tight turns.

        The field is valid from wherever the chair is by then, so `start` is called anew: while `valid_from_anywhere`
        the chair may keep driving its present plan. `has_time` says whether there is time for more of the field.
        `among_people` no tight turns are planned around people's present places: the dynamic window finds the way along
        the line for the half width, except through doors that leave it no choice.
        """
        try:
            self.valid_from_anywhere = True
            self.legs = yield from self._legs_over(costmap, start, among_people, has_time)
        finally:
            self.valid_from_anywhere = False
        return joined_legs(self.legs)

    def _legs_over(
        self, costmap: Costmap, start: Callable[[], Pose2], among_people: bool, has_time: HasTime | None
    ) -> Resumable[tuple[PathLeg, ...]]:
        """Return the legs along the cheapest line on which the whole chair fits; a gap that refuses it is dear at once."""
        for _ in range(_MOST_REFUSED):
            self._refused = [gap for gap in self._refused if gap.is_as_narrow(costmap)]
            priced = with_dear_gaps(costmap, self._refused)
            yield from prepared(self._search_over(priced, start()), has_time)
            here = start()
            line = line_over(priced, self._cells(priced, here), here, self.goal)
            doors = self._doors(costmap, line) if self._check_footprint else []
            if not self._check_footprint or (among_people and not doors):
                return (self._plain_leg(costmap, line),)
            if not among_people and any(gap.is_on(line) for gap in self._refused):
                break  # every way leads through one
            searches = None if among_people else self._stand_still
            try:
                work = way_legs(costmap, line, here, self.goal, doors, self._limits, searches)
                return tuple((yield from in_time_slices(work, CELLS_PER_STEP)))
            except NoPath as error:
                if among_people:
                    return (self._plain_leg(costmap, line),)
                gap = refused_on(line, here, error, costmap)
                if gap is None:
                    raise
                self._refused.append(gap)
        first, self._refused = self._refused[0], []
        raise first.error

    def _plain_leg(self, costmap: Costmap, line: FloatArray) -> PathLeg:
        """Return the line (N, 2) [m] with its corners rounded for the half width alone."""
        cells = transform_points(costmap.grid.map_from_grid.inverse(), line) / costmap.grid.resolution
        rounded = round_corners(costmap.prices, cells, ROUNDING, costmap.barred)
        points = transform_points(costmap.grid.map_from_grid, rounded * costmap.grid.resolution)
        return PathLeg(Path(np.column_stack([points, _headings(points, self.goal.theta)])))

    def _doors(self, costmap: Costmap, line: FloatArray) -> list[DoorPassage]:
        """Return the doors on a line (N, 2) [m] that the chair passes straight."""
        cells = transform_points(costmap.grid.map_from_grid.inverse(), line) / costmap.grid.resolution
        return [door for _, _, door in tight_doors(costmap, cells, NARROW, costmap.body.width + STRAIGHT_DOOR)]

    def is_free(self, points: FloatArray) -> bool:
        """Return whether all points (N, 2) [m] in map are passable on the last costmap."""
        if self._costmap is None:
            return False
        cells = cells_from_points(self._costmap.grid, points)
        return bool(inside(self._costmap.grid, cells).all() and self._costmap.prices[tuple(cells.T)].all())

    def _cells(self, costmap: Costmap, here: Pose2) -> IntArray:
        """Return the path (N, 2) over the cells; raises `NoPath`."""
        search = self._search_over(costmap, here)
        try:
            self.cost = search.replan()
        except NoPath as error:
            raise NoPath(
                f"no path wide enough for the chair leads from ({here.x:.2f}, {here.y:.2f}) to "
                f"({self.goal.x:.2f}, {self.goal.y:.2f}); clear the way or choose another goal"
            ) from error
        return search.path()

    def replan_among_people(
        self,
        costmap: Costmap,
        start: Callable[[], Pose2],
        people: ExpectedPeople,
        cruise: float,
        has_time: HasTime | None = None,
    ) -> Resumable[Path]:
        """Do `replan_resumably` among moving people, predicted rather than walls.

        The direct path keeps to one side, or to the other if it would meet somebody there at `cruise` [m/s] (`kept_right`),
        and stays there while people are about. If it meets somebody on both, a path around the people, over the costmap
        with their prediction, is taken where it is faster than waiting and the direct path.
        """
        direct = yield from self.replan_resumably(costmap, start, bool(people.tracks), has_time)
        if not people.tracks:
            self._side = 1.0
            return direct
        forecast, plain = self.settings.forecast, self.legs
        direct_s, wait_s = math.inf, math.inf
        self.valid_from_anywhere = True  # until the next search is done
        for side in (self._side, -self._side):
            yield
            legs = yield from self._kept_to_one_side(plain, costmap, side)
            path = joined_legs(legs)
            seconds, wait = arrival(people, path.poses[:, :2], cruise, forecast)
            if seconds < direct_s:
                direct, self.legs, self._side, direct_s, wait_s = path, legs, side, seconds, wait
            if wait_s == 0.0:
                return direct
        legs = self.legs
        yield
        expected = with_forecast(costmap, predicted_occupancy(people, costmap.grid, forecast))
        with suppress(PlanningError):  # then no path leads around them
            around = yield from self.replan_resumably(expected, start, True, has_time)
            if arrival(people, around.poses[:, :2], cruise, forecast)[0] < direct_s:
                return around
        self.legs = legs
        return direct

    def _stand_still(self) -> None:
        """Let the chair stand before a search for a multi-point turn, which begins where the chair is."""
        self.valid_from_anywhere = False

    def _kept_to_one_side(
        self, legs: Sequence[PathLeg], costmap: Costmap, side: float
    ) -> Resumable[tuple[PathLeg, ...]]:
        """Return the legs moved to the usual side (1.0) or the other (-1.0), where there is room."""
        aside = self.settings.keep_right.aside * side
        moved = []
        for leg in legs:
            path = leg.path if leg.backwards else kept_right(leg.path, costmap, aside)
            if path is not leg.path and leg.is_line:
                rooms = yield from in_time_slices(rooms_beside(costmap, path.poses), CELLS_PER_STEP)
                leg = replace(leg, rooms=rooms)
            moved.append(replace(leg, path=path))
        return tuple(moved)

    def _search_over(self, costmap: Costmap, start: Pose2) -> GridPlanner:
        """Return the search over a costmap from the start."""
        check_free_space(costmap)
        begin = start_cell(costmap, start, START_REACH)
        return self._updated_search(costmap, begin, goal_cell(costmap, self.goal, start))

    def _updated_search(self, costmap: Costmap, start: Cell, goal: Cell) -> GridPlanner:
        """Return the search over these prices; a new one only if the grid's geometry changed."""
        before, self._costmap = self._costmap, costmap
        if self._search is None or before is None or not _same_geometry(before, costmap):
            make = grid_planner(self.settings.planner, self.settings.harmonic)
            self._search = make(costmap.prices, goal, start, costmap.barred)
            return self._search
        self._search.move_start(start)
        if before is costmap:
            return self._search
        changed = cells_where(costmap.prices != before.prices)
        if len(changed):
            self._search.update(changed, costmap.prices[changed[:, 0], changed[:, 1]])
        return self._search


def _same_geometry(first: Costmap, second: Costmap) -> bool:
    return (
        first.prices.shape == second.prices.shape
        and first.grid.resolution == second.grid.resolution
        and first.grid.map_from_grid == second.grid.map_from_grid
    )


def line_over(costmap: Costmap, cells: IntArray, start: Pose2, goal: Pose2) -> FloatArray:
    """Return the taut line (N, 2) [m] in map over a path's cells, with the exact ends."""
    chain = cells[:, ::-1].astype(np.float64) + 0.5
    points = chain[pull_taut(costmap.prices, chain, costmap.barred)]
    line = transform_points(costmap.grid.map_from_grid, points * costmap.grid.resolution)
    ends = np.array([[start.x, start.y]]), np.array([[goal.x, goal.y]])
    return evenly_spaced(np.concatenate([ends[0], line[1:-1], ends[1]]), SPACING)


def _headings(points: FloatArray, last: float) -> FloatArray:
    """Return the direction from each point to the next, and the last heading."""
    ahead = np.diff(points, axis=0)
    return np.append(np.arctan2(ahead[:, 1], ahead[:, 0]), last)
