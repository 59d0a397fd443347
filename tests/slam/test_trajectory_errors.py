"""The metrics against each other, against known numbers, and against the tool beside the recordings."""

from __future__ import annotations

import gzip
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.errors import RecordingDamaged, RecordingError, RecordingNotFound
from waychair.geometry import compose
from waychair.recordings.recording import read_recording, write_tum
from waychair.slam.trajectory_errors import Relations, read_relations, relation_errors, truth_errors
from waychair.types import Odometry, Pose2, Trajectory

SECOND = 1_000_000_000


def wave(count: int = 200) -> Trajectory:
    t = np.linspace(0.0, 10.0, count)
    poses = np.stack([np.cos(t), 0.3 * t, np.remainder(0.7 * t, math.tau)], axis=1)
    return Trajectory((t * 20 * SECOND).astype(np.int64), poses)


def relations_of(trajectory: Trajectory, pairs: list[tuple[int, int]]) -> Relations:
    poses = [Pose2(*pose) for pose in trajectory.poses]
    found = [(poses[i].inverse() @ poses[j]).array() for i, j in pairs]
    return Relations(trajectory.stamps_ns[np.array(pairs)], np.array(found))


def raw_odometry(path: Path) -> Trajectory:
    frames = read_recording(path).frames
    readings = [frame.wheels[-1] for frame in frames]
    poses = [reading.odom_from_base.array() for reading in readings if isinstance(reading, Odometry)]
    return Trajectory(np.array([frame.stamp_ns for frame in frames]), np.array(poses))


def test_a_perfect_trajectory_has_no_error_and_loops_are_distinguished_from_local_relations() -> None:
    trajectory = wave()
    errors = relation_errors(trajectory, relations_of(trajectory, [(0, 3), (10, 20), (0, 199), (150, 20)]))
    assert (errors.total, errors.every.count, errors.local.count, errors.loop.count) == (4, 4, 2, 2)
    assert errors.every.max_m < 1e-9
    assert errors.every.max_deg < 1e-9


def test_a_known_error_is_measured_exactly() -> None:
    trajectory = wave()
    true = relations_of(trajectory, [(0, 3), (10, 20)])
    off = compose(true.poses, np.array([[0.3, -0.4, 0.1], [0.0, 0.1, -0.2]]))
    errors = relation_errors(trajectory, Relations(true.stamps_ns, off)).every
    assert errors.mean_m == pytest.approx((0.5 + 0.1) / 2, abs=1e-9)
    assert errors.max_m == pytest.approx(0.5, abs=1e-9)
    assert errors.std_m == pytest.approx(0.4 / math.sqrt(2), abs=1e-9)
    assert errors.mean_deg == pytest.approx(math.degrees(0.15), abs=1e-9)


def test_relations_of_the_laser_need_its_mount() -> None:
    base = wave()
    mount = Pose2(0.3, 0.1, 0.2)
    laser = Trajectory(base.stamps_ns, compose(base.poses, mount.array()))
    relations = relations_of(laser, [(0, 30), (40, 90)])
    assert relation_errors(base, relations, mount).every.max_m < 1e-9
    assert relation_errors(base, relations).every.max_m > 0.05


def test_stamps_without_a_pose_are_left_out_and_no_common_stamp_is_refused() -> None:
    trajectory = wave()
    true = relations_of(trajectory, [(0, 3), (10, 20)])
    shifted = true.stamps_ns.copy()
    shifted[1, 0] += SECOND // 2
    errors = relation_errors(trajectory, Relations(shifted, true.poses))
    assert (errors.total, errors.every.count) == (2, 1)
    with pytest.raises(RecordingError, match="none of the 2 relations"):
        relation_errors(trajectory, Relations(true.stamps_ns + 10**15, true.poses))


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1), st.integers(0, 40_000_000))
def test_a_moved_trajectory_is_aligned_with_the_truth(x: float, y: float, theta: float, late_ns: int) -> None:
    truth = wave()
    moved = Trajectory(truth.stamps_ns + late_ns, compose(np.array([x, y, theta]), truth.poses))
    errors = truth_errors(moved, truth)
    assert errors.rmse_m < 1e-6
    assert errors.errors.max_deg < 1e-4
    back = errors.truth_from_map @ Pose2(x, y, theta)
    np.testing.assert_allclose(back.array(), 0.0, atol=1e-6)


def test_a_mirrored_trajectory_does_not_align_with_the_truth() -> None:
    truth = wave()
    mirrored = Trajectory(truth.stamps_ns, truth.poses * (1.0, -1.0, -1.0))
    assert truth_errors(mirrored, truth).rmse_m > 0.1


def test_too_few_common_poses_are_refused() -> None:
    truth = wave()
    late = Trajectory(truth.stamps_ns + 10**15, truth.poses)
    empty = Trajectory(np.zeros(0, np.int64), np.zeros((0, 3)))
    with pytest.raises(RecordingError, match="only 0 of 200 poses"):
        truth_errors(late, truth)
    with pytest.raises(RecordingError, match="is empty"):
        truth_errors(empty, truth)
    with pytest.raises(RecordingError, match="is empty"):
        relation_errors(empty, relations_of(truth, [(0, 1)]))


@pytest.mark.parametrize(
    ("log", "relations", "mean_m", "mean_deg"),
    [
        ("lidar_intel/intel_first1088s.clf.gz", "lidar_intel/intel_first1088s.relations.gz", 3.53, 41.1),
        ("lidar_fr079/fr079_laser.clf.gz", "lidar_fr079/fr079.relations.gz", None, None),
    ],
)
def test_raw_odometry_of_the_real_logs_scores_as_published_and_as_by_the_tool(
    data_dir: Path, tmp_path: Path, log: str, relations: str, mean_m: float | None, mean_deg: float | None
) -> None:
    trajectory = raw_odometry(data_dir / log)
    errors = relation_errors(trajectory, read_relations(data_dir / relations))
    if mean_m is not None and mean_deg is not None:
        assert errors.every.mean_m == pytest.approx(mean_m, abs=0.01)
        assert errors.every.mean_deg == pytest.approx(mean_deg, abs=0.1)
    tool = data_dir.parent / "tools" / "trajectory_error.py"
    if not tool.is_file():
        pytest.skip(f"no metric at {tool}")
    write_tum(tmp_path / "t.tum", trajectory)
    command = [sys.executable, str(tool), "relations", str(tmp_path / "t.tum"), str(data_dir / relations)]
    said = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    every = errors.every
    assert (every.count, errors.total) == (said["relations"], said["of"])
    ours = [every.mean_m, every.std_m, every.max_m, every.mean_deg, every.std_deg, every.max_deg]
    names = ["trans_mean_m", "trans_std_m", "trans_max_m", "rot_mean_deg", "rot_std_deg", "rot_max_deg"]
    np.testing.assert_allclose(ours, [said[name] for name in names], rtol=1e-5)


def test_gmapping_on_freiburg_scores_as_documented(data_dir: Path) -> None:
    folder = data_dir / "lidar_fr079"
    with gzip.open(folder / "fr079_gmapping_poses.txt.gz", "rt") as file:
        rows = np.array([[float(field) for field in line.split()[:4]] for line in file if line[0] not in "#\n"])
    stamps = np.rint(rows[:, 0] * 1e6).astype(np.int64) * 1000
    errors = relation_errors(Trajectory(stamps, rows[:, 1:]), read_relations(folder / "fr079.relations.gz")).every
    assert errors.count == 1664
    assert (errors.mean_m, errors.std_m) == (pytest.approx(0.0584, abs=1e-4), pytest.approx(0.0421, abs=1e-4))
    assert (errors.mean_deg, errors.std_deg) == (pytest.approx(0.704, abs=1e-3), pytest.approx(0.671, abs=1e-3))


@pytest.mark.parametrize("text", ["", "# only a comment\n", "1 2 3\n", "1 2 x 0 0 0 0 0\n", "1 2 0 0 0 0 0 nan\n", "1 2 0 0 0 0 0 0 0\n"])  # fmt: skip
def test_invalid_relations_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "r.relations").write_text(text)
    with pytest.raises(RecordingDamaged, match=r"r\.relations"):
        read_relations(tmp_path / "r.relations")
    with pytest.raises(RecordingNotFound):
        read_relations(tmp_path / "none")
    (tmp_path / "cut.gz").write_bytes(gzip.compress(b"1 2 0 0 0 0 0 0\n" * 100)[:-20])
    with pytest.raises(RecordingDamaged, match="cannot read the relations"):
        read_relations(tmp_path / "cut.gz")
