"""Start-up times of whole commands: median of ten runs with byte code and kernels in their caches, first runs apart.

    python -m evaluation.speed.start_up [first]

The log is the first hundred scans of a simulated drive through a flat, the plan leads over its map. `first` also measures
the runs after an installation, each with an empty kernel cache.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from evaluation.corruptions.log_faults import write_log
from waychair.recordings.recording import read_tum

RUNS, SCANS = 10, 100
_COMMAND = (sys.executable, "-c", "from waychair.cli.main import main; main()")


def timed(words: tuple[str, ...], **environment: str) -> tuple[float, float]:
    """Run a command; return its wall clock and processor time [s]."""
    env = {**os.environ, **environment}
    env.pop("PYTHONDONTWRITEBYTECODE", None)
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(words, check=True, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def short_log(path: Path) -> Path:
    """Write a log of a hundred scans in a room, with odometry; return its path."""
    write_log(path)
    lines, kept = path.read_text().splitlines(keepends=True), 0
    for number, line in enumerate(lines):
        kept += line.startswith(("FLASER", "ROBOTLASER"))
        if kept == SCANS:
            path.write_text("".join(lines[: number + 1]))
            return path
    raise AssertionError(f"the drive has only {kept} scans")


def commands(folder: Path) -> dict[str, tuple[str, ...]]:
    """Return the measured commands by name; the plan's needs the folder of the map's."""
    log, made = short_log(folder / "short.log"), folder / "map"
    mapping = (*_COMMAND, "map", str(log), "--out", str(made))
    timed(mapping)
    poses = read_tum(made / "trajectory.tum").poses
    ends = [f"{x:.2f},{y:.2f},{theta:.2f}" for x, y, theta in (poses[0], poses[len(poses) // 2])]
    return {
        "Python": (sys.executable, "-c", "pass"),
        "numba alone": (sys.executable, "-c", "import numba"),
        "waychair --help": (*_COMMAND, "--help"),
        f"map of {SCANS} scans": mapping,
        "plan on its map": (*_COMMAND, "plan", "--map", str(made), "--start", ends[0], "--goal", ends[1]),
    }


def main(first: bool) -> None:
    """Print a row a command: medians and the least wall clock and processor times."""
    with tempfile.TemporaryDirectory() as folder:
        for name, words in commands(Path(folder)).items():
            timed(words)
            wall, cpu = zip(*(timed(words) for _ in range(RUNS)), strict=True)
            row = f"{name:20s} wall {statistics.median(wall):5.2f} s (least {min(wall):5.2f})"
            row += f"   processor {statistics.median(cpu):5.2f} s (least {min(cpu):5.2f})"
            if first and "waychair.cli" in words[2]:
                row += f"   first {timed(words, NUMBA_CACHE_DIR=tempfile.mkdtemp(dir=folder))[0]:6.1f} s"
            print(row, flush=True)


if __name__ == "__main__":
    main("first" in sys.argv[1:])
