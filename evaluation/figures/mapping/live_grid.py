"""The grid of a live mapping: its processor time beside the mapper's, its longest call, its delay after a closure."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluation.figures.mapping.logs import DATA
from waychair.offline.mapping import MappingSettings, map_recording
from waychair.recordings.recording import Recording, read_recording
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.types import FloatArray, Json

LOG = "lidar_intel/intel_first1088s.clf.gz"
MOST_MS = 20.0


def live_grid(out: Path) -> Json:
    """Intel: the grid takes at most the mapper's CPU time, no call over 20 ms, and equals the map of `waychair map`."""
    recording, settings = read_recording(DATA / LOG), MappingSettings()
    _drive(
        Recording(recording.path, recording.frames[:200], recording.base_from_laser, ""), settings
    )  # load the kernels
    live, mapper_ms, draw_ms, pending = _drive(recording, settings)
    copy_ms = _copying(live)
    result = live.settle()
    grid, mapped = live.grid(), map_recording(recording, settings).grid
    same = grid.map_from_grid == mapped.map_from_grid and np.array_equal(grid.cells, mapped.cells)
    figures = {
        "mapper_ms_mean": float(mapper_ms.mean()),
        "grid_ms_mean": float(draw_ms.mean()),
        "grid_ms_p99": float(np.quantile(draw_ms, 0.99)),
        "grid_ms_max": float(draw_ms.max()),
        "copy_ms": copy_ms,
    }
    passed = same and draw_ms.mean() <= mapper_ms.mean() and max(draw_ms.max(), copy_ms) <= MOST_MS
    return {
        "passed": bool(passed),
        "same_as_map": bool(same),
        **{name: round(value, 3) for name, value in figures.items()},
        "scans_in_grid": len(result.scan_frames),
        "most_pending": int(pending.max()),
        "frames_to_follow_a_closure": _longest_run(pending > 0),
        "frames": len(pending),
    }


def _drive(
    recording: Recording, settings: MappingSettings
) -> tuple[LiveMapping, FloatArray, FloatArray, NDArray[np.int64]]:
    """Map all frames; return CPU time of mapper and grid [ms], and the scans still to move, after each frame."""
    live = LiveMapping(settings, recording.base_from_laser)
    mapper, drawing, pending = [], [], []
    for frame in recording.frames:
        reckoned, started, kept = live.reckon(frame), time.process_time(), live.seconds["grid"]
        live.include(reckoned)
        live.draw()
        grid = live.seconds["grid"] - kept
        mapper.append(time.process_time() - started - grid)
        drawing.append(grid)
        pending.append(live.pending)
    return live, 1e3 * np.array(mapper), 1e3 * np.array(drawing), np.array(pending)


def _copying(live: LiveMapping) -> float:
    """Return the median CPU time [ms] of a copy of the whole grid."""
    times = []
    for _ in range(9):
        started = time.process_time()
        live.grid()
        times.append(time.process_time() - started)
    return 1e3 * float(np.median(times))


def _longest_run(flags: NDArray[Any]) -> int:
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
