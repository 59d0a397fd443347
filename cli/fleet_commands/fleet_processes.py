"""`waychair fleet demo --processes`: a world and a process for each chair, with pages of all chairs and of staff."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from waychair.trials.fleet.fleet_demo import FleetDemo
    from waychair.trials.fleet.fleet_drive import FleetScene
    from waychair.trials.fleet.live.live_fleet import LiveFleet

LIVE = "live"
"""Folder of the processes' files, beside the report."""


def run_processes(
    scene: FleetScene, out: Path, world: str, console: Console, headless: bool, page_port: int, staff_port: int
) -> FleetDemo:
    """Return the demo of a fleet of processes.

    Raises:
        FleetError: the processes cannot start, or die again and again.
        ConfigError: a page's port is taken.
        MissingExtra: the extra [fleet] is not installed.
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    import shutil
    import time

    from waychair.cli.options.progress import stage_bars
    from waychair.errors import FleetError
    from waychair.firmware_bridge.board import board_program
    from waychair.runtime.processes import Process, signalled
    from waychair.trials.fleet.fleet_demo import FleetDemo, best_bay
    from waychair.trials.fleet.live.live_fleet import LiveFleet
    from waychair.trials.fleet.live.live_plan import DESK, new_plan

    board_program()  # built here, not by several processes at once
    folder = (out / LIVE).resolve()
    shutil.rmtree(folder, ignore_errors=True)
    name = str(Path(world).resolve()) if Path(world).suffix else world
    plan = new_plan(folder, name, len(scene.starts), scene.seed, () if headless else (DESK,))
    stopped = signalled(signal.SIGINT, signal.SIGTERM)
    environment = dict(os.environ)
    more: tuple[Process, ...] = ()
    if not headless:
        from waychair.cli.fleet_commands.staff_options import staff_secrets

        environment |= staff_secrets(environment)
        desk = "waychair.cli.fleet_commands.desk_process"
        arguments = (str(folder / f"fleet{DESK}.yaml"), str(staff_port))
        more = (Process("staff desk", desk, arguments, vital=False),)
    total = sum(map(len, scene.goals))
    began = time.perf_counter()
    with ExitStack() as stack:
        fleet = stack.enter_context(LiveFleet(folder, plan, _told(console), more, environment))
        shown = stack.enter_context(_page(fleet, page_port, console, headless))
        show = stack.enter_context(stage_bars(console))
        while not (fleet.finished or fleet.ended or stopped()):
            fleet.watch()
            shown()
            show("drive", sum(chair.reached for chair in fleet.record.run.chairs) / total)
        show("drive", 1.0)
        if fleet.ended:
            raise FleetError(f"the demo ends: {fleet.ended}; its processes said why above")
        record = fleet.record
        for own, pose, goals in zip(record.run.chairs, record.poses, scene.goals, strict=False):
            own.note_end(scene.places[goals[-1]].pose, pose)
        factor = record.factor
    wall_s = time.perf_counter() - began
    with stage_bars(console) as show:
        bay = best_bay(scene, show)
    return FleetDemo(scene, record.run, wall_s, bay, first=1, ended=record.ended, factor=factor)


def _told(console: Console) -> Callable[[str], None]:
    return lambda sentence: console.print(sentence, highlight=False)


@contextmanager
def _page(fleet: LiveFleet, port: int, console: Console, headless: bool) -> Iterator[Callable[[], None]]:
    """Serve the page of all chairs while the block runs; yield what renews it."""
    from dataclasses import asdict

    from waychair.trials.fleet.fleet_demo import plan_of
    from waychair.ui.fleet_page import FleetPage, fleet_page

    if headless:
        yield lambda: None
        return
    page = FleetPage()
    page.plan = plan_of(fleet.record.scene)

    def show() -> None:
        view = fleet.record.view()
        if view is not None:
            page.view = asdict(view)

    with fleet_page(page, port) as address:
        console.print(f"To watch this in a browser, open {address}")
        yield show
