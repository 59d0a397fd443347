"""The grid benchmark of multi-agent path finding.

The grids are those of `WAYCHAIR_DATA`; times are processor times of this thread, kernels loaded before.
"""

from __future__ import annotations

import os
from pathlib import Path

from waychair.maps.grid.moving_ai import load_free_cells, load_queries
from waychair.planning.fleet.agents import Task, fault, task_of_cells
from waychair.planning.fleet.solving import load_kernels, solved
from waychair.types import Json

_GRIDS = Path(os.environ.get("WAYCHAIR_DATA", "")) / "mapf"
_SHORT = (
    ("random-32-32-20", 50, 1.07),
    ("random-32-32-20", 100, 1.13),
    ("room-32-32-4", 50, 1.08),
    ("empty-16-16", 60, 1.03),
)
"""Grid, agents, and the most that the sum of costs may be over its bound after three seconds."""

_LARGE = (("den312d", 200), ("warehouse-10-20-10-2-1", 200))


def fleet_mapf(out: Path) -> Json:
    """Sum of costs over bound after 3 s: at most 1.03 to 1.13; a first valid answer in 0.5 s, 200 agents in 5 s."""
    load_kernels()
    found: dict[str, Json] = {}
    passed = True
    for name, agents, most in _SHORT:
        task = _task(name, agents)
        answer = solved(task, 3.0)
        ratio = answer.sum_of_costs / answer.bound
        good = fault(task, answer.paths) == "" and ratio <= most and answer.first_ms <= 500.0
        found[f"{name} {agents}"] = {
            "sum_of_costs": answer.sum_of_costs,
            "bound": answer.bound,
            "ratio": round(ratio, 4),
            "most": most,
            "first_ms": round(answer.first_ms, 1),
        }
        passed &= good
    for name, agents in _LARGE:
        task = _task(name, agents)
        answer = solved(task, 5.0)
        passed &= fault(task, answer.paths) == "" and answer.first_ms <= 5000.0
        ratio = answer.sum_of_costs / answer.bound
        found[f"{name} {agents}"] = {"ratio": round(ratio, 4), "first_ms": round(answer.first_ms, 1)}
    return {"passed": passed, **found}


def _task(name: str, agents: int) -> Task:
    queries = load_queries(_GRIDS / f"{name}.scen")[:agents]
    free = load_free_cells(_GRIDS / f"{name}.map")
    return task_of_cells(free, [query.start for query in queries], [query.goal for query in queries])
