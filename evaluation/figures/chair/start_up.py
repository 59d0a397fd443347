"""`waychair --help` under half a second: median of ten runs of the whole process."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

from waychair.types import Json

RUNS = 10


def run(out: Path) -> Json:
    """Wall time of `waychair --help` [s]."""
    command = [str(Path(sys.executable).parent / "waychair"), "--help"]
    times = []
    for _ in range(RUNS + 1):
        started = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - started)
    median = statistics.median(times[1:])
    return {"passed": median < 0.5, "median_s": round(median, 3), "max_s": round(max(times[1:]), 3)}
