"""The simulator node as a process: its messages, their clock, and the board behind its cable."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.ros.transforms import read_transforms
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.firmware_bridge.bridge import Bridge
from waychair.firmware_bridge.transports import Reconnecting, SerialTransport
from waychair.ros import topics
from waychair.ros.messages import camera, motion, sensors
from waychair.ros.messages.reports import DiagnosticLevel
from waychair.ros.messages.wire import stamp_of
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.types import JoystickInput

if TYPE_CHECKING:
    from tests.ros.harness import Harness, Heard

SENT = (
    topics.SCAN,
    topics.IMU,
    topics.JOINTS,
    topics.ODOMETRY,
    topics.TRUTH,
    topics.TF,
    topics.sonar(0),
    topics.sonar(7),
)
PICTURES = (topics.COLOUR, topics.DEPTH, topics.COLOUR_INFO, topics.DEPTH_INFO)


@dataclass
class Simulation:
    """The process, its messages, and the path of its cable."""

    process: Any
    heard: dict[str, Heard]
    cable: Path


@pytest.fixture(scope="module")
def simulation(ros: Harness, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulation]:
    cable = tmp_path_factory.mktemp("cable") / "board"
    cable.symlink_to("/dev/null")  # left by a killed simulator
    arguments = ("-p", f"board_link:={cable}", "-p", "people:=false", "-r", "__ns:=/ward")
    wanted = SENT + (PICTURES if renderer_problem() is None else ())
    heard = {
        topic.name: ros.heard(topic, topic.name if topic is topics.TF else f"/ward/{topic.name}") for topic in wanted
    }
    with ros.process("-m", "waychair.ros.nodes.simulator_node", "--ros-args", *arguments) as process:
        ros.spin_until(lambda: all(len(messages) >= 8 for messages in heard.values()), "every topic")
        for topic in wanted[len(SENT) :]:  # pictures would keep the tests busy
            heard[topic.name].close()
        yield Simulation(process, heard, cable)


def test_every_sensor_has_its_frame_and_the_common_clock(simulation: Simulation) -> None:
    for topic in (*SENT[:5], *SENT[6:]):
        for message in simulation.heard[topic.name]:
            assert message.header.frame_id == topic.frame
            assert abs(time.time_ns() - stamp_of(message)) < 120e9
    scan = sensors.read_scan(simulation.heard["scan"][-1])
    assert np.isfinite(scan.ranges).any()
    assert sensors.read_imu(simulation.heard["imu/data"][-1]).accel[2] == pytest.approx(9.81, abs=1.0)
    assert sensors.read_range(simulation.heard["sonar_0"][-1]) > 0.0


SLOW_START = """
import time
from waychair.ros.nodes import simulator_node
simulator_node.leave_out_present = lambda: time.sleep(0.5)
simulator_node.main()
"""


@pytest.mark.nightly
def test_a_slow_start_makes_no_stamp_older(ros: Harness) -> None:
    heard, ages = ros.heard(topics.JOINTS, "/slow/joint_states"), list[int]()

    def is_heard_often() -> bool:
        ages.extend(time.time_ns() - stamp_of(message) for message in heard[-1:])
        return len(heard) >= 50

    with ros.process("-c", SLOW_START, "--ros-args", "-p", "people:=false", "-r", "__ns:=/slow"):
        ros.spin_until(is_heard_often, "wheel counts")
    heard.close()
    assert 0.0 < min(ages) < 0.3e9


@pytest.mark.parametrize(("topic", "period_ms"), [(topics.ODOMETRY, 20), (topics.JOINTS, 20), (topics.TRUTH, 20)])
def test_reliable_topics_lose_no_message_and_keep_their_period(
    simulation: Simulation, topic: topics.RosTopic, period_ms: float
) -> None:
    """By the stamps of the simulator itself; a loaded computer drops whole steps, and says so."""
    stamps = np.array([stamp_of(message) for message in simulation.heard[topic.name]])
    steps_ms = np.diff(stamps) / 1e6
    assert np.median(steps_ms) == pytest.approx(period_ms, abs=0.01)
    assert (steps_ms > period_ms - 0.01).all()


def test_odometry_and_its_transform_agree_at_rest(simulation: Simulation) -> None:
    odometry = motion.read_odometry(simulation.heard["odom"][-1])
    assert odometry.covariance is not None
    transforms = {stamp: pose for each in simulation.heard["/tf"] for stamp, pose in read_transforms(each).values()}
    common = [message for message in simulation.heard["odom"] if stamp_of(message) in transforms]
    assert common
    for message in common:
        told, pose = transforms[stamp_of(message)].planar(), motion.read_odometry(message).odom_from_base
        np.testing.assert_allclose(told.array(), pose.array(), atol=1e-9)
    assert math.hypot(odometry.odom_from_base.x, odometry.odom_from_base.y) < 0.05


@pytest.mark.skipif(renderer_problem() is not None, reason="this computer cannot render pictures")
def test_pictures_come_with_depth_and_the_camera_matrix(simulation: Simulation) -> None:
    pairing = camera.CameraPairing()
    pairing.calibrated(simulation.heard[topics.COLOUR_INFO.name][0])
    halves = [(stamp_of(message), pairing.colour, message) for message in simulation.heard[topics.COLOUR.name]]
    halves += [(stamp_of(message), pairing.depth, message) for message in simulation.heard[topics.DEPTH.name]]
    frames = [take(message) for _, take, message in sorted(halves, key=lambda half: half[0])]
    whole = [frame for frame in frames if frame is not None]
    assert whole
    assert whole[-1].image.shape == (480, 640, 3)
    assert 0.3 < np.nanmedian(whole[-1].depth) < 8.0


def test_a_late_subscriber_still_gets_the_mounts(simulation: Simulation, ros: Harness) -> None:
    mounts = ros.heard(topics.TF_STATIC)
    ros.spin_until(lambda: mounts, "the mounts")
    base_from_laser = read_transforms(mounts[0])["base_link", "laser"][1]
    assert base_from_laser.planar() == CHAIR_A.base_from_laser
    assert ("camera_link", "camera_color_optical_frame") in read_transforms(mounts[0])


def test_the_riders_stick_moves_the_chair_and_returns_to_rest(simulation: Simulation, ros: Harness) -> None:
    from waychair.ros.interface_types import interface_type
    from waychair.ros.messages.wire import serialised

    publisher = ros.node.create_publisher(interface_type(topics.JOY.type), "/ward/joy", topics.profile(topics.JOY.qos))
    truth = simulation.heard["ground_truth/odom"]

    def speed() -> float:
        return float(truth[-1].twist.twist.linear.x)

    def push() -> None:
        now_ns = ros.node.get_clock().now().nanoseconds
        publisher.publish(serialised(sensors.joy(JoystickInput(now_ns, forward=0.3))))

    ros.spin_until(lambda: speed() > 0.05, "the chair to move", push)
    ros.spin_until(lambda: abs(speed()) < 0.01, "the chair to rest")
    assert max(each.twist.twist.linear.x for each in truth) > 0.05
    ros.node.destroy_publisher(publisher)


def test_the_shipped_board_answers_at_the_other_end_of_the_cable(simulation: Simulation) -> None:
    bridge = Bridge(Reconnecting(lambda: SerialTransport(str(simulation.cable))), DEFAULT, CHAIR_A.chair_id)
    deadline = time.monotonic() + 30.0
    while bridge.telemetry is None and time.monotonic() < deadline:
        bridge.listen(time.monotonic_ns())
        bridge.beat(time.monotonic_ns())
        time.sleep(0.005)  # a heartbeat's period, not a wait for a condition
    assert bridge.telemetry is not None, bridge.trouble
    assert bridge.trouble == ()


def test_the_simulator_reports_its_pace_and_its_cable(simulation: Simulation, ros: Harness) -> None:
    report = ros.report("/ward/simulator: simulation")
    assert dict(report.values)["cable"] == str(simulation.cable)
    assert dict(report.values)["contacts"] == "0"
    assert ros.report("/ward/simulator: input joy").level in (
        DiagnosticLevel.OK,
        DiagnosticLevel.WARN,
        DiagnosticLevel.ERROR,
    )


def test_the_cable_is_removed_at_the_end(simulation: Simulation) -> None:
    from tests.ros.harness import ended

    assert simulation.cable.is_symlink()
    assert ended(simulation.process, signal.SIGTERM) == (0, "")
    assert not simulation.cable.is_symlink()


def test_simulated_time_is_published_and_used(ros: Harness) -> None:
    clock, odometry = ros.heard(topics.CLOCK), ros.heard(topics.ODOMETRY)
    arguments = ("-p", "use_sim_time:=true", "-p", "camera:=false")
    with ros.process("-m", "waychair.ros.nodes.simulator_node", "--ros-args", *arguments):
        ros.spin_until(lambda: len(clock) > 20 and len(odometry) > 20, "the clock")
    ticks = np.array([tick.clock.sec * 10**9 + tick.clock.nanosec for tick in clock])
    assert ticks[0] < 60e9
    assert np.median(np.diff(ticks)) == 10_000_000
    assert (np.diff(ticks) > 0).all()
    assert stamp_of(odometry[0]) < 60e9


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        pytest.param("world:=atlantis", "atlantis", marks=pytest.mark.nightly),
        ("plant_model:=toy", "plant_model = 'toy' is unknown"),
    ],
)
def test_an_impossible_simulation_is_refused_in_one_sentence(ros: Harness, argument: str, sentence: str) -> None:
    with ros.process("-m", "waychair.ros.nodes.simulator_node", "--ros-args", "-p", argument) as process:
        output, _ = process.communicate(timeout=60.0)
    assert process.returncode == 2
    assert sentence in output
    assert "Traceback" not in output
    assert output.count("\n") == 1
