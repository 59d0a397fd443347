"""The cells node: the behaviour cells of a chair, for a rider without sight. It tells, and drives nothing.

It runs where `perceive` is true, in a process of its own, so that the navigator's ticks do not wait for it.

| takes | |
|---|---|
| scan, odom, sonar_0.., camera/... | the sensors; at least odom and one that sees |
| map, localisation, people | the map, the pose on it, and people, in map |
| drive_state, joy | the chair's tilt; the rider's stick |
| servo_camera/... | the camera on servos with its laser's line |

| sends | |
|---|---|
| perception/signal, perception/state, perception/doorways | the signal in words, all that a page shows, and the doorways found |
| servo_camera/command | orders to the camera on servos |

The service `want_door` (std_srvs/SetBool) lets the cells lead the rider through a doorway, or no longer.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from waychair.control.safety.fitness import has_valid_reading
from waychair.errors import ConfigError
from waychair.geometry import transform_points
from waychair.planning.seen.door_frames import DoorFrame
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.camera import CameraPairing
from waychair.ros.messages.cells import doorways, perception, signal
from waychair.ros.messages.chair import DriveReport, read_drive_state, read_localisation
from waychair.ros.messages.maps import read_occupancy_grid
from waychair.ros.messages.motion import read_odometry, read_points
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.messages.sensors import SonarRing, read_joy, read_scan
from waychair.ros.messages.servos import ServoPairing, pan_tilt_command
from waychair.ros.node_settings.cells import CellsNodeSettings
from waychair.ros.nodes.node import ChairNode, run_node
from waychair.ros.nodes.parts.known_chair import known_chair
from waychair.runtime.pages.perception_view import perception_view
from waychair.runtime.perception import CellInputs, Perceived, Perception
from waychair.runtime.senses.frame_sight import FrameSight, frames_in
from waychair.slam.localising.localisation import Localisation
from waychair.slam.odometry.odometry_track import OdometryTrack
from waychair.slam.odometry.tilt import Tilt
from waychair.topics import COMMAND as COMMAND_RATE
from waychair.types import (
    FloatArray,
    JoystickInput,
    OccupancyGrid,
    Odometry,
    PanTiltAngles,
    Picture,
    Pose2,
    RgbdFrame,
    Scan,
    ServoMessage,
    SonarReadings,
)

_SONARS = 8
_SHOWN_EVERY = 4
"""Ticks from one message of perception/state to the next: five a second, as fast as a page draws."""

_NOWHERE = OccupancyGrid(np.full((1, 1), -1, np.int8), 0.05, Pose2())
"""The map before there is one: nothing is known."""


class _Latest:
    """The latest of each input that the cells are told once a tick."""

    def __init__(self) -> None:
        self.odometry: Odometry | None = None
        self.located: Localisation | None = None
        self.grid = _NOWHERE
        self.people: FloatArray = np.empty((0, 2))
        self.stick: JoystickInput | None = None
        self.state: DriveReport | None = None
        self.angles: PanTiltAngles | None = None


class CellsNode(ChairNode[CellsNodeSettings]):
    """A node with the `Perception` of one chair."""

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        """
        Raises:
            ConfigError: `perceive` is not set.
        """
        super().__init__("cells", CellsNodeSettings, arguments=arguments)
        s = self.settings
        if not s.perceive:
            raise ConfigError("the cells node is switched off: set its parameter perceive to true, or do not start it")
        self._calibration = known_chair(s.calibration, s.chair)
        self._cells = Perception(self._calibration.body)
        self._track, self._latest = OdometryTrack(), _Latest()
        self._frames, self._frames_busy = FrameSight(), False
        self._perceived: Perceived | None = None
        self._ticks, self._signal = 0, ""
        self._send_signal, self._send_state = self.publisher(topics.SIGNAL), self.publisher(topics.PERCEPTION)
        self._send_doorways, self._send_order = self.publisher(topics.DOORWAYS), self.publisher(topics.PAN_TILT_COMMAND)
        self._listen()
        self.create_service(interface_type("std_srvs/srv/SetBool"), "want_door", self._answer_want_door)
        self.every(COMMAND_RATE.rate_hz, self._tick)

    def reports(self) -> Iterable[Report]:
        """Report the signal, and each sensor or cell that is not to be believed."""
        if self._perceived is None:
            yield Report("cells", DiagnosticLevel.STALE, "the cells have not run yet")
            return
        for trouble in self._perceived.troubles:
            yield Report("cells", DiagnosticLevel.WARN, trouble)
        if not self._perceived.troubles:
            yield Report("cells", DiagnosticLevel.OK, self._perceived.signal or "no signal")

    def _listen(self) -> None:
        with_true_stamp, frame = self._calibration.with_true_stamp, self.settings.scan_frame
        self.listen(topics.ODOMETRY, lambda message: with_true_stamp(read_odometry(message)), self._take_odometry)
        self.listen(
            topics.SCAN, lambda message: with_true_stamp(read_scan(message, frame)), self._take_scan, needed=False
        )
        self.listen(topics.LOCALISATION, read_localisation, self._take_localisation, needed=False)
        self.listen(topics.MAP, read_occupancy_grid, self._take_map, needed=False)
        self.listen(topics.PEOPLE, read_points, self._take_people, needed=False)
        self.listen(topics.JOY, read_joy, self._take_stick, needed=False)
        self.listen(topics.DRIVE_STATE, read_drive_state, self._take_state, needed=False)
        ring = SonarRing(_SONARS)
        for k in range(_SONARS):

            def read(message: Any, k: int = k) -> SonarReadings | None:
                return ring.hear(k, message)

            self.listen(topics.sonar(k), read, self._take_sonars, needed=False)
        if self.settings.camera:
            pairing = CameraPairing()
            self.listen(topics.DEPTH_INFO, lambda message: message, pairing.calibrated, needed=False)
            self.listen(topics.COLOUR, pairing.colour, self._take_frame, needed=False)
            self.listen(topics.DEPTH, pairing.depth, self._take_frame, needed=False)
        servos = ServoPairing()
        self.listen(topics.SERVO_INFO, lambda message: message, servos.calibrated, needed=False)
        self.listen(topics.SERVO_PICTURE, servos.colour, self._take_picture, needed=False)
        self.listen(topics.PAN_TILT, servos.angles, self._take_angles, needed=False)

    def _answer_want_door(self, request: Any, response: Any) -> Any:
        self._cells.door_wanted = bool(request.data)
        response.success = True
        response.message = "leads through a doorway" if request.data else "no longer leads through a doorway"
        return response

    def _take_odometry(self, odometry: Odometry) -> None:
        self._track.take(odometry)
        self._latest.odometry = odometry

    def _take_scan(self, scan: Scan) -> None:
        at = self._track.odom_from_base(scan.stamp_ns)
        if at is not None:
            self._cells.see(self._calibration.masked(scan), at)

    def _take_localisation(self, located: tuple[int, Localisation]) -> None:
        self._latest.located = located[1]

    def _take_map(self, grid: OccupancyGrid) -> None:
        self._latest.grid = grid

    def _take_people(self, people: FloatArray) -> None:
        self._latest.people = people

    def _take_stick(self, stick: JoystickInput) -> None:
        self._latest.stick = stick

    def _take_state(self, report: DriveReport) -> None:
        self._latest.state = report

    def _take_sonars(self, readings: SonarReadings | None) -> None:
        at = None if readings is None else self._track.odom_from_base(readings.stamp_ns)
        if readings is not None and at is not None:
            self._cells.hear(readings, at)

    def _take_frame(self, frame: RgbdFrame | None) -> None:
        if frame is None or not has_valid_reading(frame):
            return
        true, state = self._calibration.with_true_stamp(frame), self._latest.state
        at = self._track.odom_from_base(true.stamp_ns)
        if at is not None:
            self._cells.look(true, at, None if state is None else Tilt(true.stamp_ns, *state.tilt))

    def _take_angles(self, told: tuple[PanTiltAngles, Picture | None]) -> None:
        self._latest.angles = told[0]
        self._watch(told[0])
        self._take_picture(told[1])

    def _take_picture(self, picture: Picture | None) -> None:
        if picture is not None:
            self._watch(picture)
            self._look_for_frames(picture)

    def _look_for_frames(self, picture: Picture) -> None:
        """Look for door frames in a picture without the laser, in the worker thread, one picture at a time."""
        angles, at = self._latest.angles, self._track.odom_from_base(picture.stamp_ns)
        rests = angles is not None and angles.settled and angles.stamp_ns == picture.stamp_ns
        if (
            self._frames_busy
            or picture.laser
            or not self._cells.door_wanted
            or angles is None
            or not rests
            or at is None
        ):
            return
        self._frames_busy = True

        def found(proposals: list[DoorFrame]) -> None:
            self._frames_busy = False
            self._cells.propose(self._frames.seen(proposals, picture, angles.pan, at))

        self.worker.submit(lambda: frames_in(picture), found)

    def _watch(self, message: ServoMessage) -> None:
        at = self._track.odom_from_base(message.stamp_ns)
        if at is not None:
            self._cells.watch(message, at)

    def _tick(self) -> None:
        """Run the cells, and send their words. Stamps are of ROS's clock."""
        now_ns, latest = self.now_ns(), self._latest
        at = self._track.odom_from_base(now_ns)
        odometry = None if at is None else latest.odometry
        people = np.empty((0, 2))
        if latest.located is not None:
            people = transform_points(latest.located.map_from_odom.inverse(), latest.people)
        known = CellInputs(odometry, at or Pose2(), latest.located, latest.grid, people, latest.stick)
        self._perceived = done = self._cells.step(now_ns, known)
        self._ticks += 1
        if done.order is not None:
            self._send_order(pan_tilt_command(done.order))
        if done.signal != self._signal:
            self._signal = done.signal
            self._send_signal(signal(done.signal))
        if self._ticks % _SHOWN_EVERY == 0:
            self._send_state(perception(perception_view(done, self._calibration.body, latest.angles)))
            self._send_doorways(doorways(now_ns, done.doorways))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(CellsNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
