"""Runs by the hundred, spread over the processors, and kept as they end: a measurement of hours may be interrupted.

What is kept is kept by the code that ran, under `out/acceptance/runs/`, and only where no line of that is uncommitted:
begun again there, a measurement takes up what was done and goes on, whatever else was committed meanwhile (the page, the
nodes, the command line, tests, documents). `ACCEPTANCE_PROCESSES` in the environment takes fewer processors.
"""

from __future__ import annotations

import hashlib
import multiprocessing
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

Result = TypeVar("Result")

_HERE = Path(__file__).parents[2]


def over_seeds(name: str, run: Callable[[int], Result], count: int) -> list[Result]:
    """What a function of the seed gives for 0 to `count` - 1, in that order; it and its results can be pickled.

    name: of these runs among all that are measured; what was kept under it is not run again.
    """
    kept = _kept()
    folder = None if kept is None else kept / re.sub(r"[^\w.]+", "_", name)
    return list(_processes().map(partial(_known_or_run, folder, run), range(count)))


def processes() -> int:
    """How many runs go on at a time."""
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
    """Of the code that runs; empty where it was changed since, or there is none."""
    try:
        changes = _git("status", "--porcelain")
        return "" if changes else _git("rev-parse", "--short=12", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        return ""


@cache
def code() -> str:
    """Of all that a run consists of, by its content; empty where any of it was changed since, or there is no commit."""
    try:
        if _git("status", "--porcelain", "--", *_RUNS):
            return ""
        trees = _git("rev-parse", *(f"HEAD:{path}" for path in _RUNS))
        return hashlib.sha256(trees.encode()).hexdigest()[:12]
    except (OSError, subprocess.CalledProcessError):
        return ""


_RUNS = (
    "benchmarks", "calibration", "control", "firmware_bridge", "maps", "planning", "pyproject.toml", "runtime",
    "simulation", "slam", "src", "trials",
)  # fmt: skip
"""What runs where something is driven or mapped without nodes, page and command line."""


def _kept() -> Path | None:
    """Where the runs of this code are kept; None where that would not say which code ran."""
    return Path("out") / "acceptance" / "runs" / code() if code() else None


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=_HERE, check=True, capture_output=True, text=True).stdout.strip()


@cache
def _processes() -> ProcessPoolExecutor:
    """For all that is measured; each starts afresh, for a renderer does not survive a fork."""
    return ProcessPoolExecutor(processes(), multiprocessing.get_context("spawn"))
