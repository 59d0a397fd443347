"""A node's subscription: decodes raw messages of one topic, and diagnoses missing, stale, late and invalid messages."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from waychair.errors import MessageError
from waychair.recordings.bags.ros_transforms import stamp_ns as nanoseconds
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.messages.wire import deserialised
from waychair.ros.topics import RosTopic, profile

if TYPE_CHECKING:
    from rclpy.node import Node

T = TypeVar("T")

CLOCK_ERROR_NS = 5_000_000_000
"""A message whose stamp differs from its arrival by more than this is from another clock."""

DECODING_ERRORS = (ArithmeticError, AssertionError, IndexError, TypeError, ValueError)
"""Errors that decoding absurd numbers can raise. An invalid message must never end a node."""

_QUEUE_S = 0.1  # s; messages of this time are queued while the node is busy

_CHAIR_NODES = frozenset(("bridge", "cells", "mapper", "navigator", "page", "recorder"))
"""The nodes of a chair that subscribe to topics of drivers."""

UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
"""ROS's name of a publisher that was discovered before its node."""

_NAMELESS = "a node whose name is not known yet"

SLOW_FRACTION = 0.8
"""A topic below this fraction of its nominal rate is reported as slow."""


class Input(Generic[T]):
    """One subscription, with the age and the number of its messages, and the reasons of missing or refused messages.

    `latest` is the last decoded value; None before the first.
    """

    def __init__(
        self,
        node: Node,
        topic: RosTopic,
        read: Callable[[Any], T],
        take: Callable[[T], object] | None = None,
        refuse: Callable[[str], object] | None = None,
        *,
        needed: bool = True,
    ) -> None:
        """Subscribe; `read` decodes a plain message, and `take` is called with the result in the executor's thread.

        A message for which `read` raises is counted and reported, and `refuse` is called with the reason: for inputs whose
        previous value must not stay in force, or whose sender expects an answer. An input that is not `needed` may stay silent.
        """
        from rclpy.event_handler import SubscriptionEventCallbacks

        silent = SubscriptionEventCallbacks(use_default_callbacks=False)  # waiting for events costs more than polling
        self.topic = topic
        self.latest: T | None = None
        self.stamp_ns: int | None = None
        self._node = node
        self._read = read
        self._take = take
        self._refuse = refuse
        self._needed = needed
        self._count = 0
        self._refused = ""
        self._publisher_count, self._publisher_problem = 0, ""
        self._arrived_ns: int | None = None
        self._reported = (time.monotonic_ns(), 0)
        qos = replace(topic.qos, depth=max(topic.qos.depth, round(_QUEUE_S * topic.rate_hz)))
        self.subscription = node.create_subscription(
            interface_type(topic.type), topic.name, self._receive, profile(qos), event_callbacks=silent, raw=True
        )

    @property
    def name(self) -> str:
        """Return the topic's name after remapping."""
        return str(self.subscription.topic_name)

    def age_ns(self) -> int | None:
        """Return the age of the last message's stamp by the node's clock; None before the first message."""
        return None if self.stamp_ns is None else self._now_ns() - self.stamp_ns

    def is_stale(self) -> bool:
        """Return whether the last message is missing, too old for its nominal rate, or from another clock."""
        stream = self.topic.stream
        return stream is not None and stream.is_stale(self.stamp_ns, self._now_ns())

    def report(self) -> Report:
        """Return this input's state for /diagnostics; the rate is that since the last report."""
        before_ns, count = self._reported
        now_ns = time.monotonic_ns()
        self._reported = now_ns, self._count
        rate_hz = (self._count - count) * 1e9 / max(1, now_ns - before_ns)
        level, message = self._judge(rate_hz)
        self._refused = ""
        age_ns = self.age_ns()
        values = [("topic", self.name), ("rate [Hz]", f"{rate_hz:.1f}"), ("messages", str(self._count))]
        if age_ns is not None:
            values.append(("age [s]", f"{age_ns * 1e-9:.3f}"))
        return Report(f"input {self.topic.name}", level, message, tuple(values))

    def publisher_problem(self) -> str:
        """Return a sentence about a publisher of another type or with an incompatible QoS; '' if there is none."""
        from rclpy.qos import QoSCompatibility, qos_check_compatible

        wanted = profile(self.topic.qos)
        for offer in self._node.get_publishers_info_by_topic(self.name):
            known = offer.node_name != UNKNOWN_NODE
            sender = f"{offer.node_namespace.rstrip('/')}/{offer.node_name}" if known else _NAMELESS
            if offer.topic_type != self.topic.type:
                return f"{sender} sends {offer.topic_type} on {self.name}, not {self.topic.type}: remap one of them"
            verdict, reason = qos_check_compatible(offer.qos_profile, wanted)
            if verdict == QoSCompatibility.ERROR:
                why = reason.strip().removeprefix("ERROR: ").rstrip(";")
                return f"{sender} offers {self.name} with an incompatible QoS ({why}): change its QoS"
        return ""

    def _judge(self, rate_hz: float) -> tuple[DiagnosticLevel, str]:
        stream, age_ns = self.topic.stream, self.age_ns()
        if misfit := self._current_publisher_problem():
            return DiagnosticLevel.ERROR, misfit
        if self._refused:
            return DiagnosticLevel.ERROR, self._refused
        if not self._needed and rate_hz == 0.0:
            return DiagnosticLevel.OK, "silent"
        if age_ns is None or self._arrived_ns is None:
            return DiagnosticLevel.STALE, f"no message has arrived on {self.name} yet: start its publisher"
        if rate_hz > 0.0 and abs(age_ns) > CLOCK_ERROR_NS:
            return DiagnosticLevel.ERROR, (
                f"stamps on {self.name} are {age_ns * 1e-9:.1f} s from this node's clock: set use_sim_time alike for all "
                "nodes, and the computers' clocks"
            )
        if self.is_stale():
            if age_ns < 0:
                ahead_s = -age_ns * 1e-9
                return (
                    DiagnosticLevel.ERROR,
                    f"the last message is stamped {ahead_s:.2f} s ahead: set the computers' clocks",
                )
            limit_s = (stream.max_age_ns() or 0) * 1e-9 if stream else 0.0
            return (
                DiagnosticLevel.ERROR,
                f"the last message is {age_ns * 1e-9:.2f} s old, the limit is {limit_s:.2f} s",
            )
        if rate_hz < SLOW_FRACTION * self.topic.rate_hz:
            return DiagnosticLevel.WARN, f"{rate_hz:.1f} Hz instead of {self.topic.rate_hz:g} Hz"
        return DiagnosticLevel.OK, ""

    def _receive(self, data: bytes) -> None:
        self._arrived_ns = time.monotonic_ns()
        self._count += 1
        try:
            message = deserialised(data, self.topic.type)
            value = self._read(message)
        except MessageError as error:
            self._refused = str(error)
        except DECODING_ERRORS as error:
            self._refused = (
                f"{self.name} holds impossible values ({str(error) or type(error).__name__}): check its publisher"
            )
        else:
            self._accept(message, value)
            return
        if self._refuse is not None:
            self._refuse(self._refused)

    def _accept(self, message: Any, value: T) -> None:
        header = getattr(message, "header", None)
        self.stamp_ns = self._now_ns() if header is None else nanoseconds(header.stamp)
        self.latest = value
        if self._take is not None:
            self._take(value)

    def _current_publisher_problem(self) -> str:
        """Return `publisher_problem`, updated when the number of publishers changes, or a name may be known; log it once."""
        senders = self._node.count_publishers(self.name)
        if senders != self._publisher_count or _NAMELESS in self._publisher_problem:
            before, self._publisher_count, self._publisher_problem = (
                self._publisher_problem,
                senders,
                self.publisher_problem(),
            )
            if self._publisher_problem not in ("", before) and self._tells_for_all():
                self._node.get_logger().error(self._publisher_problem)
        return self._publisher_problem

    def _tells_for_all(self) -> bool:
        """Return whether this node logs the topic's problems: of the chair's nodes that subscribe, one does."""
        here, own = self._node.get_namespace(), self._node.get_name()
        others = self._node.get_subscriptions_info_by_topic(self.name)
        names = {str(each.node_name) for each in others if each.node_namespace == here} & _CHAIR_NODES
        return own not in names or bool(own == min(names))

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
