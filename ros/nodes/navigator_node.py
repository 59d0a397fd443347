"""The navigator node: it turns goals into velocity commands at 20 Hz, every second tick just after a scan.

| takes | |
|---|---|
| map, localisation, odom | the map, and the chair's pose and twist |
| scan, sonar_0.., camera/... | obstacles |
| goal_pose; the action navigate_to_pose | the goal; the rider's `confirm` begins the drive |
| drive_state | the bridge's mode, the command that it sent, and the reason why a drive ended |
| speed_limit | the largest speed |
| floor | another map with its places and zones; for journeys over storeys see `Journeys` |

| sends | |
|---|---|
| cmd_vel, drive_request | to the bridge, which accepts them from this node only |
| plan, local_plan, people, global_costmap/costmap, local_costmap/... | see `NavigationDisplay` |
| places | the named places of the map |
| guard/unscanned | to the bridge: drop-offs, things near the chair that no scan shows, and the reach of people who walk |
| building_graph | the building's graph; with the action compute_route: see `BuildingRoutes` |

Services: `pause`, `go_on` and `cancel` (std_srvs/Trigger), and `bt_navigator/get_state` (lifecycle_msgs) for scripts
that wait for Nav2's node.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Sequence

from waychair.control.drive.navigation import ACTIVE, Navigation, Stage
from waychair.control.safety.fitness import SLOW_SPEED
from waychair.control.safety.stops import halt
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.errors import ConfigError, WaychairError
from waychair.garbage import leave_out_present
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import load_zones
from waychair.recordings.bags.ros_messages import make
from waychair.ros import topics
from waychair.ros.messages.chair import (
    NO_GOAL,
    DriveReport,
    DriveRequest,
    drive_request,
    places,
    read_drive_state,
    read_localisation_on_floor,
)
from waychair.ros.messages.floor import Floor, read_floor
from waychair.ros.messages.maps import read_loaded_grid
from waychair.ros.messages.motion import (
    read_odometry,
    read_pose_stamped,
    read_speed_limit,
    twist,
    twist_stamped,
)
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.messages.sensors import read_scan
from waychair.ros.node_settings.navigator import NavigatorNodeSettings
from waychair.ros.nodes.navigator_parts.building_routes import BuildingRoutes, DriveNow
from waychair.ros.nodes.navigator_parts.journeys import Journeys
from waychair.ros.nodes.navigator_parts.navigate_action import NavigateAction, feedback
from waychair.ros.nodes.navigator_parts.navigation_display import NavigationDisplay
from waychair.ros.nodes.navigator_parts.navigator_senses import NavigatorSenses
from waychair.ros.nodes.navigator_parts.navigator_state import (
    CurrentDrive,
    Latest,
    NavigatedBuilding,
    NavigatorPublishers,
)
from waychair.ros.nodes.navigator_parts.remote_chair import ChairNow
from waychair.ros.nodes.node import ChairNode, offer_get_state, run_node
from waychair.ros.nodes.parts.known_chair import known_chair
from waychair.ros.nodes.parts.map_layout import first_layout
from waychair.ros.nodes.parts.refusals import Refusals
from waychair.ros.nodes.parts.tick_phase import TickPhase
from waychair.runtime.pilot import Pilot
from waychair.runtime.rider.sentences import GOES_ON, NOTHING_PAUSED, NOTHING_TO_PAUSE, PAUSED
from waychair.slam.localising.localisation import Localisation
from waychair.slam.odometry.odometry_track import OdometryTrack
from waychair.slam.odometry.tilt import Tilt
from waychair.topics import CAMERA as CAMERA_RATE
from waychair.topics import COMMAND as COMMAND_RATE
from waychair.topics import SCAN as SCAN_RATE
from waychair.types import Goal, OccupancyGrid, Odometry, Pose2, Scan, Twist

_PERIOD_NS = round(1e9 / COMMAND_RATE.rate_hz)
_FEEDBACK_EVERY = 4  # ticks
_DRAWN_HZ = 1.0
"""Rate at which the map's folder is searched for drawings that another program has changed."""
_SILENT_NS = 500_000_000
"""A drive waits at rest so long for the bridge or the localiser before it ends (F25)."""


class NavigatorNode(ChairNode[NavigatorNodeSettings]):
    """A node with a `Pilot` on the mapper's map."""

    def __init__(self) -> None:
        super().__init__("navigator", NavigatorNodeSettings)
        s = self.settings
        self._calibration = known_chair(s.calibration, s.chair)
        self._layout = first_layout(s.map_folder)
        self._pilot: Pilot | None = None
        self._track = OdometryTrack()
        self._latest, self._drive = Latest(), CurrentDrive()
        self._refusals = Refusals("last goal", self.get_logger().error)
        self._navigation: Navigation | None = None

        stamped = s.enable_stamped_cmd_vel
        self._publish = NavigatorPublishers(
            command=self.publisher(topics.STAMPED_COMMAND if stamped else topics.COMMAND),
            request=self.publisher(topics.DRIVE_REQUEST),
            places=self.publisher(topics.PLACES),
            layout=self.publisher(topics.LAYOUT),
        )
        self._display = NavigationDisplay(self, self._calibration.body)
        self._publish.places(places(self.now_ns(), self._layout.places))
        self.listen(topics.LAYOUT, lambda message: message, lambda message: self._reload_layout(), needed=False)
        self.every(_DRAWN_HZ, self._watch_drawing)
        self.listen(topics.MAP, read_loaded_grid, self._take_map)
        self.listen(topics.FLOOR, read_floor, self._take_floor, needed=False)
        with_true_stamp = self._calibration.with_true_stamp
        self.listen(topics.ODOMETRY, lambda message: with_true_stamp(read_odometry(message)), self._take_odometry)
        self.listen(topics.LOCALISATION, read_localisation_on_floor, self._take_localisation)
        self.listen(topics.SCAN, lambda message: with_true_stamp(read_scan(message, s.scan_frame)), self._take_scan)
        self.listen(topics.DRIVE_STATE, read_drive_state, self._take_drive_state)
        self.listen(topics.GOAL, read_pose_stamped, self._take_goal, self.refuse, needed=False)
        full_speed = s.limiter.max_speed
        self.listen(
            topics.SPEED_LIMIT, lambda message: read_speed_limit(message, full_speed), self._limit_speed, needed=False
        )
        self._action = NavigateAction(self, self)
        self._building = NavigatedBuilding(
            BuildingRoutes(self, self._layout.folder, self._calibration.body, self._drive_now),
            Journeys(self, self, self._calibration.body),
        )
        self._senses = NavigatorSenses(self, self, self._building.journeys.tags.look, camera=s.camera)
        self.serve("cancel", self._answer_cancel)
        self.serve("pause", self._answer_pause)
        self.serve("go_on", self._answer_go_on)
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
            BuildingError: the chair is in a lift.
        """
        self._building.journeys.make_way()
        self.begin_leg(self._layout.goal_at(goal), goal_id)

    def begin_leg(self, goal: Goal, goal_id: int) -> None:
        """Start a drive to a goal, of a journey as well.

        Raises:
            ConfigError: as `begin`.
        """
        if self._pilot is None:
            raise ConfigError("there is no map yet: start the mapper, or wait for it")
        if missing := self._missing_input(time.monotonic_ns()):
            raise ConfigError(missing)
        assert isinstance(goal.target, Pose2)
        self._pilot.go(goal)
        self._drive.goal, self._drive.goal_id, self._drive.began_ns = goal.target, goal_id, time.monotonic_ns()
        self._drive.recoveries = self._pilot.navigator.recovery.begun
        self._drive.is_open, self._drive.was_driven = True, False
        self._refusals.accepted()

    def cancel(self) -> None:
        """Give the goal up and stop, and the journey that it was part of; for the action and the service."""
        self._building.journeys.cancel()
        self.cancel_leg()

    def cancel_leg(self) -> None:
        """Give the goal up and stop."""
        self._drive.is_open = False
        if self._pilot is not None:
            self._pilot.drop("the drive was cancelled")

    def refuse(self, reason: str) -> None:
        """Answer a goal that cannot be begun, in the log, on /diagnostics and in the request to the bridge."""
        self._refusals.refused(f"a goal was refused: {reason}")

    def _take_goal(self, goal: Pose2) -> None:
        """Start a drive requested by topic; a waiting client of the action learns that its goal was replaced."""
        self._action.end(reached=False, reason="another goal was given")
        try:
            self.begin(goal, time.time_ns())
        except WaychairError as error:
            self.refuse(str(error))

    def _answer_cancel(self) -> tuple[bool, str]:
        active = self._building.journeys.active or (self._pilot is not None and self._pilot.navigator.active)
        self.cancel()
        return True, "cancelled" if active else "there was nothing to cancel"

    def _answer_pause(self) -> tuple[bool, str]:
        paused = self._building.journeys.pause() or self.pause_leg()
        return paused, PAUSED if paused else NOTHING_TO_PAUSE

    def _answer_go_on(self) -> tuple[bool, str]:
        goes_on = self._building.journeys.go_on() or self.go_on_leg()
        return goes_on, GOES_ON if goes_on else NOTHING_PAUSED

    def pause_leg(self) -> bool:
        """Pause the drive; return whether there is one."""
        return self._pilot is not None and self._pilot.pause()

    def go_on_leg(self) -> bool:
        """Continue the drive that was paused, or take the way offered; return whether there is one."""
        return self._pilot is not None and self._pilot.go_on()

    def _limit_speed(self, limit: float) -> None:
        self._latest.limit = limit

    def _take_map(self, loaded: tuple[OccupancyGrid, int]) -> None:
        """Use a new map at once, or after the current drive; that of another floor as soon as the floor is told, too."""
        self._layout.next_grid, self._layout.loaded_ns = loaded
        self._follow_floor()
        self._use_next_map()

    def _take_floor(self, told: Floor) -> None:
        self._layout.floor = told
        self._follow_floor()

    def _follow_floor(self) -> None:
        """Once another floor and its map have come, take the map with its places and zones; a drive under way ends.

        Places or zones that cannot be read leave the node on its last floor, so that no drive begins.
        """
        layout = self._layout
        try:
            if not layout.follow():
                return
        except WaychairError as error:
            self.get_logger().error(f"{error}; the chair does not drive on this map")
            return
        if self._pilot is not None and self._pilot.navigator.active:
            self._pilot.drop("the chair has got another map: ask for the goal again")
        assert layout.folder is not None
        self._latest.located = self._latest.scan = None  # of the last map
        self._publish.places(places(self.now_ns(), layout.places))
        self._building.routes.follow(layout.folder)
        self._use_next_map()

    def _use_next_map(self) -> None:
        layout = self._layout
        if layout.next_grid is None or layout.waits or (self._pilot is not None and self._pilot.navigator.active):
            return
        grid, layout.next_grid = layout.next_grid, None
        try:
            self._pilot = pilot = layout.pilot_on(grid, self._calibration, self.settings)
        except WaychairError as error:
            self.get_logger().error(f"{error}; the chair does not drive on this map")
            return
        self._show_map(pilot, grid)
        leave_out_present()

    def _show_map(self, pilot: Pilot, grid: OccupancyGrid) -> None:
        zones = self._layout.zones
        self._display.draw(lambda: pilot.drawn(grid, zones).costmap())

    def _reload_layout(self) -> None:
        """Load changed places and zones; a current drive is replanned with them."""
        folder = self._layout.folder
        if self._layout.drawn is None or folder is None:
            return
        self._layout.drawn.note()
        try:
            self._layout.places, self._layout.zones = load_places(folder), load_zones(folder)
        except WaychairError as error:
            self.get_logger().error(f"{error}; places and zones stay unchanged")
            return
        named, zones, pilot, grid = self._layout.places, self._layout.zones, self._pilot, self._layout.grid
        self._publish.places(places(self.now_ns(), named))
        if pilot is not None and grid is not None:
            self.worker.submit(lambda: pilot.drawn(grid, zones), lambda drawn: pilot.redraw(drawn, named))
            self._show_map(pilot, grid)

    def _watch_drawing(self) -> None:
        """Tell all nodes of places, zones or erased parts that another program has changed, such as `waychair places`."""
        if self._layout.drawn is not None and self._layout.drawn.changed():
            self._publish.layout(make("std_msgs/msg/Empty", 0))

    def _take_odometry(self, odometry: Odometry) -> None:
        if self._track.take(odometry):
            self._latest.located = None  # the odometry restarted, so the old localisation is void

    def _take_scan(self, scan: Scan) -> None:
        self._latest.scan = scan
        self._building.journeys.hear(scan)
        self._pass_scan()

    def _take_localisation(self, told: tuple[int, Localisation, int]) -> None:
        stamp_ns, found, revision = told
        if revision != self._layout.revision:
            return  # of another floor's map
        located = stamp_ns, found
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

    @property
    def pilot(self) -> Pilot | None:
        """The pilot on the present map; None before the first map."""
        return self._pilot

    def tilt(self, stamp_ns: int) -> Tilt | None:
        """Return the chair's tilt as the bridge reports it; None before its first report."""
        state = self._latest.state
        return None if state is None else Tilt(stamp_ns, *state.tilt)

    def map_from_base(self, stamp_ns: int) -> Pose2 | None:
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
        self._building.journeys.step()
        self._senses.tell_guard(self.now_ns(), self._layout.revision)
        self._senses.process_camera()

    def now(self) -> ChairNow:
        """Return the node's view of the chair, for a journey."""
        located, navigator = self._latest.located, None if self._pilot is None else self._pilot.navigator
        now_ns = self.now_ns()
        return ChairNow(
            stamp_ns=now_ns,
            map_from_base=self.map_from_base(now_ns),
            odom_from_base=self._track.odom_from_base(now_ns),
            continued=self._track.continued,
            twist=self._track.twist,
            localisation=None if located is None else located[1],
            navigation=Navigation(Stage.IDLE)
            if navigator is None
            else Navigation(navigator.stage, reason=navigator.reason),
            goal_id=self._drive.goal_id,
            state=self._latest.state,
            floor=self._layout.floor,
            revision=self._layout.revision,
        )

    def _step(self) -> None:
        """Make one step of the navigator, and send its request to the bridge, even without a drive.

        Stamps are of ROS's clock. The navigator itself uses the steady clock, so that jumps of ROS's clock do not affect
        it.
        """
        now_ns, steady_ns = self.now_ns(), time.monotonic_ns()
        pose = self.map_from_base(now_ns)
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
        stage = Stage.IDLE if self._pilot is None else self._pilot.navigator.stage
        drives, arrived = self._drive.was_driven and stage in ACTIVE, stage is Stage.ARRIVED
        return DriveNow(drives, arrived, self.map_from_base(self.now_ns()))

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
            return DriveRequest(now_ns, last_goal=self._refusals.last, floor_revision=self._layout.revision)
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
            floor_revision=self._layout.revision,
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
        heard_ns = self._senses.camera_ns
        return heard_ns is not None and CAMERA_RATE.is_stale(heard_ns, now_ns)

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
        self._publish.command(twist_stamped(request.stamp_ns, command) if stamped else twist(command))
        self._publish.request(drive_request(request))

    def _update_action(self, pose: Pose2 | None = None) -> None:
        """Send the action's feedback periodically and at the end, and its result at once."""
        self._drive.ticks += 1
        if not self._action.active or self._pilot is None:
            return
        navigator = self._pilot.navigator
        due = not navigator.active or self._drive.ticks % _FEEDBACK_EVERY == 0
        if due and pose is not None and self._navigation is not None:
            recoveries, begun_ns = navigator.recovery.begun - self._drive.recoveries, self._drive.began_ns
            elapsed_s, max_speed = (time.monotonic_ns() - begun_ns) * 1e-9, self.settings.limiter.max_speed
            self._action.tell(feedback(pose, self._navigation.path, elapsed_s, recoveries, max_speed))
        if not navigator.active:
            self._action.end(reached=navigator.stage is Stage.ARRIVED, reason=navigator.reason)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(NavigatorNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
