"""`waychair evaluate` of cameras in space and of chairs on the floor, against truths of any rate."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.cli.command import waychair
from waychair.recordings.recording import read_tum_in_space, write_tum
from waychair.slam.trajectory_alignment import alignment_in_space, leaves_plane
from waychair.slam.trajectory_errors import space_errors, truth_errors
from waychair.types import Trajectory, Trajectory3

SECOND = 1_000_000_000


def in_space(times: np.ndarray) -> Trajectory3:
    """A hand-held camera on a wavy loop that looks around."""
    positions = np.column_stack([np.sin(times), 0.5 * np.cos(0.7 * times), 1.2 + 0.3 * np.sin(1.3 * times)])
    turns = Rotation.from_euler("xyz", np.column_stack([0.4 * np.sin(times), 0.3 * np.cos(times), 0.5 * times]))
    return Trajectory3((times * SECOND).astype(np.int64) + SECOND, turns.as_matrix(), positions)


def moved(trajectory: Trajectory3, turn: Rotation, shift: tuple[float, float, float]) -> Trajectory3:
    rotation = turn.as_matrix()
    return Trajectory3(
        trajectory.stamps_ns, rotation @ trajectory.rotations, trajectory.positions @ rotation.T + np.array(shift)
    )


def on_floor(times: np.ndarray, speed: float = 0.8) -> Trajectory:
    """A chair on a circle of 3 m radius."""
    angle = speed / 3.0 * times
    poses = np.column_stack([3.0 * np.sin(angle), 3.0 * (1.0 - np.cos(angle)), angle])
    return Trajectory((times * SECOND).astype(np.int64) + SECOND, poses)


def said(*arguments: str | Path) -> dict[str, object]:
    done = waychair("evaluate", *arguments, "--json")
    assert done.returncode == 0, done.stderr
    values: dict[str, object] = json.loads(done.stdout)
    return values


def test_a_camera_is_aligned_in_space_and_its_rotations_are_compared_whole(tmp_path: Path) -> None:
    truth = in_space(np.arange(0.0, 20.0, 0.05))
    turn = Rotation.from_euler("xyz", [1.0, -0.7, 2.5])
    mine = moved(truth, turn, (4.0, -3.0, 2.0))
    assert space_errors(mine, truth).rmse_m < 1e-9
    tilted = Trajectory3(
        mine.stamps_ns, mine.rotations @ Rotation.from_euler("x", 3.0, degrees=True).as_matrix(), mine.positions
    )
    away = mine.positions + turn.apply(np.array([[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]] * 200))
    write_tum(tmp_path / "mine.tum", Trajectory3(tilted.stamps_ns, tilted.rotations, away))
    write_tum(tmp_path / "truth.tum", truth)
    done = waychair("evaluate", tmp_path / "mine.tum", "--truth", tmp_path / "truth.tum")
    assert "400 of 400 poses, RMSE 0.0300 m, aligned in space" in done.stdout
    values = said(tmp_path / "mine.tum", "--truth", tmp_path / "truth.tum")
    assert values["rmse_m"] == pytest.approx(0.03, abs=1e-4)
    assert values["errors"]["mean_deg"] == pytest.approx(3.0, abs=0.05)  # type: ignore[index]
    matrix = np.array(values["truth_from_map"])
    np.testing.assert_allclose(matrix[:3, :3], turn.inv().as_matrix(), atol=1e-3)


def test_one_file_in_space_is_enough_and_the_floor_stays_the_plane(tmp_path: Path) -> None:
    times = np.arange(0.0, 20.0, 0.05)
    write_tum(tmp_path / "flat.tum", on_floor(times))
    write_tum(tmp_path / "space.tum", in_space(times))
    assert "in space" in waychair("evaluate", tmp_path / "flat.tum", "--truth", tmp_path / "space.tum").stdout
    assert "in the plane" in waychair("evaluate", tmp_path / "flat.tum", "--truth", tmp_path / "flat.tum").stdout
    flat = read_tum_in_space(tmp_path / "flat.tum")
    uneven = flat.positions + np.column_stack([np.zeros((400, 2)), 0.01 * np.sin(times) + 0.4])
    assert not leaves_plane(Trajectory3(flat.stamps_ns, flat.rotations, uneven))


def test_a_mirrored_drive_on_the_floor_is_no_good_drive(tmp_path: Path) -> None:
    """In space the mirrored drive would be the true one seen from below."""
    truth = on_floor(np.arange(0.0, 30.0, 0.05))
    write_tum(tmp_path / "truth.tum", truth)
    spiral = truth.poses * np.linspace(0.5, 1.0, len(truth.poses))[:, None]
    write_tum(tmp_path / "spiral.tum", Trajectory(truth.stamps_ns, spiral))
    write_tum(tmp_path / "mirrored.tum", Trajectory(truth.stamps_ns, spiral * (1.0, -1.0, -1.0)))
    assert said(tmp_path / "mirrored.tum", "--truth", tmp_path / "spiral.tum")["rmse_m"] > 0.3  # type: ignore[operator]


@pytest.mark.parametrize("rate", [5.0, 10.0, 25.0])
def test_a_right_trajectory_is_right_against_a_truth_of_any_rate(rate: float) -> None:
    mine = on_floor(np.arange(0.013, 20.0, 0.21))
    flat = truth_errors(mine, on_floor(np.arange(0.0, 21.0, 1.0 / rate)))
    assert flat.rmse_m < 0.002
    assert flat.errors.max_deg < 0.05
    assert flat.errors.count == len(mine.stamps_ns)
    space = space_errors(in_space(np.arange(0.013, 20.0, 0.21)), in_space(np.arange(0.0, 21.0, 1.0 / rate)))
    assert space.rmse_m < 0.004
    assert space.errors.max_deg < 0.6


def test_pauses_of_the_truth_are_not_bridged_and_its_ends_are_not_stretched() -> None:
    times = np.arange(0.0, 20.0, 0.1)
    truth = on_floor(times[(times < 5.0) | (times > 9.0)])
    errors = truth_errors(on_floor(np.arange(-2.0, 22.0, 0.1) + 0.03), truth)
    assert errors.rmse_m < 0.003
    assert 155 <= errors.errors.count <= 165


def test_stamps_of_the_truth_that_come_twice_or_out_of_order_do_no_harm() -> None:
    truth = on_floor(np.arange(0.0, 20.0, 0.1))
    order = np.random.default_rng(1).permutation(np.r_[np.arange(200), np.arange(0, 200, 7)])
    shuffled = Trajectory(truth.stamps_ns[order], truth.poses[order])
    assert truth_errors(on_floor(np.arange(0.0, 19.0, 0.17)), shuffled).rmse_m < 0.001


def test_a_straight_line_and_a_camera_that_only_turns_are_aligned_by_their_rotations() -> None:
    times = np.arange(0.0, 10.0, 0.05)
    looks = Rotation.from_euler("xyz", np.column_stack([0.3 * np.sin(times), 0.1 * times, 0.2 * times])).as_matrix()
    turn = Rotation.from_euler("xyz", [0.4, 1.0, -2.0])
    for positions in (times[:, None] * np.array([0.5, 0.2, 0.1]), np.zeros((200, 3))):
        truth = Trajectory3((times * SECOND).astype(np.int64), looks, positions)
        errors = space_errors(moved(truth, turn, (1.0, 2.0, 3.0)), truth)
        assert errors.rmse_m < 1e-6
        assert errors.errors.max_deg < 1e-3
        aligned = alignment_in_space(
            moved(truth, turn, (0.0, 0.0, 0.0)).positions, turn.as_matrix() @ looks, positions, looks
        )
        np.testing.assert_allclose(aligned.rotation, turn.inv().as_matrix(), atol=1e-6)


def test_poses_of_another_frame_are_told_apart_from_errors(tmp_path: Path) -> None:
    truth = in_space(np.arange(0.0, 20.0, 0.05))
    optical = Rotation.from_euler("xyz", [-90.0, 0.0, -90.0], degrees=True).as_matrix()
    write_tum(tmp_path / "optical.tum", Trajectory3(truth.stamps_ns, truth.rotations @ optical, truth.positions))
    write_tum(tmp_path / "truth.tum", truth)
    told = waychair("evaluate", tmp_path / "optical.tum", "--truth", tmp_path / "truth.tum").stdout
    assert "RMSE 0.0000 m" in told
    assert "the rotations differ by about 120 degrees everywhere" in told


def test_files_of_other_programs_are_evaluated(tmp_path: Path) -> None:
    """numpy.savetxt writes exponents, EuRoC's tools nanoseconds and commas, others milliseconds."""
    truth = on_floor(np.arange(1.7e9, 1.7e9 + 10.0, 0.05))
    write_tum(tmp_path / "truth.tum", truth)
    rows = np.array([[float(f) for f in line.split()] for line in (tmp_path / "truth.tum").read_text().splitlines()])
    np.savetxt(tmp_path / "savetxt.txt", rows)
    for name, unit in (("ns.csv", 1), ("ms.csv", 10**6)):
        lines = [
            f"{at // unit}," + ",".join(f"{v:.9f}" for v in row[1:])
            for at, row in zip(truth.stamps_ns.tolist(), rows, strict=True)
        ]
        (tmp_path / name).write_text("#timestamp,x,y,z,qx,qy,qz,qw\n" + "\n".join(lines))
    for name in ("savetxt.txt", "ns.csv", "ms.csv"):
        values = said(tmp_path / name, "--truth", tmp_path / "truth.tum")
        assert values["rmse_m"] < 1e-3, name  # type: ignore[operator]
        assert values["errors"]["count"] == len(rows), name  # type: ignore[index]
    (tmp_path / "bad.txt").write_text("1700000000.0 0 0 0 0 0 0 1\nnan 0 0 0 0 0 0 1\n")
    assert (
        "bad.txt line 2 is not" in waychair("evaluate", tmp_path / "bad.txt", "--truth", tmp_path / "truth.tum").stderr
    )


def test_the_error_in_space_is_that_of_the_tool_beside_the_recordings(data_dir: Path, tmp_path: Path) -> None:
    tool = data_dir.parent / "tools" / "trajectory_error.py"
    if not tool.is_file():
        pytest.skip(f"no metric at {tool}")
    truth_file = data_dir / "rgbd_tum_fr1_rpy_head" / "groundtruth.txt"
    truth = read_tum_in_space(truth_file)
    noise = np.random.default_rng(5).normal(0.0, 0.01, (len(truth.stamps_ns), 3))
    mine = moved(truth, Rotation.from_euler("xyz", [0.3, 0.2, -1.0]), (1.0, 1.0, 1.0))
    write_tum(tmp_path / "mine.tum", Trajectory3(mine.stamps_ns, mine.rotations, mine.positions + noise))
    command = [sys.executable, str(tool), "ate", str(tmp_path / "mine.tum"), str(truth_file)]
    theirs = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    ours = said(tmp_path / "mine.tum", "--truth", truth_file)
    assert ours["rmse_m"] == pytest.approx(theirs["rmse_m"], rel=1e-4)
    assert theirs["rmse_m"] == pytest.approx(math.sqrt(3) * 0.01, rel=0.04)
