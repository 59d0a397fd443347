"""The global planner: from a costmap, a start and a goal to a path in map, searched on cells and cut into legs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, setting
from waychair.errors import (
    ConfigError,
    GoalOccupied,
    NoPath,
    PlanningError,
)
from waychair.geometry import arc_lengths, transform_points
from waychair.maps.grid.cells import cells_from_points, cells_where, inside
from waychair.planning.body.clearance import HARD, NARROW, TIGHT_DOOR
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import Costmap, check_free_space
from waychair.planning.grid.grid_graph import Cell
from waychair.planning.grid.resumable import CELLS_PER_STEP, Resumable, finished, in_time_slices
from waychair.planning.grid.smoothing import line_cost, pull_taut, round_corners
from waychair.planning.harmonic.harmonic_field import HarmonicSettings
from waychair.planning.harmonic.laplace_solvers import HasTime
from waychair.planning.harmonic.rubber_band import band
from waychair.planning.route.direct_leg import direct_leg
from waychair.planning.route.door_alignment import legs_between_turns, line_up, tight_doors
from waychair.planning.route.grid_planner import HARMONIC, GridPlanner, grid_planner, prepared
from waychair.planning.route.keep_right import KeepRightSettings, kept_right
from waychair.planning.route.leg_planning import door_leg
from waychair.planning.route.legs import DoorPassage, DrivingManner, PathLeg, joined_legs
from waychair.planning.route.path_ends import cell_at, goal_cell, start_cell
from waychair.planning.route.way_making import way_legs
from waychair.planning.seen.forecast import (
    ExpectedPeople,
    ForecastSettings,
    arrival,
    predicted_occupancy,
    with_forecast,
)
from waychair.types import FloatArray, IntArray, Path, Pose2


@dataclass(frozen=True, slots=True)
class PlannerSettings(Settings):
    """Which planner searches the cells, and how a path is made of them."""

    planner: str = setting("dstar-lite", "", "planner on the grid: dstar-lite, astar, dijkstra or harmonic")
    smooth: str = setting(
        "auto", "", "smoothing of the path: taut, band, none, or auto (band for the harmonic planner, else taut)"
    )
    harmonic: HarmonicSettings = field(default_factory=HarmonicSettings)
    forecast: ForecastSettings = field(default_factory=ForecastSettings)
    keep_right: KeepRightSettings = field(default_factory=KeepRightSettings)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        grid_planner(self.planner)
        if self.smooth not in SMOOTHINGS:
            raise ConfigError(f"smooth = '{self.smooth}' is unknown; choose {', '.join(SMOOTHINGS)}")

    @property
    def smoothing(self) -> str:
        """The smoothing in force: taut, band or none."""
        if self.smooth != "auto":
            return self.smooth
        return "band" if self.planner == HARMONIC else "taut"


SMOOTHINGS = ("auto", "taut", "band", "none")

SPACING = 0.1
"""[m] Distance of a path's poses."""

START_REACH = 0.3
"""[m] Largest distance of the path's first cell from a start that is too close to a wall."""

ROUNDING = 10
"""Smoothing passes over the corners."""

RUN_UP = 1.0
"""[m] Straight run before the middle of a door."""

TURN_FROM = 1.2
"""[rad] At sharper corners before or after a door the chair turns on the spot."""


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


class GlobalPlanner:
    """A planner to one goal that keeps its search state, so that replanning only searches where something changed."""

    def __init__(
        self, goal: Pose2, settings: PlannerSettings = PlannerSettings(), check_footprint: bool = True
    ) -> None:
        """Without `check_footprint` the path is made for the half width only, with no doors, turns and exact legs."""
        self.goal = goal
        self.settings = settings
        self._check_footprint = check_footprint
        self.cost = 0
        self._costmap: Costmap | None = None
        self._search: GridPlanner | None = None
        self.legs: tuple[PathLeg, ...] = ()
        self.valid_from_anywhere = False
        self._distrusted: list[DoorPassage] = []

    def distrust(self, door: DoorPassage) -> None:
        """Treat this door as an ordinary tight place from now on: the chair found no door there."""
        self._distrusted.append(door)

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
        """Do `replan` in bounded parts: the harmonic field, then the path over cells and its band, then tight turns.

        The field is valid from wherever the chair is by then, so `start` is called anew, and a band takes little time:
        while `valid_from_anywhere` the chair may keep driving its present plan. `has_time` says whether there is time
        for more of the field. `among_people` no tight turns are planned around people's present places and no leg is
        exact: the local planner checks the footprint.
        """
        try:
            self.valid_from_anywhere = True
            yield from prepared(self._search_over(costmap, start()), has_time)
            here = start()
            cells = self._cells(costmap, here)
            direct = direct_leg(costmap, here, self.goal) if self._check_footprint and not among_people else None
            if direct is not None:
                self.legs = (direct,)
                return joined_legs(self.legs)
            line = line_over(costmap, cells, here, self.goal)
            grid_from_map, cell = costmap.grid.map_from_grid.inverse(), costmap.grid.resolution
            spaced = _evenly_spaced(transform_points(grid_from_map, line) / cell, SPACING / cell)
            doors = [door for _, _, door in tight_doors(costmap, spaced, self._narrow, costmap.body.width + 0.25)]
            line = transform_points(costmap.grid.map_from_grid, spaced * cell)
            legs = yield from way_legs(costmap, line, here, self.goal, doors)
        finally:
            self.valid_from_anywhere = False
        self.legs = tuple(legs)
        return joined_legs(self.legs)

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
        near: bool = False,
        has_time: HasTime | None = None,
    ) -> Resumable[Path]:
        """Do `replan_resumably` among moving people, predicted rather than walls; `near`: some are close to the chair.

        The direct path keeps to one side (`kept_right`). It is taken if it meets nobody at `cruise` [m/s], or if a path
        around the people, over the costmap with their prediction, is no faster than waiting and the direct path.
        """
        direct = yield from self.replan_resumably(costmap, start, near, has_time)
        if people.tracks:
            direct = self._kept_to_one_side(costmap)
        forecast = self.settings.forecast
        direct_s, wait_s = arrival(people, direct.poses[:, :2], cruise, forecast)
        if wait_s == 0.0:
            return direct
        legs = self.legs
        self.valid_from_anywhere = True  # until the next search is done
        yield
        expected = with_forecast(costmap, predicted_occupancy(people, costmap.grid, forecast))
        with suppress(PlanningError):  # then no path leads around them
            around = yield from self.replan_resumably(expected, start, near, has_time)
            if arrival(people, around.poses[:, :2], cruise, forecast)[0] < direct_s:
                return around
        self.legs = legs
        return direct

    @property
    def _narrow(self) -> float:
        """The clearance [m] below which a place is treated as a doorway; 0: none is."""
        return NARROW if self._check_footprint else 0.0

    def _kept_to_one_side(self, costmap: Costmap) -> Path:
        """Return the path with its free legs moved to one side, where there is room."""
        keep = self.settings.keep_right
        self.legs = tuple(
            replace(leg, path=kept_right(leg.path, costmap, keep)) if leg.manner is DrivingManner.FREE else leg
            for leg in self.legs
        )
        return joined_legs(self.legs)

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


def _legs_from_cells(
    costmap: Costmap,
    cells: IntArray,
    start: Pose2,
    goal: Pose2,
    settings: PlannerSettings,
    narrow: float,
    distrusted: Sequence[DoorPassage] = (),
) -> Resumable[list[PathLeg]]:
    """Return legs along the chain of cells, pulled taut where that costs no more, and cut at tight doors; resumable."""
    cell = costmap.grid.resolution
    grid_from_map = costmap.grid.map_from_grid.inverse()
    ends: FloatArray = transform_points(grid_from_map, np.array([[start.x, start.y], [goal.x, goal.y]])) / cell
    chain: FloatArray = cells[:, ::-1].astype(np.float64) + 0.5
    # The exact ends replace their cells; a start too close to a wall is joined to the first passable cell.
    chain = np.concatenate([ends[:1], chain if costmap.prices[cell_at(costmap, start)] == 0 else chain[1:]])
    chain = np.concatenate([chain[:-1] if len(chain) > 1 else chain, ends[1:]])
    taut = _evenly_spaced(_pulled(costmap, chain, settings), SPACING / cell)
    legs: list[PathLeg] = []
    leaves: float | None = None
    here, begin, widest = start, 0, costmap.body.width + TIGHT_DOOR
    for first, _, door in tight_doors(costmap, taut, narrow, widest):
        through = None if _is_one_of(door, distrusted) else door_leg(costmap, door, here, goal)
        if through is None:
            continue
        entry, leaving = transform_points(grid_from_map, through.path.poses[[0, -1], :2]) / cell
        if math.dist(through.path.poses[0, :2], (here.x, here.y)) > SPACING / 2:
            before = begin + _nearest(taut[begin : max(first, begin + 1)], entry)
            chunk = taut[begin : before + 1]
            bent = _bent_into(costmap, chunk, entry, leaving - entry) if settings.smoothing == "band" else None
            chunk = np.concatenate([chunk if bent is None else bent, entry[None]])
            heading = float(through.path.poses[0, 2])
            legs += yield from _free_legs(
                costmap=costmap,
                points=chunk,
                heading=heading,
                settings=settings,
                narrow=narrow,
                leaves=leaves,
                straight_in=bent is not None,
            )
        legs.append(through)
        here = Pose2(*through.path.poses[-1])
        begin = first + _nearest(taut[first:], leaving)
        beyond = taut[begin + 1 :]
        if not len(beyond) and math.dist(taut[begin], leaving) > SPACING / cell:
            beyond = taut[begin:]  # the goal itself lies beyond the door leg
        bent = _bent_into(costmap, beyond[::-1], leaving, entry - leaving) if settings.smoothing == "band" else None
        leaves = None if bent is None else float(through.path.poses[-1, 2])
        beyond = beyond if bent is None else bent[::-1]
        taut = np.concatenate([taut[:begin], leaving[None], beyond])
    legs += yield from _free_legs(
        costmap=costmap, points=taut[begin:], heading=goal.theta, settings=settings, narrow=narrow, leaves=leaves
    )
    _join(legs)
    return legs


def line_over(costmap: Costmap, cells: IntArray, start: Pose2, goal: Pose2) -> FloatArray:
    """Return the taut line (N, 2) [m] in map over a path's cells, with the exact ends."""
    chain = cells[:, ::-1].astype(np.float64) + 0.5
    points = chain[pull_taut(costmap.prices, chain, costmap.barred)]
    line = transform_points(costmap.grid.map_from_grid, points * costmap.grid.resolution)
    ends = np.array([[start.x, start.y]]), np.array([[goal.x, goal.y]])
    return np.concatenate([ends[0], line[1:-1], ends[1]])


def _is_one_of(door: DoorPassage, others: Sequence[DoorPassage]) -> bool:
    """Return whether a door is at the place of one of the others."""
    at = door.map_from_door
    return any(math.hypot(at.x - other.map_from_door.x, at.y - other.map_from_door.y) < _SAME_DOOR for other in others)


_SAME_DOOR = 0.3
"""Doors of two plans whose middles are no farther apart [m] are the same door."""


def _free_legs(
    costmap: Costmap,
    points: FloatArray,
    heading: float,
    settings: PlannerSettings,
    narrow: float,
    leaves: float | None = None,
    straight_in: bool = False,
) -> Resumable[list[PathLeg]]:
    """Return legs along points [cells], lined up with narrow places, corners rounded, the last ending in a heading.

    A band starts in the direction `leaves` [rad] and, if `straight_in`, arrives in the direction of the heading.
    Corners for a turn on the spot are not rounded: there one leg ends and the next begins.
    """
    cell = costmap.grid.resolution
    spacing = SPACING / cell
    taut = _evenly_spaced(_pulled(costmap, points, settings), spacing)
    lined_up, run_ends = line_up(costmap, taut, narrow, RUN_UP)
    parts = []
    cut = legs_between_turns(costmap, lined_up, run_ends, TURN_FROM)
    for k, part in enumerate(cut):
        ends = (leaves if k == 0 else None, heading if straight_in and k == len(cut) - 1 else None)
        rounded = yield from _rounded(costmap, _evenly_spaced(part, spacing), settings, ends)
        at = transform_points(costmap.grid.map_from_grid, rounded * cell)
        parts.append(np.column_stack([at, _headings(at)]))
    for part, following in pairwise(parts):
        part[-1, 2] = following[0, 2]
    parts[-1][-1, 2] = heading
    return [PathLeg(Path(part)) for part in parts]


def _pulled(costmap: Costmap, points: FloatArray, settings: PlannerSettings) -> FloatArray:
    """Return the points pulled taut; those of the harmonic planner only on request, since they keep clear of walls."""
    if settings.smoothing == "none" or (settings.smoothing == "band" and settings.planner == HARMONIC):
        return points
    return points[pull_taut(costmap.prices, points, costmap.barred)]


def _rounded(
    costmap: Costmap, points: FloatArray, settings: PlannerSettings, ends: tuple[float | None, float | None]
) -> Resumable[FloatArray]:
    """Return the points with corners rounded, by the prices of the cells or, with a band, for the footprint.

    `ends` are the band's headings [rad] in map at its ends, where they are fixed.
    """
    if settings.smoothing == "none":
        return points
    if ends == (None, None):
        points = round_corners(costmap.prices, points, ROUNDING, costmap.barred)
    if settings.smoothing != "band":
        return points
    # at a fixed end there is a curve already, which must not be cut
    turned = costmap.grid.map_from_grid.theta
    leaves, arrives = (
        None if end is None else np.array([math.cos(end - turned), math.sin(end - turned)]) for end in ends
    )
    work = band(costmap, points, leaves, arrives)
    banded = yield from in_time_slices(work, CELLS_PER_STEP)
    return points if _is_against_one_way(costmap, banded) else banded


def _is_against_one_way(costmap: Costmap, points: FloatArray) -> bool:
    """Return whether a line through points [cells] goes against a one-way zone; a band only knows walls."""
    if costmap.barred is None:
        return False
    return any(
        line_cost(costmap.prices, a, b, c, d, costmap.barred) == math.inf
        and line_cost(costmap.prices, a, b, c, d, None) < math.inf
        for (a, b), (c, d) in pairwise(points.tolist())
        if (a, b) != (c, d)
    )


def _join(legs: list[PathLeg]) -> None:
    """Let each leg begin at the exact end of the one before it; door legs stay unchanged."""
    for leg, following in pairwise(legs):
        here, there = leg.path.poses[-1], following.path.poses[0]
        if following.manner is DrivingManner.DOOR:
            here[:2] = there[:2]
        else:
            there[:2] = here[:2]


def _bent_into(costmap: Costmap, points: FloatArray, end: FloatArray, direction: FloatArray) -> FloatArray | None:
    """Return points [cells] towards the end of a door leg, with their last part bent into its direction (2,).

    That part is a cubic Bezier curve, so that a band begins without a corner there. None where no such curve is free,
    and where the chair would come from ahead: there it turns on the spot.
    """
    cell, along = costmap.grid.resolution, direction / np.hypot(*direction)
    for k in range(len(points) - 1):
        reach = math.dist(points[k], end)
        way = end - points[max(k - 4, 0)]
        if reach * cell > _BEND_WITHIN or way @ along < 0.2 * np.hypot(*way):
            continue
        into = points[min(k + 1, len(points) - 1)] - points[max(k - 4, 0)]
        second, third = points[k] + 0.4 * reach * into / np.hypot(*into), end - 0.5 * reach * along
        t = np.linspace(0.0, 1.0, math.ceil(reach) + 2)[1:-1, None]
        curve = (1 - t) ** 3 * points[k] + 3 * t * (1 - t) ** 2 * second + 3 * t**2 * (1 - t) * third + t**3 * end
        bent = np.concatenate([points[: k + 1], curve])
        line = np.concatenate([bent[k:], end[None]])
        if all(line_cost(costmap.prices, a, b, c, d, costmap.barred) < math.inf for (a, b), (c, d) in pairwise(line)):
            return bent
    return None


_BEND_WITHIN = 1.6
"""Distance [m] before and after a door leg within which a band bends into its direction."""


def _nearest(points: FloatArray, point: FloatArray) -> int:
    return int(np.argmin(np.hypot(*(points - point).T)))


def _evenly_spaced(points: FloatArray, spacing: float) -> FloatArray:
    """Return points along a polyline, at most `spacing` apart, both ends included."""
    along = arc_lengths(points)
    count = max(int(np.ceil(along[-1] / spacing)), 1) + 1
    at = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, points[:, 0]), np.interp(at, along, points[:, 1])])


def _headings(points: FloatArray) -> FloatArray:
    """Return the direction from each point to the next; the last one is repeated."""
    ahead = np.diff(points, axis=0)
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    return np.append(headings, headings[-1:] if len(headings) else [0.0])
