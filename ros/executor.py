"""An executor for nodes that hear hundreds of messages a second: rclpy's, without what one thread does not need.

rclpy makes a task of every message and wakes its own wait twice for each, so that other threads notice; here messages
and timers are served at once. Measured on the bridge, that leaves a third of the CPU time.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.subscription import Subscription
from rclpy.timer import Timer


class NodeExecutor(SingleThreadedExecutor):
    """Serves one node from one thread; what it calls for messages and timers are plain functions."""

    def _make_handler(self, entity: Any, node: Any, take_from_wait_list: Callable[[Any], Any]) -> Any:
        if isinstance(entity, Subscription) and entity.raw:
            return _Served(entity, self._serve_message)
        if isinstance(entity, Timer):
            return _Served(entity, self._serve_timer)
        return super()._make_handler(entity, node, take_from_wait_list)

    def _serve_message(self, subscription: Any) -> None:
        taken = None
        with suppress(InvalidHandle), subscription.handle:  # it may have been destroyed meanwhile
            taken = subscription.handle.take_message(subscription.msg_type, True)
        if taken is not None:
            subscription.callback(taken[0])

    def _serve_timer(self, timer: Any) -> None:
        with suppress(InvalidHandle), timer.handle:
            timer.handle.call_timer()
            timer.callback()


class _Served:
    """Has the interface of the task that rclpy's executor would make, as far as that looks at it."""

    __slots__ = ("_entity", "_serve")

    def __init__(self, entity: Any, serve: Callable[[Any], None]) -> None:
        self._entity = entity
        self._serve = serve

    def __call__(self) -> None:
        self._serve(self._entity)

    def exception(self) -> None:
        """What it raises is raised by the call."""

    def result(self) -> None:
        """Nothing."""
