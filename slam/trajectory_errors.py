"""Trajectory errors, against published relative poses or against the true trajectory."""

from __future__ import annotations

import gzip
import math
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.errors import RecordingDamaged, RecordingError, RecordingNotFound
from waychair.geometry import compose, invert, wrap_angles
from waychair.recordings.stamps import stamp_from_text
from waychair.recordings.text.carmen import GZIP_MAGIC
from waychair.slam.trajectory_alignment import (
    MAX_TRUTH_GAP,
    alignment_in_plane,
    alignment_in_space,
    rotations_between,
    truth_between,
)
from waychair.types import BoolArray, FloatArray, IntArray, Pose2, Trajectory, Trajectory3

MAX_GAP = 0.02  # s; a relation whose stamp is further from every pose is left out
LOOP_TIME = 60.0  # s; relations over a longer time cross a loop


@dataclass(frozen=True, slots=True)
class Relations:
    """Reference relations: stamps_ns (N, 2), and the laser pose (N, 3) at the second stamp in that at the first."""

    stamps_ns: IntArray
    poses: FloatArray


@dataclass(frozen=True, slots=True)
class Errors:
    """Count, mean, sample standard deviation and maximum of the errors in translation [m] and in rotation [deg].

    Deviations are nan for fewer than two errors, all other values for none.
    """

    count: int
    mean_m: float
    std_m: float
    max_m: float
    mean_deg: float
    std_deg: float
    max_deg: float


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """Errors over all usable relations, the local ones, and those that cross a loop; `total` were given."""

    total: int
    every: Errors
    local: Errors
    loop: Errors


@dataclass(frozen=True, slots=True)
class TruthErrors:
    """Errors of position [m] and heading [deg] after alignment with the truth; `total` poses were given."""

    total: int
    errors: Errors
    rmse_m: float
    truth_from_map: Pose2


@dataclass(frozen=True, slots=True)
class SpaceErrors:
    """Errors of position [m] and of the whole rotation [deg] after alignment in space; `total` poses were given.

    `truth_from_map` is the alignment's matrix (4, 4), row by row.
    """

    total: int
    errors: Errors
    rmse_m: float
    truth_from_map: tuple[tuple[float, ...], ...]


def read_relations(path: Path) -> Relations:
    """Read published relations: one line `stamp1 stamp2 x y z roll pitch yaw` each, plain or gzipped.

    Raises:
        RecordingNotFound: the file does not exist.
        RecordingDamaged: a line does not hold two stamps and six finite numbers, or the file has no relation.
    """
    try:
        data = path.read_bytes()
        text = (gzip.decompress(data) if data.startswith(GZIP_MAGIC) else data).decode()
    except FileNotFoundError as error:
        raise RecordingNotFound(f"there is no relations file {path}; check the path") from error
    except (OSError, EOFError, UnicodeDecodeError, zlib.error) as error:
        raise RecordingDamaged(f"cannot read the relations {path}: {error}") from error
    stamps, poses = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            first, second = stamp_from_text(fields[0]), stamp_from_text(fields[1])
            x, y, _, _, _, yaw = (float(field) for field in fields[2:])
            if not math.isfinite(x + y + yaw):
                raise ValueError("its numbers are not finite")
        except (ValueError, IndexError) as error:
            message = f"{path} line {number} is not `stamp1 stamp2 x y z roll pitch yaw`: {error}"
            raise RecordingDamaged(message) from error
        stamps.append((first, second))
        poses.append((x, y, yaw))
    if not stamps:
        raise RecordingDamaged(f"{path} holds no relations; give a .relations file")
    return Relations(np.array(stamps, np.int64), np.array(poses))


def relation_errors(
    trajectory: Trajectory,
    relations: Relations,
    base_from_laser: Pose2 | None = None,
) -> RelationErrors:
    """Return the errors relation^-1 (p1^-1 p2) of Kuemmerle et al. 2009 (Autonomous Robots 27, eq. 6, weights 1).

    The trajectory is interpolated between its poses. Relations are between laser poses, so a trajectory of the base
    needs the mount `base_from_laser`.

    Raises:
        RecordingError: no relation has poses at both its stamps.
    """
    order = np.argsort(trajectory.stamps_ns, kind="stable")
    stamps, poses = trajectory.stamps_ns[order], trajectory.poses[order]
    if base_from_laser is not None:
        poses = compose(poses, base_from_laser.array())
    usable: BoolArray = _gaps(stamps, relations.stamps_ns).max(axis=1) <= MAX_GAP * 1e9
    if not usable.any():
        raise RecordingError(
            f"none of the {len(usable)} relations has poses within {MAX_GAP:g} s at both stamps: "
            "check that they belong to this recording"
        )
    first, second = relations.stamps_ns[usable].T
    moved = compose(invert(poses_at(stamps, poses, first)), poses_at(stamps, poses, second))
    away = compose(invert(relations.poses[usable]), moved)
    loop: BoolArray = np.abs(second - first) > LOOP_TIME * 1e9
    everything = np.ones(len(loop), bool)
    return RelationErrors(len(usable), *(_errors(away, mask) for mask in (everything, ~loop, loop)))


def truth_errors(trajectory: Trajectory, truth: Trajectory) -> TruthErrors:
    """Return the absolute trajectory error in the plane: each pose against the truth at its stamp, after alignment.

    The truth is interpolated between its poses (`truth_between`).

    Raises:
        RecordingError: fewer than three poses have a truth.
    """
    stamps, order = np.unique(truth.stamps_ns, return_index=True)
    usable, before, after, part = _usable(stamps, trajectory.stamps_ns)
    first, second = truth.poses[order[before[usable]]], truth.poses[order[after[usable]]]
    share = part[usable][:, None]
    true = first + share * np.column_stack([second[:, :2] - first[:, :2], wrap_angles(second[:, 2] - first[:, 2])])
    poses = trajectory.poses[usable]
    truth_from_map = alignment_in_plane(poses[:, :2], true[:, :2])
    aligned = compose(truth_from_map.array(), poses)
    away = np.column_stack([aligned[:, :2] - true[:, :2], wrap_angles(aligned[:, 2] - true[:, 2])])
    rmse = float(np.sqrt((away[:, :2] ** 2).sum(axis=1).mean()))
    return TruthErrors(len(usable), _errors(away, np.ones(len(away), bool)), rmse, truth_from_map)


def space_errors(trajectory: Trajectory3, truth: Trajectory3) -> SpaceErrors:
    """Return the absolute trajectory error in space, as `truth_errors` does in the plane.

    The rotation's error is the angle of the rotation between a pose and the truth.

    Raises:
        RecordingError: fewer than three poses have a truth.
    """
    stamps, order = np.unique(truth.stamps_ns, return_index=True)
    usable, before, after, part = _usable(stamps, trajectory.stamps_ns)
    first, second, share = order[before[usable]], order[after[usable]], part[usable]
    true = truth.positions[first] + share[:, None] * (truth.positions[second] - truth.positions[first])
    true_turns = rotations_between(truth.rotations[first], truth.rotations[second], share)
    positions, turns = trajectory.positions[usable], trajectory.rotations[usable]
    truth_from_map = alignment_in_space(positions, turns, true, true_turns)
    away = np.linalg.norm(positions @ truth_from_map.rotation.T + truth_from_map.translation - true, axis=1)
    between = np.swapaxes(truth_from_map.rotation @ turns, 1, 2) @ true_turns
    # from the difference to the identity, since the cosine tells nothing of small angles
    angles = 2.0 * np.arcsin(np.minimum(1.0, np.linalg.norm(between - np.eye(3), axis=(1, 2)) / math.sqrt(8.0)))
    errors = _errors(np.column_stack([away, np.zeros(len(away)), angles]), np.ones(len(away), bool))
    matrix = np.vstack([np.column_stack([truth_from_map.rotation, truth_from_map.translation]), [0.0, 0.0, 0.0, 1.0]])
    rows = tuple(tuple(row) for row in matrix.tolist())
    return SpaceErrors(len(usable), errors, float(np.sqrt((away**2).mean())), rows)


def _usable(stamps: IntArray, times: IntArray) -> tuple[BoolArray, IntArray, IntArray, FloatArray]:
    """Return `truth_between` for at least three poses.

    Raises:
        RecordingError: fewer have a truth.
    """
    if len(stamps) == 0 or len(times) == 0:
        raise RecordingError("one of the two trajectories is empty; there is nothing to compare")
    usable, before, after, part = truth_between(stamps, times)
    if usable.sum() < 3:
        raise RecordingError(
            f"only {int(usable.sum())} of {len(usable)} poses have a true pose within {MAX_TRUTH_GAP:g} s: "
            "check that both belong to one recording with one clock"
        )
    return usable, before, after, part


def _errors(away: FloatArray, mask: BoolArray) -> Errors:
    metres, degrees = np.hypot(away[mask, 0], away[mask, 1]), np.abs(np.degrees(away[mask, 2]))
    if len(metres) == 0:
        return Errors(0, *([math.nan] * 6))
    spread = [float(values.std(ddof=1)) if len(values) > 1 else math.nan for values in (metres, degrees)]
    return Errors(
        count=len(metres),
        mean_m=float(metres.mean()),
        std_m=spread[0],
        max_m=float(metres.max()),
        mean_deg=float(degrees.mean()),
        std_deg=spread[1],
        max_deg=float(degrees.max()),
    )


def _nearest(stamps: IntArray, times: IntArray) -> IntArray:
    """Return the index of the stamp nearest to each time; `stamps` ascend."""
    after = np.clip(np.searchsorted(stamps, times), 1, max(1, len(stamps) - 1))
    after = np.minimum(after, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    nearest: IntArray = np.where(np.abs(stamps[before] - times) <= np.abs(stamps[after] - times), before, after)
    return nearest


def _gaps(stamps: IntArray, times: IntArray) -> IntArray:
    """Return the distance [ns] of each time to the nearest stamp."""
    if len(stamps) == 0:
        raise RecordingError("the trajectory is empty; there is nothing to compare")
    gaps: IntArray = np.abs(stamps[_nearest(stamps, times)] - times)
    return gaps


def poses_at(stamps: IntArray, poses: FloatArray, times: IntArray) -> FloatArray:
    """Return poses (N, 3) at the times, interpolated linearly (the heading by the shorter turn) and held outside."""
    seconds, wanted = (stamps - stamps[0]) * 1e-9, (times - stamps[0]) * 1e-9
    columns = [poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2])]
    return np.stack([np.interp(wanted, seconds, column) for column in columns], axis=1)
