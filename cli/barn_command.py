"""The BARN benchmark on the command line."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from waychair.cli.options.arguments import NonEmptyPath, PositiveInt

_SPEED = 0.5
"""Top speed [m/s] of the benchmark."""


def barn_command(
    folder: NonEmptyPath,
    *,
    worlds: PositiveInt | None = None,
    starts: PositiveInt = 1,
    speed: float | None = None,
    body: str = "jackal",
    scale: float = 1.0,
    jobs: PositiveInt | None = None,
    config: Path | None = None,
    json: bool = False,
    quiet: bool = False,
) -> None:
    """Run the BARN benchmark (drives through fields of cylinders without a map), and print the score.

    Parameters
    ----------
    folder
        Folder of the world_NNN.txt files, or a folder with a subfolder `worlds` of them.
    worlds
        Number of worlds, evenly spread over the folder; default all.
    starts
        Runs per world, each from a different seeded start.
    speed
        Top speed [m/s]; default that of --config, else 0.5.
    body
        jackal (the benchmark's robot), or chair A or B.
    scale
        Scale of all lengths of the worlds, including the cylinders.
    jobs
        Number of processes; default one per core.
    config
        YAML file with settings that differ from the defaults (see `waychair config chair`). Those of the navigator's
        recovery, clearance, planner and dwa replace the benchmark's own; the benchmark has no other part of a chair.
    json
        Print JSON, with a row per world.
    quiet
        Show no progress, and print the score alone.
    """
    import json as text

    from rich.table import Table

    from waychair.cli.options.progress import prepare_kernels, told_share
    from waychair.cli.options.tables import print_table
    from waychair.planning.warm_up import warm_up
    from waychair.trials.barn import BarnTask, report, run_worlds, worlds_in

    changes, speed = _changes(config), _SPEED if speed is None else speed
    task = BarnTask(body=body, speed=speed, scale=scale, starts=starts, changes=changes)
    paths = worlds_in(folder, worlds)
    prepare_kernels(quiet)
    with told_share("driving", quiet) as show:
        warm_up()  # here, where it is told, and not by each of the worker processes
        runs = run_worlds(paths, task, jobs or os.cpu_count() or 1, show)
    result = report(runs, task)
    if json:
        print(text.dumps(result, indent=2, allow_nan=False))
        return
    columns = ("world", "score", "success", "contact", "timeout", "time_s", "least_clearance_m")
    table = Table(*columns, title=f"BARN, body {body}, {speed:g} m/s, scale {scale:g}")
    for row in result["worlds"]:
        table.add_row(row["world"], *(f"{row[key]:.3f}" for key in columns[1:]))
    if not quiet:
        print_table(table)
    print(
        f"score {result['score']:.4f}, success {result['success']:.3f}, contact {result['contact']:.4f} "
        f"(below {result['contact_below']:.4f} with 95 % confidence), timeout {result['timeout']:.3f} of {result['runs']} runs"
    )


def _changes(path: Path | None) -> Mapping[str, Any]:
    """Return the file's changes of the mapless navigator's settings.

    Raises:
        ConfigError: the file is wrong, or it changes nothing that the benchmark has.
    """
    import dataclasses

    from waychair.cli.options.configuration import load_configuration
    from waychair.config import changed_values
    from waychair.control.drive.mapless import MaplessSettings
    from waychair.errors import ConfigError

    if path is None:
        return {}
    chair = changed_values(load_configuration(path).chair)
    navigator = chair.get("navigator", {})
    known = {entry.name for entry in dataclasses.fields(MaplessSettings)}
    changes = {key: value for key, value in navigator.items() if key in known}
    if chair and not changes:
        raise ConfigError(
            f"{path}: the benchmark has no part of the chair but navigator.{', navigator.'.join(sorted(known - {'memory'}))}, "
            "none of which the file changes: omit --config"
        )
    return changes
