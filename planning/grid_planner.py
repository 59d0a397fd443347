"""The one place where a word picks the planner on the grid: all of them answer to `GridPlanner`."""

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
from waychair.planning.dstar_lite import DStarLite
from waychair.planning.grid_graph import Cell, Prices
from waychair.planning.grid_search import AStar, Dijkstra, GridPath
from waychair.planning.harmonic import HarmonicSettings
from waychair.planning.harmonic_search import HarmonicSearch
from waychair.planning.laplace_solvers import GoOn
from waychair.planning.slices import Slices
from waychair.types import Bytes, IntArray


class GridPlanner(Protocol):
    """The cheapest way to one goal over prices that change and from a start that moves; see `DStarLite`."""

    pops: int

    def move_start(self, cell: Cell) -> None:
        """The next `replan` starts from this cell."""

    def update(self, cells: IntArray, prices: Prices) -> None:
        """Cells (N, 2) have new prices (N,)."""

    def replan(self) -> int:
        """Cost of the cheapest way; raises `NoPath`."""

    def path(self) -> IntArray:
        """Cells (N, 2) of the plan in force; raises `NoPath`."""


class GridPlannerFactory(Protocol):
    """Makes a planner for prices (H, W), a goal, a first start, and barred directions (H, W)."""

    def __call__(self, prices: Prices, goal: Cell, start: Cell, barred: Bytes | None = None) -> GridPlanner:
        """The planner, which keeps no hold of the arrays."""


GRID_PLANNERS: Mapping[str, GridPlannerFactory] = MappingProxyType(
    {"dstar-lite": DStarLite, "astar": AStar, "dijkstra": Dijkstra}
)


HARMONIC = "harmonic"
"""The planner that follows a potential rather than the cheapest way."""


def grid_planner(name: str, harmonic: HarmonicSettings | None = None) -> GridPlannerFactory:
    """The planner of this name: one of those that find the cheapest way, or the harmonic one, which keeps more clear.

    `harmonic` are the settings of that one.

    Raises:
        ConfigError: there is none.
    """
    if name == HARMONIC:
        return partial(HarmonicSearch, settings=harmonic)
    if name not in GRID_PLANNERS:
        raise ConfigError(f"there is no planner '{name}'; choose {', '.join(GRID_PLANNERS)}, {HARMONIC}")
    return GRID_PLANNERS[name]


def prepared(planner: GridPlanner, go_on: GoOn | None = None) -> Slices[None]:
    """Do, in slices, what would hold the next `replan` up: the harmonic planner solves its field, the others search.

    Raises:
        MapTooLarge, NotConverged: see `HarmonicSearch.prepare`.
    """
    if isinstance(planner, HarmonicSearch):
        yield from planner.prepare(go_on)


def plan_on_cells(prices: Prices, start: Cell, goal: Cell, planner: str = "dstar-lite") -> GridPath:
    """The cheapest way over (H, W) prices, planned once by the planner of a name.

    Raises:
        NoFreeSpace, StartOutsideMap, StartOccupied, GoalOutsideMap, GoalOccupied, NoPath.
        ConfigError: there is no such planner.
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
            f"no way leads from column {start[1]}, row {start[0]} to column {goal[1]}, row {goal[0]}; "
            "choose another goal"
        ) from error
    return GridPath(cost, search.path(), search.pops)
