"""Mapping: simulated floors, very long logs, and very large buildings."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from evaluation.figures.mapping.logs import DATA
from evaluation.runs.long_drives import SLOW_MS, command_figures, live_figures
from evaluation.scenes.maps.map_score import wall_agreement
from waychair.maps.folders.map_files import load_map
from waychair.recordings.recording import read_recording, read_tum
from waychair.simulation.plan.world import load_world
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.trajectory_errors import truth_errors
from waychair.trials.record import true_trajectory
from waychair.types import Json

PASSES = 10
_INTEL = "lidar_intel/intel_first1088s.clf.gz"
LARGE = {
    "infinite_corridor": "lidar_radish_corrected/infinite-corridor-corrected.log.gz",
    "aces": "lidar_radish_corrected/aces-corrected.log.gz",
    "seattle": "lidar_radish_corrected/seattle-corrected.log.gz",
    "freiburg_campus": "lidar_radish_corrected/freiburg-campus-corrected.log.gz",
    "intel": _INTEL,
}
KEY_SCANS = 5000
_MOST_GROWTH, _MOST_MB = 1.2, 350.0
_REAL_TIME, _REAL_TIME_INTEL = 100.0, 250.0


def sim_mapping(out: Path) -> Json:
    """Simulated second_floor and basement, people walking: ATE <= 0.10 m, 95 % of the map's walls within 5 cm.

    Without a bar: the share of true wall faces that the map shows. Some faces border free space that was only seen by
    beams parallel to them.
    """
    floors = {world: _mapped_floor(world) for world in ("second_floor", "basement")}
    passed = all(floor["ate_m"] <= 0.10 and floor["walls_true"] >= 0.95 for floor in floors.values())
    figures = {f"{world}_{name}": value for world, floor in floors.items() for name, value in floor.items()}
    return {"passed": passed, **figures}


def _mapped_floor(world: str) -> Json:
    """Run the two commands of a user, and compare the map with its world."""
    waychair = str(Path(sys.executable).parent / "waychair")
    with tempfile.TemporaryDirectory() as folder:
        bag, made = Path(folder) / "drive.mcap", Path(folder) / "map"
        record = [waychair, "simulate", "--world", world, "--no-camera", "--record", str(bag), "--quiet"]
        subprocess.run(record, check=True)
        subprocess.run([waychair, "map", str(bag), "--out", str(made), "--quiet"], check=True)
        truth = true_trajectory(bag)
        trajectory, grid = read_tum(made / "trajectory.tum"), load_map(made)
    errors = truth_errors(trajectory, truth)
    walls = wall_agreement(grid, load_world(world).grid, errors.truth_from_map, 0.05)
    return {
        "ate_m": round(errors.rmse_m, 4),
        "ate_max_m": round(errors.errors.max_m, 4),
        "walls_true": round(walls.true_cells, 4),
        "walls_found": round(walls.found_faces, 4),
    }


def growth(out: Path) -> Json:
    """The Intel log forward and back ten times: the time per scan must not grow with the length of the log."""
    recording = read_recording(DATA / _INTEL)
    there = recording.frames
    mapper, rows = Mapper(MapperSettings(), recording.base_from_laser), []
    for number in range(PASSES):
        started = time.process_time()
        for frame in there if number % 2 == 0 else there[::-1]:
            mapper.process(frame)
        milliseconds = 1e3 * (time.process_time() - started) / len(there)
        rows.append({"pass": number + 1, "ms_per_scan": round(milliseconds, 3), "key_scans": len(mapper.keys)})
    _plot_growth(out.with_suffix(".png"), rows)
    first, last = rows[0]["ms_per_scan"], float(np.mean([row["ms_per_scan"] for row in rows[-3:]]))
    return {"passed": last <= first, "first_ms": first, "last_ms": round(last, 3), "rows": rows}


def growth_large(out: Path) -> Json:
    """Four logs, each driven there and back and through further wings to 5,000 key scans, and Intel as it is.

    Bars: the last tenth of the key scans takes at most 1.2 times as long as the second, no scan of the live mapper over
    100 ms, no tear, at most 350 MB, and the command at most a hundredth of the drive's time (Intel: a 250th).
    `GROWTH_LOGS=aces,seattle` takes some of the logs, `GROWTH_KEY_SCANS=2000` shorter drives.
    """
    names = os.environ.get("GROWTH_LOGS", ",".join(LARGE)).split(",")
    count = int(os.environ.get("GROWTH_KEY_SCANS", str(KEY_SCANS)))
    rows = {name: _large_building(out.with_name(f"{out.stem}_{name}"), name, count) for name in names}
    return {"passed": all(row["passed"] for row in rows.values()), **rows}


def _large_building(folder: Path, name: str, count: int) -> Json:
    folder.mkdir(parents=True, exist_ok=True)
    is_intel, path = name == "intel", DATA / LARGE[name]
    with tempfile.TemporaryDirectory() as work:
        drive = Path(work) / "drive.log"
        live = live_figures(path, drive, folder / "live.json", 0 if is_intel else count)
        whole = command_figures(path if is_intel else drive, folder / "map")
    flat = is_intel or live["last_over_second_tenth"] <= _MOST_GROWTH
    quick = whole["times_real_time"] >= (_REAL_TIME_INTEL if is_intel else _REAL_TIME) and live["max_ms"] <= SLOW_MS
    lean = max(live["peak_mb"], whole["peak_mb"]) <= _MOST_MB
    whole_map = not live["tears"] and not whole["tears"]
    return {"passed": bool(flat and quick and lean and whole_map), "live": live, "command": whole}


def _plot_growth(path: Path, rows: list[Json]) -> None:
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
    passes = [row["pass"] for row in rows]
    axes.plot(passes, [row["ms_per_scan"] for row in rows], "o-")
    axes.set(xlabel="pass over the log", ylabel="CPU per scan [ms]", ylim=(0, None))
    nodes = axes.twinx()
    nodes.plot(passes, [row["key_scans"] for row in rows], "s--", color="grey")
    nodes.set(ylabel="key scans in the graph", ylim=(0, 1.2 * max(row["key_scans"] for row in rows)))
    figure.savefig(path, dpi=120)
    plt.close(figure)
