"""The grid planners by name, behind one interface, `GridPlanner`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Protocol

from waychair.errors import (
    ConfigError,
    GoalOccupied,
    GoalOutsideMap,
    NoFreeSpace,
    NoPath,
    StartOccupied,
    StartOutsideMap,
)
from waychair.planning.grid.dstar_lite import DStarLite
from waychair.planning.grid.grid_graph import Cell, Prices
from waychair.planning.grid.grid_search import AStar, Dijkstra, GridPath
from waychair.planning.harmonic.harmonic_field import HarmonicSettings
from waychair.planning.harmonic.harmonic_search import HarmonicSearch
from waychair.planning.harmonic.laplace_solvers import HasTime
from waychair.resumable import Resumable
from waychair.types import Bytes, IntArray


class GridPlanner(Protocol):
    """A planner to one goal over changing prices and from a moving start; see `DStarLite`."""

    pops: int

    def move_start(self, cell: Cell) -> None:
        """Start the next `replan` from this cell."""

    def update(self, cells: IntArray, prices: Prices) -> None:
        """Give cells (N, 2) new prices (N,)."""

    def replan(self) -> int:
        """Plan, and return the path's cost; raises `NoPath`."""

    def path(self) -> IntArray:
        """Return the cells (N, 2) of the present plan; raises `NoPath`."""


class GridPlannerFactory(Protocol):
    """A constructor of planners for prices (H, W), a goal, a first start, and barred directions (H, W)."""

    def __call__(self, prices: Prices, goal: Cell, start: Cell, barred: Bytes | None = None) -> GridPlanner:
        """Return the planner, which keeps no references to the arrays."""


GRID_PLANNERS: Mapping[str, GridPlannerFactory] = MappingProxyType(
    {"dstar-lite": DStarLite, "astar": AStar, "dijkstra": Dijkstra}
)


HARMONIC = "harmonic"
"""The planner that follows a potential rather than the cheapest path."""


def grid_planner(name: str, harmonic: HarmonicSettings | None = None) -> GridPlannerFactory:
    """Return the planner of this name: one for the cheapest path, or the harmonic one, which keeps more clearance.

    `harmonic` are the settings of the latter.

    Raises:
        ConfigError: no planner has this name.
    """
    if name == HARMONIC:
        return partial(HarmonicSearch, settings=harmonic)
    if name not in GRID_PLANNERS:
        raise ConfigError(f"there is no planner '{name}'; choose {', '.join(GRID_PLANNERS)}, {HARMONIC}")
    return GRID_PLANNERS[name]


def prepared(planner: GridPlanner, has_time: HasTime | None = None) -> Resumable[None]:
    """Do the slow part of the next `replan` resumably: the harmonic planner's field, or the search of D* Lite.

    Raises:
        MapTooLarge, NotConverged: see `HarmonicSearch.prepare`.
    """
    if isinstance(planner, HarmonicSearch):
        yield from planner.prepare(has_time)
    elif isinstance(planner, DStarLite):
        yield from planner.prepare()


def plan_on_cells(prices: Prices, start: Cell, goal: Cell, planner: str = "dstar-lite") -> GridPath:
    """Return a path over (H, W) prices, planned once by the planner of a name.

    Raises:
        NoFreeSpace, StartOutsideMap, StartOccupied, GoalOutsideMap, GoalOccupied, NoPath.
        ConfigError: no planner has this name.
    """
    make = grid_planner(planner)
    if not prices.any():
        raise NoFreeSpace("the map has no free cell; give a map with some")
    height, width = prices.shape
    for cell, name, outside, occupied in (
        (start, "start", StartOutsideMap, StartOccupied),
        (goal, "goal", GoalOutsideMap, GoalOccupied),
    ):
        at = f"the {name} in column {cell[1]}, row {cell[0]}"
        if not (0 <= cell[0] < height and 0 <= cell[1] < width):
            raise outside(f"{at} lies outside the map of {width} columns and {height} rows; choose a cell inside it")
        if prices[cell] == 0:
            raise occupied(f"{at} is occupied; choose a free cell")
    search = make(prices, goal, start)
    try:
        cost = search.replan()
    except NoPath as error:
        raise NoPath(
            f"no path leads from column {start[1]}, row {start[0]} to column {goal[1]}, row {goal[0]}; "
            "choose another goal"
        ) from error
    return GridPath(cost, search.path(), search.pops)
