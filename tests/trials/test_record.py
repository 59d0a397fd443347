"""A drive along a route: its bag holds all messages of the simulator, and the true poses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.geometry import compose
from waychair.recordings.recording import read_recording
from waychair.simulation.pacing import Pacer
from waychair.simulation.plan.world import load_world, world_from_grid
from waychair.simulation.simulator import Simulator
from waychair.trials.record import EPOCH_NS, drive_route, mounts_of
from waychair.types import ImuSample, OccupancyGrid, Odometry, Pose2, RgbdFrame, Scan, SonarReadings, Twist, WheelTicks

TICK_NS = 50_000_000
ROUTE = np.array([[2.0, 0.0]])


class Straight(Simulator):
    """A simulator that drives 5 cm per tick and sends a message of each kind; scans are stamped by their first beam."""

    def __init__(self) -> None:
        field = OccupancyGrid(np.zeros((80, 80), np.int8), 0.05, Pose2(-2.0, -2.0, 0.0))
        super().__init__(world_from_grid(field, Pose2()), CHAIR_A)

    def advance(self, duration_ns: int) -> tuple[Any, ...]:
        assert duration_ns == TICK_NS
        self._level.now_ns += TICK_NS
        turns = 0.05 * self.now_ns / TICK_NS / (math.tau * CHAIR_A.wheel_radius)
        ticks = round(turns * CHAIR_A.ticks_per_turn)
        image, depth = np.zeros((4, 6, 3), np.uint8), np.ones((4, 6), np.float32)
        return (
            WheelTicks(self.now_ns, ticks, ticks),
            ImuSample(self.now_ns, np.array([0.0, 0.0, 9.81]), np.zeros(3)),
            RgbdFrame(self.now_ns - 10_000_000, image, depth, np.eye(3)),
            SonarReadings(self.now_ns, np.ones(8, np.float32)),
            Scan(self.now_ns - 45_000_000, np.ones(90, np.float32), -1.5, 0.033),
        )

    def truth(self) -> Pose2:
        return Pose2(0.05 * self.now_ns / TICK_NS, 0.0, 0.0)

    def twist(self) -> Twist:
        return Twist(1.0, 0.0)


def messages(path: Path, topic: str) -> Iterator[Any]:
    with AnyReader([path]) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        for connection, _, data in reader.messages(connections):
            yield reader.deserialize(data, connection.msgtype)


def test_all_messages_of_the_simulator_are_recorded_with_the_true_pose_of_each_tick(tmp_path: Path) -> None:
    drive = drive_route(Straight(), CHAIR_A, ROUTE, tmp_path / "drive.mcap")
    ticks = drive.scans
    assert ticks == pytest.approx(39, abs=1)
    assert (drive.duration_s, drive.distance_m) == (pytest.approx(0.05 * ticks), pytest.approx(0.05 * ticks))
    with AnyReader([tmp_path / "drive.mcap"]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert counts == {
        "/tf_static": 1,
        **dict.fromkeys(
            [
                "/scan", "/odom", "/tf", "/joint_states", "/imu/data", "/ground_truth/odom",
                "/camera/color/image_raw", "/camera/color/camera_info",
                "/camera/aligned_depth_to_color/image_raw", "/camera/aligned_depth_to_color/camera_info",
                *(f"/sonar_{k}" for k in range(8)),
            ],
            ticks,
        ),
    }  # fmt: skip
    for message in messages(tmp_path / "drive.mcap", "/ground_truth/odom"):
        at_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec - EPOCH_NS
        assert message.pose.pose.position.x == pytest.approx(0.05 * at_ns / TICK_NS)
    stamp = next(messages(tmp_path / "drive.mcap", "/scan")).header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == EPOCH_NS + 5_000_000


def test_a_pacer_is_called_once_every_tick() -> None:
    told: list[int] = []

    class Listener(Pacer):
        def pace(self, now_ns: int) -> None:
            told.append(now_ns)

    drive = drive_route(Straight(), CHAIR_A, ROUTE, pacer=Listener())
    assert told == [(k + 1) * TICK_NS for k in range(drive.scans)]


def test_an_interrupted_drive_keeps_its_recording(tmp_path: Path) -> None:
    def interrupt(share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop:
        drive_route(Straight(), CHAIR_A, ROUTE, tmp_path / "drive.mcap", interrupt)
    assert str(tmp_path / "drive.part.mcap") in stop.value.__notes__[0]
    assert len(list(messages(tmp_path / "drive.part.mcap", "/scan"))) == pytest.approx(21, abs=1)


def test_a_real_drive_gives_frames_with_odometry_that_ends_at_the_end_of_the_drive(tmp_path: Path) -> None:
    world = load_world("corridor_t").without_people()
    simulator = Simulator(world, CHAIR_A, seed=3)
    start = simulator.truth()
    drive = drive_route(simulator, CHAIR_A, world.route()[:1], tmp_path / "drive.mcap")
    recording = read_recording(tmp_path / "drive.mcap")
    assert recording.warnings == () or "left out" in recording.warnings[0]
    assert drive.scans - 2 <= len(recording.frames) <= drive.scans
    np.testing.assert_allclose(recording.base_from_laser.array(), CHAIR_A.base_from_laser.array(), atol=1e-9)
    last = [w for frame in recording.frames for w in frame.wheels if isinstance(w, Odometry)][-1].odom_from_base
    believed, true = start @ last, simulator.truth()
    assert math.dist((believed.x, believed.y), (true.x, true.y)) == pytest.approx(drive.odometry_error_m, abs=0.15)


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B, ChairBody(camera_yaw=0.7, camera_pitch=-0.3, laser_theta=1.0)])
def test_mounts_are_the_3d_mounts_of_the_body(body: ChairBody) -> None:
    mounts = mounts_of(body, 0.4)
    np.testing.assert_allclose(mounts["laser"].planar().array(), body.base_from_laser.array(), atol=1e-12)
    assert mounts["laser"].translation[2] == body.laser_z
    assert mounts["imu_link"].translation.tolist() == [body.imu_x, body.imu_y, body.imu_z]
    camera = mounts["camera_link"]
    yaw, pitch, roll = Rotation.from_matrix(camera.rotation).as_euler("ZYX")
    assert (yaw, pitch, roll) == pytest.approx((body.camera_yaw, body.camera_pitch, 0.0), abs=1e-12)
    ahead = compose(mounts["sonar_0"].planar().array(), np.array([1.0, 0.0, 0.0]))
    assert ahead[0] == pytest.approx(body.front + 1.0)
    assert [mounts[f"sonar_{k}"].translation[2] for k in range(8)] == [0.4] * 8
