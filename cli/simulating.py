"""`waychair worlds` and `waychair simulate`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonNegativeInt, check_picture
from waychair.cli.options.chair_options import PlantName

if TYPE_CHECKING:
    from waychair.simulation.pacing import Pacer
    from waychair.simulation.plan.world import World
    from waychair.simulation.simulator import SimulationSettings, Simulator
    from waychair.trials.record import RouteDrive
    from waychair.types import FloatArray, SensorMessage


def worlds_command(
    name: str | None = None,
    /,
    *,
    level: str | None = None,
    picture: Annotated[Path | None, Parameter(name=["--picture", "--out", "-o"])] = None,
) -> None:
    """List the shipped simulated worlds: size, places, doors that can be closed, routes and hazards of each level.

    Parameters
    ----------
    name
        Show only this world, with the names of its doors: a shipped world, or a plan's .yaml file.
    level
        Show only this level of it.
    picture
        Draw the plan of that level (default the first) into this .png file.
    """
    from rich.table import Column, Table

    from waychair.cli.options.tables import print_table
    from waychair.offline.report import write_png
    from waychair.simulation.plan.world import levels_of, load_world, shipped_worlds
    from waychair.trials.world_plan import world_picture

    check_picture(picture, "--picture")
    if name is None and (level is not None or picture is not None):
        raise BadArgument("--level and --picture need the name of a world")
    names = shipped_worlds() if name is None else (name,)
    levels = [(each, one) for each in names for one in ((level,) if level else levels_of(each))]
    if picture is not None:
        write_png(picture, world_picture(load_world(*levels[0])))
    table = Table(
        Column("world", no_wrap=True), "size, m", "places", "doors, m", "routes, m", "hazards", show_lines=True
    )
    for each, one in levels:
        table.add_row(*_row(load_world(each, one), brief=name is None))
    print_table(table)
    if picture is not None:
        print(picture)


def _row(world: World, brief: bool) -> tuple[str, ...]:
    """Return a level's table row; `brief` counts the doors instead of naming them."""
    from waychair.simulation.plan.world import MARGIN
    from waychair.trials.record import route_length
    from waychair.trials.world_plan import hazard_names

    doors = ", ".join(f"{door.name} {door.width:.4g}" for door in world.doors)
    if brief and len(world.doors) > 1:
        widths = [door.width for door in world.doors]
        doors = f"{len(widths)}: {min(widths):.4g} to {max(widths):.4g}"
    height, width = (count * world.grid.resolution - 2 * MARGIN for count in world.grid.cells.shape)
    return (
        world.name if world.level in ("", world.name) else f"{world.name}, {world.level}",
        f"{width:.4g} x {height:.4g}",
        ", ".join(place.name for place in world.places),
        doors,
        ", ".join(f"{route} {route_length(points, world.start):.0f}" for route, points in world.routes.items()),
        ", ".join(hazard_names(world)),
    )


def simulate_command(
    *,
    world: Annotated[str, Parameter(name=["--world", "--sim"])],
    level: str | None = None,
    route: str = "mapping",
    record: Annotated[Path | None, Parameter(name=["--record", "--out", "-o"])] = None,
    seed: NonNegativeInt = 0,
    mode: Literal["lockstep", "fast", "realtime"] = "fast",
    camera: bool | None = None,
    people: bool = True,
    chair: str = "A",
    plant: PlantName | None = None,
    rider: Literal["stick", "blind"] = "stick",
    driver: str = "default",
    config: Path | None = None,
    quiet: bool = False,
) -> None:
    """Drive a simulated chair along a route of a world, and record it.

    A simulated rider, who knows the true pose, steers by joystick. Sensor messages, wheel odometry and true poses are
    recorded as a ROS 2 bag for `waychair map`; with pictures about 1 GB a minute. If the disk fills up or you interrupt
    the drive, the recorded part stays as NAME.part.

    Parameters
    ----------
    world
        A world of `waychair worlds`, or a plan's .yaml file.
    level
        Level of the world, default the first.
    route
        Name of one of the level's routes.
    record
        Path of the bag: a new .mcap or .db3 file, or a new folder.
    seed
        Seed of the simulated chair, of its sensors and noise.
    mode
        fast: as fast as possible; realtime: at wall-clock speed; lockstep: one tick per answer of the driver (the rider
        of a route answers at once).
    camera
        Simulate a camera; by default only if the drive is recorded and this machine can render.
    people
        Simulate the people of the plan.
    chair
        A built-in chair (A, B, ...), or a chair's .yaml file.
    plant
        kinematic: wheels follow their commands; mujoco: mass, motors, casters and slip. Default that of --config, else
        kinematic.
    rider
        stick: sees, and steers by the true pose; blind: feels the glove, and is led from waypoint to waypoint by the whole
        chair with its board (see `waychair guide`).
    driver
        The blind driver: default, older, noisy_hand and others of `waychair guide`.
    config
        YAML file with settings that differ from the defaults (see `waychair config simulation`).
    quiet
        Print nothing but errors and warnings.
    """
    from contextlib import nullcontext

    from waychair.cli.options.configuration import load_configuration
    from waychair.simulation.pacing import PaceMode, Pacer
    from waychair.simulation.plan.world import load_world

    configured = load_configuration(config).simulation
    place = load_world(world, level)
    place = place if people else place.without_people()
    waypoints = place.route(route)
    simulator = _simulator(
        place=place,
        chair=chair,
        configured=configured if plant is None else replace(configured, plant_model=plant),
        seed=seed,
        sensors=record is not None or bool(camera),
        camera=camera,
    )
    pacer = Pacer(PaceMode(mode))
    with _blind(simulator, place, waypoints, driver, seed) if rider == "blind" else nullcontext() as messages:
        drive = _driven(simulator, waypoints, record, pacer, quiet, messages)
    if pacer.lost_s > 0.0:
        print(f"waychair: {_lateness(pacer)}", file=sys.stderr)
    if not quiet:
        print(
            f"{drive.distance_m:.1f} m in {drive.duration_s:.0f} s, {drive.scans} scans, no contacts; "
            f"{pacer.real_time_factor:.3g} times real time; wheel odometry ended {drive.odometry_error_m:.1f} m off"
            + (f": {record}" if record else "")
        )


def _simulator(
    place: World, chair: str, configured: SimulationSettings, seed: int, *, sensors: bool, camera: bool | None
) -> Simulator:
    """Return the simulator of this seed's chair; warn on standard error if a wanted camera is not available."""
    from waychair.simulation.plant.chair_file import load_chair, randomised_chair
    from waychair.simulation.sensors.camera import CameraSettings
    from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors

    made = randomised_chair(load_chair(chair), seed)
    settings = SimulatorSettings(plant=made.plant, mujoco=made.mujoco)
    settings = configured.over(with_all_sensors(settings) if sensors else settings)
    if camera is False:
        settings = replace(settings, camera=CameraSettings())
    simulator = Simulator(place, made.body, settings, seed)
    if simulator.camera_problem is not None:
        print(f"waychair: simulating without the camera: {simulator.camera_problem}", file=sys.stderr)
    return simulator


def _blind(
    simulator: Simulator, place: World, route: FloatArray, driver: str, seed: int
) -> AbstractContextManager[Iterator[SensorMessage]]:
    from waychair.trials.guiding.blind_route import blind_drive

    return blind_drive(simulator, place, route, driver, seed)


def _driven(
    simulator: Simulator,
    waypoints: FloatArray,
    record: Path | None,
    pacer: Pacer,
    quiet: bool,
    messages: Iterator[SensorMessage] | None,
) -> RouteDrive:
    """Drive along the route with a progress bar on standard error."""
    from waychair.cli.options.progress import prepare_kernels, told_share

    prepare_kernels(quiet)
    from waychair.trials.record import drive_route

    with told_share("driving", quiet) as show:
        return drive_route(
            simulator=simulator,
            body=simulator.body,
            route=waypoints,
            bag=record,
            progress=show,
            pacer=pacer,
            drive=messages,
        )


def _lateness(pacer: Pacer) -> str:
    return (
        f"this machine could not keep real time: it is {pacer.lost_s:.1f} s behind, "
        f"at {pacer.real_time_factor:.2f} times real time"
    )
