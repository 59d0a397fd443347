"""The cost of mapping a long drive, live and by the command: the time of each scan, and memory, in a process of its own.

`python -m evaluation.runs.long_drives LOG DRIVE FIGURES KEY_SCANS` drives through the building of a log until there are so many
key scans (0: the log itself), writes the drive as a log, and the figures as JSON.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evaluation.scenes.maps.long_buildings import long_drive, write_log
from waychair.files import write_json
from waychair.garbage import leave_out_present
from waychair.kernel_cache import load_lightly
from waychair.offline.mapping_report import tears_of
from waychair.recordings.recording import read_recording
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.slam.mapping.mapper_warm_up import warm_up
from waychair.types import FloatArray, IntArray, Json, SensorFrame

SLOW_MS = 100.0
"""Time of a scan [ms] from which it is counted as slow."""


@dataclass(frozen=True, slots=True)
class LiveCost:
    """The cost of a live drive: processor time (N,) of each scan [ms], number of key scans (N,) after it, tears at the end, and
    memory [MB]."""

    milliseconds: FloatArray
    key_scans: IntArray
    tears: int
    peak_mb: float

    def tenths(self) -> list[float]:
        """Return the mean time [ms] of the scans that became key scans, in each tenth of them.

        On known ground no scan becomes one; there the time depends on the drive and not on the size of the map.
        """
        new = np.diff(self.key_scans, prepend=0) > 0
        tenth = np.minimum(9, (self.key_scans[new] - 1) * 10 // self.key_scans[-1])
        mean: list[float] = (
            (np.bincount(tenth, self.milliseconds[new], 10) / np.bincount(tenth, None, 10)).round(3).tolist()
        )
        return mean

    def figures(self) -> Json:
        """Return the cost in figures."""
        tenths, slow = self.tenths(), self.milliseconds > SLOW_MS
        return {
            "scans": len(self.milliseconds),
            "key_scans": int(self.key_scans[-1]),
            "mean_ms": round(float(self.milliseconds.mean()), 3),
            "p99_ms": round(float(np.quantile(self.milliseconds, 0.99)), 2),
            "max_ms": round(float(self.milliseconds.max()), 1),
            "slow_scans": int(slow.sum()),
            "ms_per_key_scan_by_tenth": tenths,
            "last_over_second_tenth": round(tenths[9] / tenths[1], 3),
            "tears": self.tears,
            "peak_mb": round(self.peak_mb, 1),
        }


def live_figures(recording: Path, drive: Path, figures: Path, key_scans: int) -> Json:
    """Return the figures of a live drive in a process of its own; see `drive_live` for the arguments."""
    arguments = [str(recording), str(drive), str(figures), str(key_scans)]
    subprocess.run([sys.executable, "-m", "evaluation.runs.long_drives", *arguments], check=True)
    return dict(json.loads(figures.read_text()))


def command_figures(log: Path, folder: Path) -> Json:
    """Map a log by the command; return its processor time beside the drive's, its memory, and the tears."""
    waychair = str(Path(sys.executable).parent / "waychair")
    before = os.times()
    subprocess.run([waychair, "map", str(log), "--out", str(folder), "--quiet"], check=True)
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    report = json.loads((folder / "report.json").read_text())
    return {
        "cpu_s": round(cpu, 2),
        "times_real_time": round(report["duration_s"] / cpu, 1),
        "peak_mb": report["peak_memory_mb"],
        "tears": len(report["tears"]),
    }


def drive_live(path: Path, drive: Path, key_scans: int) -> LiveCost:
    """Drive through the building of a log until there are so many key scans, and write the drive; 0: the log itself."""
    load_lightly()
    recording = read_recording(path)
    warm_up()
    live = LiveMapping(LiveMappingSettings(), recording.base_from_laser)
    leave_out_present()  # as the nodes of a chair do
    milliseconds, keys, frames = list[float](), list[int](), list[SensorFrame]()
    for frame in long_drive(recording) if key_scans else recording.frames:
        started = time.process_time()
        live.process(frame)
        milliseconds.append(1e3 * (time.process_time() - started))
        keys.append(len(live.mapper.keys))
        if key_scans:
            frames.append(frame)
            if keys[-1] >= key_scans:
                break
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    if frames:
        write_log(drive, frames)
    return LiveCost(np.array(milliseconds), np.array(keys, np.int64), len(tears_of(live.mapper.result())), peak_mb)


if __name__ == "__main__":
    write_json(Path(sys.argv[3]), drive_live(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[4])).figures())
