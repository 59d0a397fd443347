"""The BARN benchmark: its robot at two speeds, and a chair in scaled worlds, without a map."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from evaluation.figures.mapping.logs import DATA
from evaluation.runs.kept_runs import over_seeds
from waychair.trials.barn import BarnRun, BarnTask, report, run_worlds, worlds_in
from waychair.types import Json

STARTS = 5


def barn(out: Path) -> Json:
    """200 worlds by 5 starts at 0.5 m/s: success >= 97 %, contact <= 1 %, score >= 0.26 (move_base's DWA: 0.159)."""
    found = figures(BarnTask())
    return {"passed": found["success"] >= 0.97 and found["contact"] <= 0.01 and found["score"] >= 0.26, **found}


def barn_fast(out: Path) -> Json:
    """The same at 2 m/s: score >= 0.40 (best page seen: 0.368)."""
    found = figures(BarnTask(speed=2.0))
    return {"passed": found["score"] >= 0.40, **found}


def barn_chair(out: Path) -> Json:
    """Worlds 1.63 times as large, chair A at 0.8 m/s: success >= 95 %, no contact."""
    found = figures(BarnTask(body="A", speed=0.8, scale=1.63))
    return {"passed": found["success"] >= 0.95 and found["contact"] == 0.0, **found}


def figures(task: BarnTask, worlds: int | None = None, starts: int = STARTS) -> Json:
    """Return the report over all worlds."""
    task = BarnTask(body=task.body, speed=task.speed, scale=task.scale, starts=starts)
    paths = worlds_in(DATA / "barn", worlds)
    found = over_seeds(f"barn {task} of {len(paths)}", partial(_in_world, paths, task), len(paths))
    return report([run for runs in found for run in runs], task)


def _in_world(paths: Sequence[Path], task: BarnTask, index: int) -> list[BarnRun]:
    return run_worlds([paths[index]], task)
