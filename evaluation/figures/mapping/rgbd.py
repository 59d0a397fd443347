"""Real colour and depth, mapped by the `waychair map` command and scored by the metric shipped with the recordings.

Without a bar: the same recordings with missing frames, noisy depth, black frames, and a gap.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from evaluation.figures.mapping.logs import DATA
from waychair.recordings.recording import read_recording, write_tum
from waychair.recordings.rgbd_folders import read_truth
from waychair.slam.rgbd.rgbd_mapper import RgbdMapper
from waychair.types import Float32Array, Json, RgbdFrame, Trajectory3

Worse = Callable[[list[RgbdFrame]], list[RgbdFrame]]
ATE_M, FRAME_MS = 0.03, 75.0


def tum_rpy(out: Path) -> Json:
    """TUM fr1/rpy, first 14 s: ATE <= 0.03 m (RTAB-Map on this file: 0.043), <= 75 ms of one core a frame."""
    return _scored(out, "rgbd_tum_fr1_rpy_head")


def tsdf_sample(out: Path) -> Json:
    """50 frames of a kitchen: poses within 0.03 m of the data set's own, <= 75 ms of one core a frame."""
    return _scored(out, "rgbd_tsdf_sample50")


def _scored(out: Path, name: str) -> Json:
    folder, made = DATA / name, out.with_suffix("")
    truth = made / "truth.tum"
    command = [str(Path(sys.executable).parent / "waychair"), "map", str(folder), "--out", str(made), "--quiet"]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")
    for _ in range(2):  # the first run may compile the kernels
        subprocess.run(command, check=True, env={**os.environ, **threads})
    report = json.loads((made / "report.json").read_text())
    write_tum(truth, read_truth(folder))
    errors = _error(made / "trajectory.tum", truth)
    figures = {
        "ate_m": round(errors["rmse_m"], 4),
        "ate_max_m": round(errors["max_m"], 4),
        "placed": report["placed"],
        "pictures": report["pictures"],
        "frame_cpu_ms": report["frame_ms"]["mean"],
        "frame_cpu_p95_ms": report["frame_ms"]["p95"],
        "key_frames": report["counts"]["key_frames"],
        "loops": report["counts"]["loops"],
        "states": report["states"],
    }
    passed = (
        errors["rmse_m"] <= ATE_M
        and report["frame_ms"]["mean"] <= FRAME_MS
        and report["placed"] >= 0.99 * report["pictures"]
    )
    return {"passed": passed, **figures, "worse": _worse_rows(made, folder, truth)}


def _error(trajectory: Path, truth: Path) -> Json:
    tool = DATA.parent / "tools" / "trajectory_error.py"
    command = [sys.executable, str(tool), "ate", str(trajectory), str(truth)]
    return dict(json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout))


def _worse_rows(made: Path, folder: Path, truth: Path) -> list[Json]:
    frames, rows = list(read_recording(folder).pictures()), []
    for name, worse in _WORSE.items():
        mapper = RgbdMapper()
        for frame in worse(frames):
            mapper.process(frame)
        result = mapper.result()
        trajectory: Trajectory3 = result.trajectory
        path = made / f"{name.replace(' ', '_')}.tum"
        write_tum(path, trajectory)
        errors = _error(path, truth)
        row = {"frames": len(worse(frames)), "placed": len(trajectory.stamps_ns), "states": result.states}
        row |= {"pieces": len(set(result.pieces)), "loops": len(result.loops)}
        rows.append({"row": name, "ate_m": round(errors["rmse_m"], 4), "max_m": round(errors["max_m"], 4), **row})
    return rows


def _noisy(frames: list[RgbdFrame]) -> list[RgbdFrame]:
    """Return frames with depth noise of 0.5 % of the squared depth, about twice the sensor's."""
    rng = np.random.default_rng(1)

    def disturbed(depth: Float32Array) -> Float32Array:
        return depth + rng.normal(0.0, 0.005, depth.shape).astype(np.float32) * depth**2

    return [replace(frame, depth=disturbed(frame.depth)) for frame in frames]


def _some_black(seed: int) -> Worse:
    def worse(frames: list[RgbdFrame]) -> list[RgbdFrame]:
        black = np.random.default_rng(seed).random(len(frames)) < 0.2
        return [replace(f, image=np.zeros_like(f.image)) if b else f for f, b in zip(frames, black, strict=True)]

    return worse


def _gone(frames: list[RgbdFrame]) -> list[RgbdFrame]:
    """Return the frames without the middle fifth."""
    middle, half = len(frames) // 2, len(frames) // 10
    return frames[: middle - half] + frames[middle + half :]


_WORSE: dict[str, Worse] = {
    "every 2nd frame": lambda frames: frames[::2],
    "every 3rd frame": lambda frames: frames[::3],
    "depth noise": _noisy,
    "a fifth black, first draw": _some_black(1),
    "a fifth black, second draw": _some_black(2),
    "a fifth black, third draw": _some_black(3),
    "camera gone for a while": _gone,
    "rows all exposed at once": lambda frames: [replace(frame, row_step=0.0) for frame in frames],
}
