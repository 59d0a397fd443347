"""A chair that is carried while it maps, by splices of real logs, and real drives in which no chair was carried."""

from __future__ import annotations

import dataclasses
import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from evaluation.figures.mapping.logs import DATA
from evaluation.scenes.maps.spliced_drives import odometry_in, spliced, with_odometry
from waychair.geometry import compose, invert
from waychair.offline.mapping_report import tears_of, torn_warnings
from waychair.recordings.recording import Recording, read_recording
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.slam.trajectory_errors import Relations, read_relations, relation_errors
from waychair.types import FloatArray, IntArray, Json, Pose2, SensorFrame

SPLICES = 10
_RADISH = "lidar_radish_corrected/{}-corrected.log.gz"
LOGS = {
    "intel": "lidar_intel/intel_first1088s.clf.gz",
    "fr079": "lidar_fr079/fr079_laser.clf.gz",
    "exp1": "lidar_coreslam/exp1.dat.gz",
    "exp2": "lidar_coreslam/exp2.dat.gz",
    "sena": "wheelchair_sena/sena_one_loop.clf.gz",
    "aces": _RADISH.format("aces"),
    "seattle": _RADISH.format("seattle"),
    "freiburg_101": _RADISH.format("freiburg-101"),
    "freiburg_campus": _RADISH.format("freiburg-campus"),
    "infinite_corridor": _RADISH.format("infinite-corridor"),
}
_RELATIONS = {
    "intel": "lidar_intel/intel_first1088s.relations.gz",
    "fr079": "lidar_fr079/fr079.relations.gz",
}
_MOST_M, _MOST_AGAINST_OWN_M = (
    0.10,
    0.5,
)  # [m] mean error across loops of a map that was repaired; the own map errs, too
_MOST_APART, _PAIRS = 2.0, 2000  # [m] between two poses that are compared across a splice, and their greatest number
_KNOWN_GROUND = 1.0  # [m] of a way from an earlier one
_WITHOUT_ODOMETRY = ("intel", "fr079", "exp1", "exp2")
_WAY_NOISE, _TURN_NOISE = 0.05, math.radians(1.0)  # standard deviations: share of the way, [rad] after one metre


def carried(out: Path) -> Json:
    """A chair carried during mapping, by random splices of real logs: 16 of 20 maps are repaired and right.

    The odometry does not show the splice. A splice is repaired if the relations across loops are as good as in the
    original log, known if the report says that a part is not joined, or by odometry alone, and silently wrong otherwise. A log without
    published relations is compared with its own map without a splice. Parts of which neither returns to the other's ground
    cannot be joined: `returned_m` is the way after the splice within 1 m of the way before it. `CARRIED_SEED=7` takes other
    splices, `CARRIED_SPLICES=20` more of each log, `CARRIED_LOGS=aces,exp1` other logs.
    """
    seed, count = int(os.environ.get("CARRIED_SEED", "2026")), int(os.environ.get("CARRIED_SPLICES", str(SPLICES)))
    names = os.environ.get("CARRIED_LOGS", "intel,fr079").split(",")
    rng, counts = np.random.default_rng(seed), Counter[str](mended=0, known=0, wrong=0)
    rows = []
    for name in names:
        log = _SplicedLog(name)
        for _ in range(count):
            cut, on = log.draw(rng)
            verdict, error = log.verdict(cut, on)
            counts[verdict] += 1
            rows.append(
                {
                    "log": name,
                    "cut": cut,
                    "on": on,
                    "verdict": verdict,
                    "across_loops_m": round(error, 4),
                    "returned_m": round(log.returned(cut, on), 1),
                }
            )
            print(rows[-1], flush=True)
    return {"passed": counts["mended"] >= 0.8 * len(rows) and not counts["wrong"], **counts, "rows": rows}


class _SplicedLog:
    """A log, and what its map should be."""

    def __init__(self, name: str) -> None:
        self.recording = read_recording(DATA / LOGS[name])
        self._relations: Relations | None = None
        if name in _RELATIONS:
            self._relations = read_relations(DATA / _RELATIONS[name])
        self._whole = mapper_over(self.recording, self.recording.frames).result()

    def draw(self, rng: np.random.Generator) -> tuple[int, int]:
        """Return the number of the frame at which the chair is lifted, and of that at which it is put down."""
        count = len(self.recording.frames)
        if self._relations is not None:
            cut = int(rng.integers(800, count - 2200))
            return cut, cut + int(rng.integers(400, count - cut - 1500))
        cut = int(rng.integers(count // 4, count // 2))
        return cut, cut + int(rng.integers(count // 10, count // 4))

    def verdict(self, cut: int, on: int) -> tuple[str, float]:
        """Return whether the map of a splice is mended, known to be torn, or wrong, and its error across loops [m]."""
        frames = self.recording.frames
        result = mapper_over(self.recording, spliced(frames[:cut], frames[on:])).result()
        if self._relations is not None:
            error, limit = relation_errors(result.trajectory, self._relations).loop.mean_m, _MOST_M
        else:
            error, limit = self._error_across(result, cut, on), _MOST_AGAINST_OWN_M
        if error < limit:
            return "mended", error
        told = "is not joined", "odometry alone joins"
        known = any(words in warning for warning in torn_warnings(result) for words in told)
        return "known" if known else "wrong", error

    def returned(self, cut: int, on: int) -> float:
        """Return the way [m] after the splice that lies within 1 m of the way before it, on the map without a splice."""
        positions = self._whole.trajectory.poses[:, :2]
        before, after = positions[:cut], positions[on:]
        away, _ = KDTree(before).query(after[1:])
        steps = np.hypot(*np.diff(after, axis=0).T)
        return float(steps[away < _KNOWN_GROUND].sum())

    def _error_across(self, result: MapperResult, cut: int, on: int) -> float:
        """Return the mean difference [m] from the map without a splice, of poses near each other on its two sides."""
        truth, found = self._whole.trajectory.poses, result.trajectory.poses  # a pose for every frame, in order
        i, j = _nearest_pairs(truth[:cut], truth[on:])
        wanted = compose(invert(truth[:cut][i]), truth[on:][j])
        got = compose(invert(found[:cut][i]), found[cut:][j])
        return float(np.hypot(*(got - wanted)[:, :2].T).mean())


def _nearest_pairs(a: FloatArray, b: FloatArray) -> tuple[IntArray, IntArray]:
    """Return indices of poses (N, 3) and (M, 3) within 2 m of each other, or of the nearest ones."""
    apart = np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])
    order = np.argsort(apart, axis=None)[: max(_PAIRS, int((apart < _MOST_APART).sum()))]
    chosen = order[:: max(len(order) // _PAIRS, 1)]
    i, j = np.unravel_index(chosen, apart.shape)
    return i, j


def mapper_over(recording: Recording, frames: Iterable[SensorFrame]) -> Mapper:
    """Return the mapper of a recording's lidar after these frames."""
    mapper = Mapper(MapperSettings(), recording.base_from_laser)
    for frame in frames:
        mapper.process(frame)
    mapper.end_searches()
    return mapper


def false_tears(out: Path) -> Json:
    """Real drives in which no chair was carried: no tear, with clean odometry, with noise, and with none at all.

    The noise is 5 % of the way and 1 degree after a metre. `FALSE_TEARS_LOGS=aces,exp1` takes some of the logs.
    """
    names = os.environ.get("FALSE_TEARS_LOGS", ",".join(LOGS)).split(",")
    rows: list[Json] = []
    for name in names:
        recording = read_recording(DATA / LOGS[name])
        drives = {"clean": recording.frames, "noise": list(_noisy(recording.frames, len(rows)))}
        if name in _WITHOUT_ODOMETRY:
            drives["no odometry"] = [dataclasses.replace(frame, wheels=(), imu=()) for frame in recording.frames]
        for odometry, frames in drives.items():
            result = mapper_over(recording, frames).result()
            tears = tears_of(result)
            rows.append({"log": name, "odometry": odometry, "tears": tears, "counts": dict(result.counts)})
            print({"log": name, "odometry": odometry, "tears": tears}, flush=True)
    return {"passed": not any(row["tears"] for row in rows), "drives": len(rows), "rows": rows}


def _noisy(frames: Sequence[SensorFrame], seed: int) -> Iterator[SensorFrame]:
    """Yield frames with odometry whose every step errs."""
    rng, pose = np.random.default_rng(seed), odometry_in(frames[0]).odom_from_base
    yield frames[0]
    for before, now in pairwise(frames):
        step = (odometry_in(before).odom_from_base.inverse() @ odometry_in(now).odom_from_base).array()
        way = math.hypot(step[0], step[1])
        step += rng.normal(0.0, 1.0, 3) * (_WAY_NOISE * way, _WAY_NOISE * way, _TURN_NOISE * math.sqrt(way))
        pose = pose @ Pose2(*step.tolist())
        yield with_odometry(now, pose)
