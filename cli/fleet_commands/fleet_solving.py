"""`waychair fleet solve`: paths for many agents on a grid."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonEmptyPath, NonNegativeInt, PositiveInt
from waychair.cli.options.messages import sayer
from waychair.cli.options.progress import prepare_kernels, told_share


def solve_command(
    map: NonEmptyPath,
    scen: NonEmptyPath,
    /,
    *,
    agents: PositiveInt,
    seconds: float = 3.0,
    seed: NonNegativeInt = 0,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    json: bool = False,
    quiet: bool = False,
) -> None:
    """Find short paths for many agents on a grid of the Moving AI benchmark, in which no two ever meet.

    Parameters
    ----------
    map
        Moving AI .map file; agents move to the four neighbours of a cell or wait.
    scen
        Moving AI scenario; agent k takes its k-th query.
    agents
        Number of agents.
    seconds
        Processor time to spend, beside loading; longer gives shorter paths.
    seed
        Seed of the random choices.
    out
        JSON file for the `paths`: for each agent a list of [column, row], one for each step.
    json
        Print JSON.
    quiet
        Print nothing but errors.
    """
    import math
    from json import dumps

    import numpy as np

    from waychair.files import write_json
    from waychair.maps.grid.moving_ai import SUFFIX, check_queries, is_moving_ai, load_free_cells, load_queries
    from waychair.planning.fleet.agents import task_of_cells
    from waychair.planning.fleet.solving import load_kernels, solved

    if not (math.isfinite(seconds) and seconds > 0.0):
        raise BadArgument(f"--seconds must be a number above 0, not {seconds:g}")
    if not is_moving_ai(map):
        raise BadArgument(f"the map must be a Moving AI {SUFFIX} file, not '{map}'")
    free, queries = load_free_cells(map), load_queries(scen)
    if agents > len(queries):
        raise BadArgument(f"{scen} has {len(queries)} queries, not {agents}: give --agents {len(queries)} or fewer")
    queries = queries[:agents]
    check_queries(queries, free)
    task = task_of_cells(free, [query.start for query in queries], [query.goal for query in queries])
    prepare_kernels(quiet)
    with told_share("solving", quiet) as show:
        load_kernels()
        found = solved(task, seconds, seed, show)
    if out is not None:
        write_json(out, {"paths": np.argwhere(free)[found.paths][:, :, ::-1].tolist()})
    values = {
        "sum_of_costs": found.sum_of_costs,
        "bound": found.bound,
        "first_ms": round(found.first_ms, 3),
        "valid": found.valid,
    }
    said = (
        f"{agents} agents: sum of costs {found.sum_of_costs}, bound {found.bound}; "
        f"first answer after {found.first_ms:.1f} ms"
    )
    sayer(quiet)(dumps(values) if json else said)
