"""An executor for nodes that receive hundreds of messages a second: rclpy's, with a wait set that is kept.

rclpy builds a wait set and its lists of entities anew for every wait, makes a task of every message, and wakes its own
wait twice for each, to notify other threads. This executor keeps them until an entity comes or goes, and calls the
callbacks of messages, timers and guard conditions directly. `python -m evaluation.speed.ros_waits` compares the two.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
    TimeoutObject,
)
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription
from rclpy.timer import Timer

_KINDS = ("timer", "subscription", "guard_condition", "client", "service")
"""Kinds of entities in the order in which they are served."""


class NodeExecutor(SingleThreadedExecutor):
    """Serves nodes from one thread; callbacks of messages, timers and guard conditions must be plain functions."""

    def __init__(self, *, context: Any = None) -> None:
        super().__init__(context=context)
        self._kept: _WaitSet | None = None
        self._is_changed = True
        self._tasks: list[tuple[Any, Any, Any]]
        self._takes: dict[str, Callable[[Any], Any]] = {
            "timer": self._take_timer,
            "subscription": self._take_subscription,
            "guard_condition": self._take_guard_condition,
            "client": self._take_client,
            "service": self._take_service,
            "waitable": self._take_waitable,
        }

    def wake(self) -> None:
        """Wake the executor; entities have come or gone, so that the wait set is built again."""
        self._is_changed = True
        super().wake()

    def add_node(self, node: Any) -> bool:
        """Serve a node as well; return whether it is new."""
        self._is_changed = True
        return bool(super().add_node(node))

    def remove_node(self, node: Any) -> None:
        """Serve a node no longer."""
        self._is_changed = True
        super().remove_node(node)

    def spin(self) -> None:
        """Serve the nodes until shutdown."""
        try:
            super().spin()
        finally:
            self._let_go()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Serve no more callbacks, and let go of the nodes' entities; return whether all running callbacks have ended."""
        self._let_go()
        return bool(super().shutdown(timeout_sec))

    def _wait_for_ready_callbacks(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        nodes: Sequence[Any] | None = None,
        condition: Callable[[], bool] = lambda: False,
    ) -> Iterator[tuple[Any, Any, Any]]:
        """Yield the ready callbacks of all nodes as handlers with their entity and node, as rclpy's executor does."""
        ends_s = _end(timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec)
        has_served = False
        while not has_served and not self._is_shutdown and not condition():
            for task in self._waiting_tasks():
                has_served = True
                yield task

            left_s = -1.0 if ends_s is None else max(0.0, ends_s - time.monotonic())
            ready = self._wait_set().wait(left_s)
            if self._is_shutdown:
                raise ShutdownException
            if not self._context.ok():
                raise ExternalShutdownException

            for kind, entity, node in ready:
                if entity.callback_group.can_execute(entity):
                    take = self._takes[kind]
                    has_served = True
                    yield self._make_handler(entity, node, take), entity, node
                elif kind == "guard_condition":
                    entity.trigger()  # a wait resets it
            if ends_s is not None and not has_served and time.monotonic() >= ends_s:
                raise TimeoutException
        if self._is_shutdown:
            raise ShutdownException
        if condition():
            raise ConditionReachedException

    def _waiting_tasks(self) -> list[tuple[Any, Any, Any]]:
        """Return tasks to go on with, such as coroutines that await a future, and forget the ended ones."""
        if not self._tasks:
            return []
        with self._tasks_lock:
            self._tasks = [each for each in self._tasks if not (each[0].done() or each[0].cancelled())]
            return [each for each in reversed(self._tasks) if not each[0].executing()]

    def _wait_set(self) -> _WaitSet:
        """Return the kept wait set, or a new one if an entity or the state of a callback group has changed."""
        kept = self._kept
        if kept is not None and not self._is_changed and not kept.has_changed_groups():
            return kept
        self._let_go()
        self._is_changed = False  # before the entities are read: a later change is seen by the next wait
        self._kept = _WaitSet(self.get_nodes(), self._guard, self._sigint_gc, self._context)
        return self._kept

    def _let_go(self) -> None:
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.close()

    def _make_handler(self, entity: Any, node: Any, take_from_wait_list: Callable[[Any], Any]) -> Any:
        if isinstance(entity, Subscription) and entity.raw:
            return _Served(entity, _serve_message)
        if isinstance(entity, Timer):
            return _Served(entity, _serve_timer)
        if isinstance(entity, GuardCondition):
            return _Served(entity, _serve_guard_condition)
        return super()._make_handler(entity, node, take_from_wait_list)


class _WaitSet:
    """The entities of nodes whose callback groups are free, kept in use, and rcl's wait set for them."""

    def __init__(self, nodes: Iterable[Any], guard: Any, interrupt: Any, context: Any) -> None:
        """`guard` and `interrupt` are the executor's own guard conditions; they only end a wait."""
        self._uses = ExitStack()
        self._uses.enter_context(context.handle)
        self._groups: dict[Any, tuple[Any, bool]] = {}
        self._handles: dict[str, list[Any]] = {kind: [] for kind in _KINDS}
        self._owners: dict[str, dict[int, tuple[Any, Any]]] = {kind: {} for kind in _KINDS}
        self._waitables: list[tuple[Any, Any]] = []
        for node in nodes:
            self._add(node)
        for own in (guard, interrupt):
            with suppress(InvalidHandle):  # the context may have been shut down meanwhile
                self._uses.enter_context(own.handle)
                self._handles["guard_condition"].append(own.handle)
        self._set = self._made(context)
        self._adds = (
            (self._set.add_timer, self._handles["timer"]),
            (self._set.add_subscription, self._handles["subscription"]),
            (self._set.add_guard_condition, self._handles["guard_condition"]),
            (self._set.add_client, self._handles["client"]),
            (self._set.add_service, self._handles["service"]),
        )

    def has_changed_groups(self) -> bool:
        """Return whether a callback group has become busy or free since this set was made."""
        return any(group.can_execute(entity) != was_free for group, (entity, was_free) in self._groups.items())

    def wait(self, timeout_s: float) -> list[tuple[str, Any, Any]]:
        """Return the entities that are ready within the timeout, with their kind and node; a negative timeout is none."""
        waited = self._set
        waited.clear_entities()
        for add, handles in self._adds:
            for handle in handles:
                add(handle)
        for waitable, _ in self._waitables:
            waitable.add_to_wait_set(waited)
        waited.wait(-1 if timeout_s < 0.0 else int(timeout_s * 1e9))

        found = [("waitable", waitable, node) for waitable, node in self._waitables if waitable.is_ready(waited)]
        for kind, owners in self._owners.items():
            if owners:
                ready = (owners.get(pointer) for pointer in waited.get_ready_entities(kind))
                found += [(kind, *owner) for owner in ready if owner is not None]
        return [
            each for each in found if each[0] != "timer" or each[1].handle.is_timer_ready()
        ]  # rcl reports cancelled timers too

    def close(self) -> None:
        """Let go of the entities, so that those that were destroyed meanwhile can end."""
        self._uses.close()

    def _add(self, node: Any) -> None:
        by_kind = (node.timers, node.subscriptions, node.guards, node.clients, node.services)
        for kind, entities in zip(_KINDS, by_kind, strict=True):
            for entity in entities:
                if self._use(entity, entity.handle):
                    self._handles[kind].append(entity.handle)
                    self._owners[kind][entity.handle.pointer] = (entity, node)
        for waitable in node.waitables:
            if self._use(waitable, waitable):
                self._waitables.append((waitable, node))

    def _use(self, entity: Any, handle: Any) -> bool:
        """Keep an entity in use; return whether it is waited for, which it is if it exists and its group is free."""
        group = entity.callback_group
        _, is_free = self._groups.setdefault(group, (entity, group.can_execute(entity)))
        if is_free:
            with suppress(InvalidHandle):  # it was destroyed meanwhile
                self._uses.enter_context(handle)
                return True
        return False

    def _made(self, context: Any) -> Any:
        more = [waitable.get_num_entities() for waitable, _ in self._waitables]
        sizes = {
            kind: len(handles) + sum(getattr(each, f"num_{kind}s") for each in more)
            for kind, handles in self._handles.items()
        }
        events = sum(each.num_events for each in more)
        order = ("subscription", "guard_condition", "timer", "client", "service")
        return rclpy_implementation.WaitSet(*(sizes[kind] for kind in order), events, context.handle)


def _end(timeout_s: float | None) -> float | None:
    """Return the time on the monotonic clock at which a wait ends; without a timeout or with a negative one None."""
    return None if timeout_s is None or timeout_s < 0.0 else time.monotonic() + timeout_s


def _serve_message(subscription: Any) -> None:
    taken = None
    with suppress(InvalidHandle), subscription.handle:  # the subscription may have been destroyed meanwhile
        taken = subscription.handle.take_message(subscription.msg_type, True)
    if taken is not None:
        subscription.callback(taken[0])


def _serve_timer(timer: Any) -> None:
    with suppress(InvalidHandle), timer.handle:
        timer.handle.call_timer()
        timer.callback()


def _serve_guard_condition(guard: Any) -> None:
    guard.callback()


class _Served:
    """A stand-in for an rclpy task, with the part of its interface that rclpy's executor uses."""

    __slots__ = ("_entity", "_serve")

    def __init__(self, entity: Any, serve: Callable[[Any], None]) -> None:
        self._entity = entity
        self._serve = serve

    def __call__(self) -> None:
        self._serve(self._entity)

    def exception(self) -> None:
        """Return None, since the call itself raises the callback's exceptions."""

    def result(self) -> None:
        """Return None: a callback has no result."""
