"""Hundreds of runs, spread over the processors and stored as they end, so that a long measurement can be interrupted.

Results are stored under `out/acceptance/runs/` by the content of the code that ran, if all of it is committed. A
restarted measurement reuses them, even after commits of other parts (page, nodes, command line, tests, documents). The
environment variable `ACCEPTANCE_PROCESSES` reduces the number of processes.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import subprocess
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

from waychair.files import write_bytes
from waychair.trials.worker_pool import new_pool

Result = TypeVar("Result")

_HERE = Path(__file__).parents[2]


def over_seeds(name: str, run: Callable[[int], Result], count: int) -> list[Result]:
    """Return a function's results for the seeds 0 to `count` - 1, in order; it and its results must be picklable.

    `name` identifies these runs; stored results under it are not run again.
    """
    return list(_lasting_pool().map(partial(_known_or_run, kept_folder(name), run), range(count)))


def kept_folder(name: str) -> Path | None:
    """Return the folder for the results of runs of this code; None if the code cannot be identified."""
    kept = _kept()
    return None if kept is None else kept / re.sub(r"[^\w.]+", "_", name)


def figure_pool() -> ProcessPoolExecutor:
    """Return fresh processes for the runs of a figure."""
    return new_pool(processes())


def processes() -> int:
    """Return the number of parallel runs."""
    return int(os.environ.get("ACCEPTANCE_PROCESSES", str(os.cpu_count() or 1)))


def _known_or_run(folder: Path | None, run: Callable[[int], Result], seed: int) -> Result:
    if folder is None:
        return run(seed)
    path = folder / f"{seed}.pickle"
    if path.exists():
        known: Result = pickle.loads(path.read_bytes())
        return known
    result = run(seed)
    write_bytes(path, pickle.dumps(result))
    return result


@cache
def commit() -> str:
    """Return the commit of the running code; empty if the code has uncommitted changes or there is no commit."""
    try:
        changes = _git("status", "--porcelain")
        return "" if changes else _git("rev-parse", "--short=12", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        return ""


@cache
def code() -> str:
    """Return the content hash of all code of a run; empty if any of it is uncommitted or there is no commit."""
    try:
        if _git("status", "--porcelain", "--", *_RUNS):
            return ""
        trees = _git("rev-parse", *(f"HEAD:{path}" for path in _RUNS))
        return hashlib.sha256(trees.encode()).hexdigest()[:12]
    except (OSError, subprocess.CalledProcessError):
        return ""


_RUNS = (
    "calibration", "control", "evaluation", "firmware_bridge", "maps", "offline", "planning", "pyproject.toml", "recordings", "runtime",
    "simulation", "slam", "src", "trials",
)  # fmt: skip
"""The folders of code that runs in drives and mapping, without nodes, page and command line."""


def _kept() -> Path | None:
    """Return the folder for the results of this code; None if the code cannot be identified."""
    return Path("out") / "acceptance" / "runs" / code() if code() else None


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=_HERE, check=True, capture_output=True, text=True).stdout.strip()


@cache
def _lasting_pool() -> ProcessPoolExecutor:
    """Return the processes of all runs that are kept."""
    return figure_pool()
