"""`waychair plan`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import NonEmptyPath
from waychair.cli.options.messages import sayer, warnings_unless
from waychair.cli.options.progress import prepare_kernels, told_share, told_time

if TYPE_CHECKING:
    from collections.abc import Mapping

    from waychair.offline.report import PngFigure
    from waychair.planning.grid.costmap import Costmap
    from waychair.planning.route.global_planner import PlannerSettings
    from waychair.types import BoolArray, IntArray, Place
    from waychair.types import Path as Poses

Pose = Annotated[str, Parameter(allow_leading_hyphen=True)]


def plan_command(
    *,
    map: NonEmptyPath,
    start: Pose | None = None,
    goal: Pose | None = None,
    scen: NonEmptyPath | None = None,
    planner: str | None = None,
    body: str = "A",
    config: Path | None = None,
    png: Annotated[NonEmptyPath | None, Parameter(name=["--png", "--out", "-o"])] = None,
    resolution: float | None = None,
    json: bool = False,
    quiet: bool = False,
) -> None:
    """Plan a path for the chair on a map, or over the cells of a Moving AI benchmark map.

    Parameters
    ----------
    map
        Map folder, its map.yaml or another map_server YAML, or a Moving AI .map file.
    start
        Start: X,Y or X,Y,YAW in metres and radians, or the name of a place; on a .map column,row with row 0 on top.
    goal
        Goal, in the same form.
    scen
        Moving AI scenario: plan all its queries. Fails if a query has no path, or another cost than the scenario gives.
    planner
        dstar-lite, astar, dijkstra or harmonic; default that of --config, else dstar-lite.
    body
        The chair's body: A, B, A_mid, A_front or robot.
    config
        YAML file with settings that differ from the defaults (see `waychair config chair`): the navigator's planner and
        clearance apply, over the cells of a .map file the planner's name.
    png
        Draw the path on the map into this .png file; with harmonic also the potential, and D* Lite's path.
    resolution
        Side of the cells to plan on, in metres, a multiple of the map's own; for maps too large for this computer.
    json
        Print JSON.
    quiet
        Print nothing but errors.
    """
    from waychair.cli.options.arguments import BadArgument, check_picture
    from waychair.maps.folders.map_files import load_info, yaml_path
    from waychair.maps.grid.moving_ai import SUFFIX, is_moving_ai

    on_cells = is_moving_ai(map)
    if scen is not None and (start, goal, png) != (None, None, None):
        raise BadArgument("--scen holds its own starts and goals: omit --start, --goal and --png")
    if scen is not None and not on_cells:
        raise BadArgument(f"--scen needs a Moving AI {SUFFIX} file, not '{map}'")
    if on_cells and resolution is not None:
        raise BadArgument(f"--resolution does not apply to a {SUFFIX} file: omit it")
    if on_cells and body != "A":
        raise BadArgument(f"--body does not apply to a {SUFFIX} file: omit it")
    settings, comfortable = _planning_settings(config, planner)
    say = sayer(quiet)
    prepare_kernels(quiet)
    if scen is not None:
        _plan_scenario(map, scen, settings.planner, json, quiet)
    elif start is None or goal is None:
        raise BadArgument("give --start and --goal, or --scen")
    elif on_cells:
        check_picture(png, "--png", map)
        with told_time("planning", quiet):
            said = _plan_on_cells(map, start, goal, settings.planner, png, json)
        say(said)
    else:
        check_picture(png, "--png", yaml_path(map), load_info(yaml_path(map)).image)
        with told_time("planning", quiet):
            said = _plan_for_the_chair(
                map=map,
                start=start,
                goal=goal,
                settings=settings,
                comfortable=comfortable,
                body=body,
                png=png,
                json=json,
                resolution=resolution,
                quiet=quiet,
            )
        say(said)


def _planning_settings(config: Path | None, planner: str | None) -> tuple[PlannerSettings, float]:
    """Return the planner's settings and the comfortable clearance [m]: those of the file, with the options over them."""
    from waychair.planning.body.clearance import COMFORTABLE
    from waychair.planning.route.global_planner import PlannerSettings

    settings, comfortable = PlannerSettings(), COMFORTABLE
    if config is not None:
        from waychair.cli.options.configuration import load_configuration

        navigator = load_configuration(config).chair.navigator
        settings, comfortable = navigator.planner, navigator.clearance.comfortable
    return with_planner(settings, planner), comfortable


def with_planner(settings: PlannerSettings, planner: str | None) -> PlannerSettings:
    """Return the planner's settings with the option --planner over them."""
    from dataclasses import replace

    return settings if planner is None else replace(settings, planner=planner)


def _plan_for_the_chair(
    map: Path,
    start: str,
    goal: str,
    settings: PlannerSettings,
    comfortable: float,
    body: str,
    png: Path | None,
    json: bool,
    resolution: float | None,
    quiet: bool,
) -> str:
    """Plan a path in metres for the chair's footprint; return what to print."""
    import time

    from waychair.cli.options.arguments import body_named
    from waychair.errors import PlanningError
    from waychair.maps.drawn.zones import check_zones, load_zones
    from waychair.maps.folders.map_files import load_map
    from waychair.offline.report import path_picture, write_png
    from waychair.planning.grid.costmap import check_free_space
    from waychair.planning.grid.drawn_map import DrawnMap
    from waychair.planning.route.global_planner import GlobalPlanner, check_goal
    from waychair.planning.route.grid_planner import HARMONIC
    from waychair.planning.route.path_ends import check_start
    from waychair.planning.route.path_turns import turn_histogram

    chair = body_named(body)
    grid = load_map(map, warnings_unless(quiet), resolution=resolution)
    begin, end, zones = place_on_map(map, start, "--start"), place_on_map(map, goal, "--goal"), load_zones(map)
    check_zones(zones, grid)
    drawn = DrawnMap(grid, chair, zones, comfortable)
    costmap = drawn.costmap()
    check_free_space(costmap)
    search = GlobalPlanner(end.pose, settings)
    try:
        check_start(costmap, chair, begin.pose)
        check_goal(costmap, chair, end.pose, begin.pose)
        begun = time.thread_time()
        path = search.replan(costmap, begin.pose)
    except PlanningError as error:
        from waychair.planning.route.refused_plans import explained
        from waychair.resumable import finished

        raise finished(explained(error, drawn, begin.pose, end.pose)) from error
    ms = 1e3 * (time.thread_time() - begun)
    if png is not None:
        plain = path_picture(grid, path, (begin, end))
        in_a_field = settings.planner == HARMONIC
        write_png(png, _with_potential(costmap, begin, end, settings, path) if in_a_field else plain)
    turns = {f"{edge}": count for edge, count in zip(*(part.tolist() for part in turn_histogram(path)), strict=True)}
    values = {"length_m": path.length(), "cost": search.cost / _per_cell(), "ms": ms, "turns_from_deg": turns}
    said = f"{path.length():.2f} m from {begin.name} to {end.name}" + (f": {png}" if png else "")
    if settings.planner == HARMONIC:
        said += "\nturns at every 0.10 m, from degrees: " + ", ".join(
            f"{edge}: {count}" for edge, count in turns.items()
        )
    return _json({**values, "poses": path.poses.tolist()}) if json else said


def _with_potential(costmap: Costmap, begin: Place, end: Place, settings: PlannerSettings, path: Poses) -> PngFigure:
    """Return a picture of the potential, with the path and the default planner's path."""
    import numpy as np

    from waychair.maps.grid.cells import cells_from_points
    from waychair.offline.planning_report import potential_picture
    from waychair.planning.harmonic.harmonic_field import log_field
    from waychair.planning.harmonic.harmonic_search import absorption_from_prices
    from waychair.planning.harmonic.laplace_solvers import LaplaceProblem
    from waychair.planning.route.global_planner import PlannerSettings, plan

    row, column = cells_from_points(costmap.grid, np.array([[end.pose.x, end.pose.y]]))[0].tolist()
    found = log_field(LaplaceProblem(absorption_from_prices(costmap.prices), (row, column)))
    paths = {settings.planner: path}
    paths["dstar-lite"] = plan(costmap, begin.pose, end.pose, PlannerSettings())
    return potential_picture(costmap.grid, found, paths, (begin, end))


def _plan_on_cells(map: Path, start: str, goal: str, planner: str, png: Path | None, json: bool) -> str:
    """Plan a point's path over the cells of a Moving AI map; return what to print."""
    import time

    import numpy as np

    from waychair.maps.grid.moving_ai import load_free_cells
    from waychair.offline.report import write_png
    from waychair.planning.grid.grid_graph import FREE_PRICE
    from waychair.planning.route.grid_planner import plan_on_cells

    free = load_free_cells(map)
    ends = _cell(start, "--start"), _cell(goal, "--goal")
    _load_kernels(planner)
    begun = time.thread_time()
    found = plan_on_cells(np.where(free, FREE_PRICE, 0).astype(np.int32), *ends, planner)
    ms = 1e3 * (time.thread_time() - begun)
    cost = found.cost / _per_cell()
    if png is not None:
        write_png(png, _cells_picture(free, found.cells, (start, goal), planner))
    values = {"cost": cost, "ms": ms, "cells": found.cells[:, ::-1].tolist()}
    return _json(values) if json else f"{cost:.4f} cells from {start} to {goal}" + (f": {png}" if png else "")


def _cells_picture(free: BoolArray, cells: IntArray, names: tuple[str, str], planner: str) -> PngFigure:
    """Return a picture of a path over cells, with y upwards and 1 m per cell; for harmonic also the potential."""
    import numpy as np

    from waychair.offline.report import path_picture
    from waychair.planning.grid.grid_graph import FREE_PRICE
    from waychair.planning.route.grid_planner import HARMONIC, plan_on_cells
    from waychair.types import OccupancyGrid, Place, Pose2
    from waychair.types import Path as Poses

    upright = np.flipud(free)
    grid = OccupancyGrid(np.where(upright, 0, 100).astype(np.int8), 1.0)

    def drawn(way: IntArray) -> Poses:
        points = np.column_stack([way[:, 1] + 0.5, len(free) - 0.5 - way[:, 0]])
        return Poses(np.column_stack([points, np.zeros(len(points))]))

    path = drawn(cells)
    marks = [Place(name, Pose2(*path.poses[i].tolist())) for name, i in zip(names, (0, -1), strict=True)]
    if planner != HARMONIC:
        return path_picture(grid, path, marks)
    from waychair.offline.planning_report import potential_picture
    from waychair.planning.harmonic.harmonic_field import log_field
    from waychair.planning.harmonic.laplace_solvers import laplace_problem

    (i, j), (row, column) = cells[[0, -1]].tolist()
    prices = np.where(free, FREE_PRICE, 0).astype(np.int32)
    shortest = plan_on_cells(prices, (i, j), (row, column), "dstar-lite").cells
    found = log_field(laplace_problem(upright, (len(free) - 1 - row, column)))
    return potential_picture(
        grid=grid,
        found=found,
        paths={planner: path, "dstar-lite": drawn(shortest)},
        places=marks,
        every=1.0,
        unit="cells",
    )


def _plan_scenario(map: Path, scen: Path, planner: str, json: bool, quiet: bool) -> None:
    """Plan all queries of a scenario from scratch, and print them; the cost of a query without a path is null.

    Raises:
        PlanningError: after the output, if a query has no path or another cost than the scenario gives.
    """
    import statistics
    import time

    import numpy as np

    from waychair.errors import NoPath, PlanningError
    from waychair.maps.grid.moving_ai import check_queries, load_free_cells, load_queries
    from waychair.planning.grid.grid_graph import FREE_PRICE
    from waychair.planning.route.grid_planner import HARMONIC, plan_on_cells

    free, queries = load_free_cells(map), load_queries(scen)
    check_queries(queries, free)
    prices = np.where(free, FREE_PRICE, 0).astype(np.int32)
    costs: list[float | None] = []
    times = []
    with told_share("planning", quiet) as show:
        _load_kernels(planner)
        for query in queries:
            begun = time.thread_time()
            try:
                costs.append(plan_on_cells(prices, query.start, query.goal, planner).cost / _per_cell())
            except NoPath:
                costs.append(None)
            times.append(1e3 * (time.thread_time() - begun))
            show(len(costs) / len(queries))
    optima = [query.optimal for query in queries]
    both, say = list(zip(costs, optima, strict=True)), sayer(quiet)
    right = [cost is not None and abs(cost - optimal) <= 1e-4 * optimal for cost, optimal in both]
    if json:
        rows = zip(costs, optima, times, strict=True)
        say(_json({"queries": [{"cost": cost, "optimal": optimal, "ms": ms} for cost, optimal, ms in rows]}))
    else:
        say(f"{sum(right)} of {len(queries)} queries at their optimal cost, median {statistics.median(times):.2f} ms")
    without = [number for number, cost in enumerate(costs, start=1) if cost is None]
    if without:
        raise NoPath(f"there is no path for {_listed(without)} of {scen}: give the scenario of this map")
    dearer = [number for number, is_right in enumerate(right, start=1) if not is_right]
    if dearer and planner != HARMONIC:  # harmonic paths are not the cheapest
        raise PlanningError(f"the cost differs from {scen} for {_listed(dearer)}: give the scenario of this map")


def _listed(numbers: list[int]) -> str:
    """Return the first ten query numbers as text, and the count of the others."""
    first, more = ", ".join(map(str, numbers[:10])), len(numbers) - 10
    return f"{'query' if len(numbers) == 1 else 'queries'} {first}" + (f" and {more} more" if more > 0 else "")


def _load_kernels(planner: str) -> None:
    """Plan once to load the compiled kernels, so that this does not count in the measured times."""
    import numpy as np

    from waychair.planning.grid.grid_graph import FREE_PRICE
    from waychair.planning.route.grid_planner import plan_on_cells

    plan_on_cells(np.full((1, 2), FREE_PRICE, np.int32), (0, 0), (0, 1), planner)


def _per_cell() -> int:
    """Return the cost of a straight step, to express costs in cells."""
    from waychair.planning.grid.grid_graph import STRAIGHT

    return STRAIGHT


def _cell(text: str, option: str) -> tuple[int, int]:
    """Return (row, column) of `column,row`."""
    from waychair.cli.options.arguments import BadArgument

    try:
        column, row = (int(part) for part in text.split(","))
    except ValueError:
        raise BadArgument(f"{option} must be X,Y, the column and row of a cell (such as 12,40), not '{text}'") from None
    return row, column


def _json(values: object) -> str:
    import json

    return json.dumps(values, allow_nan=False)


def place_on_map(map: Path, text: str, option: str) -> Place:
    """Return the map's place of this name, or the pose that the text gives, named by the text."""
    from waychair.maps.drawn.places import load_places

    return place_among(load_places(map), text, option)


def place_among(places: Mapping[str, Place], text: str, option: str, owner: str = "the map") -> Place:
    """Return the place or pose that the text gives; `owner` names the owner of the places in errors."""
    from waychair.cli.options.arguments import place_from_text

    return place_from_text(places, text, option, owner)
