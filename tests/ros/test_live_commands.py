"""Commands for a chair that runs: refused goals are answered, Ctrl-C says what the chair does, a new place is known."""

from __future__ import annotations

import importlib.util
import math
import signal
import subprocess
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.ros.realtime import ALONE
from waychair.types import Pose2

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("ROS is not installed (no rclpy)", allow_module_level=True)

from evaluation.runs.live_stack import COMMAND, LiveStack, waychair

from waychair.ros import topics
from waychair.ros.environment import ros_environment
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.motion import pose_stamped
from waychair.ros.messages.wire import serialised

if TYPE_CHECKING:
    from tests.ros.harness import Harness

pytestmark = ALONE

FAR = Pose2(10.4, 4.5, math.pi)
TRIES = 5
"""A busy computer may end a drive."""


@pytest.fixture(scope="module")
def stack(ros: Harness, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveStack]:
    with LiveStack(tmp_path_factory.mktemp("stack"), ros.domain, "--no-camera", "--no-people") as running:
        yield running


def test_a_goal_by_topic_that_is_refused_is_answered_in_log_and_status_until_one_is_accepted(stack: LiveStack) -> None:
    node = stack.client.node
    publisher = node.create_publisher(
        interface_type(topics.GOAL.type), topics.GOAL.name, topics.profile(topics.GOAL.qos)
    )
    stack.until(lambda: publisher.get_subscription_count() > 0, "the navigator to listen")
    wrong = {
        "the frame 'odom' is not accepted": pose_stamped(node.get_clock().now().nanoseconds, FAR, "odom"),
        "lies outside the map": pose_stamped(node.get_clock().now().nanoseconds, Pose2(400.0, 1.0)),
    }
    for sentence, goal in wrong.items():
        publisher.publish(serialised(goal))
        publisher.publish(serialised(goal))
        stack.until(lambda sentence=sentence: sentence in (stack.state.last_goal if stack.state else ""), sentence)
        assert stack.log.count(sentence) == 1
    told = waychair(stack.domain, "status").stdout
    assert "last goal     the goal 400.00, 1.00 was refused: " in told
    stack.until_ready(node.get_clock().now().nanoseconds)  # until then a goal is dropped, as of a chair without a pose
    said = ""
    for _ in range(TRIES):
        assert stack.client.go_to_pose(FAR)
        stack.until(lambda: stack.state is not None and not stack.state.last_goal, "the refusal to be forgotten")
        done, said = stack.client.cancel()
        assert done
        if said == "cancelled":
            break
    assert said == "cancelled"
    node.destroy_publisher(publisher)


def test_an_initial_pose_off_the_map_is_refused_and_one_on_it_is_taken(stack: LiveStack) -> None:
    told = waychair(stack.domain, "initial-pose", "400,1,0")
    assert told.returncode == 1
    assert "an initial pose was refused: 400.00, 1.00 lies outside the map" in told.stderr
    assert "initial pose  an initial pose was refused" in waychair(stack.domain, "status").stdout
    assert stack.really is not None
    here = stack.really.odom_from_base
    told = waychair(stack.domain, "initial-pose", f"{here.x:.2f},{here.y:.2f},{here.theta:.2f}")
    assert told.returncode == 0, told.stderr
    assert "(ok, " in told.stdout
    assert "initial pose" not in waychair(stack.domain, "status").stdout


def test_a_place_that_is_added_while_the_chair_runs_is_known_to_it(stack: LiveStack) -> None:
    folder = stack.folder / "run" / "map"
    added = waychair(stack.domain, "places", "--map", str(folder), "--add", "annex", "3,1,0")
    assert added.returncode == 0, added.stderr
    stack.until(lambda: "annex" in stack.client.places(), "the new place")


@pytest.mark.nightly
def test_ctrl_c_of_goto_says_that_the_chair_drives_on_or_cancels_the_drive(stack: LiveStack) -> None:
    for more, ends, words in (((), False, "DRIVES ON"), (("--cancel-on-exit",), True, "was cancelled")):

        def ask(more: tuple[str, ...] = more) -> None:
            nonlocal running
            if running is not None and running.poll() is None:
                return  # it is slow to start on a busy computer
            running = subprocess.Popen(
                [*COMMAND, "goto", "10.4,4.5,3.14", "--yes", *more],
                env=ros_environment(domain=stack.domain),
                stderr=subprocess.PIPE,
                text=True,
            )

        running: subprocess.Popen[str] | None = None
        stack.drive(ask, lambda: stack.driving and stack.really is not None and abs(stack.really.twist.v) > 0.1)
        assert running is not None
        running.send_signal(signal.SIGINT)
        said = running.communicate(timeout=20.0)[1]
        assert words in said
        if ends:
            stack.until(lambda: not stack.driving, "the drive to end")
        else:
            assert "`waychair stop` stops it at once" in said
            assert stack.driving
            assert waychair(stack.domain, "stop").stdout == "stopped\n"
            stack.until(lambda: not stack.driving, "the drive to end")
