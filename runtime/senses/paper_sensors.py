"""The paper's own sensors on a chair of today, for the paper's network: sonars' packets, doors to look at, and the camera's aim.

The paper finds door frames in the picture. Beside a door the lintel is above a picture that is taken level, so here the gaps that the
laser's line shows are proposed instead; the network validates, tracks and leads as it is written. Its Way finder asks the
camera only into sectors without a sonar, which are behind the chair. So while no cell of the doorway wants the camera, it
looks ahead and to both sides in turn, else no door would ever be seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.commands import NULL
from waychair.control.behaviours.doorway import FrameCandidate, FramesSeen
from waychair.control.behaviours.free_space import WayFound
from waychair.control.behaviours.managers import GrantMemory, aim_servos, grant
from waychair.control.behaviours.paper import PaperSettings
from waychair.control.behaviours.paper_settings import CameraLimits
from waychair.control.behaviours.range_finder import WAY_FINDER, CameraAim, SensorCommand
from waychair.control.behaviours.runtime import Innervation
from waychair.control.behaviours.sonar import SonarPacket, packet_from_ranges
from waychair.control.behaviours.view.servo_cells import SweepMemory, servo_camera_limits, swept_look
from waychair.geometry import wrap_angle
from waychair.planning.seen.doorways import Doorway
from waychair.runtime.senses.servo_camera_sight import ServoCameraTold
from waychair.types import PanTiltCommand, Pose2, SonarReadings

_CONFIDENCE = 0.8
"""Confidence of a gap between two surfaces: surer than the network asks for, as the line decides at once."""

_IN_VIEW = math.radians(12.0)
"""rad; a door so little to the right shows in a picture straight ahead too. Pan does not wrap: it takes 1.1 s from side to side."""


class PaperSensors:
    """What one chair's sensors tell the paper's network, and where its camera looks."""

    def __init__(self) -> None:
        self.settings = PaperSettings(camera=servo_camera_limits(CameraLimits()))
        """The network's thresholds, with the optics of this chair's camera."""
        self._aim: tuple[CameraAim, int] | None = None
        self._seen_ns: int | None = None
        self._sweep, self._grant = SweepMemory(), GrantMemory()
        self._granted: SensorCommand | None = None

    def packet(self, readings: SonarReadings) -> SonarPacket:
        """Return the sonars' packet of readings."""
        return packet_from_ranges(readings.ranges.tolist())

    def frames(self, doorways: Iterable[Doorway], odom_from_base: Pose2) -> FramesSeen:
        """Return the doorways in odom that the line has shown, as frames to be looked at."""
        base_from_odom = odom_from_base.inverse()
        return FramesSeen(tuple(_frame(base_from_odom @ each.pose, each.width) for each in doorways))

    def note(self, told: ServoCameraTold, now_ns: int) -> None:
        """Take in the camera's news."""
        if told.aim is not None:
            self._aim = told.aim, now_ns
        if told.sight is not None:
            self._seen_ns = told.stamp_ns

    def order(self, done: Innervation, now_ns: int) -> PanTiltCommand | None:
        """Return where the camera looks: at the door if a cell of the doorway wants it, else in turn; None without a camera."""
        granted = done.ports["grant"]
        if self._aim is None:
            return None
        aim, told_ns = self._aim
        if granted.ab and granted.eo is not None and granted.eo.client != WAY_FINDER:
            return PanTiltCommand(now_ns, *_without_a_round(aim_servos(granted.eo), aim.pan), laser=True)
        limits = self.settings.camera
        request, self._sweep = swept_look(self._seen_ns, self._granted, self._sweep, now_ns)
        reported = aim if now_ns - told_ns <= round(limits.fresh * 1e9) else None
        look = Reading(WayFound(NULL, request), now_ns)
        command, self._grant = grant(None, None, look, reported, limits, self._grant, now_ns)
        self._granted = command
        return None if command is None else PanTiltCommand(now_ns, *aim_servos(command), laser=True)


def _without_a_round(wanted: tuple[float, float], pan: float) -> tuple[float, float]:
    """Return the aim for the servos, straight ahead instead of a little to the right of it where pan would turn all the way round."""
    return (0.0, wanted[1]) if wanted[0] > math.tau - _IN_VIEW and pan < math.pi else wanted


def _frame(base_from_door: Pose2, width: float) -> FrameCandidate:
    """Return a doorway's jambs as directions [rad] in base; left is the greater one."""
    ends = (base_from_door @ Pose2(0.0, aside) for aside in (-width / 2, width / 2))
    one, other = (math.atan2(end.y, end.x) for end in ends)
    between = wrap_angle(other - one)
    right = one if between > 0.0 else other
    return FrameCandidate(right + abs(between), right, _CONFIDENCE)
