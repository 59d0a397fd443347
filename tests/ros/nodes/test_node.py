"""The base class of all nodes: settings as parameters, diagnostics, and a clean end."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from waychair.errors import ConfigError
from waychair.recordings.bags import ros_messages
from waychair.ros import topics
from waychair.ros.messages.motion import pose_with_covariance
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.topics import CLOCK, RELIABLE, SCAN, profile
from waychair.types import Pose2, Scan

if TYPE_CHECKING:
    from tests.ros.harness import Harness
    from tests.ros.plain_node import PlainNode

SCRIPT = Path(__file__).parents[1] / "plain_node.py"


@contextmanager
def plain_node(ros: Harness, *arguments: str) -> Iterator[PlainNode]:
    """The node in this process, served by the harness."""
    from tests.ros.plain_node import PlainNode

    with ros.serving(PlainNode(["--ros-args", *arguments])) as node:
        yield node


@contextmanager
def sender(ros: Harness, topic: Any) -> Iterator[Callable[[Any], None]]:
    """Yield a function that publishes plain messages, or invalid bytes, on a topic."""
    from waychair.ros.interface_types import interface_type
    from waychair.ros.messages.wire import serialised

    publisher = ros.node.create_publisher(interface_type(topic.type), topic.name, profile(topic.qos))
    yield lambda message: publisher.publish(message if isinstance(message, bytes) else serialised(message))
    ros.node.destroy_publisher(publisher)


def scan_now(ros: Harness) -> Scan:
    return Scan(ros.node.get_clock().now().nanoseconds, np.ones(11, np.float32), -0.5, 0.1, range_max=9.0)


def test_parameters_come_from_the_settings_with_units_and_bounds(ros: Harness) -> None:
    with plain_node(ros) as node:
        described = node.describe_parameter("inner.range")
        assert described.description == "how far it looks [m]"
        assert (described.floating_point_range[0].from_value, described.floating_point_range[0].to_value) == (0.5, 30.0)
        assert node.get_parameter("beams").value == 3
        assert node.describe_parameter("beams").integer_range[0].to_value == 9
        assert node.describe_parameter("name").read_only
        assert not described.read_only


def test_a_parameter_file_gives_settings_and_integers_count_as_floats(ros: Harness, tmp_path: Path) -> None:
    file = tmp_path / "chair.yaml"
    file.write_text("/**:\n  ros__parameters: {speed: 1, loud: true, inner: {range: 4.5, sectors: [0.5, 1.5]}}\n")
    with plain_node(ros, "--params-file", str(file), "-p", "name:=B") as node:
        assert (node.settings.speed, node.settings.loud, node.settings.name) == (1.0, True, "B")
        assert (node.settings.inner.range, node.settings.inner.sectors) == (4.5, (0.5, 1.5))
        assert list(node.get_parameter("inner.sectors").value) == [0.5, 1.5]


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        ("speed:=2.0", r"speed = 2.0 is impossible: it must lie in \[0, 1.5\] m/s"),
        ("inner.rnage:=4.0", "unknown key 'rnage'; did you mean 'range'"),
        ("beams:=many", "Expected `int`, got `str` - at `\\$.beams`"),
        ("beams.few:=1", "Expected `int`, got `object`"),
    ],
)
def test_an_impossible_parameter_is_refused_with_the_settings_own_sentence(
    ros: Harness, argument: str, sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence), plain_node(ros, "-p", argument):
        pass


def test_only_changeable_settings_change_while_the_node_runs(ros: Harness) -> None:
    from rclpy.parameter import Parameter

    with plain_node(ros) as node:
        for parameter, refusal in (
            (Parameter("speed", value=9.0), "speed = 9.0 is impossible: it must lie in [0, 1.5] m/s"),
            (Parameter("speed", value="fast"), "Expected `float`, got `str`"),
            (Parameter("beams", value=4), "beams cannot be changed while the node runs: set it at the start"),
        ):
            result = node.set_parameters_atomically([parameter])
            assert not result.successful
            assert refusal in result.reason
        assert node.told == []
        assert node.set_parameters_atomically([Parameter("speed", value=1)]).successful
        assert node.settings == node.told[0] == replace(node.settings, speed=1.0)
        assert node.get_parameter("speed").value == 1.0


def test_a_namespace_and_remapping_reach_the_topics(ros: Harness) -> None:
    with plain_node(ros, "-r", "__ns:=/ward", "-r", "scan:=front/scan") as node:
        assert node.scans.name == "/ward/front/scan"
        assert ros.report("/ward/plain: input scan").level is DiagnosticLevel.STALE


def test_a_sensor_with_a_qos_that_does_not_fit_is_named(ros: Harness) -> None:
    with plain_node(ros) as node, sender(ros, SCAN):
        node.listen(replace(SCAN, qos=RELIABLE), lambda message: message)
        report = ros.report("plain: input scan", lambda report: "QoS" in report.message)
    assert report.level is DiagnosticLevel.ERROR
    assert "/tests offers /scan with an incompatible QoS" in report.message


def test_a_sensor_of_another_type_is_named(ros: Harness) -> None:
    lidar = """
import rclpy, sensor_msgs.msg
rclpy.init()
node = rclpy.create_node("lidar")
publisher = node.create_publisher(sensor_msgs.msg.Imu, "scan", 5)
rclpy.spin(node)
"""
    with plain_node(ros), ros.process("-c", lidar):
        says = "/lidar sends sensor_msgs/msg/Imu on /scan, not sensor_msgs/msg/LaserScan"
        report = ros.report("plain: input scan", lambda report: report.message.startswith(says))
    assert report.level is DiagnosticLevel.ERROR


def test_a_publisher_that_is_found_before_its_node_is_named_later(ros: Harness) -> None:
    with plain_node(ros) as node, sender(ros, SCAN):
        found, is_known = node.get_publishers_info_by_topic, False

        def offers(topic: str) -> Any:
            told = found(topic)
            for each in told if not is_known else ():
                each.node_name = "_NODE_NAME_UNKNOWN_"
            return told

        node.get_publishers_info_by_topic = offers
        node.listen(replace(SCAN, qos=RELIABLE), lambda message: message)
        nameless = "a node whose name is not known yet offers /scan"
        ros.report("plain: input scan", lambda report: report.message.startswith(nameless))
        is_known = True
        ros.report("plain: input scan", lambda report: report.message.startswith("/tests offers /scan"))


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (ros_messages.laser_scan(Scan(5, np.ones(11, np.float32), math.nan, 0.1)), "angle"),
        (b"\x00\x01\x00\x00nothing of the kind", "are not a sensor_msgs/msg/LaserScan"),
    ],
)
def test_an_impossible_message_is_reported_and_dropped(ros: Harness, message: Any, sentence: str) -> None:
    with plain_node(ros) as node, sender(ros, SCAN) as send:
        report = ros.report("plain: input scan", lambda report: sentence in report.message, lambda: send(message))
        assert report.level is DiagnosticLevel.ERROR
        assert node.scans.latest is None


@pytest.mark.parametrize(
    "error", [OverflowError("too large"), AssertionError(), np.linalg.LinAlgError("singular"), ZeroDivisionError()]
)
def test_no_error_of_reading_a_message_ends_a_node(ros: Harness, error: Exception) -> None:
    def read(message: Any) -> Any:
        raise error

    with plain_node(ros) as node, sender(ros, topics.POSE) as send:
        node.listen(topics.POSE, read)
        message = pose_with_covariance(5, Pose2())
        report = ros.report(
            "input amcl_pose", lambda report: "impossible values" in report.message, lambda: send(message)
        )
    assert report.level is DiagnosticLevel.ERROR
    assert (str(error) or type(error).__name__) in report.message


def test_stamps_of_another_clock_are_distinguished_from_old_ones(ros: Harness) -> None:
    old = ros_messages.laser_scan(replace(scan_now(ros), stamp_ns=5_000_000_000))
    with plain_node(ros) as node, sender(ros, SCAN) as send:
        report = ros.report("plain: input scan", lambda report: "use_sim_time" in report.message, lambda: send(old))
        assert report.level is DiagnosticLevel.ERROR
        assert node.scans.is_stale()
        assert ros.report("plain: input scan", lambda report: "s old" in report.message).level is DiagnosticLevel.ERROR


def test_simulated_time_without_a_clock_is_reported(ros: Harness) -> None:
    with plain_node(ros, "-p", "use_sim_time:=true") as node:
        assert node.now_ns() == 0
        assert "no node publishes /clock" in ros.report("plain: clock").message


def test_two_clocks_are_reported(ros: Harness) -> None:
    clock = ros_messages.make(CLOCK.type, ros_messages.header(7_000_000_000, "").stamp)
    with plain_node(ros, "-p", "use_sim_time:=true") as node, sender(ros, CLOCK) as send, sender(ros, CLOCK):
        ros.spin_until(node.now_ns, "the time", lambda: send(clock))
        report = ros.report("plain: clock", lambda report: "start the simulator" not in report.message)
        assert report == Report(
            report.name, DiagnosticLevel.ERROR, "2 nodes send /clock, so that time jumps: stop all but one"
        )


def test_a_stamp_in_the_future_is_reported_as_such(ros: Harness) -> None:
    with plain_node(ros), sender(ros, SCAN) as send:

        def scan() -> None:
            now = scan_now(ros)
            send(ros_messages.laser_scan(replace(now, stamp_ns=now.stamp_ns + 3_000_000_000)))

        report = ros.report("plain: input scan", lambda report: "ahead" in report.message, scan)
        assert report.level is DiagnosticLevel.ERROR


def test_heavy_work_leaves_the_executor_free_and_returns_its_result_to_it(ros: Harness) -> None:
    import threading

    done: list[int] = []
    go_on = threading.Event()
    with plain_node(ros) as node:
        node.worker.submit(lambda: go_on.wait(30.0) and threading.get_ident(), done.append)
        assert ros.report("plain: node").level is DiagnosticLevel.OK
        assert not done
        go_on.set()
        ros.spin_until(lambda: done, "the result")
    assert done[0] != threading.get_ident()


def test_of_too_many_jobs_the_oldest_waiting_ones_are_dropped(ros: Harness) -> None:
    import threading

    done: list[int] = []
    go_on = threading.Event()
    with plain_node(ros) as node:
        for k in range(10):
            node.worker.submit(lambda k=k: go_on.wait(30.0) and k, done.append)  # type: ignore[misc]
        go_on.set()
        ros.spin_until(lambda: 9 in done, "the last job")
        assert node.worker.dropped + len(done) == 10
    assert done in ([0, 6, 7, 8, 9], [6, 7, 8, 9]), "the first may have started before the second came"


def test_an_error_of_a_job_reaches_the_executor(ros: Harness) -> None:
    def fail() -> None:
        raise ConfigError("the world is flat")

    with plain_node(ros) as node:
        node.worker.submit(fail, lambda result: None)
        with pytest.raises(ConfigError, match="flat"):
            ros.spin_until(lambda: False, "the failure")


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_process_with_success(ros: Harness, by: signal.Signals) -> None:
    from tests.ros.harness import ended

    with ros.process(SCRIPT) as process:
        ros.report("plain: node", lambda report: ("pid", str(process.pid)) in report.values)
        assert ended(process, by) == (0, "")


def test_a_process_with_an_impossible_parameter_says_so_in_one_sentence(ros: Harness) -> None:
    with ros.process(SCRIPT, "--ros-args", "-p", "speed:=-1.0") as process:
        output, _ = process.communicate(timeout=30.0)
    assert process.returncode == 2
    assert output.count("\n") == 1
    assert "speed = -1.0 is impossible: it must lie in [0, 1.5] m/s" in output


def test_an_invalid_parameter_file_is_refused_in_one_sentence(ros: Harness, tmp_path: Path) -> None:
    with ros.process(SCRIPT, "--ros-args", "--params-file", tmp_path / "missing.yaml") as process:
        output, _ = process.communicate(timeout=30.0)
    assert process.returncode == 2
    assert "missing.yaml" in output
    assert "Traceback" not in output
