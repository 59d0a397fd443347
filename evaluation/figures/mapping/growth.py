"""Mapping of very large buildings: the time of a scan, and the memory, must not grow with the building."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evaluation.figures.mapping.logs import DATA
from evaluation.scenes.long_buildings import long_drive, write_log
from waychair.files import write_json
from waychair.offline.mapping_report import tears_of
from waychair.recordings.recording import read_recording
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.slam.mapping.warm_up import warm_up
from waychair.types import FloatArray, Json, SensorFrame

LOGS = {
    "infinite_corridor": "lidar_radish_corrected/infinite-corridor-corrected.log.gz",
    "aces": "lidar_radish_corrected/aces-corrected.log.gz",
    "seattle": "lidar_radish_corrected/seattle-corrected.log.gz",
    "freiburg_campus": "lidar_radish_corrected/freiburg-campus-corrected.log.gz",
}
INTEL = "lidar_intel/intel_first1088s.clf.gz"
KEY_SCANS = 5000
MOST_GROWTH, MOST_MS, LEAST_REAL_TIME, LEAST_REAL_TIME_INTEL = 1.2, 100.0, 100.0, 250.0
MOST_MB = 350.0


@dataclass(frozen=True, slots=True)
class LiveCost:
    """The cost of a live drive: processor time of each scan [ms], key scans after it, tears at the end, and memory [MB]."""

    milliseconds: FloatArray
    key_scans: FloatArray
    tears: int
    peak_mb: float

    def tenths(self) -> list[float]:
        """Return the mean time [ms] per key scan in each tenth of the key scans."""
        tenth = np.minimum(9, (self.key_scans - 1) * 10 // self.key_scans[-1]).astype(np.int64)
        keys = np.bincount(tenth, np.diff(self.key_scans, prepend=0), 10)
        return (np.bincount(tenth, self.milliseconds, 10) / np.maximum(keys, 1)).round(3).tolist()


def growth_large(out: Path) -> Json:
    """Four logs, each driven there and back and through further wings to 5,000 key scans, and Intel.

    Bars: the last tenth of the key scans takes at most 1.2 times as long as the second, no scan of the live mapper over
    100 ms, the command takes at most a hundredth of the drive's time (Intel a 250th), memory at most 350 MB.
    `GROWTH_LOGS=aces,seattle` takes some of the logs, `GROWTH_KEY_SCANS=2000` a shorter drive.
    """
    names = os.environ.get("GROWTH_LOGS", ",".join([*LOGS, "intel"])).split(",")
    count = int(os.environ.get("GROWTH_KEY_SCANS", str(KEY_SCANS)))
    figures = {name: _building(out.with_name(f"{out.stem}_{name}"), name, count) for name in names}
    return {"passed": all(each["passed"] for each in figures.values()), **figures}


def _building(folder: Path, name: str, count: int) -> Json:
    """Return the figures of one log, live in a process of its own and by the command."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        log, told = Path(work) / "drive.log", folder / "live.json"
        path = DATA / (INTEL if name == "intel" else LOGS[name])
        child = [sys.executable, "-m", "evaluation.figures.mapping.growth", str(path), str(log), str(told)]
        subprocess.run([*child, str(count if name in LOGS else 0)], check=True)
        live = json.loads(told.read_text())
        whole = _command(path if name == "intel" else log, folder / "map")
    least = LEAST_REAL_TIME_INTEL if name == "intel" else LEAST_REAL_TIME
    passed = live["max_ms"] <= MOST_MS and whole["times_real_time"] >= least and whole["peak_mb"] <= MOST_MB
    grown = live["last_over_second_tenth"] <= MOST_GROWTH or name == "intel"
    return {"passed": bool(passed and grown and not live["tears"]), "live": live, "command": whole}


def _command(log: Path, folder: Path) -> Json:
    """Map a log by the command; return its processor time beside the drive's, and its memory."""
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


def drive_live(path: Path, log: Path, count: int) -> LiveCost:
    """Drive through the building of a log until there are so many key scans, and write the drive; 0: the log itself."""
    recording = read_recording(path)
    warm_up()
    live = LiveMapping(LiveMappingSettings(), recording.base_from_laser)
    rows, frames = [], list[SensorFrame]()
    for frame in long_drive(recording) if count else recording.frames:
        started = time.process_time()
        live.process(frame)
        rows.append((1e3 * (time.process_time() - started), len(live.mapper.keys)))
        if count:
            frames.append(frame)
        if count and len(live.mapper.keys) >= count:
            break
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    write_log(log, frames)
    milliseconds, keys = np.array(rows).T
    return LiveCost(milliseconds, keys, len(tears_of(live.mapper.result())), peak_mb)


def _told(cost: LiveCost) -> Json:
    tenths = cost.tenths()
    return {
        "scans": len(cost.milliseconds),
        "key_scans": int(cost.key_scans[-1]),
        "mean_ms": round(float(cost.milliseconds.mean()), 3),
        "p99_ms": round(float(np.quantile(cost.milliseconds, 0.99)), 2),
        "max_ms": round(float(cost.milliseconds.max()), 1),
        "scans_over_100_ms": int((cost.milliseconds > MOST_MS).sum()),
        "ms_per_key_scan_by_tenth": tenths,
        "last_over_second_tenth": round(tenths[9] / tenths[1], 3),
        "tears": cost.tears,
        "peak_mb": round(cost.peak_mb, 1),
    }


if __name__ == "__main__":
    write_json(Path(sys.argv[3]), _told(drive_live(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[4]))))
