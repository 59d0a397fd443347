"""Answers of the chair's nodes for the web server's threads: the node's executor receives them, a thread waits for them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.task import Future

from waychair.runtime.pages.chair_port import ANSWER_S

if TYPE_CHECKING:
    from rclpy.node import Node


def in_executor(node: Node, send: Callable[[], Future]) -> Future:
    """Send an action's request in the executor's thread; return a future of its answer.

    From another thread the answer could arrive before rclpy has noted the request. It would be lost ("unexpected goal response").
    """
    answered = Future()

    def call() -> None:
        send().add_done_callback(lambda sent: answered.set_result(sent.result()))

    node.executor.create_task(call)
    return answered


def wait_for(future: Future) -> Any:
    """Wait for an answer that arrives in the executor's thread, and return it; None after the timeout."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    return future.result() if done.wait(0.8 * ANSWER_S) else None
