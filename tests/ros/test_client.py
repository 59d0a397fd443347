"""The client alone: silent nodes and unreadable messages."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from waychair.errors import MessageError, RosError
from waychair.ros import topics
from waychair.ros.messages.motion import pose_stamped
from waychair.types import Pose2

if TYPE_CHECKING:
    from tests.ros.harness import Harness
    from waychair.ros.client import ChairClient

LONG_S = 5.0


class Ending:
    """A result that arrives while the client listens."""

    def done(self) -> bool:
        return False


@pytest.fixture
def client(ros: Harness) -> Iterator[ChairClient]:
    from waychair.ros.client import ChairClient

    with ChairClient("client_of_tests", domain=ros.domain) as client:
        yield client


def test_a_client_that_has_not_listened_for_long_listens_before_it_calls_the_navigator_dead(
    client: ChairClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    from waychair.ros.messages.outcomes import TaskResult

    monkeypatch.setattr(client, "_ended", Ending())
    client._feedback_s = time.monotonic() - LONG_S
    assert client.result().result is TaskResult.FAILED

    def tells(*, timeout_sec: float) -> None:
        client._feedback_s = time.monotonic()

    client._feedback_s = time.monotonic() - LONG_S
    monkeypatch.setattr(client._executor, "spin_once", tells)
    assert client.result().result is TaskResult.UNKNOWN


def test_an_unreadable_message_is_named_if_no_other_comes(ros: Harness, client: ChairClient) -> None:
    from waychair.ros.interface_types import interface_type
    from waychair.ros.messages.wire import serialised

    topic = topics.GOAL
    publisher = ros.node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))

    def read(message: Any) -> Any:
        raise MessageError("a pose's quaternion has length 0")

    timer = client.node.create_timer(0.05, lambda: publisher.publish(serialised(pose_stamped(5, Pose2()))))
    with pytest.raises(
        RosError, match="within 2 s; its messages cannot be decoded: a pose's quaternion has length 0"
    ) as caught:
        client._latest(topic, read, 2.0, "navigator")
    assert not isinstance(caught.value, MessageError)
    client.node.destroy_timer(timer)
    ros.node.destroy_publisher(publisher)


def test_a_command_that_only_asks_loads_no_planner_and_no_kernels(ros_domain: int) -> None:
    program = (
        "import sys, waychair.ros.client\nheavy = {'numba', 'scipy', 'gtsam', 'matplotlib'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
