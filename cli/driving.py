"""`waychair demo` and `waychair navigate`: simulated chairs that drive as fast as the computer can."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

from cyclopts import Parameter

from waychair.cli.options.arguments import NonEmptyPath, NonNegativeInt
from waychair.cli.planning import Pose, place_among, place_on_map, with_planner

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from waychair.maps.drawn.zones import Zone
    from waychair.runtime.chair import ChairSettings
    from waychair.simulation.plan.world import World
    from waychair.simulation.simulator import SimulationSettings
    from waychair.trials.demo.demo import Demo
    from waychair.trials.demo.demo_page import DemoPage
    from waychair.trials.drive import DriveRecord
    from waychair.types import OccupancyGrid, Place, Pose2

_Run = TypeVar("_Run")


def demo_command(
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("out/demo"),
    seed: NonNegativeInt = 0,
    world: Annotated[str, Parameter(name=["--world", "--sim"])] = "second_floor",
    surprises: bool = True,
    box: Path | None = None,
    config: Path | None = None,
    headless: bool = False,
    page_port: NonNegativeInt | None = None,
    quiet: bool = False,
) -> None:
    """Map a simulated floor by joystick, then let the chair localise itself on the map and drive to three places.

    In a world of several levels with lifts, such as hospital, two storeys are mapped and joined by a lift, and the chair travels
    from a room of one to a room of the other. Writes report.html and report.json. The demo runs as fast as possible; a web page
    shows it live.

    Parameters
    ----------
    out
        Folder for the map and the report.
    seed
        Seed of the simulated chair, of its sensors and noise, and of the people.
    world
        A world of `waychair worlds`, or a plan's .yaml file.
    surprises
        People walk about, one may suddenly step in front, and a door on the planned path is closed.
    box
        Folder of a black box that logs the chair's inputs and actions, for `waychair why`.
    config
        YAML file with settings that differ from the defaults (see `waychair config map`, `chair` and `simulation`).
    headless
        Show no page.
    page_port
        Port of the page; default 8000, or a free port if that is taken.
    quiet
        Print nothing but errors.
    """
    from rich.console import Console

    from waychair.cli.options.configuration import load_configuration
    from waychair.cli.options.progress import stage_bars
    from waychair.offline.mapping import MappingSettings
    from waychair.trials.demo.demo import run_demo
    from waychair.trials.demo.demo_page import DemoPage
    from waychair.trials.demo.demo_report import write_report
    from waychair.trials.travel.building_demo import is_building, run_building_demo
    from waychair.trials.travel.building_demo_report import building_facts, write_building_report

    configured = load_configuration(config)
    console = Console(stderr=True, quiet=quiet)
    page = DemoPage()

    def shown(run: Callable[..., _Run]) -> _Run:
        with _shown(page, headless, page_port, console), stage_bars(console) as show:
            return run(
                out=out,
                seed=seed,
                progress=show,
                world=world,
                surprises=surprises,
                box=box,
                watcher=page,
                mapping_settings=configured.map.narrowed(MappingSettings),
                chair_settings=configured.chair,
                simulation=configured.simulation,
            )

    if is_building(world):
        travelled = shown(run_building_demo)
        write_building_report(out, travelled)
        if not quiet:
            for name, value in building_facts(travelled):
                print(f"{name:38s} {value}")
            print(f"see {out / 'report.html'}")
        if not travelled.record.arrived:
            sys.exit(1)
        return
    demo = shown(run_demo)
    write_report(out, demo)
    if not quiet:
        _print_demo(demo, out)
    if demo.reached < len(demo.legs) or page.stop_requested:
        sys.exit(1)


def _print_demo(demo: Demo, out: Path) -> None:
    """Print a row for each goal, the figures, and the path of the report."""
    from rich.console import Console
    from rich.table import Table

    from waychair.trials.demo.demo_report import HEADER, IN_TERMINAL, facts, row

    table = Table(*HEADER[:IN_TERMINAL], title=demo.world)
    for leg in demo.legs:
        table.add_row(*row(leg)[:IN_TERMINAL])
    Console().print(table)
    for name, value in facts(demo):
        print(f"{name:22s} {value}")
    print(f"{demo.reached} of {len(demo.legs)} goals reached; see {out / 'report.html'}")


@contextmanager
def _shown(page: DemoPage, headless: bool, port: int | None, console: Console) -> Iterator[None]:
    """Serve the demo's page while the block runs."""
    from waychair.cli.options.page_process import has_ui, port_of_page
    from waychair.install_advice import install_command
    from waychair.ui.server import page_server

    if headless:
        yield
    elif not has_ui():
        console.print(f"To watch this in a browser: {install_command('ui')}", markup=False)
        yield
    else:
        with page_server(page, http_port=port_of_page(port)) as address:
            console.print(f"To watch this in a browser, open {address}")
            yield


def navigate_command(
    *,
    goal: Annotated[list[str], Parameter(allow_leading_hyphen=True)],
    map: NonEmptyPath | None = None,
    world: Annotated[str | None, Parameter(name=["--world", "--sim"])] = None,
    start: Pose | None = None,
    people: NonNegativeInt = 0,
    sensors: bool = False,
    seed: NonNegativeInt = 0,
    planner: str | None = None,
    box: Path | None = None,
    trace: Path | None = None,
    config: Path | None = None,
    resolution: float | None = None,
    quiet: bool = False,
) -> None:
    """Drive a simulated chair to places on a map, obeying the map's zones.

    Without --world the world is raised from the map. With --world the map must be of a drive that began at the world's
    start (as from `waychair simulate`); without a map it is the world's plan.

    Parameters
    ----------
    goal
        Name of a place, or X,Y or X,Y,YAW in metres and radians; may be repeated.
    map
        Map folder or its map.yaml.
    world
        Name of a world (see `waychair worlds`), or a plan's .yaml file.
    start
        The chair's start, in the same form; default 0,0,0 of the map, or the world's start.
    people
        Number of people who walk about.
    sensors
        Simulate sonars, a depth camera and an IMU besides the lidar.
    seed
        Seed of the simulated chair, of its sensors and noise, and of the people.
    planner
        dstar-lite, astar, dijkstra or harmonic; default that of --config, else dstar-lite.
    box
        Folder of a black box that logs the chair's inputs and actions, for `waychair why`.
    trace
        File for the trace of the behaviour cells, for `waychair behaviours`; they are switched on for it.
    config
        YAML file with settings that differ from the defaults (see `waychair config chair` and `simulation`).
    resolution
        Side of the map's cells, in metres, a multiple of the map's own; for maps too large for this computer.
    quiet
        Print nothing but errors.
    """
    from waychair.cli.options.arguments import BadArgument
    from waychair.cli.options.configuration import load_configuration
    from waychair.cli.options.messages import warnings_unless
    from waychair.cli.options.progress import prepare_kernels
    from waychair.maps.folders.map_files import load_map
    from waychair.simulation.plan.world import load_world

    if map is None and world is None:
        raise BadArgument("no map is given: give --map, --world, or both")
    if not goal:
        raise BadArgument("no goal is given: give at least one --goal")
    configured = load_configuration(config)
    plan = None if world is None else load_world(world)
    if map is not None:
        course = _course_on_map(load_map(map, warnings_unless(quiet), resolution=resolution), map, plan, start, goal)
    elif resolution is not None:
        raise BadArgument("--resolution needs a --map: omit it")
    else:
        course = _course_in_world(plan, start, goal)
    prepare_kernels(quiet)
    legs = _driven(
        course,
        quiet=quiet,
        default_start=start is None,
        seed=seed,
        people=people,
        sensors=sensors,
        box=box,
        trace=trace,
        settings=_with_planner(configured.chair, planner),
        simulation=configured.simulation,
    )
    if not quiet:
        _print_legs(legs)
    if failed := [leg for leg in legs if not leg.reached]:
        begun = " (the drive began at 0,0,0, the default --start)" if start is None and map is not None else ""
        for leg in failed:
            print(f"waychair: {leg.place} was not reached: {leg.reason}{begun}", file=sys.stderr)
        sys.exit(1)


@dataclass(frozen=True, slots=True)
class _Course:
    """The map, start and goals of a drive; `scanned` is the part of the map that the lidar sees, None for all of it."""

    grid: OccupancyGrid
    start: Pose2
    goals: list[Place]
    world: World | None
    zones: tuple[Zone, ...] = ()
    scanned: OccupancyGrid | None = None
    map_from_world: Pose2 | None = None


def _course_on_map(grid: OccupancyGrid, map: Path, world: World | None, start: str | None, goals: list[str]) -> _Course:
    """Return the course on the grid of a map, which was made from the start of `world` if that is given."""
    from waychair.maps.drawn.zones import check_zones, load_zones
    from waychair.maps.folders.depth_layer import load_depth_layer, scanned_part

    zones = load_zones(map)
    places = [place_on_map(map, text, "--goal") for text in goals]
    begin = place_on_map(map, start or "0,0,0", "--start").pose
    scanned = scanned_part(grid, load_depth_layer(map, grid))
    check_zones(zones, grid)
    return _Course(grid, begin, places, world, zones, scanned, None if world is None else world.start.inverse())


def _course_in_world(world: World | None, start: str | None, goals: list[str]) -> _Course:
    """Return the course on the plan of a world."""
    assert world is not None
    own, owner = {place.name: place for place in world.places}, f"the world '{world.name}'"
    places = [place_among(own, text, "--goal", owner) for text in goals]
    begin = world.start if start is None else place_among(own, start, "--start", owner).pose
    return _Course(world.grid, begin, places, world)


def _with_planner(settings: ChairSettings, planner: str | None) -> ChairSettings:
    """Return the chair's settings with the option --planner over them."""
    from dataclasses import replace

    planned = with_planner(settings.navigator.planner, planner)
    return replace(settings, navigator=replace(settings.navigator, planner=planned))


def _driven(
    course: _Course,
    *,
    quiet: bool,
    default_start: bool,
    seed: int,
    people: int,
    sensors: bool,
    box: Path | None,
    trace: Path | None,
    settings: ChairSettings,
    simulation: SimulationSettings,
) -> tuple[DriveRecord, ...]:
    """Drive the course, and tell how far the chair has come; a start that is impossible is told to be the default one."""
    from waychair.cli.options.progress import told_time
    from waychair.errors import StartOccupied, StartOutsideMap
    from waychair.trials.navigate import navigate
    from waychair.types import Pose2

    try:
        with told_time("driving", quiet) as tell:
            return navigate(
                grid=course.grid,
                start=course.start,
                goals=course.goals,
                seed=seed,
                people=people,
                world=course.world,
                zones=course.zones,
                sensors=sensors,
                scanned=course.scanned,
                map_from_world=course.map_from_world or Pose2(),
                box=box,
                trace=trace,
                settings=settings,
                simulation=simulation,
                progress=lambda goal, metres: tell(f"{metres:.0f} m on the way to {goal}"),
            )
    except (StartOccupied, StartOutsideMap) as error:
        if not default_start:
            raise
        raise type(error)(f"{error} with --start (the default start was used)") from error


def _print_legs(legs: Sequence[DriveRecord]) -> None:
    """Print a table with a row for each goal."""
    from rich.console import Console
    from rich.table import Table

    from waychair.trials.demo.demo_report import HEADER, IN_TERMINAL, row

    table = Table(*HEADER[:IN_TERMINAL])
    for leg in legs:
        table.add_row(*row(leg)[:IN_TERMINAL])
    Console().print(table)
