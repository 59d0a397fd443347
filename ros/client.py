"""A Python client of a chair's nodes: the pose, the places, and drives, with method names that Nav2 users know.

    with ChairClient() as chair:
        chair.go_to_pose(chair.places()["lift"].pose)
        chair.confirm()                       # the rider's confirmation
        while not chair.is_task_complete():
            print(chair.feedback().distance_remaining)
        print(chair.result().reason)

The method names of nav2_simple_commander's BasicNavigator work too (`goToPose`, `isTaskComplete`, ...).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Mapping
from types import TracebackType
from typing import Any, Self, TypeVar

import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.node import Node

from waychair.errors import MessageError, RosError
from waychair.recordings.bags.ros_topics import RosTopic
from waychair.ros import topics
from waychair.ros.environment import enter_ros_environment, namespace_arguments
from waychair.ros.executor import NodeExecutor
from waychair.ros.interface_types import interface_type
from waychair.ros.interrupts import held_interrupts
from waychair.ros.messages.chair import (
    NO_GOAL,
    DriveReport,
    goal_id_of,
    read_drive_state,
    read_located,
    read_places,
)
from waychair.ros.messages.floor import JourneyReport, StoreyGoal, read_journey_state, storey_goal
from waychair.ros.messages.guidance import read_guidance
from waychair.ros.messages.motion import pose_stamped, pose_with_covariance, read_pose_stamped
from waychair.ros.messages.outcomes import DriveOutcome, TaskResult
from waychair.ros.messages.reports import Report, read_diagnostics
from waychair.ros.messages.wire import deserialised, native, serialised
from waychair.runtime.pages.guide_view import GuideView
from waychair.slam.localising.localisation import Localisation
from waychair.types import Place, Pose2

T = TypeVar("T")

_SUCCEEDED, _CANCELED, _ABORTED = 4, 5, 6  # action_msgs/msg/GoalStatus

_SPIN_S = 0.3
_SETTLED_S = 1.0
"""Time after which the localisation at a pose that was set can be judged: ten scans."""

_NODES = ("simulator", "bridge", "mapper", "navigator", "page")
"""The nodes of a chair, in the order of their start."""

_OFFERED_BY = dict.fromkeys(("cancel", "pause", "go_on", "say_storey"), "navigator")
"""The nodes that offer services; the bridge offers all others."""

_SILENT_S = 3.0
"""A navigator that sends no feedback for so long has died; it normally sends feedback five times a second."""


class ChairClient:
    """A client of one chair's nodes. Each call has a timeout for its answer."""

    def __init__(self, name: str = "chair_client", *, domain: int | None = None, namespace: str = "") -> None:
        """Join the ROS domain; `namespace` is that of the chair's nodes.

        Raises:
            ConfigError: the domain is not in 0 to 101, or the namespace is invalid.
        """
        enter_ros_environment(domain=domain)
        named = namespace_arguments(namespace)
        self._namespace = namespace.strip("/")
        self._context = Context()
        rclpy.init(context=self._context, args=["--ros-args", *named] if named else [])
        self.node = Node(name, context=self._context, start_parameter_services=False)
        self._executor = NodeExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._messages: dict[str, Any] = {}
        self._decode_errors: dict[str, str] = {}  # the defect of the last unreadable message, by topic
        self._services: dict[str, Any] = {}
        self._action = ActionClient(
            self.node, interface_type("nav2_msgs/action/NavigateToPose"), topics.NAVIGATE_TO_POSE
        )
        self._handle: Any = None
        self._ended: Any = None
        self._feedback: Any = None
        self._feedback_s = 0.0
        self._senders: dict[str, Any] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect; a drive in progress continues."""
        self._executor.shutdown()
        self._action.destroy()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def wait_until_active(self, timeout_s: float = 10.0) -> None:
        """Wait until the nodes answer and the chair is localised.

        Raises:
            RosError: timeout.
        """
        self.localisation(timeout_s)
        if not self._spin_until(self._action.server_is_ready, timeout_s):
            raise RosError(self._silence("navigator", "offers no drive", timeout_s))

    def nodes(self, expected: Collection[str] = (), timeout_s: float = 0.0) -> tuple[str, ...]:
        """Return the names of the chair's nodes that run, as far as they are discovered.

        It waits until all `expected` ones are discovered, at most `timeout_s`.
        """
        self._spin_until(lambda: set(expected) <= set(self._discovered()), timeout_s)
        return self._discovered()

    def _discovered(self) -> tuple[str, ...]:
        here = f"/{self._namespace}"
        found = self.node.get_node_names_and_namespaces()
        return tuple(name for name in _NODES if (name, here) in found)

    def places(self, timeout_s: float = 5.0) -> Mapping[str, Place]:
        """Return the named places of the map.

        Raises:
            RosError: timeout.
        """
        return self._latest(topics.PLACES, read_places, timeout_s, "navigator")

    def localisation(self, timeout_s: float = 5.0) -> Localisation:
        """Return the chair's pose, and how reliable it is.

        Raises:
            RosError: timeout.
        """
        return self._located(timeout_s)[1]

    def refused_pose(self, timeout_s: float = 5.0) -> str:
        """Return why the last initial pose was refused, as a sentence; empty after one that was taken.

        Raises:
            RosError: timeout.
        """
        return self._located(timeout_s)[2]

    def report(self, node: str, part: str, timeout_s: float = 2.0) -> Report | None:
        """Return a node's report about one of its parts on /diagnostics; None if none arrives in time."""
        name = f"{self._prefix}/{node}: {part}"

        def found() -> Report | None:
            reports = self._messages[topics.DIAGNOSTICS.name] or {}
            return reports.get(name)

        self._subscribe(topics.DIAGNOSTICS, self._collected_reports)
        self._spin_until(lambda: found() is not None, timeout_s)
        return found()

    def drive_state(self, timeout_s: float = 5.0) -> DriveReport:
        """Return the drive mode, its reason, and the conditions that prevent a drive.

        Raises:
            RosError: timeout.
        """
        return self._latest(topics.DRIVE_STATE, read_drive_state, timeout_s, "bridge")

    def go_to_pose(self, pose: Pose2, timeout_s: float = 5.0) -> bool:
        """Request a drive to a pose in map, which waits for the rider's `confirm`; return whether it was accepted.

        Raises:
            RosError: the navigator does not answer in time.
        """
        return self._send_goal(native(pose_stamped(self._now_ns(), pose)), timeout_s)

    def travel_to(self, goal: str, storey: str = "", timeout_s: float = 20.0) -> JourneyReport:
        """Ask for a journey to a goal of the building, by its path or by its name on a storey; it waits for `confirm`.

        Raises:
            RosError: the navigator does not answer in time, or refuses the goal, with its reason.
        """
        before = self.journey(1.0)
        self._publish("navigator", topics.STOREY_GOAL, storey_goal(StoreyGoal(goal, storey)), timeout_s)
        if not self._spin_until(lambda: self.journey(0.0).stamp_ns != before.stamp_ns, timeout_s):
            raise RosError(f"the journey was not planned within {timeout_s:g} s: see `waychair status`")
        found = self.journey(0.0)
        if found.phase == "refused":
            raise RosError(found.sentence)
        return found

    def journey(self, timeout_s: float = 5.0) -> JourneyReport:
        """Return the state of the journey; without one within the timeout an empty report."""
        try:
            return self._latest(topics.JOURNEY, read_journey_state, timeout_s, "navigator")
        except RosError:
            return JourneyReport(0)

    def guide_to(self, goal: str, storey: str = "", timeout_s: float = 20.0) -> None:
        """Have the rider told the way while driving to a goal, "" for no longer; RosError where the page's node refuses."""
        self._publish("page", topics.GUIDE_TO, storey_goal(StoreyGoal(goal, storey)), timeout_s)
        if not self._spin_until(lambda: (self.guidance(0.0) is not None) == bool(goal), timeout_s):
            raise RosError(f"guidance to '{goal}' did not begin within {timeout_s:g} s: see the page node's log")

    def _publish(self, node: str, topic: RosTopic, message: Any, timeout_s: float) -> None:
        """Send a plain message as soon as a node of the chair receives it."""
        if topic.name not in self._senders:
            kind = interface_type(topic.type)
            self._senders[topic.name] = self.node.create_publisher(kind, topic.name, topics.profile(topic.qos))
        sender = self._senders[topic.name]
        if not self._spin_until(lambda: sender.get_subscription_count() > 0, timeout_s):
            raise RosError(self._silence(node, f"does not subscribe to {topic.name}", timeout_s))
        sender.publish(serialised(message))

    def guidance(self, timeout_s: float = 5.0) -> GuideView | None:
        """Return step guidance as a page shows it; None without."""
        try:
            return self._latest(topics.GUIDANCE, read_guidance, timeout_s, "page")
        except RosError:
            return None

    def say_storey(self, storey: str, place: str = "", timeout_s: float = 5.0) -> tuple[bool, str]:
        """Give the rider's word for the storey on which the chair is, and the place at which it stands; return whether it was
        taken, and a sentence.

        Raises:
            RosError: the navigator does not answer in time.
        """
        kind = interface_type("waychair_msgs/srv/SayStorey")
        return self._ask("say_storey", kind, kind.Request(storey=storey, place=place), timeout_s)

    @property
    def goal_id(self) -> int:
        """Return the id of the goal that this client requested last; `NO_GOAL` before the first."""
        return NO_GOAL if self._handle is None else goal_id_of(self._handle.goal_id)

    def relocalise(self, pose: Pose2, timeout_s: float = 5.0) -> Localisation:
        """Tell the localiser the chair's pose in map, as `set_initial_pose`; return the localisation from there.

        Raises:
            RosError: no mapper answers in time, or it refuses the pose, with its reason.
        """
        before_ns = self._located(timeout_s)[0]
        self.set_initial_pose(pose, timeout_s)

        if not self._spin_until(lambda: self._located(timeout_s)[0] > before_ns, timeout_s):
            raise RosError(f"no scan was localised within {timeout_s:g} s: see `waychair status`")
        self.spin(_SETTLED_S)
        if refused := self.refused_pose():
            raise RosError(refused)
        return self.localisation()

    def confirm(self, timeout_s: float = 5.0, *, goal_id: int | None = None) -> tuple[bool, str]:
        """Confirm one goal for the rider, by default this client's last; return whether the drive begins, and a sentence.

        It is refused if another goal has arrived meanwhile. `goal_id` is that of a `drive_state` that the rider saw.

        Raises:
            RosError: the bridge does not answer in time.
        """
        kind = interface_type("waychair_msgs/srv/Confirm")
        if goal_id is None:  # the bridge learns of the goal a moment after the client
            goal_id = self.goal_id
            self.drive_state(timeout_s)
            self._spin_until(
                lambda: self._messages[topics.DRIVE_STATE.name].goal_id == goal_id, min(timeout_s, _SPIN_S)
            )
        return self._ask("confirm", kind, kind.Request(goal_id=goal_id), timeout_s)

    def trigger(self, name: str, timeout_s: float = 5.0) -> tuple[bool, str]:
        """Call a std_srvs/Trigger service of the chair; return whether it did what it was asked for, and a sentence.

        Raises:
            RosError: no node offers it, or it does not answer in time.
        """
        kind = interface_type("std_srvs/srv/Trigger")
        return self._ask(name, kind, kind.Request(), timeout_s)

    def stop(self, timeout_s: float = 5.0) -> tuple[bool, str]:
        """Stop the chair, as the rider's Stop does.

        Raises:
            RosError: the bridge does not answer in time.
        """
        return self.trigger("stop", timeout_s)

    def reset_faults(self, timeout_s: float = 5.0) -> tuple[bool, str]:
        """Reset latched faults, after somebody has repaired their cause.

        Raises:
            RosError: the bridge does not answer in time.
        """
        return self.trigger("reset_faults", timeout_s)

    def cancel(self, timeout_s: float = 5.0) -> tuple[bool, str]:
        """Cancel the current drive, even if another client requested it.

        Raises:
            RosError: the navigator does not answer in time.
        """
        return self.trigger("cancel", timeout_s)

    def pause(self, timeout_s: float = 5.0) -> tuple[bool, str]:
        """Pause the current drive, even if another client requested it; the chair stops and keeps its goal until `go_on`.

        Raises:
            RosError: the navigator does not answer in time.
        """
        return self.trigger("pause", timeout_s)

    def go_on(self, timeout_s: float = 5.0) -> tuple[bool, str]:
        """Resume the paused drive, or take the other way that the chair offers.

        Raises:
            RosError: the navigator does not answer in time.
        """
        return self.trigger("go_on", timeout_s)

    def cancel_task(self, timeout_s: float = 5.0) -> None:
        """Cancel the drive that this client requested."""
        if self._handle is not None:
            done = self._handle.cancel_goal_async()
            self._spin_until(done.done, timeout_s)

    def is_task_complete(self, wait_s: float = 0.1) -> bool:
        """Return whether the drive has ended, after waiting `wait_s` at most. A dead navigator counts as an end."""
        if self._ended is None or self._spin_until(self._ended.done, wait_s):
            return True
        if time.monotonic() - self._feedback_s > _SILENT_S:
            self.spin(_SPIN_S)  # feedback is received only while this client spins
        return self._ended.done() or self._navigator_is_dead

    def feedback(self) -> Any:
        """Return the latest nav2_msgs/action/NavigateToPose feedback; None before the first."""
        return self._feedback

    def result(self) -> DriveOutcome:
        """Return how the drive ended; UNKNOWN while it is in progress."""
        self.is_task_complete(0.0)  # receive an end that arrived since the last spin
        if self._ended is not None and not self._ended.done() and self._navigator_is_dead:
            return DriveOutcome(TaskResult.FAILED, "the navigator does not answer any more: see `waychair status`")
        if self._ended is None or not self._ended.done():
            return DriveOutcome(TaskResult.UNKNOWN)
        answer = self._ended.result()
        kinds = {_SUCCEEDED: TaskResult.SUCCEEDED, _CANCELED: TaskResult.CANCELED, _ABORTED: TaskResult.FAILED}
        kind = kinds.get(answer.status, TaskResult.UNKNOWN)
        return DriveOutcome(kind, str(answer.result.error_msg), int(answer.result.error_code))

    def set_initial_pose(self, pose: Pose2, timeout_s: float = 5.0) -> None:
        """Tell the localiser the chair's pose in map.

        Raises:
            RosError: no mapper subscribes in time.
        """
        self._publish("mapper", topics.INITIAL_POSE, pose_with_covariance(self._now_ns(), pose), timeout_s)

    def goToPose(self, pose: Any, behavior_tree: str = "") -> bool:
        """Request a drive as BasicNavigator does, with a geometry_msgs/PoseStamped."""
        return self._send_goal(pose, 5.0)

    def setInitialPose(self, pose: Any) -> None:
        """Set the initial pose as BasicNavigator does, with a geometry_msgs/PoseStamped."""
        from waychair.ros.messages.wire import plain

        self.set_initial_pose(read_pose_stamped(plain(pose)))

    cancelTask = cancel_task
    isTaskComplete = is_task_complete
    getFeedback = feedback

    def getResult(self) -> TaskResult:
        """Return the result as BasicNavigator does."""
        return self.result().result

    def waitUntilNav2Active(self, navigator: str = "", localizer: str = "") -> None:
        """Wait as BasicNavigator does; the arguments are ignored, since there is one navigator and one localiser."""
        self.wait_until_active()

    def spin(self, seconds: float) -> None:
        """Receive messages for a number of seconds."""
        self._spin_until(lambda: False, seconds)

    def _send_goal(self, pose: Any, timeout_s: float) -> bool:
        if not self._spin_until(self._action.server_is_ready, timeout_s):
            raise RosError(self._silence("navigator", "offers no drive", timeout_s))
        goal = interface_type("nav2_msgs/action/NavigateToPose").Goal()
        goal.pose = pose
        self._feedback = self._ended = self._handle = None
        sent = self._action.send_goal_async(goal, feedback_callback=self._take_feedback)
        if not self._spin_until(sent.done, timeout_s):
            raise RosError(f"the navigator does not answer within {timeout_s:g} s: see `waychair status`")
        handle = sent.result()
        if handle is None or not handle.accepted:
            return False
        self._handle, self._ended = handle, handle.get_result_async()
        self._feedback_s = time.monotonic()
        return True

    def _take_feedback(self, message: Any) -> None:
        self._feedback, self._feedback_s = message.feedback, time.monotonic()

    @property
    def _navigator_is_dead(self) -> bool:
        return self._ended is not None and time.monotonic() - self._feedback_s > _SILENT_S

    def _ask(self, name: str, kind: Any, request: Any, timeout_s: float) -> tuple[bool, str]:
        """Call a service; return its success, and its sentence."""
        if name not in self._services:
            self._services[name] = self.node.create_client(kind, name)
        client = self._services[name]
        if not self._spin_until(client.service_is_ready, timeout_s):
            raise RosError(self._silence(_OFFERED_BY.get(name, "bridge"), f"does not offer '{name}'", timeout_s))
        asked = client.call_async(request)
        if not self._spin_until(asked.done, timeout_s):
            client.remove_pending_request(asked)
            raise RosError(f"'{name}' was not answered within {timeout_s:g} s: see `waychair status`")
        answer = asked.result()
        return bool(answer.success), str(answer.message)

    @property
    def _prefix(self) -> str:
        return f"/{self._namespace}" if self._namespace else ""

    def _located(self, timeout_s: float) -> tuple[int, Localisation, str]:
        """Return the mapper's last message: the scan's stamp, the localisation, and why an initial pose was refused."""
        return self._latest(topics.LOCALISATION, read_located, timeout_s, "mapper")

    def _collected_reports(self, message: Any) -> dict[str, Report]:
        """Return the last reports by name, with those of a message of /diagnostics."""
        known = self._messages[topics.DIAGNOSTICS.name] or {}
        return {**known, **{report.name: report for report in read_diagnostics(message)}}

    def _subscribe(self, topic: topics.RosTopic, read: Callable[[Any], object]) -> bool:
        """Subscribe to a topic unless that was done; return whether it was. Unreadable messages are skipped."""
        if topic.name in self._messages:
            return True
        self._messages[topic.name] = None

        def take(data: bytes) -> None:
            try:
                self._messages[topic.name] = read(deserialised(data, topic.type))
            except MessageError as error:
                self._decode_errors[topic.name] = f"; its messages cannot be decoded: {error}"

        self.node.create_subscription(interface_type(topic.type), topic.name, take, topics.profile(topic.qos), raw=True)
        return False

    def _latest(self, topic: topics.RosTopic, read: Callable[[Any], T], timeout_s: float, sender: str) -> T:
        """Return the latest message of a topic; the first call subscribes and waits."""
        if self._subscribe(topic, read):
            self._spin_until(lambda: False, 0.0)
        if not self._spin_until(lambda: self._messages[topic.name] is not None, timeout_s):
            if why := self._decode_errors.get(topic.name):
                raise RosError(f"no {topic.name} from the {sender} within {timeout_s:g} s{why}")
            raise RosError(self._silence(sender, f"sends no {topic.name}", timeout_s))
        found: T = self._messages[topic.name]
        return found

    def _silence(self, sender: str, lacks: str, timeout_s: float) -> str:
        """Return why a node of the chair has not answered: it says nothing, is not there yet, or no chair runs."""
        running = self.nodes()
        if sender in running:
            return f"the {sender} runs, but {lacks} within {timeout_s:g} s: see `waychair status`"
        if running:
            run = "runs" if len(running) == 1 else "run"
            return f"the chair is starting: {' and '.join(running)} {run}, the {sender} does not yet; ask again in some seconds"
        where = (
            f"ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}{f', namespace {self._prefix}' if self._prefix else ''}"
        )
        return (
            f"no chair runs in {where}: start one with `waychair up`, or name its --domain and --namespace; a chair that was "
            "just started needs some seconds"
        )

    def _spin_until(self, true: Callable[[], bool], timeout_s: float) -> bool:
        """Receive messages until a condition holds; return whether it does within the timeout."""
        ends = time.monotonic() + timeout_s
        while not true():
            left = ends - time.monotonic()
            with held_interrupts():  # inside of a callback an interrupt would reach rclpy, and lose messages
                self._executor.spin_once(timeout_sec=max(0.0, min(left, 0.1)))
            if left <= 0.0:
                return true()
        return True

    def _now_ns(self) -> int:
        return int(self.node.get_clock().now().nanoseconds)
