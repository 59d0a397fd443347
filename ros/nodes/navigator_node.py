"""The navigator node: it turns goals into velocity commands at 20 Hz, every second tick just after a scan.

| takes | |
|---|---|
| map, localisation, odom | the map, and the chair's pose and twist |
| scan, sonar_0.., camera/... | obstacles |
| goal_pose; the action navigate_to_pose | the goal; the rider's `confirm` begins the drive |
| drive_state | the bridge's mode, the command that it sent, and the reason why a drive ended |
| speed_limit | the largest speed |

| sends | |
|---|---|
| cmd_vel, drive_request | to the bridge, which accepts them from this node only |
| plan, local_plan, people, global_costmap/costmap, local_costmap/... | see `NavigationDisplay` |
| places | the named places of the map |
| building_graph | the building's graph; with the action compute_route: see `BuildingRoutes` |

Services: `pause`, `go_on` and `cancel` (std_srvs/Trigger), and `bt_navigator/get_state` (lifecycle_msgs) for scripts
that wait for Nav2's node.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any

from waychair.control.drive.navigator import Navigation, Stage
from waychair.control.safety.fitness import SLOW_SPEED, has_valid_reading
from waychair.control.safety.stops import halt
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.errors import ConfigError, WaychairError
from waychair.garbage import leave_out_present
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import Zone, load_zones
from waychair.maps.folders.map_drawing import DrawnFiles
from waychair.recordings.bags.ros_messages import make
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.camera import CameraPairing
from waychair.ros.messages.chair import (
    NO_GOAL,
    DriveReport,
    DriveRequest,
    drive_request,
    places,
    read_drive_state,
    read_localisation,
)
from waychair.ros.messages.maps import read_occupancy_grid
from waychair.ros.messages.motion import (
    read_odometry,
    read_pose_stamped,
    read_speed_limit,
    twist,
    twist_stamped,
)
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.messages.sensors import SonarRing, read_scan
from waychair.ros.node_settings.navigator import NavigatorNodeSettings
from waychair.ros.nodes.node import ChairNode, offer_get_state, run_node
from waychair.ros.nodes.parts.building_routes import BuildingRoutes, DriveNow
from waychair.ros.nodes.parts.known_chair import known_chair
from waychair.ros.nodes.parts.navigate_action import DriveFeedback, NavigateAction, remaining_distance
from waychair.ros.nodes.parts.navigation_display import NavigationDisplay
from waychair.ros.nodes.parts.refusals import Refusals
from waychair.ros.nodes.parts.tick_phase import TickPhase
from waychair.runtime.pilot import Pilot
from waychair.runtime.sentences import GOES_ON, NOTHING_PAUSED, NOTHING_TO_PAUSE, PAUSED
from waychair.slam.localising.localisation import Localisation
from waychair.slam.odometry.odometry_track import OdometryTrack
from waychair.slam.odometry.tilt import Tilt
from waychair.topics import CAMERA as CAMERA_RATE
from waychair.topics import COMMAND as COMMAND_RATE
from waychair.topics import SCAN as SCAN_RATE
from waychair.types import Goal, OccupancyGrid, Odometry, Place, Pose2, RgbdFrame, Scan, SonarReadings, Twist

_PERIOD_NS = round(1e9 / COMMAND_RATE.rate_hz)
_FEEDBACK_EVERY = 4  # ticks
_SONARS = 8
_DRAWN_HZ = 1.0
"""Rate at which the map's folder is searched for drawings that another program has changed."""
_SILENT_NS = 500_000_000
"""A drive waits at rest so long for the bridge or the localiser before it ends (F25)."""


@dataclass(slots=True)
class _Layout:
    """The map with its places and zones; `next_grid` waits for the end of the current drive, `drawn` is their files."""

    places: dict[str, Place]
    zones: tuple[Zone, ...]
    grid: OccupancyGrid | None = None
    next_grid: OccupancyGrid | None = None
    drawn: DrawnFiles | None = None


@dataclass(slots=True)
class _Latest:
    """The latest inputs, and the times [ns] of the last ones by the steady clock; `scan_ns` is a scan's stamp."""

    scan: Scan | None = None  # waits for its localisation
    located: tuple[int, Localisation] | None = None
    frame: RgbdFrame | None = None  # waits for the next tick
    state: DriveReport | None = None
    limit: float = math.inf
    bridge_ns: int | None = None
    scan_ns: int = 0  # of the last scan that was used
    pose_ns: int | None = None  # when the chair's pose was last known
    camera_ns: int | None = None


@dataclass(slots=True)
class _Drive:
    """The current goal, the start of its drive by the steady clock, and the number of recoveries before it."""

    goal: Pose2 = field(default_factory=Pose2)
    goal_id: int = NO_GOAL
    began_ns: int = 0
    recoveries: int = 0
    ticks: int = 0
    is_open: bool = False  # until its end was noted
    was_driven: bool = False  # the computer has driven to it


class NavigatorNode(ChairNode[NavigatorNodeSettings]):
    """A node with a `Pilot` on the mapper's map."""

    def __init__(self) -> None:
        super().__init__("navigator", NavigatorNodeSettings)
        s = self.settings
        self._calibration = known_chair(s.calibration, s.chair)
        folder = FilePath(s.map_folder)
        self._layout = _Layout(load_places(folder), load_zones(folder)) if s.map_folder else _Layout({}, ())
        self._pilot: Pilot | None = None
        self._track = OdometryTrack()
        self._latest, self._drive = _Latest(), _Drive()
        self._refusals = Refusals("last goal", self.get_logger().error)
        self._navigation: Navigation | None = None

        stamped = s.enable_stamped_cmd_vel
        self._send_command = self.publisher(topics.STAMPED_COMMAND if stamped else topics.COMMAND)
        self._send_request = self.publisher(topics.DRIVE_REQUEST)
        self._display = NavigationDisplay(self, self._calibration.body)
        self._send_places = self.publisher(topics.PLACES)
        self._send_places(places(self.now_ns(), self._layout.places))
        self.listen(topics.LAYOUT, lambda message: message, lambda message: self._reload_layout(), needed=False)
        if s.map_folder:
            self._watch_drawing(DrawnFiles(folder))
        self.listen(topics.MAP, read_occupancy_grid, self._take_map)
        with_true_stamp = self._calibration.with_true_stamp
        self.listen(topics.ODOMETRY, lambda message: with_true_stamp(read_odometry(message)), self._take_odometry)
        self.listen(topics.LOCALISATION, read_localisation, self._take_localisation)
        self.listen(topics.SCAN, lambda message: with_true_stamp(read_scan(message, s.scan_frame)), self._take_scan)
        self.listen(topics.DRIVE_STATE, read_drive_state, self._take_drive_state)
        self._listen_to_sonars()
        if s.camera:
            self._listen_to_camera()
        self.listen(topics.GOAL, read_pose_stamped, self._take_goal, self.refuse, needed=False)
        full_speed = s.limiter.max_speed
        self.listen(
            topics.SPEED_LIMIT, lambda message: read_speed_limit(message, full_speed), self._limit_speed, needed=False
        )
        self._action = NavigateAction(self, self)
        BuildingRoutes(self, folder if s.map_folder else None, self._calibration.body, self._drive_now)
        answers = {"cancel": self._answer_cancel, "pause": self._answer_pause, "go_on": self._answer_go_on}
        for name, answer in answers.items():
            self.create_service(interface_type("std_srvs/srv/Trigger"), name, answer)
        offer_get_state("bt_navigator", self, lambda: self._navigation is not None)
        self._phase, self._timer = TickPhase(_PERIOD_NS), self.every(COMMAND_RATE.rate_hz, self._tick)

    def reports(self) -> Iterable[Report]:
        """Report the stage of the drive, and why the last goal was refused or given up."""
        yield self._refusals.report()
        navigation = self._navigation
        if navigation is None:
            yield Report("navigation", DiagnosticLevel.STALE, "there is no map or no localisation yet")
            return
        reason = navigation.reason if self._pilot is None else self._pilot.navigator.reason
        yield Report("navigation", DiagnosticLevel.OK, reason, (("stage", navigation.stage.value),))

    def begin(self, goal: Pose2, goal_id: int) -> None:
        """Start a drive to a pose, for the action; see `navigate_action.Drive`.

        Raises:
            ConfigError: there is no map yet, or the bridge, the chair's pose or the camera is missing.
        """
        if self._pilot is None:
            raise ConfigError("there is no map yet: start the mapper, or wait for it")
        if missing := self._missing_input(time.monotonic_ns()):
            raise ConfigError(missing)
        self._pilot.go(self._with_tolerances(goal))
        self._drive.goal, self._drive.goal_id, self._drive.began_ns = goal, goal_id, time.monotonic_ns()
        self._drive.recoveries = self._pilot.navigator.recovery.begun
        self._drive.is_open, self._drive.was_driven = True, False
        self._refusals.accepted()

    def cancel(self) -> None:
        """Give the goal up and stop; for the action and the service."""
        self._drive.is_open = False
        if self._pilot is not None:
            self._pilot.drop("the drive was cancelled")

    def refuse(self, reason: str) -> None:
        """Answer a goal that cannot be begun, in the log, on /diagnostics and in the request to the bridge."""
        self._refusals.refused(f"a goal was refused: {reason}")

    def _with_tolerances(self, goal: Pose2) -> Goal:
        """Return the goal, with the tolerances of the place at this pose if there is one."""
        for place in self._layout.places.values():
            if math.hypot(place.pose.x - goal.x, place.pose.y - goal.y) < 0.01:
                return Goal(goal, place.tolerance_m, place.tolerance_rad)
        return Goal(goal)

    def _take_goal(self, goal: Pose2) -> None:
        """Start a drive requested by topic; a waiting client of the action learns that its goal was replaced."""
        self._action.end(reached=False, reason="another goal was given")
        try:
            self.begin(goal, time.time_ns())
        except WaychairError as error:
            self.refuse(str(error))

    def _answer_cancel(self, request: Any, response: Any) -> Any:
        active = self._pilot is not None and self._pilot.navigator.active
        self.cancel()
        response.success, response.message = True, "cancelled" if active else "there was nothing to cancel"
        return response

    def _answer_pause(self, request: Any, response: Any) -> Any:
        paused = self._pilot is not None and self._pilot.pause()
        response.success, response.message = paused, PAUSED if paused else NOTHING_TO_PAUSE
        return response

    def _answer_go_on(self, request: Any, response: Any) -> Any:
        goes_on = self._pilot is not None and self._pilot.go_on()
        response.success, response.message = goes_on, GOES_ON if goes_on else NOTHING_PAUSED
        return response

    def _limit_speed(self, limit: float) -> None:
        self._latest.limit = limit

    def _take_map(self, grid: OccupancyGrid) -> None:
        """Use a new map at once, or after the current drive."""
        self._layout.next_grid = grid
        self._use_next_map()

    def _use_next_map(self) -> None:
        if self._layout.next_grid is None or (self._pilot is not None and self._pilot.navigator.active):
            return
        grid, self._layout.next_grid = self._layout.next_grid, None
        self._layout.grid = grid
        self._pilot = pilot = Pilot(
            grid=grid,
            places=self._layout.places,
            body=self._calibration.body,
            settings=self.settings,
            stops=self._calibration.stops,
            zones=self._layout.zones,
        )
        self._show_map(pilot, grid)
        leave_out_present()

    def _show_map(self, pilot: Pilot, grid: OccupancyGrid) -> None:
        zones = self._layout.zones
        self._display.draw(lambda: pilot.drawn(grid, zones).costmap())

    def _reload_layout(self) -> None:
        """Load changed places and zones; a current drive is replanned with them."""
        if self._layout.drawn is None:
            return
        folder = FilePath(self.settings.map_folder)
        self._layout.drawn.note()
        try:
            self._layout.places, self._layout.zones = load_places(folder), load_zones(folder)
        except WaychairError as error:
            self.get_logger().error(f"{error}; places and zones stay unchanged")
            return
        named, zones, pilot, grid = self._layout.places, self._layout.zones, self._pilot, self._layout.grid
        self._send_places(places(self.now_ns(), named))
        if pilot is not None and grid is not None:
            self.worker.submit(lambda: pilot.drawn(grid, zones), lambda drawn: pilot.redraw(drawn, named))
            self._show_map(pilot, grid)

    def _watch_drawing(self, drawn: DrawnFiles) -> None:
        """Tell all nodes of places, zones or erased parts that another program has changed, such as `waychair places`."""
        self._layout.drawn, send_layout = drawn, self.publisher(topics.LAYOUT)

        def watch() -> None:
            if drawn.changed():
                send_layout(make("std_msgs/msg/Empty", 0))

        self.every(_DRAWN_HZ, watch)

    def _take_odometry(self, odometry: Odometry) -> None:
        if self._track.take(odometry):
            self._latest.located = None  # the odometry restarted, so the old localisation is void

    def _take_scan(self, scan: Scan) -> None:
        self._latest.scan = scan
        self._pass_scan()

    def _take_localisation(self, located: tuple[int, Localisation]) -> None:
        if self._latest.located is None or located[0] != self._latest.located[0]:
            self._latest.located = located
            self._pass_scan()

    def _pass_scan(self) -> None:
        """Pass a scan to the pilot once its localisation has arrived."""
        scan, located = self._latest.scan, self._latest.located
        if self._pilot is None or scan is None or located is None or scan.stamp_ns != located[0]:
            return
        self._latest.scan, self._latest.scan_ns = None, scan.stamp_ns
        self._timer.timer_period_ns = self._phase.message_arrived(time.monotonic_ns())
        self._pilot.see(self._calibration.masked(scan), located[1], self._track.twist)

    def _listen_to_sonars(self) -> None:
        ring = SonarRing(_SONARS)
        for k in range(_SONARS):

            def read(message: Any, k: int = k) -> SonarReadings | None:
                return ring.hear(k, message)

            self.listen(topics.sonar(k), read, self._take_sonars, needed=False)

    def _take_sonars(self, readings: SonarReadings | None) -> None:
        pose = None if readings is None else self._map_from_base(readings.stamp_ns)
        if readings is not None and self._pilot is not None and pose is not None:
            self._pilot.hear(readings, pose)

    def _listen_to_camera(self) -> None:
        pairing = CameraPairing()
        self.listen(topics.DEPTH_INFO, lambda message: message, pairing.calibrated, needed=False)
        self.listen(topics.COLOUR, pairing.colour, self._take_frame, needed=False)
        self.listen(topics.DEPTH, pairing.depth, self._take_frame, needed=False)

    def _take_frame(self, frame: RgbdFrame | None) -> None:
        if frame is not None and has_valid_reading(frame):  # a frame without any depth is ignored
            self._latest.frame, self._latest.camera_ns = self._calibration.with_true_stamp(frame), time.monotonic_ns()

    def _process_camera(self) -> None:
        """Process the latest camera frame, just after a tick, since it takes much of the time to the next tick."""
        frame, self._latest.frame = self._latest.frame, None
        pose = None if frame is None else self._map_from_base(frame.stamp_ns)
        if frame is not None and self._pilot is not None and pose is not None:
            state = self._latest.state
            tilt = None if state is None else Tilt(frame.stamp_ns, *state.tilt)
            self._pilot.look(frame, pose, tilt)

    def _map_from_base(self, stamp_ns: int) -> Pose2 | None:
        """Return the chair's pose at a stamp; None without current odometry or localisation."""
        odom_from_base = self._track.odom_from_base(stamp_ns)
        if odom_from_base is None or self._latest.located is None:
            return None
        return self._latest.located[1].map_from_odom @ odom_from_base

    def _take_drive_state(self, report: DriveReport) -> None:
        """Take the bridge's report: its verdict about the drive, and the command that it sent."""
        self._latest.state, self._latest.bridge_ns = report, time.monotonic_ns()
        pilot = self._pilot
        if pilot is None or self._drive.goal_id == NO_GOAL:
            return
        mine = report.goal_id == self._drive.goal_id
        self._drive.was_driven |= mine and report.driving
        if mine and report.drops_goal:
            self._drive.is_open = False  # the bridge itself tells why
        if mine and pilot.navigator.active:
            pilot.obey(SupervisorVerdict(report.mode, report.reason, drops_goal=report.drops_goal))
        pilot.note_sent(report.command if mine else None)

    def _tick(self) -> None:
        self._phase.ticked(time.monotonic_ns())
        self._timer.timer_period_ns = _PERIOD_NS
        self._step()
        self._process_camera()

    def _step(self) -> None:
        """Make one step of the navigator, and send its request to the bridge, even without a drive.

        Stamps are of ROS's clock. The navigator itself uses the steady clock, so that jumps of ROS's clock do not affect
        it.
        """
        now_ns, steady_ns = self.now_ns(), time.monotonic_ns()
        pose = self._map_from_base(now_ns)
        pilot = self._pilot
        missing = self._missing_input(steady_ns)
        if missing and pilot is not None and pilot.navigator.active:
            pilot.drop(missing)
        if pilot is None or pose is None or self._latest.located is None or self._scan_is_stale(now_ns):
            self._note_end()
            self._send(Twist(), self._request(now_ns))
            if pilot is None or not pilot.navigator.active:
                self._display.clear()
            self._update_action()
            return
        self._latest.pose_ns = steady_ns
        pilot.expire(steady_ns)
        navigation = self._navigation = pilot.step(steady_ns, pose, self._latest.located[1].map_from_odom)
        self._note_end()
        command = self._slowed(navigation.twist) if navigation.driving else Twist()
        self._send(command, self._request(now_ns, navigation))
        map_from_odom = self._latest.located[1].map_from_odom
        self._display.show(navigation, pilot.navigator, map_from_odom, self._track.odom_from_base(now_ns))
        self._update_action(pose)
        self._use_next_map()

    def _drive_now(self) -> DriveNow:
        drives = self._drive.was_driven and self._pilot is not None and self._pilot.navigator.active
        arrived = self._pilot is not None and self._pilot.navigator.stage is Stage.ARRIVED
        return DriveNow(drives, arrived, self._map_from_base(self.now_ns()))

    def _note_end(self) -> None:
        """Note once why a goal was given up, for its sender."""
        if not self._drive.is_open or self._pilot is None or self._pilot.navigator.active:
            return
        self._drive.is_open = False
        if self._pilot.navigator.stage is Stage.FAILED:
            goal, ended = self._drive.goal, "given up" if self._drive.was_driven else "refused"
            self._refusals.refused(f"the goal {goal.x:.2f}, {goal.y:.2f} was {ended}: {self._pilot.navigator.reason}")

    def _request(self, now_ns: int, navigation: Navigation | None = None) -> DriveRequest:
        """Return the request to the bridge from this tick's navigation; without one, only the goal."""
        if self._pilot is None:
            return DriveRequest(now_ns, last_goal=self._refusals.last)
        navigator, last = self._pilot.navigator, navigation or self._navigation
        driving = navigator.active and navigation is not None and navigation.driving
        return DriveRequest(
            stamp_ns=now_ns,
            goal_id=self._drive.goal_id,
            active=navigator.active,
            driving=driving,
            scan_ns=0 if navigation is None else self._latest.scan_ns,
            goal=self._drive.goal,
            stage=navigator.stage.value,
            reason=navigator.reason,
            plans=0 if last is None else last.plans,
            furniture=self._pilot.mapped_legs,
            last_goal=self._refusals.last,
        )

    def _missing_input(self, now_ns: int) -> str:
        """Return why a goal must be dropped: the bridge, the localisation or (if so configured) the camera is silent; or ''."""
        if self._latest.bridge_ns is None or now_ns - self._latest.bridge_ns > _SILENT_NS:
            return "the bridge does not answer: wait until it is back, then request the goal again"
        if self._latest.pose_ns is None or now_ns - self._latest.pose_ns > _SILENT_NS:
            return "the chair is not localised: wait until it is, then request the goal again"
        stops = self.settings.fitness.depth_silent == "stop"
        return halt("depth_stale").text if stops and self._camera_is_silent(now_ns) else ""

    def _camera_is_silent(self, now_ns: int) -> bool:
        """Return whether a working camera has fallen silent, so that drop-offs go unseen (F13)."""
        return self._latest.camera_ns is not None and CAMERA_RATE.is_stale(self._latest.camera_ns, now_ns)

    def _scan_is_stale(self, now_ns: int) -> bool:
        """Return whether the last localised scan is too old for driving."""
        return self._latest.located is None or SCAN_RATE.is_stale(self._latest.located[0], now_ns)

    def _slowed(self, command: Twist) -> Twist:
        blind = self._camera_is_silent(time.monotonic_ns())
        limit = min(self._latest.limit, SLOW_SPEED) if blind else self._latest.limit
        share = min(1.0, limit / max(abs(command.v), 1e-9))
        return Twist(share * command.v, share * command.omega)

    def _send(self, command: Twist, request: DriveRequest) -> None:
        stamped = self.settings.enable_stamped_cmd_vel
        self._send_command(twist_stamped(request.stamp_ns, command) if stamped else twist(command))
        self._send_request(drive_request(request))

    def _update_action(self, pose: Pose2 | None = None) -> None:
        """Send the action's feedback periodically and at the end, and its result at once."""
        self._drive.ticks += 1
        if not self._action.active or self._pilot is None:
            return
        navigator = self._pilot.navigator
        if not navigator.active or self._drive.ticks % _FEEDBACK_EVERY == 0:
            self._send_feedback(pose)
        if not navigator.active:
            self._action.end(reached=navigator.stage is Stage.ARRIVED, reason=navigator.reason)

    def _send_feedback(self, pose: Pose2 | None) -> None:
        navigation = self._navigation
        if pose is None or navigation is None or self._pilot is None:
            return
        recoveries = self._pilot.navigator.recovery.begun - self._drive.recoveries
        left = remaining_distance(navigation.path, pose)
        elapsed_s = (time.monotonic_ns() - self._drive.began_ns) * 1e-9
        seconds = left / max(self.settings.limiter.max_speed / 2, 0.05)
        self._action.tell(DriveFeedback(pose, elapsed_s, seconds, recoveries, left))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(NavigatorNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
