"""Commands about simulated worlds."""

from __future__ import annotations

import sys
from pathlib import Path


def worlds_command() -> None:
    """List the simulated worlds that ship: their size, places, doors that can be closed, and routes."""
    from rich.console import Console
    from rich.table import Table

    from waychair.simulation.world import MARGIN, load_world, shipped_worlds
    from waychair.trials.record import route_length

    table = Table("world", "size, m", "places", "doors, m", "routes, m", show_lines=True)
    for name in shipped_worlds():
        world = load_world(name)
        height, width = (count * world.grid.resolution - 2 * MARGIN for count in world.grid.cells.shape)
        table.add_row(
            name,
            f"{width:.4g} x {height:.4g}",
            ", ".join(place.name for place in world.places),
            ", ".join(f"{door.name} {door.width:.4g}" for door in world.doors),
            ", ".join(f"{route} {route_length(points, world.start):.0f}" for route, points in world.routes.items()),
        )
    Console().print(table)


def simulate_command(
    *, world: str, route: str = "mapping", record: Path | None = None, seed: int = 0, quiet: bool = False
) -> None:
    """Drive a simulated chair along a route of a world, and record it.

    A rider who sees the truth holds the joystick. Scans and wheel odometry are recorded as a ROS 2 bag, which
    `waychair map` reads.

    Parameters
    ----------
    world
        One of `waychair worlds`, or a plan's .yaml file.
    route
        Name of one of the world's routes.
    record
        Where to write the bag: a new .mcap or .db3 file, or a new folder.
    seed
        Seed of the simulated chair, its sensors and its noise.
    quiet
        Print nothing but errors.
    """
    from rich.console import Console
    from rich.progress import Progress

    from waychair.calibration.chair import CHAIR_A
    from waychair.simulation.simulator import Simulator
    from waychair.simulation.world import load_world
    from waychair.trials.demo import chair_of
    from waychair.trials.record import drive_route

    place = load_world(world)
    waypoints = place.route(route)
    simulator = Simulator(place, CHAIR_A, chair_of(seed), seed)
    with Progress(console=Console(file=sys.stderr, quiet=quiet), transient=True, disable=quiet) as bar:
        task = bar.add_task("driving", total=1.0)
        drive = drive_route(simulator, CHAIR_A, waypoints, record, lambda share: bar.update(task, completed=share))
    if not quiet:
        print(
            f"{drive.distance_m:.1f} m in {drive.duration_s:.0f} s, {drive.scans} scans, no contacts; wheel odometry "
            f"ended {drive.odometry_error_m:.1f} m off" + (f": {record}" if record else "")
        )
