"""The bridge node: it supervises the drive, limits the navigator's speeds and sends them to the board by its cable.

| takes | |
|---|---|
| cmd_vel, drive_request | the navigator's speeds and requests; only fresh ones, and only from the navigator |
| scan, imu/data, joint_states, battery_state | for odometry, limits and the collision monitor (a process of its own) |
| localisation | for slow zones; a chair that is not localised does not drive |
| floor | the map in use; no drive while a node has another one, or while the storey is not certain |
| stop | the rider's Stop |
| guard/unscanned, guard/seen_walls | for the guard: what no scan shows, and walls that were seen on a way without a map |
| haptics/state | for the guard: the guide's hold of the stick |
| page_joystick, page_watch, layout_changed | from a page: its joystick, its heartbeat, changed zones |

| sends | |
|---|---|
| odom, /tf, /tf_static | dead reckoning, and the mounts of the chair's file |
| drive_state | the drive mode and its reason, and the command that was sent |
| guard | the level of help while the rider drives, and the caps of the board's guard |

Services: `confirm` (waychair_msgs/Confirm: the rider's confirmation of a goal), `choose_level` (waychair_msgs/ChooseLevel),
`stop`, `reset_faults`, `override_guard` (std_srvs/Trigger).
A black box records the requests (go, confirm, stop, reset), sensor messages, decisions and commands. A page's joystick,
changed zones and a newly set pose appear in it by their effects only.

The node ticks on each request of the navigator, without delay, and otherwise by a timer. Its parts use the steady clock,
so that jumps of ROS's clock do not affect them. Incoming stamps are converted, and messages stamped by another clock are
dropped. A goal requested before this node started is over: no drive resumes by itself.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from waychair.calibration.fits.dac import DEFAULT
from waychair.control.safety.stops import Halt, halt
from waychair.control.safety.supervisor import DRIVEN, deflection_of
from waychair.errors import WaychairError
from waychair.firmware_bridge.bridge import MAX_AGE_MS
from waychair.firmware_bridge.heartbeat import Heartbeat
from waychair.firmware_bridge.real_boards import check_cable, is_real, open_cable
from waychair.firmware_bridge.transports import Reconnecting
from waychair.geometry import in_space
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import load_zones
from waychair.recordings.bags import ros_messages
from waychair.recordings.bags.ros_messages import BASE_FRAME, ODOM_FRAME
from waychair.ros import topics
from waychair.ros.description import robot_description, wheel_transforms
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.chair import (
    NO_GOAL,
    DriveReport,
    DriveRequest,
    drive_state,
    read_drive_request,
    read_localisation_on_floor,
)
from waychair.ros.messages.floor import Floor, read_floor
from waychair.ros.messages.motion import pose_with_covariance, read_twist, read_twist_stamped, transform
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.messages.sensors import read_battery, read_imu, read_page_joystick, read_scan, read_wheels
from waychair.ros.mounts import static_transforms
from waychair.ros.node_settings.bridge import BridgeNodeSettings
from waychair.ros.nodes.node import ChairNode, run_node
from waychair.ros.nodes.parts.bridge_log import BridgeLog, TickRecord
from waychair.ros.nodes.parts.bridge_state import (
    MAX_CLOCK_DIFFERENCE_NS,
    BridgeDrive,
    BridgePublishers,
    LastMessage,
    Localised,
)
from waychair.ros.nodes.parts.commanders import NAVIGATOR_NODE, PAGE_NODE, Commanders
from waychair.ros.nodes.parts.help_levels import LEVEL, HelpLevels
from waychair.ros.nodes.parts.known_chair import known_chair
from waychair.ros.topics import RosTopic
from waychair.runtime.black_box.recorder import LoggedChair
from waychair.runtime.drive_base import ChairMessage, DriveBase
from waychair.runtime.monitor_process import MonitorProcess, Watched
from waychair.runtime.pages.page_watch import PageWatch
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.topics import SCAN as SCAN_RATE
from waychair.types import ChairStatus, Goal, JoystickInput, Odometry, Pose2, Twist, WheelTicks

_OPENING_S = 0.02  # longest time that a tick waits for opening the cable
_AHEAD_NS = 50_000_000  # a request may be stamped so far ahead, since /clock is coarse
_TICK_NS = 45_000_000  # without requests the node ticks this long after the last tick
_LATE_NS = 65_000_000  # requests come every 50 ms, or a little later; each is answered by one tick, no more
_WHEELS_HZ = 10.0
_WATCH_HZ = 50.0


class BridgeNode(ChairNode[BridgeNodeSettings]):
    """A node with a `DriveBase`, its heartbeat and its collision monitor."""

    def __init__(self) -> None:
        super().__init__("bridge", BridgeNodeSettings, dynamic=(LEVEL,))
        s = self.settings
        self._calibration = calibration = known_chair(s.calibration, s.chair)
        if s.calibration or is_real(s.cable):
            check_cable(s.cable, calibration, s.calibration or "the bridge")
        watched = Watched(calibration.body, s.monitor, calibration.stops, calibration.self_mask)
        monitor = MonitorProcess(watched)
        monitor.__enter__()
        self.at_end(lambda: monitor.__exit__(None, None, None))
        cable = Reconnecting(lambda: open_cable(s.cable, calibration), patience_s=_OPENING_S)
        zones = load_zones(Path(s.map_folder)) if s.map_folder else ()
        model = None if calibration.dac else DEFAULT
        self._base = DriveBase(
            calibration=calibration, cable=cable, start=Pose2(), settings=s, model=model, monitor=monitor, zones=zones
        )
        heartbeat = Heartbeat(self._base.bridge, cable)
        heartbeat.__enter__()
        self.at_end(lambda: heartbeat.__exit__(None, None, None))
        self._log = self._start_log()
        self._help = HelpLevels(self, self._base, s.help_level)

        self._request, self._command = LastMessage(DriveRequest(0)), LastMessage(Twist())
        self._localised, self._drive = Localised(), BridgeDrive()
        self._page_watch = PageWatch()
        authorised = {
            self.resolve_topic_name(topics.COMMAND.name): NAVIGATOR_NODE,
            self.resolve_topic_name(topics.DRIVE_REQUEST.name): NAVIGATOR_NODE,
            self.resolve_topic_name(topics.PAGE_JOYSTICK.name): PAGE_NODE,
        }
        self._commanders = Commanders(self, authorised, time.monotonic_ns())
        self._publish = BridgePublishers(
            odometry=self.publisher(topics.ODOMETRY),
            transform=self.publisher(topics.TF),
            state=self.publisher(topics.DRIVE_STATE),
            pose=self.publisher(topics.INITIAL_POSE),
        )
        self.publisher(topics.TF_STATIC)(ros_messages.transforms(self.now_ns(), static_transforms(calibration.body)))
        self.publisher(topics.ROBOT_DESCRIPTION)(robot_description(calibration.body))
        self.every(_WHEELS_HZ, self._publish_wheels)
        self.listen(
            _best_effort(topics.JOINTS),
            lambda message: read_wheels(message, self._calibration.body.ticks_per_turn),
            self._take_wheels,
        )
        self.listen(topics.IMU, lambda message: read_imu(message, s.imu_frame), self._take_sensor)
        self.listen(topics.SCAN, lambda message: read_scan(message, s.scan_frame), self._take_sensor)
        self.listen(_best_effort(topics.BATTERY), read_battery, self._take_sensor, needed=s.fitness.power_monitor)
        self.listen(_best_effort(topics.SEAT), self._read_seat, self._take_sensor, needed=s.fitness.seat_switch)
        self.listen(topics.LOCALISATION, read_localisation_on_floor, self._take_localisation)
        self.listen(topics.FLOOR, read_floor, self._take_floor, needed=False)
        if s.enable_stamped_cmd_vel:
            self.listen(
                topics.STAMPED_COMMAND, read_twist_stamped, self._take_stamped, self._take_invalid_speed, needed=False
            )
        else:
            self.listen(topics.COMMAND, read_twist, self._command.take, self._take_invalid_speed, needed=False)
        self.listen(topics.DRIVE_REQUEST, read_drive_request, self._take_request, needed=False)
        self.listen(
            topics.PAGE_JOYSTICK,
            read_page_joystick,
            self._take_page_joystick,
            lambda reason: self._take_page_joystick(None),
            needed=False,
        )
        self.listen(topics.PAGE_WATCH, lambda message: message, self._take_page_heartbeat, needed=False)
        self.listen(topics.LAYOUT, lambda message: message, self._reload_zones, needed=False)
        self.listen(topics.STOP, lambda message: message, lambda message: self._stop(), needed=False)
        self.serve("stop", self._stop)
        self.create_service(interface_type("waychair_msgs/srv/Confirm"), "confirm", self._answer_confirm)
        self.serve("reset_faults", self._reset)
        self.every(_WATCH_HZ, self._watch)

    def _start_log(self) -> BridgeLog | None:
        """Return the black box's log if a folder is configured."""
        s = self.settings
        if not s.black_box_folder:
            return None
        places = load_places(Path(s.map_folder)) if s.map_folder else {}
        log = BridgeLog(Path(s.black_box_folder), LoggedChair(s, self._calibration, places), s.black_box)
        self.at_end(log.close)
        return log

    def on_settings(self, settings: BridgeNodeSettings) -> None:
        """Take a level of help that somebody has set as a parameter."""
        self._help.take(settings.help_level)

    def reports(self) -> Iterable[Report]:
        """Report the black box, the drive mode with the conditions against driving, and the board."""
        if self._log is not None:
            yield self._log.report()
        last = self._drive.report
        if last is None:
            return
        first = last.halts[0][1] if last.halts else ""
        level = DiagnosticLevel.OK if last.ready else DiagnosticLevel.WARN
        values = (
            ("mode", last.mode.value),
            ("reason", last.reason),
            ("halts", ", ".join(stop_id for stop_id, _ in last.halts)),
            ("goal", str(last.goal_id)),
        )
        yield Report("drive", level, first, values)
        telemetry = self._base.bridge.telemetry
        if telemetry is None:
            yield Report(
                "board",
                DiagnosticLevel.ERROR,
                self._base.bridge.trouble[0] if self._base.bridge.trouble else "no board",
            )
        else:
            yield Report("board", DiagnosticLevel.OK, "", (("state", str(telemetry.state)),))

    def _take_sensor(self, message: ChairMessage) -> bool:
        """Process a sensor's message with its stamp converted to the steady clock; return False if it is of another clock."""
        age_ns = self.now_ns() - message.stamp_ns
        if abs(age_ns) > MAX_CLOCK_DIFFERENCE_NS:
            self._base.dismiss(message, 1e-9 * age_ns, time.monotonic_ns())
            return False
        heard = replace(message, stamp_ns=time.monotonic_ns() - age_ns)
        self._base.hear(self._base.with_true_stamp(heard))
        if self._log is not None:
            self._log.add_message(heard)
        return True

    def _take_wheels(self, message: WheelTicks) -> None:
        odometry = self._base.motion.odometry if self._take_sensor(message) else None
        if odometry is not None:
            self._publish_odometry(replace(odometry, stamp_ns=message.stamp_ns))

    def _publish_wheels(self) -> None:
        """Publish the wheels' rotation, for displays."""
        frames = wheel_transforms(self._calibration.body, self._base.motion.wheels or WheelTicks(0, 0, 0))
        self._publish.transform(ros_messages.transforms(self.now_ns(), frames))

    def _publish_odometry(self, odometry: Odometry) -> None:
        pose = odometry.odom_from_base
        self._publish.odometry(
            ros_messages.odometry(
                stamp_ns=odometry.stamp_ns,
                parent=ODOM_FRAME,
                parent_from_base=pose,
                twist=odometry.twist,
                covariance=odometry.covariance,
                twist_covariance=self._base.motion.twist_covariance,
            )
        )
        self._publish.transform(transform(odometry.stamp_ns, ODOM_FRAME, BASE_FRAME, in_space(pose)))

    def _take_floor(self, told: Floor) -> None:
        """Take the map in use: of another map its zones, and nothing of the last one's; of the same one its certainty."""
        before, self._localised.floor = self._localised.floor, told
        if before is not None and before.revision == told.revision:
            return
        self._log_request(f"storey {told.storey}")
        if before is not None:
            self._base.change_map((), Pose2())  # it is where the localiser finds it
        self._reload_zones(None)

    def _take_localisation(self, located: tuple[int, Localisation, int]) -> None:
        """Take the localiser's message; a repeated one is only a heartbeat."""
        stamp_ns, localisation, self._localised.revision = located
        self._localised.heartbeat.take(localisation)
        self._localised.steady_ns = time.monotonic_ns() - (self.now_ns() - stamp_ns)
        if stamp_ns != self._localised.stamp_ns and not SCAN_RATE.is_stale(
            self._localised.steady_ns, time.monotonic_ns()
        ):
            self._localised.stamp_ns, self._localised.last = stamp_ns, localisation
            self._base.locate(localisation, self._localised.steady_ns)

    def _read_seat(self, message: Any) -> ChairStatus:
        return ChairStatus(self.now_ns(), seated=bool(message.data))

    def _take_invalid_speed(self, reason: str) -> None:
        """Replace the last speed by nan after an invalid one, so that the chair stops at once (F5)."""
        self._command.take(Twist(math.nan, math.nan))

    def _take_stamped(self, command: tuple[int, Twist]) -> None:
        if self._is_fresh(command[0]):
            self._command.take(command[1])

    def _take_request(self, request: DriveRequest) -> None:
        """Process a request of the navigator, unless it was delayed on its way."""
        if not self._is_fresh(request.stamp_ns):
            return
        if request.active and not self._drive.requested:
            self._drive.goal_id = self._drive.ended_goal_id = request.goal_id
        self._drive.requested = True
        self._request.take(request)
        if request.scan_ns:
            self._base.note_mapped_legs(request.furniture, time.monotonic_ns() - (self.now_ns() - request.scan_ns))
        self._tick()

    def _is_fresh(self, stamp_ns: int) -> bool:
        """Return whether a stamp is no older than the board's limit for commands (F2)."""
        return -_AHEAD_NS <= self.now_ns() - stamp_ns <= MAX_AGE_MS * 1_000_000

    def _watch(self) -> None:
        """Tick without a request, if none has come for a while or another node falls silent during a drive."""
        now_ns = time.monotonic_ns()
        silent = self._request.is_silent(now_ns) or self._localised.heartbeat.is_silent(now_ns)
        due = now_ns - self._drive.ticked_ns > _TICK_NS and now_ns - self._request.at_ns > _LATE_NS
        if due or (silent and self._drive.mode in DRIVEN):
            self._tick()

    def _tick(self) -> None:
        """Make one tick: decide the drive mode, send the command to the board, and publish the state."""
        now_ns = self._drive.ticked_ns = time.monotonic_ns()
        request: DriveRequest = self._request.value
        if request.active and request.goal_id != self._drive.goal_id:
            self._drive.goal_id = request.goal_id
            self._log_request("go", Goal(request.goal))
            self._base.request()
            if self.settings.confirm_goals:
                self._base.confirm()
        active = request.active and self._drive.goal_id not in (NO_GOAL, self._drive.ended_goal_id)
        verdict, telemetry = self._base.supervise(now_ns, active, self._halts(now_ns, active))
        if verdict.guarded:
            self._help.watch(self._localised, now_ns)
        fresh = active and request.driving and not self._command.is_silent(now_ns)
        asked = self._command.value if fresh else None
        driven = self._base.drive(now_ns, verdict, asked)
        self._drive.mode = verdict.mode
        if self._drive.mode not in DRIVEN:
            self._page_watch.over()
        if self._base.stopped_after_push:
            self._relocalise()
        if active and (verdict.drops_goal or driven.ended):
            self._drive.ended_goal_id, self._drive.last_stop = self._drive.goal_id, driven.ended or verdict.reason
        elif verdict.halt is not None and verdict.halt.stop.id == "stop_pressed":  # also without a goal
            self._drive.last_stop = verdict.reason
        if self._log is not None:
            decided = TickRecord(
                now_ns=now_ns,
                request=request,
                asked=asked or Twist(),
                located=self._localised.last,
                verdict=verdict,
                driven=driven,
                telemetry=telemetry,
            )
            self._log.add_tick(self._base, decided)
        tilt = self._base.motion.tilt
        self._drive.report = DriveReport(
            stamp_ns=self.now_ns(),
            goal_id=self._drive.goal_id,
            mode=verdict.mode,
            reason=driven.ended or verdict.reason,
            drops_goal=self._drive.goal_id == self._drive.ended_goal_id,
            ready=self._base.ready,
            command=driven.command if driven.sent.active else None,
            ended=driven.ended,
            halts=tuple((halted.stop.id, halted.text) for halted in self._base.halts),
            tilt=(0.0, 0.0) if tilt is None else (tilt.roll, tilt.pitch),
            scan_ns=request.scan_ns,
            goal=request.goal,
            last_stop=self._drive.last_stop,
            last_goal=request.last_goal,
            countdown_s=self._base.countdown_s(now_ns) or 0.0,
            steered=verdict.steered,
            pushed=telemetry is not None and not deflection_of(telemetry.joystick) < self.settings.supervisor.override,
        )
        self._publish.state(drive_state(self._drive.report))

    def _halts(self, now_ns: int, active: bool) -> list[Halt]:
        """Return the halts that only a chair of several processes has: silent nodes and additional commanders."""
        halts = [halt("open_network")] if self.settings.ignore_commands else []
        if (active or self._drive.mode in DRIVEN) and self._request.is_silent(now_ns):
            halts.append(halt("navigator_silent"))
        if self._localised.heartbeat.is_silent(now_ns) or SCAN_RATE.is_stale(self._localised.steady_ns, now_ns):
            halts.append(halt("localiser_silent"))
        halts += self._localised.floor_halts(self._request.value.floor_revision if active else None)
        self._commanders.check(now_ns)
        if self._commanders.intruder:
            halts.append(halt("two_commanders", self._commanders.intruder))
        halts += self._page_watch.halts(now_ns)
        return halts

    def _log_request(self, value: str, *goals: Goal) -> None:
        """Record a request in the black box."""
        if self._log is not None:
            self._log.note_request(value, goals)

    def _take_page_joystick(self, stick: JoystickInput | None) -> None:
        """Take a page's joystick, unless the network is open or the message was delayed."""
        now_ns = time.monotonic_ns()
        self._commanders.check(now_ns)
        if stick is None or self.settings.ignore_commands:
            self._commanders.release_joystick()
            self._base.let_go(now_ns)
        elif self._commanders.push_joystick(now_ns) and self._is_fresh(stick.stamp_ns):
            self._base.steer(stick.forward, stick.turn, now_ns)

    def _take_page_heartbeat(self, message: Any) -> None:
        self._page_watch.seen(["page"], time.monotonic_ns())

    def _reload_zones(self, message: Any) -> None:
        """Load the changed zones."""
        told = self._localised.floor
        folder = self.settings.map_folder if told is None else told.map_folder
        if not folder:
            return
        try:
            self._base.replace_zones(load_zones(Path(folder)))
        except WaychairError:
            return  # the zones stay unchanged; the navigator, which reads the same file, says so

    def _relocalise(self) -> None:
        """After a push by hand, restart the localiser at its pose if the scans confirm that pose only partly."""
        located: Localisation | None = self._localised.heartbeat.value
        if located is not None and located.state is LocalisationState.DEGRADED:
            self._publish.pose(pose_with_covariance(self.now_ns(), located.map_from_base))

    def _stop(self) -> tuple[bool, str]:
        self._log_request("stop")
        self._base.stop()
        self._tick()
        return True, "stopped"

    def _answer_confirm(self, request: Any, response: Any) -> Any:
        response.success, response.message = self._confirm(int(request.goal_id), request.on_page)
        return response

    def _confirm(self, goal_id: int, on_page: bool = False) -> tuple[bool, str]:
        """Confirm one goal for the rider; refuse if another goal has arrived meanwhile."""
        request: DriveRequest = self._request.value
        if not request.active or self._drive.goal_id in (NO_GOAL, self._drive.ended_goal_id):
            return False, "there is no goal to confirm: request one first"
        if goal_id != self._drive.goal_id:
            return False, "the goal has changed since it was shown: look at the new goal, then confirm it"
        if self._drive.mode in DRIVEN:
            return True, "the drive is under way"
        if on_page:
            self._page_watch.began(time.monotonic_ns())
        self._log_request("confirm")
        self._base.confirm()
        self._tick()
        last = self._drive.report
        if last is not None and last.mode in DRIVEN:
            return True, "the drive begins"
        return False, "" if last is None else last.reason

    def _reset(self) -> tuple[bool, str]:
        self._drive.ended_goal_id = self._drive.goal_id
        self._log_request("reset")
        self._base.reset()
        return True, "the faults were reset; request the goal again"


def _best_effort(topic: RosTopic) -> RosTopic:
    """Return the topic with best effort, which is compatible with reliable and best-effort publishers."""
    return replace(topic, qos=replace(topic.qos, reliable=False))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(BridgeNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
