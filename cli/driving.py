"""Commands that drive the chair."""

from __future__ import annotations

import sys
from pathlib import Path


def demo_command(
    *,
    out: Path = Path("out/demo"),
    seed: int = 0,
    small: bool = False,
    world: str | None = None,
    people: bool = False,
    quiet: bool = False,
) -> None:
    """Map a real recording, then drive the chair to three places in that map through joystick volts.

    The recording is lidar_intel of WAYCHAIR_DATA (default ../shared/data); without it a small world that ships with
    waychair is driven and mapped instead. Ends in report.html and report.json.

    Parameters
    ----------
    out
        Folder for the map and the report.
    seed
        Seed of the simulated chair, its sensors and its noise.
    small
        Use the small world even where the recording is there.
    world
        Use this world instead: one of `waychair worlds`, or a plan's .yaml file.
    people
        With the people of that world, whom the chair foresees and makes way for.
    quiet
        Print nothing but errors.
    """
    from rich.console import Console
    from rich.progress import Progress, TaskID
    from rich.table import Table

    from waychair.trials.demo import SMALL_WORLD, real_log, run_demo
    from waychair.trials.demo_report import HEADER, IN_TERMINAL, row, write_report

    console = Console(stderr=True, quiet=quiet)
    log = None if small or world else real_log()
    if log is None and not (small or world):
        console.print(
            "No real recording at hand (set WAYCHAIR_DATA to a folder that holds lidar_intel): "
            "the demo uses the small world that ships with waychair.",
            markup=False,
        )
    with Progress(console=console, transient=True, disable=quiet) as bar:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=1.0)
            bar.update(tasks[stage], completed=share)

        demo = run_demo(out, seed, log, show, world or SMALL_WORLD, people)
    write_report(out, demo)
    if not quiet:
        table = Table(*HEADER[:IN_TERMINAL], title=demo.title)
        for leg in demo.legs:
            table.add_row(*row(leg)[:IN_TERMINAL])
        Console().print(table)
        print(f"{demo.reached} of {len(demo.legs)} goals reached; see {out / 'report.html'}")
    if demo.reached < len(demo.legs):
        sys.exit(1)
