"""The base class of the chair's nodes: parameters from settings, topics, diagnostics, a worker, and a clean end.

A node derives from `ChairNode`, and its process calls `run_node`. Callbacks run one after the other in the main thread;
heavy work goes to `worker`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from types import FrameType
from typing import Any, Generic, TypeVar

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter

from waychair.config import Settings
from waychair.errors import ConfigError, WaychairError
from waychair.garbage import leave_out_present
from waychair.ros.environment import enter_ros_environment
from waychair.ros.executor import NodeExecutor
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.reports import DiagnosticLevel, Report, diagnostics
from waychair.ros.messages.wire import serialised
from waychair.ros.nodes.inputs import Input
from waychair.ros.nodes.worker import Worker
from waychair.ros.parameters import ROS_PARAMETERS, descriptor, leaves, settings_from_parameters
from waychair.ros.topics import CLOCK, DIAGNOSTICS, RosTopic, profile
from waychair.runtime.processes import BEAT_HZ, CANNOT_START, beats

S = TypeVar("S", bound=Settings)
T = TypeVar("T")

_INACTIVE, _ACTIVE = (2, "inactive"), (3, "active")  # ids and labels of lifecycle_msgs/msg/State

DIAGNOSTICS_HZ = 1.0


class ChairNode(Node, Generic[S]):
    """A ROS node whose parameters are settings of type `S`, with their current values in `settings`."""

    def __init__(
        self, name: str, kind: type[S], dynamic: Iterable[str] = (), arguments: Sequence[str] | None = None
    ) -> None:
        """Create the node; `dynamic` names the settings (dotted) that may change while it runs (see `on_settings`).

        `arguments` (`--ros-args ...`) apply to this node alone, and override those of its process.

        Raises:
            ConfigError: a parameter is unknown, of a wrong type, or has an impossible value.
        """
        own = None if arguments is None else list(arguments)
        super().__init__(name, cli_args=own, automatically_declare_parameters_from_overrides=True)
        self._kind = kind
        self._dynamic = frozenset(dynamic)
        self._inputs: list[Input[Any]] = []
        self._closing = contextlib.ExitStack()
        self.settings = self._declared()
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.publisher(DIAGNOSTICS)
        self.every(DIAGNOSTICS_HZ, self._report)
        if (beat := beats()) is not None:
            self.every(BEAT_HZ, beat)
        self._worker: Worker | None = None

    @property
    def worker(self) -> Worker:
        """Return the node's thread for heavy work, started on first use."""
        if self._worker is None:
            self._worker = Worker(self)
            self.at_end(self._worker.close)
        return self._worker

    def now_ns(self) -> int:
        """Return the node's time: the computer's, or with `use_sim_time` that of /clock (0 before its first message)."""
        return int(self.get_clock().now().nanoseconds)

    def publisher(self, topic: RosTopic) -> Callable[[Any], None]:
        """Create a publisher, and return its function for plain messages."""
        silent = PublisherEventCallbacks(use_default_callbacks=False)  # the subscribers report incompatible QoS
        publisher = self.create_publisher(
            interface_type(topic.type), topic.name, profile(topic.qos), event_callbacks=silent
        )
        return lambda message: publisher.publish(serialised(message))

    def listen(
        self,
        topic: RosTopic,
        read: Callable[[Any], T],
        take: Callable[[T], object] | None = None,
        refuse: Callable[[str], object] | None = None,
        *,
        needed: bool = True,
    ) -> Input[T]:
        """Subscribe to a topic (see `Input`); its state is reported on /diagnostics."""
        self._inputs.append(Input(node=self, topic=topic, read=read, take=take, refuse=refuse, needed=needed))
        return self._inputs[-1]

    def serve(self, name: str, call: Callable[[], tuple[bool, str]]) -> None:
        """Offer a std_srvs/Trigger service that answers with success and a sentence."""

        def answer(request: Any, response: Any) -> Any:
            response.success, response.message = call()
            return response

        self.create_service(interface_type("std_srvs/srv/Trigger"), name, answer)

    def every(self, rate_hz: float, call: Callable[[], None]) -> Any:
        """Create a timer on the steady clock, which does not follow /clock."""
        return self.create_timer(1.0 / rate_hz, call, clock=self.steady_clock)

    def at_end(self, call: Callable[[], Any]) -> None:
        """Register a function for the node's end; functions are called in reverse order."""
        self._closing.callback(call)

    def reports(self) -> Iterable[Report]:
        """Return this node's own reports for /diagnostics, besides its inputs; for nodes to override."""
        return ()

    def on_settings(self, settings: S) -> None:
        """React to a parameter that changed while the node runs; for nodes to override."""

    def close(self) -> None:
        """Call the functions of `at_end`, and destroy the node."""
        self._closing.close()
        self.destroy_node()

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set parameters as in rclpy, but refuse values with the settings' own sentence."""
        answer = interface_type("rcl_interfaces/msg/SetParametersResult")
        known = leaves(self.settings)
        changed = [parameter for parameter in parameter_list if parameter.name in known]
        fixed = [parameter.name for parameter in changed if parameter.name not in self._dynamic]
        if fixed:
            reason = f"{fixed[0]} cannot be changed while the node runs: set it at the start"
            return answer(successful=False, reason=reason)
        values = {name: leaf.parameter for name, leaf in known.items()}
        values.update((parameter.name, parameter.value) for parameter in changed)
        try:
            settings = settings_from_parameters(self._kind, values, self.get_name())
        except ConfigError as error:
            return answer(successful=False, reason=str(error))
        new = leaves(settings)
        others = [parameter for parameter in parameter_list if parameter.name not in known]
        typed = [Parameter(parameter.name, value=new[parameter.name].parameter) for parameter in changed]
        result = super().set_parameters_atomically([*others, *typed])
        if result.successful and typed:
            self.settings = settings
            self.on_settings(settings)
        return result

    def _declared(self) -> S:
        """Return the settings from files and command line, and declare them as parameters with meaning and bounds."""
        given = {name: parameter.value for name, parameter in self.get_parameters_by_prefix("").items()}
        own = {name: value for name, value in given.items() if not name.startswith(ROS_PARAMETERS)}
        settings = settings_from_parameters(self._kind, own, self.get_name())
        for name in own:
            self.undeclare_parameter(name)
        for name, leaf in leaves(settings).items():
            described = descriptor(leaf, dynamic=name in self._dynamic)
            self.declare_parameter(name, leaf.parameter, described, ignore_override=True)
        return settings

    def _clock_trouble(self) -> str:
        """Return a sentence about a missing or duplicate /clock if this node follows it; else ''."""
        if not self.get_parameter("use_sim_time").value:
            return ""
        if self.now_ns() == 0:
            return "use_sim_time is set, but no node publishes /clock: start the simulator"
        senders = self.count_publishers(CLOCK.name)
        return f"{senders} nodes send /clock, so that time jumps: stop all but one" if senders > 1 else ""

    def _report(self) -> None:
        reports = [Report("node", DiagnosticLevel.OK, "", (("pid", str(os.getpid())),))]
        if trouble := self._clock_trouble():
            reports.append(Report("clock", DiagnosticLevel.ERROR, trouble))
        if self.now_ns():  # without a clock the inputs' ages are meaningless
            reports += [each.report() for each in self._inputs]
        prefix = self.get_fully_qualified_name()
        named = [
            Report(f"{prefix}: {report.name}", report.level, report.message, report.values)
            for report in (*reports, *self.reports())
        ]
        self._diagnostics(diagnostics(self.now_ns() or time.time_ns(), named))


def run_node(make: Callable[[], ChairNode[Any]], arguments: Sequence[str] | None = None) -> int:
    """Run a node's process, and return its exit code.

    0 after SIGINT or SIGTERM; CANNOT_START when the node cannot start or continue, with the reason logged in one
    sentence. See `run_until_signal` for the arguments.
    """
    try:
        run_until_signal(make, arguments)
    except WaychairError as error:
        rclpy.logging.get_logger("waychair").fatal(str(error))
        return CANNOT_START
    return 0


def run_until_signal(make: Callable[[], ChairNode[Any]], arguments: Sequence[str] | None = None) -> None:
    """Set the environment, make the node, run its callbacks until SIGINT or SIGTERM, and close it.

    `arguments` are ROS arguments (`--ros-args ...`), by default those of this process.

    Raises:
        WaychairError: the node cannot start, continue or close.
    """
    node: ChairNode[Any] | None = None
    try:
        enter_ros_environment()
        _initialise(arguments)
        node = make()
        leave_out_present()
        executor = NodeExecutor()
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:  # from rcl, if the signal came between two waits
        if rclpy.ok():
            raise
    finally:
        try:
            if node is not None:
                node.close()
        finally:
            rclpy.try_shutdown()


def offer_get_state(nav2_node: str, node: ChairNode[Any], is_active: Callable[[], bool]) -> None:
    """Offer the service `get_state` (lifecycle_msgs/GetState) under the name of one of Nav2's nodes.

    The chair's nodes have no lifecycle: `waychair up` starts and supervises their processes. But nav2_simple_commander
    asks bt_navigator and amcl whether they are active before anything else (`waitUntilNav2Active`).
    """

    def answer(request: Any, response: Any) -> Any:
        response.current_state.id, response.current_state.label = _ACTIVE if is_active() else _INACTIVE
        return response

    node.create_service(interface_type("lifecycle_msgs/srv/GetState"), f"{nav2_node}/get_state", answer)


def _initialise(arguments: Sequence[str] | None) -> None:
    """Initialise rclpy; from then on only ROS reacts to an interrupt.

    rclpy ends the spinning, and passes the interrupt on to Python, which would interrupt the node's closing as well.
    """
    begun = False

    def interrupted(number: int, frame: FrameType | None) -> None:
        if not begun:
            raise KeyboardInterrupt

    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, interrupted)
    try:
        rclpy.init(args=None if arguments is None else list(arguments))
    except RuntimeError as error:  # from rcl, e.g. for an invalid parameter file
        raise ConfigError(f"ROS cannot start: {' '.join(str(error).split())}") from error
    begun = True
