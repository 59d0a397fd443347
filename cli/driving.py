"""Commands that drive the chair."""

from __future__ import annotations

import sys
from pathlib import Path


def demo_command(
    *,
    out: Path = Path("out/demo"),
    seed: int = 0,
    world: str = "second_floor",
    surprises: bool = True,
    box: Path | None = None,
    quiet: bool = False,
) -> None:
    """Map a simulated floor by joystick, then let the chair find itself on the map and drive to three places.

    Ends in report.html and report.json.

    Parameters
    ----------
    out
        Folder for the map and the report.
    seed
        Seed of the simulated chair, its sensors and its noise, and of the people.
    world
        One of `waychair worlds`, or a plan's .yaml file.
    surprises
        People walk about, one may step suddenly in front, and a door on the planned way is shut.
    box
        Log what the chair is told and does in this folder, for `waychair why`.
    quiet
        Print nothing but errors.
    """
    from rich.console import Console
    from rich.progress import Progress, TaskID
    from rich.table import Table

    from waychair.trials.demo import run_demo
    from waychair.trials.demo_report import HEADER, IN_TERMINAL, facts, row, write_report

    console = Console(stderr=True, quiet=quiet)
    with Progress(console=console, transient=True, disable=quiet) as bar:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=1.0)
            bar.update(tasks[stage], completed=share)

        demo = run_demo(out, seed, show, world, surprises, box)
    write_report(out, demo)
    if not quiet:
        table = Table(*HEADER[:IN_TERMINAL], title=demo.world)
        for leg in demo.legs:
            table.add_row(*row(leg)[:IN_TERMINAL])
        Console().print(table)
        for name, value in facts(demo):
            print(f"{name:22s} {value}")
        print(f"{demo.reached} of {len(demo.legs)} goals reached; see {out / 'report.html'}")
    if demo.reached < len(demo.legs):
        sys.exit(1)
