"""`waychair fleet demo`: several whole chairs in one simulated building."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonNegativeInt, PositiveInt

if TYPE_CHECKING:
    from rich.console import Console

    from waychair.planning.fleet.order import Order
    from waychair.planning.fleet.waits import Wait
    from waychair.trials.fleet.fleet_demo import FleetWatcher
    from waychair.trials.fleet.fleet_drive import FleetMoment, FleetScene, Keeper

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
    staff_port: NonNegativeInt | None = None,
    processes: bool = False,
    quiet: bool = False,
) -> None:
    """Let several simulated chairs drive to three goals each in one building, and write report.html and report.json.

    Every chair runs the real software with the shipped firmware. They ask for their ways, wait for each other and pass in
    the order that is kept for them. The demo runs as fast as possible; a web page shows all chairs, and another one is that of
    staff, who give priorities there. Fails if a goal was not reached, or a chair touched anything.

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
        Show no pages.
    page_port
        Port of the page; default any free one.
    staff_port
        Port of the staff's page; default any free one. Its token and key are those of the variables WAYCHAIR_STAFF_TOKEN
        and WAYCHAIR_STAFF_KEY, else random ones, which are printed.
    processes
        Run the world and each chair in processes of their own, which talk over a network of this computer, in real time.
        The chairs keep their order by themselves, and a process that dies is started again. Needs the extra [fleet].
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
        pace_sentence,
        run_fleet_demo,
        where_it_waits,
        write_fleet_report,
    )

    scene = demo_scene(world, chairs, seed)
    prepare_kernels(quiet)
    console = Console(stderr=True, quiet=quiet)
    if processes:
        from waychair.cli.fleet_commands.fleet_processes import run_processes

        demo = run_processes(scene, out, world, console, headless, page_port or 0, staff_port or 0)
    else:
        with (
            _shown(headless, page_port or 0, console) as watcher,
            _staff(headless, staff_port or 0, console) as keeper,
            stage_bars(console) as show,
        ):
            demo = run_fleet_demo(scene, show, watcher, keeper)
    write_fleet_report(out, demo)
    values = fleet_report(demo)
    if not quiet:
        delay = "" if values["delay_s"] is None else f", {values['delay_s']:.1f} s of waiting a goal"
        print(
            f"{values['goals_reached']} of {values['goals']} goals reached by {chairs} chairs in {values['seconds']:.0f} s of "
            f"their time ({demo.wall_s:.0f} s here): {values['contacts']} contacts, {values['lockups']} lock-ups, "
            f"{values['waits']} waits{delay}"
        )
        if demo.factor is not None:
            print(pace_sentence(demo.factor))
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


@contextmanager
def _staff(headless: bool, port: int, console: Console) -> Iterator[Keeper]:
    """Serve the staff's page while the block runs; yield the keeper of the order that feeds and obeys it."""
    import os

    from waychair.cli.fleet_commands.staff_options import KEY, TOKEN, secrets_sentence, staff_page_of, staff_secrets
    from waychair.planning.fleet.waits import Audit
    from waychair.runtime.fleet.desk.staff_desk import StaffDesk, staff_view
    from waychair.trials.fleet.fleet_drive import one_warden

    if headless:
        yield one_warden
        return
    found = staff_secrets(dict(os.environ))
    desk = StaffDesk(found[KEY])
    audit = Audit()
    last_ms = 0

    def told(order: Order, present: tuple[Wait, ...], now_ms: int) -> None:
        nonlocal last_ms
        last_ms = now_ms
        audit.note(present, now_ms)
        page.view = staff_view(order, present, audit.ended, desk.given(now_ms), now_ms)

    with staff_page_of(desk, found[TOKEN], port, lambda: last_ms) as (page, address):
        console.print(f"The staff's page is at {address}; {secrets_sentence(found)}.")
        yield partial(one_warden, changed=desk.applied, told=told)
