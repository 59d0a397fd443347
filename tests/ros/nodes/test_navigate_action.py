"""navigate_to_pose across two processes, called as nav2_simple_commander and BT clients call it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from waychair.errors import ConfigError, GoalOccupied, NoPath, StartOccupied
from waychair.types import Goal, Pose2

if TYPE_CHECKING:
    from tests.ros.harness import Harness

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # action_msgs/GoalStatus


class Client:
    """An action client in the tests' process."""

    def __init__(self, ros: Harness, server: int) -> None:
        """`server` is the number of the server's process."""
        from rclpy.action import ActionClient

        from waychair.ros.interface_types import interface_type

        self._ros = ros
        self._server = server
        self.kind = interface_type("nav2_msgs/action/NavigateToPose")
        self.client = ActionClient(ros.node, self.kind, "navigate_to_pose")
        ros.spin_until(self.client.server_is_ready, "the action's server")

    def ask(self, pose: Pose2, frame: str = "map") -> tuple[Any, list[Any]]:
        """The goal's handle, and its feedback as it comes."""
        from waychair.ros.messages.motion import pose_stamped
        from waychair.ros.messages.wire import native

        feedback: list[Any] = []
        goal = self.kind.Goal(pose=native(pose_stamped(0, pose, frame)))
        asked = self.client.send_goal_async(goal, lambda message: feedback.append(message.feedback))
        self._ros.spin_until(asked.done, "the goal's acceptance")
        return asked.result(), feedback

    def servers_cpu_s(self) -> float:
        """CPU time that the server's process has used."""
        fields = Path(f"/proc/{self._server}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def result(self, handle: Any) -> tuple[int, int, str]:
        """Status, error code and sentence."""
        asked = handle.get_result_async()
        self._ros.spin_until(asked.done, "the result")
        return asked.result().status, asked.result().result.error_code, asked.result().result.error_msg


@pytest.fixture(scope="module")
def client(ros: Harness) -> Iterator[Client]:
    with ros.process(Path(__file__).parents[1] / "drive_node.py") as server:
        client = Client(ros, server.pid)
        yield client
        client.client.destroy()


def test_a_goal_is_reached_with_feedback_on_the_way(client: Client) -> None:
    handle, feedback = client.ask(Pose2(3.0, 4.0, 1.0))
    assert client.result(handle) == (SUCCEEDED, 0, "")
    distances = [each.distance_remaining for each in feedback]
    assert len(distances) >= 8
    assert distances == sorted(distances, reverse=True)
    last = feedback[-1]
    assert (last.current_pose.header.frame_id, last.number_of_recoveries) == ("map", 2)
    assert (last.current_pose.pose.position.x, last.navigation_time.sec) == (3.0, 1)
    assert last.navigation_time.nanosec == 500_000_000


def test_an_unreachable_goal_is_aborted_with_the_code_of_nav2_and_a_sentence(client: Client) -> None:
    handle, _ = client.ask(Pose2(60.0))
    assert client.result(handle) == (ABORTED, 206, "the goal (60, 0) lies in a wall")


def test_a_goal_in_an_unknown_frame_is_rejected(client: Client) -> None:
    handle, _ = client.ask(Pose2(1.0), frame="moon")
    assert not handle.accepted


def test_a_cancelled_goal_ends_as_cancelled(client: Client, ros: Harness) -> None:
    handle, feedback = client.ask(Pose2(40.0))
    ros.spin_until(lambda: feedback, "feedback")
    cancelled = handle.cancel_goal_async()
    ros.spin_until(cancelled.done, "the answer")
    assert len(cancelled.result().goals_canceling) == 1
    assert client.result(handle) == (CANCELED, 0, "a client has canceled the goal")


def test_a_new_goal_ends_the_one_before(client: Client) -> None:
    first, _ = client.ask(Pose2(40.0))
    second, _ = client.ask(Pose2(1.0))
    assert client.result(first) == (ABORTED, 0, "another goal was given")
    assert client.result(second)[0] == SUCCEEDED


def test_every_failure_of_planning_has_a_code_of_nav2(ros: Harness) -> None:
    from waychair.ros.nodes.navigator_parts.navigate_action import error_code

    codes = [error_code(kind("")) for kind in (StartOccupied, GoalOccupied, NoPath, ConfigError)]
    assert codes == [205, 206, 208, 0]


def test_a_server_waiting_for_the_end_of_a_drive_is_idle(client: Client, ros: Harness) -> None:
    """An executor that polled its coroutines would keep a core busy, 50 ms for each of these ticks."""
    handle, feedback = client.ask(Pose2(45.0))
    ros.spin_until(lambda: len(feedback) > 2, "feedback")
    before_s, count = client.servers_cpu_s(), len(feedback)
    ros.spin_until(lambda: len(feedback) >= count + 40, "more feedback")
    assert client.servers_cpu_s() - before_s < 40 * 0.015
    handle.cancel_goal_async()
    assert client.result(handle)[0] == CANCELED


def test_the_reported_recoveries_are_those_of_this_drive(ros: Harness) -> None:
    """Not the plans: with people about there is a new one each second."""
    from types import SimpleNamespace

    from waychair.ros.node_settings.navigator import NavigatorNodeSettings
    from waychair.ros.nodes.navigator_node import NavigatorNode

    told: list[Any] = []
    recovery = SimpleNamespace(begun=3)
    navigator = SimpleNamespace(recovery=recovery, active=True)
    node: Any = SimpleNamespace(
        settings=NavigatorNodeSettings(),
        _navigation=SimpleNamespace(path=None, plans=9),
        _pilot=SimpleNamespace(navigator=navigator, go=lambda goal: None),
        _action=SimpleNamespace(tell=told.append, active=True),
        _drive=SimpleNamespace(ticks=3),
        _refusals=SimpleNamespace(accepted=lambda: None),
        _missing_input=lambda now_ns: "",
    )
    NavigatorNode.begin_leg(node, Goal(Pose2()), 7)
    NavigatorNode._update_action(node, Pose2())
    recovery.begun, node._drive.ticks = 4, 7
    NavigatorNode._update_action(node, Pose2())
    assert [progress.recoveries for progress in told] == [0, 1]
