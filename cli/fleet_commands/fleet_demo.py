"""`waychair fleet demo`: several whole chairs in one simulated building."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonNegativeInt, PositiveInt

if TYPE_CHECKING:
    from rich.console import Console

    from waychair.trials.fleet.fleet_demo import FleetWatcher
    from waychair.trials.fleet.fleet_drive import FleetMoment, FleetScene

MOST_CHAIRS = 12
"""More whole chairs in lockstep take minutes for each minute of their time."""


def demo_command(
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("out/fleet"),
    chairs: PositiveInt = 3,
    world: str = "T",
    seed: NonNegativeInt = 0,
    headless: bool = False,
    page_port: NonNegativeInt | None = None,
    quiet: bool = False,
) -> None:
    """Let several simulated chairs drive to three goals each in one building, and write report.html and report.json.

    Every chair runs the real software with the shipped firmware. They ask for their ways, wait for each other and pass in
    the order that is kept for them. The demo runs as fast as possible; a web page shows all chairs. Fails if a goal was not
    reached, or a chair touched anything.

    Parameters
    ----------
    out
        Folder for the report.
    chairs
        Number of chairs.
    world
        A shipped floor plan (2bconR, 2d-grid, 3tie, 4cross, 9cube, I, Rectangle, T or fig8), or a plan's .yaml file.
    seed
        Seed of the chairs, their sensors and their goals; the same seed gives the same report.json.
    headless
        Show no page.
    page_port
        Port of the page; default any free one.
    quiet
        Print nothing but errors.
    """
    if chairs > MOST_CHAIRS:
        raise BadArgument(
            f"--chairs {chairs} is more than {MOST_CHAIRS}; use `waychair fleet simulate` for many chairs"
        )
    from rich.console import Console

    from waychair.cli.options.progress import prepare_kernels, stage_bars
    from waychair.trials.fleet.fleet_demo import (
        demo_scene,
        fleet_report,
        run_fleet_demo,
        where_it_waits,
        write_fleet_report,
    )

    scene = demo_scene(world, chairs, seed)
    prepare_kernels()
    console = Console(stderr=True, quiet=quiet)
    with _shown(headless, page_port or 0, console) as watcher, stage_bars(console) as show:
        demo = run_fleet_demo(scene, show, watcher)
    write_fleet_report(out, demo)
    values = fleet_report(demo)
    if not quiet:
        delay = "" if values["delay_s"] is None else f", {values['delay_s']:.1f} s of waiting a goal"
        print(
            f"{values['goals_reached']} of {values['goals']} goals reached by {chairs} chairs in {values['seconds']:.0f} s of "
            f"their time ({demo.wall_s:.0f} s here): {values['contacts']} contacts, {values['lockups']} lock-ups, "
            f"{values['waits']} waits{delay}"
        )
        print(where_it_waits(demo))
        print(f"report: {out / 'report.html'}")
    if values["goals_reached"] < values["goals"] or values["contacts"]:
        sys.exit(1)


@contextmanager
def _shown(headless: bool, port: int, console: Console) -> Iterator[FleetWatcher]:
    """Serve the page of all chairs while the block runs; yield the watcher that feeds it."""
    from dataclasses import asdict

    from waychair.trials.fleet.fleet_demo import FleetWatcher, plan_of, view_of
    from waychair.ui.fleet_page import FleetPage, fleet_page

    if headless:
        yield FleetWatcher()
        return
    page = FleetPage()

    class Feed(FleetWatcher):
        """Shows every moment on the page."""

        def began(self, scene: FleetScene) -> None:
            self._scene = scene
            page.plan = plan_of(scene)

        def moment(self, moment: FleetMoment) -> None:
            page.view = asdict(view_of(self._scene, moment))

    with fleet_page(page, port) as address:
        console.print(f"To watch this in a browser, open {address}")
        yield Feed()
