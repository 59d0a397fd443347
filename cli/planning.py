"""Commands that plan on a map and drive in a world raised from it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from waychair.types import Place

Pose = Annotated[str, Parameter(allow_leading_hyphen=True)]


def plan_command(*, map: Path, start: Pose, goal: Pose, png: Path | None = None) -> None:
    """Plan a path for the chair on a map.

    Parameters
    ----------
    map
        Map folder or its map.yaml.
    start
        Where from: X,Y or X,Y,YAW in metres and radians, or the name of a place.
    goal
        Where to, likewise.
    png
        Draw the path on the map into this file.
    """
    from waychair.calibration.chair import CHAIR_A
    from waychair.maps.map_files import load_map
    from waychair.planning.costmap import costmap_from_grid
    from waychair.planning.global_planner import check_goal, plan
    from waychair.runtime.report import path_picture, write_png

    grid = load_map(map)
    begin, end = _place(map, start, "--start"), _place(map, goal, "--goal")
    costmap = costmap_from_grid(grid, CHAIR_A)
    check_goal(costmap, CHAIR_A, end.pose)
    path = plan(costmap, begin.pose, end.pose)
    if png is not None:
        write_png(png, path_picture(grid, path, (begin, end)))
    print(f"{path.length():.2f} m from {begin.name} to {end.name}" + (f": {png}" if png else ""))


def navigate_command(
    *, map: Path, goal: Annotated[list[str], Parameter(allow_leading_hyphen=True)], start: Pose = "0,0,0", seed: int = 0
) -> None:
    """Drive a simulated chair to places on a map, in a world raised from it.

    Parameters
    ----------
    map
        Map folder or its map.yaml.
    goal
        Name of a place, or X,Y or X,Y,YAW in metres and radians; may be given several times.
    start
        Where the chair stands at first, likewise.
    seed
        Seed of the simulated chair, its sensors and its noise.
    """
    from rich.console import Console
    from rich.table import Table

    from waychair.maps.map_files import load_map
    from waychair.trials.demo_report import HEADER, IN_TERMINAL, row
    from waychair.trials.navigate import navigate

    goals = [_place(map, text, "--goal") for text in goal]
    legs = navigate(load_map(map), _place(map, start, "--start").pose, goals, seed)
    table = Table(*HEADER[:IN_TERMINAL])
    for leg in legs:
        table.add_row(*row(leg)[:IN_TERMINAL])
    Console().print(table)
    failed = [leg for leg in legs if not leg.reached]
    for leg in failed:
        print(f"waychair: {leg.place} was not reached: {leg.reason}", file=sys.stderr)
    if failed:
        sys.exit(1)


def _place(map: Path, text: str, option: str) -> Place:
    """The place of this name, or the pose that is written out, under its own text as a name."""
    from waychair.cli.arguments import pose_from_text
    from waychair.maps.places import find, load_places
    from waychair.types import Place

    places = load_places(map)
    if text in places or (not text[:1].lstrip("-+.").isdigit() and "," not in text):
        return find(places, text)
    return Place(text, pose_from_text(text, option))
