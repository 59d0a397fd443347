"""The simulator node: a simulated chair in real time, with the sensors, drivers and serial cable of a real one.

| sends | |
|---|---|
| scan, imu/data, sonar_0..7 | at the rates of `waychair.topics` |
| camera/... | pictures and depth, where this computer can render |
| servo_camera/... | pictures of the camera on servos, and its angles, with `sensors.servo_camera.rate_hz` above 0 |
| pressure | a barometer's, with `sensors.barometer_hz` above 0 |
| joint_states | angles of the drive wheels, from their encoders |
| odom, /tf, /tf_static | unless `publish_base` is off: dead reckoning, and the mounts of the chair's file |
| lift_states | the lifts of a world of several levels, which move; `lift_requests` call them |
| ground_truth/odom | the true pose; a driving stack must not subscribe to it |
| ground_truth/lines | the voltages of the joystick lines, at each change; likewise |
| /clock | with `use_sim_time` |

It subscribes to `joy`, the rider's joystick, and to `servo_camera/command`. The shipped firmware drives the joystick lines; a bridge connects to it by
the pseudo-terminal `board_link`, as by a cable.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from waychair.calibration.fits.dac import DEFAULT
from waychair.calibration.servo_camera_mount import SERVO_CAMERA
from waychair.errors import OutputError
from waychair.firmware_bridge.board import BoardInputs, HostBoard, LineState, board_program
from waychair.garbage import leave_out_present
from waychair.geometry import in_space
from waychair.recordings.bags import ros_messages
from waychair.recordings.bags.ros_messages import BASE_FRAME, MAP_FRAME, ODOM_FRAME
from waychair.ros import topics
from waychair.ros.description import robot_description
from waychair.ros.messages.chair import Lines, lines
from waychair.ros.messages.lifts import LiftRequest, lift_state, read_lift_request
from waychair.ros.messages.motion import transform
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.messages.sensors import read_joy
from waychair.ros.messages.servos import pan_tilt_angles, picture_messages, read_pan_tilt_command
from waychair.ros.mounts import static_transforms
from waychair.ros.node_settings.simulator import SimulatorNodeSettings
from waychair.ros.nodes.node import ChairNode, run_node
from waychair.ros.nodes.parts.simulated_lifts import SimulatedLiftAdapter
from waychair.runtime.last_pose import remember_pose, remembered_pose
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.pacing import PaceMode, Pacer
from waychair.simulation.plan.world import World, load_levels
from waychair.simulation.plant.chair_file import load_chair
from waychair.simulation.plant.pseudo_terminal import make_link
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.trials.drive import DriveSetup, board_settings
from waychair.types import (
    ImuSample,
    JoystickInput,
    Odometry,
    PanTiltAngles,
    Picture,
    Pose2,
    PressureSample,
    RgbdFrame,
    Scan,
    SonarReadings,
    WheelTicks,
)

_SAVE_POSE_HZ = 10.0
_PASSENGERS = 1
"""People who travel by the lifts all the time, in a world with people."""

_CLOCK_HZ = 100.0  # messages on /clock, with use_sim_time
_SLACK_S = 0.04
"""A longer delay is never caught up. While catching up, the board's time would pass without messages from the computer,
whose silence it tolerates for 0.1 s, and stamps would be as old as the delay."""


class _Board(HostBoard):
    """The simulated board; `lines_now` is the last state of its lines."""

    lines_now: LineState | None = None

    def step(self, now_ms: int, inputs: BoardInputs) -> LineState:
        self.lines_now = super().step(now_ms, inputs)
        return self.lines_now


class SimulatorNode(ChairNode[SimulatorNodeSettings]):
    """A node with one simulated chair, which runs in the worker's thread, since the renderer needs a single thread."""

    def __init__(self) -> None:
        super().__init__("simulator", SimulatorNodeSettings)
        self._pacer = Pacer(PaceMode.REALTIME, slack_s=_SLACK_S)
        self._lost_s = 0.0
        self._simulator: Simulator | None = None
        self._board: _Board | None = None
        self._lines: LineState | None = None
        self._cable = ""
        self._ended = threading.Event()
        self._sends: dict[str, Callable[[Any], None]] = {}
        self._uses_sim_time = bool(self.get_parameter("use_sim_time").value)
        self._joystick = self.listen(topics.JOY, read_joy, needed=False)
        self._aim = self.listen(topics.PAN_TILT_COMMAND, read_pan_tilt_command, needed=False)
        self._lifts: SimulatedLiftAdapter | None = None
        self.listen(topics.LIFT_REQUESTS, read_lift_request, self._hear_request, needed=False)
        self._saved_pose: Pose2 | None = None
        if self.settings.pose_file:
            self.every(_SAVE_POSE_HZ, self._save_pose)
        self.worker.submit(self._simulate, lambda result: None)
        self.at_end(self._ended.set)

    def reports(self) -> Iterable[Report]:
        """Report the real-time factor, the number of contacts, the level of the world, and the path of the cable."""
        if self._simulator is None:
            return (Report("simulation", DiagnosticLevel.STALE, "the world is being built"),)
        lost_s, self._lost_s = self._pacer.lost_s - self._lost_s, self._pacer.lost_s
        level, message = DiagnosticLevel.OK, ""
        if self._simulator.camera_problem is not None:
            level, message = DiagnosticLevel.WARN, self._simulator.camera_problem
        if lost_s > 0.0:
            level, message = (
                DiagnosticLevel.WARN,
                f"{lost_s:.2f} s behind real time: the computer is too busy",
            )
        values = (
            ("real time factor", f"{self._pacer.real_time_factor:.4f}"),
            ("lost [s]", f"{self._lost_s:.3f}"),
            ("contacts", str(self._simulator.contacts)),
            ("level", self._simulator.world.level),
            ("cable", self._cable),
        )
        return (Report("simulation", level, message, values),)

    def _simulate(self) -> None:
        """Build the world and run it in real time until the node ends."""
        with ExitStack() as ends:
            simulator = self._build(ends)
            body = simulator.body
            self._odometry = OdometryFilter(body)
            leave_out_present()
            # Both at once: time that passed between them would be the age of every stamp, and the chair never ready.
            self._began_ns = time.time_ns() - simulator.now_ns
            self._pacer.pace(simulator.now_ns)
            if self.settings.publish_base:
                self._send(topics.TF_STATIC, ros_messages.transforms(self._stamp_ns(0), static_transforms(body)))
                self._send(topics.ROBOT_DESCRIPTION, robot_description(body))
            step_ns = simulator.settings.plant.step_ms * 1_000_000
            clock_ns = round(1e9 / _CLOCK_HZ)
            self._simulator = simulator
            while not self._ended.is_set():
                simulator.rider = self._rider(simulator.now_ns)
                if simulator.settings.servo_camera.rate_hz > 0.0 and simulator.camera_problem is None:
                    self._serve_servo_camera(simulator)
                for state in () if self._lifts is None else self._lifts.step(self._stamp_ns(simulator.now_ns)):
                    self._send(topics.LIFT_STATES, lift_state(state))
                messages = simulator.advance(step_ns)
                self._pacer.pace(simulator.now_ns)  # before the messages, whose stamps would be in the future
                self._publish_lines()
                if self._uses_sim_time and simulator.now_ns % clock_ns < step_ns:
                    self._send_clock(simulator.now_ns)
                for message in messages:
                    stamped = replace(message, stamp_ns=self._stamp_ns(message.stamp_ns))
                    _SENDS[type(stamped)](self, stamped)
            self._simulator = None

    def _build(self, ends: ExitStack) -> Simulator:
        s, chair = self.settings, load_chair(self.settings.chair)
        levels = [world if s.people else replace(world, people=()) for world in load_levels(s.world)]
        world = levels[0]
        for level in levels if s.pose_file else ():
            stood = remembered_pose(Path(s.pose_file), _known_as(s.world, level))
            world = world if stood is None else replace(level, start=stood)
        moving = len(levels) > 1 and any(level.lifts for level in levels) and s.plant_model == "kinematic"
        lifts = Lifts(levels, s.seed, _PASSENGERS if s.people else 0) if moving else None
        if lifts is not None:
            self._lifts = SimulatedLiftAdapter(lifts, self.get_logger().warning)
        every = with_all_sensors(SimulatorSettings(s.plant_model, chair.plant, chair.mujoco))
        every = s.sensors.over(every)
        settings = every if s.camera else replace(every, camera=replace(every.camera, rate_hz=0.0))
        simulator = Simulator(world, chair.body, settings, s.seed, lifts=lifts)
        wiring = board_settings(DriveSetup(world.grid, {}, chair.body, DEFAULT))
        board = self._board = ends.enter_context(_Board(board_program(), wiring))
        simulator.wire(board)
        self._cable = board.path
        if s.board_link:
            link = Path(s.board_link)
            if link.is_symlink():
                link.unlink()  # left by a killed simulator; its terminal's number may be in use again
            make_link(link, Path(board.path))
            ends.callback(link.unlink, missing_ok=True)
            self._cable = str(link)
        return simulator

    def _save_pose(self) -> None:
        """Save the chair's pose, so that a restarted simulator continues there, as a real chair would."""
        simulator, s = self._simulator, self.settings
        pose = None if simulator is None else simulator.truth()
        if simulator is None or pose is None or pose == self._saved_pose:
            return
        self._saved_pose = pose
        try:
            remember_pose(Path(s.pose_file), _known_as(s.world, simulator.world), pose)
        except OutputError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=60.0)

    def _hear_request(self, request: LiftRequest) -> None:
        if self._lifts is not None:
            self._lifts.hear(request)

    def _rider(self, now_ns: int) -> JoystickInput:
        """Return the rider's joystick; it springs back when its messages are stale."""
        stick = self._joystick.latest
        if stick is None or self._joystick.is_stale():
            return JoystickInput(now_ns)
        return replace(stick, stamp_ns=now_ns)

    def _stamp_ns(self, simulated_ns: int) -> int:
        """Return simulated time in the clock of the other nodes: wall time, unless they follow /clock."""
        if self._uses_sim_time:
            return simulated_ns
        return self._began_ns + round(self._pacer.lost_s * 1e9) + simulated_ns

    def _send_clock(self, now_ns: int) -> None:
        self._send(topics.CLOCK, ros_messages.make("rosgraph_msgs/msg/Clock", ros_messages.header(now_ns, "").stamp))

    def _publish_lines(self) -> None:
        """Publish changed line voltages, stamped by the node's clock, which may be slightly ahead of simulated time."""
        lines_now, before = None if self._board is None else self._board.lines_now, self._lines
        if lines_now is None or (before is not None and _line_values(lines_now) == _line_values(before)):
            return
        self._lines = lines_now
        on_lines = Lines(self.now_ns(), lines_now.holder, lines_now.forward_mv / 1000.0, lines_now.turn_mv / 1000.0)
        self._send(topics.LINES, lines(on_lines))

    def _send_scan(self, scan: Scan) -> None:
        self._send(topics.SCAN, ros_messages.laser_scan(scan))

    def _send_imu(self, sample: ImuSample) -> None:
        self._odometry.update_imu(sample)
        self._send(topics.IMU, ros_messages.imu(sample))

    def _send_pressure(self, sample: PressureSample) -> None:
        self._send(topics.PRESSURE, ros_messages.pressure(sample))

    def _send_wheels(self, ticks: WheelTicks) -> None:
        assert self._simulator is not None
        self._send(topics.JOINTS, ros_messages.joint_states(ticks, self._simulator.body.ticks_per_turn))
        if self.settings.publish_base:
            self._send_odometry(self._odometry.update_wheels(ticks))
        truth, twist = self._simulator.truth(), self._simulator.twist()
        self._send(topics.TRUTH, ros_messages.odometry(ticks.stamp_ns, MAP_FRAME, truth, twist))

    def _send_odometry(self, reading: Odometry) -> None:
        pose = reading.odom_from_base
        self._send(
            topics.ODOMETRY,
            ros_messages.odometry(reading.stamp_ns, ODOM_FRAME, pose, reading.twist, reading.covariance),
        )
        self._send(topics.TF, transform(reading.stamp_ns, ODOM_FRAME, BASE_FRAME, in_space(pose)))

    def _send_sonars(self, readings: SonarReadings) -> None:
        assert self._simulator is not None
        sonar = self._simulator.settings.sonar
        for k, distance in enumerate(readings.ranges.tolist()):
            reading = ros_messages.sonar_range(readings.stamp_ns, k, distance, sonar.limits, 2 * sonar.cone)
            self._send(topics.sonar(k), reading)

    def _send_frame(self, frame: RgbdFrame) -> None:
        info = ros_messages.camera_info(frame)
        self._send(topics.COLOUR_INFO, info)
        self._send(topics.DEPTH_INFO, info)
        self._send(topics.COLOUR, ros_messages.colour_image(frame))
        self._send(topics.DEPTH, ros_messages.depth_image(frame))

    def _serve_servo_camera(self, simulator: Simulator) -> None:
        """Pass the latest order on, and send what the camera on servos saw since the last step."""
        order = self._aim.latest
        if order is not None:
            simulator.aim(order)
        looked = simulator.look()
        for angles, picture in zip(looked[::2], looked[1::2], strict=True):  # each picture comes after its angles
            assert isinstance(angles, PanTiltAngles)
            assert isinstance(picture, Picture)
            stamp_ns = self._stamp_ns(picture.stamp_ns)
            mount = SERVO_CAMERA.base_from_camera(angles.pan, angles.tilt)
            self._send(topics.TF, transform(stamp_ns, BASE_FRAME, topics.SERVO_FRAME, mount))
            self._send(topics.PAN_TILT, pan_tilt_angles(replace(angles, stamp_ns=stamp_ns), picture.laser))
            colour, info = picture_messages(replace(picture, stamp_ns=stamp_ns))
            self._send(topics.SERVO_INFO, info)
            self._send(topics.SERVO_PICTURE, colour)

    def _send(self, topic: topics.RosTopic, message: Any) -> None:
        """Publish a message; the first one on a topic creates its publisher."""
        if topic.name not in self._sends:
            self._sends[topic.name] = self.publisher(topic)
        self._sends[topic.name](message)


_SENDS: Mapping[type, Callable[[SimulatorNode, Any], None]] = {
    Scan: SimulatorNode._send_scan,
    ImuSample: SimulatorNode._send_imu,
    WheelTicks: SimulatorNode._send_wheels,
    PressureSample: SimulatorNode._send_pressure,
    SonarReadings: SimulatorNode._send_sonars,
    RgbdFrame: SimulatorNode._send_frame,
}


def _known_as(world: str, level: World) -> Path:
    """Return the name under which a chair's pose on a level of a world is kept."""
    return Path(world, level.level) if level.level else Path(world)


def _line_values(state: LineState) -> tuple[int, int, int]:
    return state.holder, state.forward_mv, state.turn_mv


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(SimulatorNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
