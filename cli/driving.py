"""`waychair demo`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from waychair.cli.options.arguments import NonNegativeInt

if TYPE_CHECKING:
    from rich.console import Console

    from waychair.trials.demo_page import DemoPage


def demo_command(
    *,
    out: Path = Path("out/demo"),
    seed: NonNegativeInt = 0,
    world: str = "second_floor",
    surprises: bool = True,
    box: Path | None = None,
    config: Path | None = None,
    headless: bool = False,
    page_port: NonNegativeInt | None = None,
    quiet: bool = False,
) -> None:
    """Map a simulated floor by joystick, then let the chair localise itself on the map and drive to three places.

    Writes report.html and report.json. The demo runs as fast as possible; a web page shows it live.

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
    from rich.progress import Progress, TaskID
    from rich.table import Table

    from waychair.cli.options.configuration import load_configuration
    from waychair.offline.mapping import MappingSettings
    from waychair.trials.demo import run_demo
    from waychair.trials.demo_page import DemoPage
    from waychair.trials.demo_report import HEADER, IN_TERMINAL, facts, row, write_report

    configured = load_configuration(config)
    console = Console(stderr=True, quiet=quiet)
    page = DemoPage()
    with _shown(page, headless, page_port, console), Progress(console=console, transient=True, disable=quiet) as bar:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=1.0)
            bar.update(tasks[stage], completed=share)

        demo = run_demo(
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
    write_report(out, demo)
    if not quiet:
        table = Table(*HEADER[:IN_TERMINAL], title=demo.world)
        for leg in demo.legs:
            table.add_row(*row(leg)[:IN_TERMINAL])
        Console().print(table)
        for name, value in facts(demo):
            print(f"{name:22s} {value}")
        print(f"{demo.reached} of {len(demo.legs)} goals reached; see {out / 'report.html'}")
    if demo.reached < len(demo.legs) or page.stop_requested:
        sys.exit(1)


@contextmanager
def _shown(page: DemoPage, headless: bool, port: int | None, console: Console) -> Iterator[None]:
    """Serve the demo's page while the block runs."""
    from waychair.cli.options.page_process import has_ui, port_of_page
    from waychair.ui.server import page_server

    if headless:
        yield
    elif not has_ui():
        console.print("To watch this in a browser: pip install 'waychair[ui]'", markup=False)
        yield
    else:
        with page_server(page, http_port=port_of_page(port)) as address:
            console.print(f"To watch this in a browser, open {address}")
            yield
