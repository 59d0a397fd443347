"""The executor of nodes: it serves as rclpy's does, and sees entities that come and go between its waits."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest

from waychair.ros.interface_types import interface_type

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.task import Future

    from tests.ros.harness import Harness
    from waychair.ros.executor import NodeExecutor


PATIENCE_S = 20.0
STRING = "std_msgs/msg/String"
TRIGGER = "std_srvs/srv/Trigger"


@pytest.fixture
def node(ros: Harness) -> Iterator[Node]:
    import rclpy

    made = rclpy.create_node("served", start_parameter_services=False)
    yield made
    made.destroy_node()


@pytest.fixture
def executor(node: Node) -> Iterator[NodeExecutor]:
    from waychair.ros.executor import NodeExecutor

    made = NodeExecutor()
    made.add_node(node)
    yield made
    made.shutdown()


def group() -> Any:
    from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

    return MutuallyExclusiveCallbackGroup()


def future(executor: NodeExecutor) -> Future:
    from rclpy.task import Future

    return Future(executor=executor)


def spin_until(executor: NodeExecutor, condition: Callable[[], object]) -> bool:
    ends = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > ends:
            return False
        executor.spin_once(timeout_sec=0.05)
    return True


def test_a_subscription_that_comes_later_is_served_and_one_that_goes_ends(node: Node, executor: NodeExecutor) -> None:
    from rclpy.serialization import serialize_message

    executor.spin_once(timeout_sec=0.0)
    heard: list[bytes] = []
    subscription = node.create_subscription(interface_type(STRING), "told", heard.append, 10, raw=True)
    sender = node.create_publisher(interface_type(STRING), "told", 10)
    assert spin_until(executor, lambda: sender.get_subscription_count() == 1)
    sender.publish(interface_type(STRING)(data="here"))
    assert spin_until(executor, lambda: heard)
    assert heard == [serialize_message(interface_type(STRING)(data="here"))]
    node.destroy_subscription(subscription)
    assert spin_until(executor, lambda: sender.get_subscription_count() == 0)


def test_a_wait_ends_at_its_timeout_and_at_a_guard_condition_of_another_thread(
    node: Node, executor: NodeExecutor
) -> None:
    begun = time.monotonic()
    executor.spin_once(timeout_sec=0.2)
    assert time.monotonic() - begun >= 0.19
    rung: list[int] = []
    bell = node.create_guard_condition(lambda: rung.append(threading.get_ident()))
    ringer = threading.Timer(0.1, bell.trigger)
    ringer.start()
    assert spin_until(executor, lambda: rung)
    ringer.join()
    assert rung == [threading.get_ident()]
    executor.spin_once(timeout_sec=0.05)
    assert len(rung) == 1


def test_a_callback_that_awaits_holds_back_only_its_own_group(node: Node, executor: NodeExecutor) -> None:
    kind, saved = interface_type(TRIGGER), future(executor)
    begun: list[int] = []
    ticks: list[float] = []

    async def save(request: object, response: object) -> object:
        begun.append(len(ticks))
        await saved
        return response

    node.create_service(kind, "save", save, callback_group=group())
    node.create_timer(0.01, lambda: ticks.append(time.monotonic()))
    client = node.create_client(kind, "save", callback_group=group())
    assert spin_until(executor, client.service_is_ready)
    first, second = client.call_async(kind.Request()), client.call_async(kind.Request())
    assert spin_until(executor, lambda: begun and len(ticks) > begun[0] + 20)
    assert len(begun) == 1
    assert not first.done()
    saved.set_result(None)
    assert spin_until(executor, lambda: first.done() and second.done())
    assert len(begun) == 2


def test_a_request_that_waits_for_a_busy_group_costs_no_empty_waits(node: Node, executor: NodeExecutor) -> None:
    kind, done = interface_type(TRIGGER), future(executor)
    begun: list[bool] = []

    async def wait(request: object, response: object) -> object:
        begun.append(True)
        await done
        return response

    node.create_service(kind, "wait", wait, callback_group=group())
    client = node.create_client(kind, "wait", callback_group=group())
    assert spin_until(executor, client.service_is_ready)
    answers = [client.call_async(kind.Request()) for _ in range(2)]
    assert spin_until(executor, lambda: begun)
    for _ in range(10):  # what the first request has set in motion
        executor.spin_once(timeout_sec=0.02)
    waits, ends = 0, time.monotonic() + 0.5
    while time.monotonic() < ends:
        executor.spin_once(timeout_sec=0.1)
        waits += 1
    assert waits < 20
    done.set_result(None)
    assert spin_until(executor, lambda: all(answer.done() for answer in answers))


def test_an_error_of_a_callback_ends_the_spinning(node: Node, executor: NodeExecutor) -> None:
    def fail() -> None:
        raise ValueError("told")

    node.create_timer(0.01, fail)
    with pytest.raises(ValueError, match="told"):
        executor.spin()
    executor.remove_node(node)
