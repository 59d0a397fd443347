"""The mapper on a synthetic flat: accuracy against truth, loops, and bad input."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from waychair.geometry import compose, invert
from waychair.slam.graph.graph_optimisation import EdgeKind
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.types import FloatArray, Odometry, Pose2, SensorFrame

Drive = tuple[list[SensorFrame], FloatArray]


def mapped(frames: list[SensorFrame], settings: MapperSettings | None = None) -> MapperResult:
    mapper = Mapper(settings or MapperSettings(), Pose2())
    for frame in frames:
        mapper.process(frame)
    return mapper.result()


def errors(result: MapperResult, truth: FloatArray) -> FloatArray:
    """Return the distance of each pose to the truth, both relative to the first pose."""
    return np.hypot(*(compose(invert(truth[:1]), truth) - result.trajectory.poses)[:, :2].T)


@pytest.fixture(scope="module")
def result(drive: Drive) -> MapperResult:
    return mapped(drive[0])


def test_poor_odometry_is_corrected_to_a_trajectory_within_centimetres(drive: Drive, result: MapperResult) -> None:
    frames, truth = drive
    odometry = np.array([frame.wheels[-1].odom_from_base.array() for frame in frames])  # type: ignore[union-attr]
    true_path = compose(invert(truth[:1]), truth)
    assert np.hypot(*(odometry - true_path)[:, :2].T).max() > 1.0
    assert errors(result, truth).max() < 0.05


def test_the_second_lap_closes_loops_with_the_first(result: MapperResult) -> None:
    loops = [edge for edge in result.edges if edge.kind is EdgeKind.LOOP]
    assert len(loops) >= 1
    assert all(edge.j - edge.i > 40 for edge in loops)


def test_the_second_lap_uses_the_key_scans_of_the_first(drive: Drive, result: MapperResult) -> None:
    first_lap = sum(frame < len(drive[0]) // 2 for frame in result.key_frames)
    assert len(result.key_frames) < 1.15 * first_lap


def test_the_graph_stops_growing_where_the_chair_drives_back_and_forth(drive: Drive) -> None:
    there = drive[0][:60]
    once, often = mapped(there), mapped((there + there[::-1]) * 4)
    assert len(often.key_poses) <= len(once.key_poses) + 2
    assert len(often.trajectory.poses) == 8 * len(there)
    assert errors(often, np.concatenate([drive[1][:60], drive[1][59::-1]] * 4)).max() < 0.03


def test_the_trajectory_has_one_pose_per_frame_with_its_stamp_in_input_order(drive: Drive) -> None:
    frames = [dataclasses.replace(frame) for frame in drive[0][:60]]
    frames[30] = dataclasses.replace(frames[30], stamp_ns=frames[10].stamp_ns + 7)  # steps back, as Intel's log does
    trajectory = mapped(frames).trajectory
    assert trajectory.stamps_ns.tolist() == [frame.stamp_ns for frame in frames]
    assert trajectory.poses.shape == (60, 3)


def test_the_same_input_gives_the_same_map(drive: Drive, result: MapperResult) -> None:
    again = mapped(drive[0])
    assert np.array_equal(again.trajectory.poses, result.trajectory.poses)


def test_a_recording_without_odometry_is_mapped_from_its_scans_alone(drive: Drive) -> None:
    frames, truth = drive
    half = len(frames) // 2 - 20
    alone = mapped([dataclasses.replace(frame, wheels=()) for frame in frames[:half]])
    assert errors(alone, truth[:half]).max() < 0.15


def test_with_empty_scans_the_odometry_decides(drive: Drive) -> None:
    frames = drive[0][:80]
    blind = [
        dataclasses.replace(
            frame,
            scan=dataclasses.replace(frame.scan, ranges=np.full(181, np.inf, np.float32)),  # type: ignore[arg-type]
        )
        for frame in frames
    ]
    result = mapped(blind)
    odometry = np.array([frame.wheels[-1].odom_from_base.array() for frame in frames])  # type: ignore[union-attr]
    assert result.trajectory.poses == pytest.approx(odometry, abs=1e-9)
    assert {edge.kind for edge in result.edges} == {EdgeKind.ODOMETRY}


def test_scans_of_varying_length_are_accepted(drive: Drive) -> None:
    frames = []
    for k, frame in enumerate(drive[0][:150]):
        assert frame.scan is not None
        cut = dataclasses.replace(frame.scan, ranges=frame.scan.ranges[: 181 - k % 3])
        frames.append(dataclasses.replace(frame, scan=cut))
    assert errors(mapped(frames), drive[1][:150]).max() < 0.05


def test_a_standing_chair_adds_no_key_scans(drive: Drive) -> None:
    frame = drive[0][0]
    frames = [dataclasses.replace(frame, stamp_ns=k, wheels=(Odometry(k, Pose2(0, 0, 1e-4 * k)),)) for k in range(50)]
    result = mapped(frames)
    assert result.counts["key_scans"] == 1
    assert result.trajectory.poses[-1] == pytest.approx([0, 0, 0], abs=1e-4)  # the scan is more exact than the wheels


def test_the_correction_of_a_match_is_distributed_over_the_poses_before_it(drive: Drive) -> None:
    settings = dataclasses.replace(MapperSettings(), key_distance=1.0, key_angle=math.radians(60))
    sparse = mapped(drive[0][:200], settings)
    assert sparse.counts["key_scans"] < 30
    assert errors(sparse, drive[1][:200]).max() < 0.08


def test_wheel_slip_is_found_by_the_scan(drive: Drive) -> None:
    frames, truth = list(drive[0][:150]), drive[1][:150]
    for k in range(70, 150):  # a jump of 0.7 m that the chair did not make
        odometry = frames[k].wheels[-1]
        assert isinstance(odometry, Odometry)
        pose = odometry.odom_from_base
        jumped = dataclasses.replace(odometry, odom_from_base=Pose2(pose.x + 0.6, pose.y - 0.35, pose.theta))
        frames[k] = dataclasses.replace(frames[k], wheels=(jumped,))
    result = mapped(frames)
    away = errors(result, truth)
    assert away[-1] < 0.01
    assert (away > 0.02).sum() <= 1  # the frame between the two key scans before and after the slip


def test_a_kidnapped_chair_is_relocalised(drive: Drive) -> None:
    """Odometry shows no motion between frames 280 and 330, and the map is still connected."""
    frames, truth = drive
    carried = list(frames[:280])
    here, there = (frames[k].wheels[-1].odom_from_base for k in (279, 330))  # type: ignore[union-attr]
    for frame in frames[330:]:
        odometry = frame.wheels[-1]
        assert isinstance(odometry, Odometry)
        pose = here @ (there.inverse() @ odometry.odom_from_base)
        carried.append(dataclasses.replace(frame, wheels=(dataclasses.replace(odometry, odom_from_base=pose),)))
    result = mapped(carried)
    assert any(edge.kind is EdgeKind.UNKNOWN for edge in result.edges)
    away = errors(result, np.concatenate([truth[:280], truth[330:]]))
    assert np.median(away) < 0.03
    assert away.max() < 0.2
