"""The complete stack of `waychair up`: goals by every interface, a rider's Stop, unknown publishers, crashes, and its
end.

Real processes, real DDS, the simulated chair in real time. Delays are judged by stamps of the processes themselves,
less the delay of the test's computer.
"""

from __future__ import annotations

import importlib.util
import os
import random
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.cli import command
from tests.ros.realtime import ALONE
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.speed.limiter import LimiterSettings
from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.grid.distance_field import are_within, distance_field
from waychair.types import Pose2

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("ROS is not installed (no rclpy)", allow_module_level=True)

from evaluation.runs.live_stack import (
    PATIENCE_S,
    Death,
    LiveStack,
    SeenMessages,
    jitter_ms,
    kill,
    until_released,
    waychair,
)

from waychair.recordings.bags.ros_messages import header, make
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.maps import read_occupancy_grid
from waychair.ros.messages.motion import pose_stamped, pose_with_covariance, twist
from waychair.ros.messages.outcomes import TaskResult
from waychair.ros.messages.reports import DiagnosticLevel, read_diagnostics
from waychair.ros.messages.wire import deserialised, native, serialised
from waychair.ros.topics import RELIABLE, RosTopic
from waychair.types import Twist

if TYPE_CHECKING:
    from tests.ros.harness import Harness

pytestmark = ALONE

GONE_MS, BACK_S = 150.0, 5.0
SOON_MS = 100.0
"""From a rider's Stop to released lines: a tick, plus the delays of the board and the messages."""

FAR = Pose2(10.4, 4.5, 3.1415926)
TRIES = 3
"""A busy computer may end a drive."""


@pytest.fixture(scope="module")
def stack(ros: Harness, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveStack]:
    with LiveStack(tmp_path_factory.mktemp("stack"), ros.domain, "--no-camera", "--no-people") as running:
        yield running


def arrives(stack: LiveStack, x: float) -> bool:
    """Whether the chair comes to rest at x, on the line along which these tests drive."""
    assert stack.really is not None
    return not stack.driving and abs(stack.really.odom_from_base.x - x) < 0.3 and abs(stack.really.twist.v) < 0.05


def test_a_late_subscriber_gets_the_map_and_the_places(stack: LiveStack) -> None:
    maps = SeenMessages()
    stack.listen(topics.MAP, read_occupancy_grid, maps)
    stack.until(lambda: maps.last is not None, "the map")
    assert maps.last.cells.shape == (200, 300)
    assert maps.last.cells.flags.writeable  # as in all other maps, so that no kernel is compiled for this one
    costs = SeenMessages()
    stack.listen(topics.GLOBAL_COSTMAP, read_occupancy_grid, costs)
    stack.until(lambda: costs.last is not None, "the costmap")
    assert set(np.unique(costs.last.cells[maps.last.cells == 0])) >= {0, 98, 99}
    assert (costs.last.cells[maps.last.cells == 100] == 100).all()
    assert set(stack.client.places()) == {"bath", "ward", "reception", "entrance", "lift"}


def test_the_footprint_surrounds_the_chair_in_odom(stack: LiveStack) -> None:
    outlines = SeenMessages()
    stack.listen(topics.FOOTPRINT, lambda message: (message.header.frame_id, message.polygon.points), outlines)
    stack.until(lambda: outlines.last is not None, "the footprint")
    frame, corners = outlines.last
    xs, ys = np.array([(corner.x, corner.y) for corner in corners]).T
    assert frame == "odom"
    assert (np.ptp(xs), np.ptp(ys)) == pytest.approx((CHAIR_A.length, CHAIR_A.width), abs=0.01)


def test_obstacles_round_the_chair_are_shown_in_odom_to_subscribers(stack: LiveStack) -> None:
    maps, costs, topic = SeenMessages(), SeenMessages(), topics.LOCAL_COSTMAP
    stack.listen(topics.MAP, read_occupancy_grid, maps)
    stack.until(lambda: maps.last is not None, "the map")
    node = stack.client.node
    looking = node.create_subscription(
        interface_type(topic.type),
        topic.name,
        lambda data: costs.all.append((0, deserialised(data, topic.type))),
        topics.profile(topic.qos),
        raw=True,
    )
    stack.until(lambda: len(costs.all) > 1, "the costs round the chair")
    node.destroy_subscription(looking)
    assert costs.last.header.frame_id == "odom"
    costs.last.header.frame_id = "map"
    near = read_occupancy_grid(costs.last)
    assert stack.localisation is not None
    map_from_odom = stack.localisation.map_from_odom
    odom_from_base = map_from_odom.inverse() @ stack.localisation.map_from_base
    rows, columns = np.nonzero(near.cells == 100)
    middles = (np.stack([columns, rows], axis=1) + 0.5) * near.resolution
    stands = transform_points(map_from_odom @ near.map_from_grid, middles)
    walls = distance_field(maps.last)
    assert are_within(walls.metres, maps.last, stands, 0.1).mean() > 0.95
    here = cells_from_points(near, np.array([[odom_from_base.x, odom_from_base.y]]))[0]
    assert near.cells[tuple(here)] < 99
    assert np.abs(here - np.array(near.cells.shape) / 2).max() * near.resolution < 0.3


@pytest.mark.parametrize("name", ["bt_navigator", "amcl"])
def test_scripts_that_wait_for_nav2_find_active_nodes(stack: LiveStack, name: str) -> None:
    kind = interface_type("lifecycle_msgs/srv/GetState")
    asked = stack.client.node.create_client(kind, f"{name}/get_state")
    stack.until(asked.service_is_ready, "the service")
    answer = asked.call_async(kind.Request())
    stack.until(answer.done, "the answer")
    assert answer.result().current_state.label == "active"
    stack.client.node.destroy_client(asked)


def test_without_a_goal_there_is_nothing_to_confirm(stack: LiveStack) -> None:
    assert stack.client.confirm() == (False, "there is no goal to confirm: request one first")


def test_a_goal_by_topic_waits_for_the_riders_confirmation_and_is_reached(stack: LiveStack) -> None:
    node = stack.client.node
    publisher = node.create_publisher(interface_type(topics.GOAL.type), "goal_pose", topics.profile(topics.GOAL.qos))
    stack.until(lambda: publisher.get_subscription_count() > 0, "the navigator to listen")

    def ask() -> None:
        publisher.publish(serialised(pose_stamped(node.get_clock().now().nanoseconds, Pose2(1.6, 1.0, 0.0))))
        stack.spin(0.5)
        assert not stack.driving

    stack.drive(ask, lambda: arrives(stack, 1.6))
    node.destroy_publisher(publisher)


@pytest.mark.nightly
def test_a_goal_of_nav2s_own_client_is_reached_with_feedback(stack: LiveStack) -> None:
    client = stack.client
    client.waitUntilNav2Active()

    def ask() -> None:
        assert client.goToPose(native(pose_stamped(client.node.get_clock().now().nanoseconds, Pose2(2.2, 1.0, 0.0))))

    stack.drive(ask, lambda: client.getResult() is TaskResult.SUCCEEDED)
    assert client.isTaskComplete()
    stack.until(lambda: client.getFeedback() is not None, "the way left")
    assert client.getFeedback().distance_remaining >= 0.0
    stack.until(lambda: arrives(stack, 2.2), "the truth to follow")


@pytest.mark.nightly
def test_several_goals_by_the_command_line_are_reached(stack: LiveStack) -> None:
    for _ in range(TRIES):
        told = waychair(stack.domain, "goto", "2.8,1.0,0", "3.4,1.0,0", "--yes")
        if told.returncode == 0:
            break
    assert told.returncode == 0, told.stderr
    assert [line.split(":")[0] for line in told.stdout.splitlines()] == ["2.8,1.0,0", "3.4,1.0,0"]
    stack.until(lambda: arrives(stack, 3.4), "the truth to follow")


def test_the_status_has_the_place_of_the_chair_and_no_reason_against_a_drive(stack: LiveStack) -> None:
    def told() -> bool:
        """Asked again where a busy computer has been late for the chair meanwhile."""
        if stack.state is not None and stack.state.halts:
            stack.client.reset_faults(10.0)
        stack.until_ready()
        status = waychair(stack.domain, "status")
        assert status.returncode == 0, status.stderr
        return "(ok, " in status.stdout and "nothing prevents a drive" in status.stdout

    stack.until(told, "status to say that nothing prevents a drive", 2 * PATIENCE_S)


def test_a_goal_in_an_unknown_frame_is_refused_and_moves_nothing(stack: LiveStack) -> None:
    goal = native(pose_stamped(stack.client.node.get_clock().now().nanoseconds, FAR, "narnia"))
    assert not stack.client.goToPose(goal)
    assert "the frame 'narnia' is not accepted: send it in map" in stack.log
    assert stack.client.confirm()[0] is False


def test_a_speed_limit_is_obeyed_and_removed(stack: LiveStack) -> None:
    node, topic = stack.client.node, topics.SPEED_LIMIT
    publisher = node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))
    stack.until(lambda: publisher.get_subscription_count() > 0, "the navigator to listen")

    def limit(percent: float) -> None:
        head = header(node.get_clock().now().nanoseconds, "map")
        publisher.publish(serialised(make(topic.type, head, True, percent)))

    def ask() -> None:
        stack.client.go_to_pose(far_from(stack), 10.0)

    limit(100.0 * 0.15 / LimiterSettings().max_speed)
    stack.drive(ask, lambda: keeps(stack, 0.1, 0.15 + 1e-6))
    limit(0.0)
    stack.client.cancel()
    stack.drive(ask, lambda: keeps(stack, 0.2, 2.0))
    node.destroy_publisher(publisher)
    stack.client.cancel()


def test_a_pose_set_far_away_ends_the_drive_and_the_right_one_corrects_it(stack: LiveStack) -> None:
    node, topic = stack.client.node, topics.INITIAL_POSE
    publisher = node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))
    stack.until(lambda: publisher.get_subscription_count() > 0, "the mapper to listen")
    stack.begin(far_from(stack))
    assert stack.localisation is not None
    said_ns = node.get_clock().now().nanoseconds
    publisher.publish(serialised(pose_with_covariance(said_ns, stack.localisation.map_from_base @ Pose2(3.0))))
    stack.until(lambda: not stack.driving, "the drive to end")
    assert any("pose_jump" in dict(state.halts) for _, state in stack.states.since(said_ns))
    stack.until(lambda: stack.really is not None and abs(stack.really.twist.v) < 0.01, "the chair to rest")
    assert stack.really is not None
    right_ns = node.get_clock().now().nanoseconds
    publisher.publish(serialised(pose_with_covariance(right_ns, stack.really.odom_from_base)))
    stack.until(lambda: stack.off_m() < 0.1, "the place to be right")
    stack.until_ready(right_ns)
    assert not stack.driving
    node.destroy_publisher(publisher)


@pytest.mark.parametrize("way", ["topic", pytest.param("service", marks=pytest.mark.nightly)])
def test_the_riders_stop_releases_the_lines_at_once_and_nothing_resumes(stack: LiveStack, way: str) -> None:
    node = stack.client.node
    publisher = node.create_publisher(interface_type(topics.STOP.type), "stop", topics.profile(topics.STOP.qos))
    stack.until(lambda: publisher.get_subscription_count() > 0, "the bridge to listen")
    stack.begin(far_from(stack))
    pressed_ns = node.get_clock().now().nanoseconds
    if way == "topic":
        publisher.publish(serialised(make("std_msgs/msg/Empty", 0)))
    else:
        assert stack.client.stop() == (True, "stopped")
    gone_ns = until_released(stack, pressed_ns)
    assert (gone_ns - pressed_ns) / 1e6 < SOON_MS + jitter_ms(stack, pressed_ns)
    stack.until(stack.client.is_task_complete, "the client to be told")
    assert stack.client.result().reason == "Stop was pressed: ask for a goal again to drive on"
    assert not resumes(stack, gone_ns)
    assert stack.client.confirm()[0] is False
    node.destroy_publisher(publisher)
    told = waychair(stack.domain, "status").stdout
    assert "last stop     Stop was pressed: ask for a goal again to drive on" in told
    assert "driving by itself to" in explained(stack, "stop_pressed")


def test_a_cancelled_drive_comes_to_rest(stack: LiveStack) -> None:
    stack.begin(far_from(stack))
    stack.client.cancelTask()
    stack.until(stack.client.is_task_complete, "the client to be told")
    assert stack.client.getResult() is TaskResult.CANCELED
    stack.until(lambda: not stack.driving, "the drive to end")


@pytest.mark.nightly
def test_a_paused_drive_stands_and_continues_on_request(stack: LiveStack) -> None:
    assert stack.client.pause() == (False, "there is no drive to pause")
    stack.begin(far_from(stack))
    told = waychair(stack.domain, "pause")
    assert (told.returncode, told.stdout) == (0, "paused: the goal is kept\n")
    stack.until(lambda: stack.really is not None and abs(stack.really.twist.v) < 0.01, "the chair to rest")
    stack.spin(1.0)
    assert stack.driving
    assert stack.really is not None
    assert abs(stack.really.twist.v) < 0.01
    told = waychair(stack.domain, "go-on")
    assert (told.returncode, told.stdout) == (0, "the drive goes on\n")
    stack.until(lambda: stack.really is not None and stack.really.twist.v > 0.1, "the chair to go on")
    again = waychair(stack.domain, "go-on")
    assert again.returncode == 1
    assert "no drive is paused" in again.stderr
    assert stack.client.cancel() == (True, "cancelled")


def test_another_goal_ends_the_present_drive_and_waits_for_its_own_confirmation(stack: LiveStack) -> None:
    stack.begin(far_from(stack))
    stack.ask(elsewhere(stack))
    assert not stack.driving
    assert stack.client.cancel() == (True, "cancelled")


@pytest.mark.nightly
def test_a_confirmation_of_a_replaced_goal_is_refused(stack: LiveStack) -> None:
    goal = far_from(stack)
    shown = stack.ask(goal)
    told = waychair(stack.domain, "confirm", "5.0,1.0,0")
    assert told.returncode == 1
    assert f"the waiting goal is {'bath' if goal == FAR else 'entrance'}: check it" in told.stderr
    for _ in range(TRIES):
        stack.ask(elsewhere(stack))
        done, sentence = stack.client.confirm(goal_id=shown)
        assert not done
        if not sentence.startswith("there is no goal"):  # which a busy computer has ended
            break
    assert sentence.startswith("the goal has changed since it was shown")
    stack.spin(0.3)
    assert not stack.driving
    assert stack.client.cancel() == (True, "cancelled")


def test_f26_a_second_publisher_of_speeds_ends_the_drive(stack: LiveStack) -> None:
    stack.begin(far_from(stack))
    node = stack.client.node
    publisher = node.create_publisher(
        interface_type(topics.COMMAND.type), topics.COMMAND.name, topics.profile(topics.COMMAND.qos)
    )
    came_ns = node.get_clock().now().nanoseconds
    try:
        publisher.publish(serialised(twist(Twist(0.8, 0.0))))
        until_released(stack, came_ns)
        stack.until(  # a publisher is known a little before its node's name is
            lambda: "onlooker" in dict(stack.state.halts if stack.state else ()).get("two_commanders", ""),
            "the stop that names the other program",
        )
        assert stack.client.confirm()[0] is False
    finally:
        node.destroy_publisher(publisher)
    stack.until_ready(node.get_clock().now().nanoseconds)
    assert not resumes(stack, came_ns + 1_000_000_000)


def stops_and_comes_back(stack: LiveStack, death: Death) -> None:
    assert death.gone_ms <= GONE_MS + death.jitter_ms
    assert death.back_s <= BACK_S + stack.start_s
    assert death.off_m < (0.3 if death.process == "simulator" else 0.15)  # it is set back to where it was before
    assert not death.resumed


@pytest.mark.parametrize(
    "name",
    ["navigator", *(pytest.param(each, marks=pytest.mark.nightly) for each in ("mapper", "bridge", "simulator"))],
)
def test_f25_a_killed_node_stops_the_chair_and_restarts(stack: LiveStack, name: str) -> None:
    stack.begin(far_from(stack))
    stack.spin(random.Random(name).uniform(0.1, 1.5))
    stops_and_comes_back(stack, kill(stack, name))


@pytest.mark.nightly
def test_the_black_box_survives_a_killed_bridge_and_tells_its_last_state(stack: LiveStack) -> None:
    stack.begin(far_from(stack))
    stops_and_comes_back(stack, kill(stack, "bridge"))
    why = explained(stack, "program_ended")
    assert "driving by itself to" in why
    assert "in the last tick of the log the chair moved, and the computer had the lines" in why


@pytest.mark.parametrize(
    "name", ["bridge", *(pytest.param(each, marks=pytest.mark.nightly) for each in ("navigator", "mapper"))]
)
def test_a_delayed_node_ends_the_drive_and_needs_no_reset(stack: LiveStack, name: str) -> None:
    stack.begin(far_from(stack))
    death = kill(stack, name, signal.SIGSTOP)
    assert death.gone_ms <= GONE_MS + death.jitter_ms
    assert not death.resumed
    assert stack.state is not None
    assert stack.state.ready or {stop_id for stop_id, _ in stack.state.halts} == {"board_host_silent"}


@pytest.mark.nightly
def test_a_dead_simulator_gives_one_clear_diagnostic(stack: LiveStack) -> None:
    reports = SeenMessages()
    stack.listen(topics.DIAGNOSTICS, read_diagnostics, reports)
    stack.begin(far_from(stack))
    dead_ns = time.time_ns()
    stops_and_comes_back(stack, kill(stack, "simulator"))
    said = [report for _, each in reports.since(dead_ns) for report in each if report.name == "/bridge: board"]
    # The second where the dead terminal's number has gone to a program beside this test.
    causes = ("there is no terminal", "leads to another program's terminal")
    errors = [report.message for report in said if report.level is DiagnosticLevel.ERROR]
    assert any(cause in message for message in errors for cause in causes)
    back_ns = time.time_ns()
    stack.until(
        lambda: any(
            report.name == "/bridge: board" and report.level is DiagnosticLevel.OK
            for _, each in reports.since(back_ns)
            for report in each
        ),
        "the board to be well again",
    )


@pytest.mark.nightly
def test_a_node_that_hangs_is_restarted(stack: LiveStack) -> None:
    stack.begin(far_from(stack))
    before, hung_ns = stack.pids["bridge"], stack.client.node.get_clock().now().nanoseconds
    os.kill(before, signal.SIGSTOP)
    until_released(stack, hung_ns)
    stack.until(lambda: stack.pids["bridge"] != before, "another bridge")
    stack.until_ready(stack.client.node.get_clock().now().nanoseconds)
    assert "'bridge' has hung for" in stack.log
    assert not stack.driving


def test_the_stack_ends_cleanly_on_request(stack: LiveStack) -> None:
    pids = stack.pids.values()
    assert stack.end(signal.SIGTERM) == 0
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)
    assert "Traceback" not in stack.log


@pytest.fixture(scope="module")
def left(ros: Harness, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveStack]:
    """Another chair's stack, in a namespace."""
    folder = tmp_path_factory.mktemp("left")
    with LiveStack(folder, ros.domain, "--no-camera", "--no-people", namespace="left") as running:
        yield running


@pytest.mark.nightly
def test_a_chair_in_a_namespace_is_driven_only_inside_of_it(left: LiveStack) -> None:
    frames = SeenMessages()
    left.listen(RosTopic("tf", "tf2_msgs/msg/TFMessage", RELIABLE), lambda message: message, frames)
    there = ("goto", "1.6,1.0,0", "--yes", "--namespace", "/left")
    # asked again where a stalled computer has ended the drive
    left.until(lambda: waychair(left.domain, *there).returncode == 0, "the chair to be driven in the namespace")
    left.until(lambda: frames.last is not None, "a transform in the namespace")
    assert waychair(left.domain, "status").returncode == 1, "there is no topic outside"
    everybodys = {"/diagnostics", "/parameter_events", "/rosout"}

    def outside() -> set[str]:
        """Topics with a publisher; an observer of another stack still listens to some."""
        node = left.client.node
        names = {name for name, _ in node.get_topic_names_and_types() if node.count_publishers(name)}
        return {name for name in names if not name.startswith("/left/")} - everybodys

    # nodes killed before are still known for some seconds
    left.until(lambda: not outside(), "nothing to be outside of the namespace")


def far_from(stack: LiveStack) -> Pose2:
    """A goal at the other end of the line along which these tests drive."""
    return FAR if stack.really is None or stack.really.odom_from_base.x < 5.0 else Pose2(1.0, 1.0, 0.0)


def keeps(stack: LiveStack, low: float, high: float) -> bool:
    """Whether the computer has driven for half a second at a speed [m/s] between these."""
    lately = [state.command for _, state in stack.states.since(time.time_ns() - 500_000_000)]
    return len(lately) > 5 and all(command is not None and low < command.v <= high for command in lately)


def elsewhere(stack: LiveStack) -> Pose2:
    """A goal other than that of `far_from`, and not where the chair stands: there it would have arrived at once."""
    stands_there = stack.really is not None and abs(stack.really.odom_from_base.x - 3.0) < 1.0
    return Pose2(1.9 if stands_there else 3.0, 1.0, 0.0)


def explained(stack: LiveStack, stop: str) -> str:
    """Return `why`'s account of the last stop, once the black box holds it."""

    said = ""

    def told() -> bool:
        nonlocal said
        said = command.waychair("why", "--box", box_of(stack)).stdout
        return f": {stop}\n" in said

    stack.until(told, f"{stop} in the box")
    return said


def box_of(stack: LiveStack) -> str:
    """The run's black box."""
    return str(stack.folder / "run" / "box")


def resumes(stack: LiveStack, since_ns: int) -> bool:
    """Whether the computer takes the lines again in the next half second."""
    stack.spin(0.5)
    return stack.driving or any(
        state.command is not None for at_ns, state in stack.states.since(since_ns) if state.stamp_ns > since_ns + 10**8
    )
