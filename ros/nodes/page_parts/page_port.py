"""The `ChairPort` of a page over the chair's nodes: it collects their messages and forwards the page's requests.

Messages arrive in the node's executor. Requests of a page come from the web server's threads, which wait for the answers.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rclpy.action import ActionClient

from waychair.calibration.calibration_file import ChairCalibration
from waychair.control.drive.navigator import Stage
from waychair.control.safety.stops import halt
from waychair.errors import RecordingError, WaychairError
from waychair.maps.drawn.places import find
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.recordings.bags.ros_decoding import picture_from_message
from waychair.recordings.bags.ros_messages import LASER_FRAME, make
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.chair import (
    DriveReport,
    DriveRequest,
    goal_id_of,
    read_drive_request,
    read_drive_state,
    read_localisation,
    read_places,
)
from waychair.ros.messages.floor import Floor, read_floor
from waychair.ros.messages.maps import read_occupancy_grid
from waychair.ros.messages.motion import pose_stamped, pose_with_covariance, read_odometry, read_path, read_points
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.messages.sensors import joy, read_scan
from waychair.ros.messages.wire import native
from waychair.ros.nodes.inputs import DECODING_ERRORS
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.page_parts.executor_answers import in_executor, wait_for
from waychair.ros.nodes.page_parts.heard_haptics import HeardSenses
from waychair.ros.nodes.page_parts.page_building import PageBuilding
from waychair.ros.nodes.page_parts.page_figures import figures
from waychair.ros.nodes.page_parts.page_guard import PageGuard
from waychair.ros.nodes.parts.map_in_use import MapInUse
from waychair.runtime.pages.chair_port import ANSWER_S, ChairView, LayoutView, PortAnswer
from waychair.runtime.pages.chair_story import DriveFacts, next_action, obstacle_of, shown_points
from waychair.runtime.pages.drawing_port import DrawingPort
from waychair.runtime.rider.sentences import sentence
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.types import DriveMode, FloatArray, JoystickInput, OccupancyGrid, Odometry, Place, Pose2, Scan

_SILENT_NS = 500_000_000
"""A node that is silent for so long counts as gone."""

_PICTURE_NS = 200_000_000  # shortest time between two encoded pictures
_PICTURE_REQUEST_NS = 3_000_000_000
"""The camera subscription ends so long after the last request for a picture."""

_AT_PLACE = 0.01
"""A goal within this distance [m] of a place is called by the place's name."""

_NO_POINTS = np.empty((0, 2))

_TRIGGERS = ("stop", "pause", "go_on", "cancel", "reset_faults")
"""Services without arguments (std_srvs/Trigger)."""


@dataclass(slots=True)
class _Received:
    """The latest messages of the nodes; `state_ns` is the arrival of the bridge's state by the steady clock."""

    state: DriveReport | None = None
    state_ns: int = 0
    request: DriveRequest = field(default_factory=lambda: DriveRequest(0))
    odometry: Odometry = field(default_factory=lambda: Odometry(0, Pose2()))
    scan: Scan | None = None  # waits for its localisation
    located: tuple[int, Localisation] | None = None
    points: FloatArray = field(default_factory=lambda: _NO_POINTS)
    path: FloatArray = field(default_factory=lambda: _NO_POINTS)
    people: FloatArray = field(default_factory=lambda: _NO_POINTS)
    grid: OccupancyGrid | None = None
    places: dict[str, Place] = field(default_factory=dict)
    map_revision: int = 0
    layout_revision: int = 1


@dataclass(slots=True)
class _DriveStory:
    """The goal's label, the reason of the last stop, and facts of the last state, for noticing changes."""

    last_stop: str = ""
    label: str = ""
    had_goal: bool = False
    was_pushed: bool = False
    was_steered: bool = False
    free_since_ns: int = 0  # by the steady clock; 0: the computer drives the lines


@dataclass(slots=True)
class _Pictures:
    """The camera's subscription, and the last picture as JPEG with its time; `problem` is the reason of a missing one."""

    subscription: Any = None
    latest: tuple[int, bytes] | None = None
    requested_ns: int = 0
    problem: str = ""


@dataclass(frozen=True, slots=True)
class _Publishers:
    """The functions that publish a page's requests."""

    joystick: Callable[[Any], None]
    heartbeat: Callable[[Any], None]
    layout: Callable[[Any], None]
    stop: Callable[[Any], None]
    pose: Callable[[Any], None]


class PagePort(PageBuilding, PageGuard, DrawingPort, HeardSenses):
    """A `ChairPort` over the messages and services that a node of this process uses."""

    def __init__(
        self,
        node: ChairNode[Any],
        calibration: ChairCalibration,
        map_folder: Path | None,
        scan_frame: str = LASER_FRAME,
    ) -> None:
        """Subscribe to the chair's nodes; `map_folder` is that of their map, None while a map is made."""
        self._node, self._calibration = node, calibration
        self._scan_frame, self._drawing = scan_frame, MapInUse(map_folder, node.get_logger().error)
        self._received, self._story, self._pictures = _Received(), _DriveStory(), _Pictures()
        self._listen()
        self._publish = _Publishers(
            joystick=node.publisher(topics.PAGE_JOYSTICK),
            heartbeat=node.publisher(topics.PAGE_WATCH),
            layout=node.publisher(topics.LAYOUT),
            stop=node.publisher(topics.STOP),
            pose=node.publisher(topics.INITIAL_POSE),
        )
        trigger = interface_type("std_srvs/srv/Trigger")
        self._services = {name: node.create_client(trigger, name) for name in _TRIGGERS}
        self._confirm = node.create_client(interface_type("waychair_msgs/srv/Confirm"), "confirm")
        self._global_localisation = node.create_client(
            interface_type("std_srvs/srv/Empty"), "reinitialize_global_localization"
        )
        self._action = ActionClient(node, interface_type("nav2_msgs/action/NavigateToPose"), topics.NAVIGATE_TO_POSE)
        node.at_end(self._action.destroy)

    def _listen(self) -> None:
        listen, with_true_stamp = self._node.listen, self._calibration.with_true_stamp
        listen(topics.DRIVE_STATE, read_drive_state, self._take_state)
        listen(topics.DRIVE_REQUEST, read_drive_request, self._take_request)
        listen(topics.LOCALISATION, read_localisation, self._take_localisation)
        listen(topics.ODOMETRY, lambda message: with_true_stamp(read_odometry(message)), self._take_odometry)
        listen(topics.SCAN, lambda message: with_true_stamp(read_scan(message, self._scan_frame)), self._take_scan)
        listen(topics.PLAN, read_path, self._take_path, needed=False)
        listen(topics.PEOPLE, read_points, self._take_people, needed=False)
        listen(topics.MAP, read_occupancy_grid, self._take_grid, needed=False)
        listen(topics.PLACES, read_places, self._take_places, needed=False)
        listen(topics.FLOOR, read_floor, self._take_floor, needed=False)
        self._listen_to_senses(self._node, self._calibration.body)
        self._listen_to_guard(self._node)
        self._listen_to_building(self._node, self._calibration.body)

    @property
    def outline(self) -> FloatArray:
        """See `ChairPort`."""
        return self._calibration.body.outline()

    def view(self) -> ChairView:
        """See `ChairPort`."""
        return self._with_guard(self._with_journey(self._drive_view()))

    def _drive_view(self) -> ChairView:
        """Return the view of a chair that knows one storey only."""
        got = self._received
        now_ns, state = time.monotonic_ns(), got.state
        found = None if got.located is None else got.located[1]
        lost = found is None or found.state is LocalisationState.LOST
        pose = None if found is None else found.map_from_odom @ self._received.odometry.odom_from_base
        silent = state is None or now_ns - self._received.state_ns > _SILENT_NS
        shown = ChairView(
            stamp_ns=now_ns,
            map_from_base=pose,
            localisation=LocalisationState.LOST if found is None else found.state,
            health=0.0 if found is None else found.health,
            mode=DriveMode.MANUAL,
            twist=self._received.odometry.twist,
            next_action="The chair's nodes do not answer. The joystick is yours.",
            last_stop=self._story.last_stop,
            scan=self._received.points,
            people=self._received.people,
            map_revision=self._received.map_revision,
            layout_revision=self._received.layout_revision,
            panel=figures(self._node.now_ns(), got.request, got.located, got.state, got.grid),
            free_since_ns=self._story.free_since_ns or None,
        )
        if silent or state is None:
            return replace(shown, free_since_ns=shown.free_since_ns or self._received.state_ns or now_ns)
        # as of that state, so that goal and end change together
        has_goal, request = self._story.had_goal, self._received.request
        goal, path = (self._story.label, self._received.path) if has_goal else ("", _NO_POINTS)
        obstacles = tuple(obstacle_of(stop_id, text) for stop_id, text in state.halts)
        countdown_s, waits = state.countdown_s or None, has_goal and state.waits
        scene = DriveFacts(
            mode=state.mode, steered=state.steered, goal=goal, waits=waits, countdown_s=countdown_s,
            stage=_stage(request.stage), reason=request.reason, pose=None if lost else pose, way=path, obstacles=obstacles,
            holds_lines=state.command is not None,
        )  # fmt: skip
        return replace(
            shown,
            mode=state.mode,
            goal=goal,
            waits=waits,
            countdown_s=countdown_s,
            next_action=next_action(scene),
            obstacles=obstacles,
            path=path,
            steered=state.steered,
            paused=has_goal and scene.stage is Stage.PAUSED,
            offers=has_goal and scene.stage is Stage.OFFERING,
        )

    def grid(self) -> OccupancyGrid | None:
        """See `ChairPort`."""
        return self._received.grid

    def layout(self) -> LayoutView:
        """See `ChairPort`."""
        return self._drawing.layout() or LayoutView(self._received.places)

    def picture(self) -> bytes | None:
        """See `ChairPort`; the camera subscription lasts only while pictures are requested."""
        self._pictures.requested_ns = time.monotonic_ns()
        return None if self._pictures.latest is None else self._pictures.latest[1]

    def reports(self) -> Iterable[Report]:
        """Report defects of the camera's pictures while they are requested."""
        if self._pictures.subscription is not None:
            yield Report(
                "camera", DiagnosticLevel.WARN if self._pictures.problem else DiagnosticLevel.OK, self._pictures.problem
            )

    def update(self) -> None:
        """Begin or end the camera subscription, and time the goals; to be called periodically in the executor's thread."""
        self._time_goals(self.view().map_from_base)
        looks = time.monotonic_ns() - self._pictures.requested_ns < _PICTURE_REQUEST_NS
        if looks and self._pictures.subscription is None:
            kind = interface_type(topics.COLOUR.type)
            qos = topics.profile(topics.COLOUR.qos)
            self._pictures.subscription = self._node.create_subscription(
                kind, topics.COLOUR.name, self._take_picture, qos
            )
        elif not looks and self._pictures.subscription is not None:
            self._node.destroy_subscription(self._pictures.subscription)
            self._pictures.subscription, self._pictures.latest, self._pictures.problem = None, None, ""

    def go(self, goal: str | Pose2) -> PortAnswer:
        """See `ChairPort`."""
        if isinstance(goal, str) and goal not in self._received.places and self._is_goal(goal):
            return self._travel(goal)
        try:
            pose = find(self._received.places, goal).pose if isinstance(goal, str) else goal
        except WaychairError as error:
            return PortAnswer(False, str(error))
        if not self._action.server_is_ready():
            return PortAnswer(False, "the navigator does not answer: wait until it is back")
        asked = interface_type("nav2_msgs/action/NavigateToPose").Goal()
        asked.pose = native(pose_stamped(self._node.now_ns(), pose))
        handle = wait_for(in_executor(self._node, lambda: self._action.send_goal_async(asked)))
        if handle is None or not handle.accepted:
            return PortAnswer(False, "the navigator rejected this goal: check that it runs")
        ended, goal_id = in_executor(self._node, handle.get_result_async), goal_id_of(handle.goal_id)
        until = time.monotonic() + ANSWER_S / 2
        while time.monotonic() < until:
            if ended.done():
                why = str(ended.result().result.error_msg)
                return PortAnswer(not why, why or f"the chair is at {self._name_of(pose)}")
            if self._received.state is not None and self._received.state.goal_id == goal_id:
                return PortAnswer(True, f"press Drive to go to {self._name_of(pose)}")
            time.sleep(0.01)
        return PortAnswer(False, "the bridge has not received the goal: check that it runs")

    def confirm(self, goal: str = "") -> PortAnswer:
        """See `ChairPort`."""
        state = self._received.state
        if state is None or not (self._has_goal(state) and state.waits):
            return PortAnswer(False, "there is nothing to say yes to: choose a place first")
        if goal and goal != (shown := self.view().goal):
            return PortAnswer(False, f"the goal was changed to {shown} meanwhile: check it, then press Drive")
        kind = interface_type("waychair_msgs/srv/Confirm")
        return self._call(self._confirm, kind.Request(goal_id=state.goal_id, on_page=True))

    def pause(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._trigger("pause")

    def go_on(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._trigger("go_on")

    def cancel(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._trigger("cancel")

    def stop(self) -> PortAnswer:
        """See `ChairPort`; sent by topic and by service, so that the faster one counts."""
        self._publish.stop(make("std_msgs/msg/Empty", 0))
        return self._trigger("stop")

    def reset(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._trigger("reset_faults")

    def steer(self, forward: float, turn: float) -> PortAnswer:
        """See `ChairPort`."""
        self._publish.joystick(joy(JoystickInput(self._node.now_ns(), forward, turn)))
        state = self._received.state
        waits = state is not None and not state.steered and state.halts
        return PortAnswer(False, obstacle_of(*waits[0]).sentence) if waits else PortAnswer(True, "")

    def release(self) -> PortAnswer:
        """See `ChairPort`."""
        let_go = joy(JoystickInput(self._node.now_ns()))
        self._publish.joystick(replace(let_go, axes=np.zeros(0, np.float32)))
        return PortAnswer(True, "")

    def start_at(self, goal: str) -> PortAnswer:
        """See `ChairPort`."""
        answer = self._start_in_building(goal, here=goal in self._received.places)
        return DrawingPort.start_at(self, goal) if answer is None else answer

    def relocalise(self, map_from_base: Pose2 | None = None) -> PortAnswer:
        """See `ChairPort`."""
        if map_from_base is not None:
            self._publish.pose(pose_with_covariance(self._node.now_ns(), map_from_base))
        elif not self._global_localisation.service_is_ready():
            return PortAnswer(False, "the localiser does not answer: wait until it is back")
        else:
            self._global_localisation.call_async(interface_type("std_srvs/srv/Empty").Request())
        return PortAnswer(True, "the chair looks where it is")

    def watched(self, pages: Sequence[str]) -> None:
        """See `ChairPort`."""
        if pages:
            self._publish.heartbeat(make("std_msgs/msg/Empty", 0))

    def _drawn(self, change: Callable[[DrawingEditor], None], done: str) -> PortAnswer:
        """Change the drawings in the map's folder, and notify the nodes."""
        try:
            self._drawing.change(change)
        except WaychairError as error:
            return PortAnswer(False, str(error))
        self._received.layout_revision += 1
        self._publish.layout(make("std_msgs/msg/Empty", 0))
        return PortAnswer(True, done)

    def _trigger(self, name: str) -> PortAnswer:
        return self._call(self._services[name], interface_type("std_srvs/srv/Trigger").Request())

    def _call(self, client: Any, request: Any) -> PortAnswer:
        if not client.service_is_ready():
            return PortAnswer(False, f"no node offers '{client.srv_name}': wait until the chair's nodes are back")
        asked = client.call_async(request)
        answer = wait_for(asked)
        if answer is None:
            client.remove_pending_request(asked)
            return PortAnswer(False, f"'{client.srv_name}' was not answered: check that the chair stands still")
        return PortAnswer(bool(answer.success), str(answer.message))

    def _has_goal(self, state: DriveReport) -> bool:
        request = self._received.request
        return request.active and request.goal_id == state.goal_id and not state.drops_goal

    def _name_of(self, goal: Pose2) -> str:
        for place in self._received.places.values():
            if math.hypot(place.pose.x - goal.x, place.pose.y - goal.y) < _AT_PLACE:
                return place.name
        return f"{goal.x:.1f}, {goal.y:.1f}"

    def _take_state(self, state: DriveReport) -> None:
        now_ns = time.monotonic_ns()
        if state.command is not None:
            self._story.free_since_ns = 0
        elif not self._story.free_since_ns:
            self._story.free_since_ns = now_ns
        self._received.state_ns = now_ns
        self._note_end(state)
        self._received.state = state

    def _note_end(self, state: DriveReport) -> None:
        """Note the reason why a drive ended, or did not begin, or that somebody pressed Stop."""
        has_goal = self._has_goal(state)
        halts, request = dict(state.halts), self._received.request
        if self._received.state is None:
            self._story.last_stop = sentence(state.last_stop)  # from before the start of this page
        if has_goal:
            self._story.label = self._name_of(state.goal)
        elif self._story.had_goal:
            arrived = _stage(request.stage) is Stage.ARRIVED
            why = request.reason if not state.drops_goal else state.last_stop or state.reason
            self._story.last_stop = sentence(f"arrived at {self._story.label}" if arrived else why)
        elif state.reason and ((self._story.was_steered and not state.steered) or self._is_stop(state)):
            self._story.last_stop = sentence(state.reason)
        elif "pushed" in halts and not self._story.was_pushed:
            self._story.last_stop = sentence(halts["pushed"])
        story = self._story
        story.had_goal, story.was_pushed, story.was_steered = has_goal, "pushed" in halts, state.steered

    def _is_stop(self, state: DriveReport) -> bool:
        """Return whether somebody pressed Stop between the last state and this one."""
        before, pressed = self._received.state, halt("stop_pressed").text
        return before is not None and state.reason == pressed != before.reason

    def _take_request(self, request: DriveRequest) -> None:
        self._received.request = request

    def _take_odometry(self, odometry: Odometry) -> None:
        self._received.odometry = odometry

    def _take_scan(self, scan: Scan) -> None:
        self._received.scan = scan
        self._show_scan()

    def _take_localisation(self, located: tuple[int, Localisation]) -> None:
        self._received.located = located
        self._show_scan()

    def _show_scan(self) -> None:
        """Show a scan once its localisation has arrived."""
        scan, located = self._received.scan, self._received.located
        if scan is None or located is None or scan.stamp_ns != located[0]:
            return
        self._received.scan = None
        mount = self._calibration.body.base_from_laser
        self._received.points = shown_points(
            self._calibration.masked(scan), mount, located[1].map_from_base, self._received.odometry.twist
        )

    def _take_path(self, path: Any) -> None:
        self._received.path = path.poses[:, :2]

    def _take_people(self, people: FloatArray) -> None:
        self._received.people = people

    def _take_floor(self, told: Floor) -> None:
        """Draw on the map in use from now on, and travel from there."""
        self._enter_storey(told)
        if told.map_folder and self._drawing.take(Path(told.map_folder)):
            self._received.layout_revision += 1

    def _take_grid(self, grid: OccupancyGrid) -> None:
        self._received.grid = grid
        self._received.map_revision += 1

    def _take_places(self, places: dict[str, Place]) -> None:
        self._received.places = places
        self._received.layout_revision += 1

    def _take_picture(self, message: Any) -> None:
        now_ns = time.monotonic_ns()
        if self._pictures.latest is not None and now_ns - self._pictures.latest[0] < _PICTURE_NS:
            return
        try:
            pixels = picture_from_message(message)
            colours = pixels[..., ::-1] if pixels.ndim == 3 else pixels
            data = cv2.imencode(".jpg", np.ascontiguousarray(colours))[1]
        except (RecordingError, cv2.error, *DECODING_ERRORS) as error:
            self._pictures.latest, self._pictures.problem = None, f"a picture cannot be read: {error}"
            return
        self._pictures.latest, self._pictures.problem = (now_ns, bytes(data)), ""


def _stage(text: str) -> Stage:
    return Stage(text) if text in {stage.value for stage in Stage} else Stage.IDLE
