"""The tests' own node, which observes other processes; tests wait for conditions and never sleep."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self, TypeVar

import rclpy

from waychair.ros.environment import ros_environment
from waychair.ros.executor import NodeExecutor
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.reports import Report, read_diagnostics
from waychair.ros.messages.wire import deserialised, plain, serialised
from waychair.ros.nodes.node import ChairNode
from waychair.ros.topics import DIAGNOSTICS, RosTopic, profile

PATIENCE_S = 40.0
"""A loaded machine takes its time; only a test that fails waits so long."""


AnyNode = TypeVar("AnyNode", bound=ChairNode[Any])


class Heard(list[Any]):
    """Messages in the order of their arrival, until `close` is called."""

    close: Callable[[], Any]


class Harness:
    """The tests' node and executor; `spin_until` is the only way of waiting."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        rclpy.init(args=[])
        self.node = rclpy.create_node("tests")
        self.executor = NodeExecutor()
        self.executor.add_node(self.node)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    @contextlib.contextmanager
    def one_test(self) -> Iterator[None]:
        """Take back at the end what the block made on the tests' node: a late joiner would hear a map sent by an earlier test."""
        node = self.node
        kept = {*node.publishers, *node.subscriptions, *node.clients}
        try:
            yield
        finally:
            for each in {*node.publishers} - kept:
                node.destroy_publisher(each)
            for each in {*node.subscriptions} - kept:
                node.destroy_subscription(each)
            for each in {*node.clients} - kept:
                node.destroy_client(each)

    @contextlib.contextmanager
    def serving(self, node: AnyNode) -> Iterator[AnyNode]:
        """A node in this process, served by this harness and closed at the end."""
        self.executor.add_node(node)
        try:
            yield node
        finally:
            self.executor.remove_node(node)
            node.close()

    def spin_until(self, condition: Callable[[], Any], what: str, meanwhile: Callable[[], None] | None = None) -> None:
        """Serve the node until the condition holds; call `meanwhile` repeatedly."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"no result while waiting for {what}"
            self.executor.spin_once(timeout_sec=0.05)
            if meanwhile is not None:
                meanwhile()

    def heard(self, topic: RosTopic, name: str = "") -> Heard:
        """Return a list that grows by the topic's plain messages while the harness spins."""
        messages = Heard()
        subscription = self.node.create_subscription(
            interface_type(topic.type),
            name or topic.name,
            lambda data: messages.append(deserialised(data, topic.type)),
            profile(topic.qos),
            raw=True,
        )
        messages.close = lambda: self.node.destroy_subscription(subscription)
        return messages

    def publisher(self, topic: RosTopic, name: str = "") -> Callable[[Any], None]:
        """Return a function that publishes plain messages on a topic, once it has a subscriber."""
        sender = self.node.create_publisher(interface_type(topic.type), name or topic.name, profile(topic.qos))
        self.spin_until(lambda: sender.get_subscription_count() > 0, f"somebody to listen to {topic.name}")
        return lambda message: sender.publish(serialised(message))

    def report(
        self,
        name: str,
        says: Callable[[Report], bool] = lambda report: True,
        meanwhile: Callable[[], None] | None = None,
    ) -> Report:
        """Return the first report on /diagnostics with this end of its name for which `says` is true."""
        found: list[Report] = []

        def look(message: Any) -> None:
            found.extend(r for r in read_diagnostics(plain(message)) if r.name.endswith(name) and says(r))

        kind = interface_type(DIAGNOSTICS.type)
        subscription = self.node.create_subscription(kind, DIAGNOSTICS.name, look, profile(DIAGNOSTICS.qos))
        self.spin_until(lambda: found, f"the report '{name}'", meanwhile)
        self.node.destroy_subscription(subscription)
        return found[0]

    @contextlib.contextmanager
    def process(self, *command: str | Path) -> Iterator[subprocess.Popen[str]]:
        """A Python process of the same domain that has ended at the end of the block.

        It is interrupted and not killed: a killed process stays in all lists of nodes for the 20 s of a DDS lease.
        """
        running = subprocess.Popen(
            [sys.executable, *map(str, command)],
            env=ros_environment(domain=self.domain),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            yield running
        finally:
            if running.poll() is None:
                running.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                running.communicate(timeout=10.0)
            running.kill()
            running.communicate()


def ended(process: subprocess.Popen[str], by: signal.Signals = signal.SIGINT) -> tuple[int, str]:
    """Return the exit code and output of a process after a signal."""
    process.send_signal(by)
    output, _ = process.communicate(timeout=PATIENCE_S)
    return process.returncode, output
