"""The messages of the camera on servos as the cells take them: its aim, its fault in one sentence, and the laser's line.

A picture is looked at once, with the angles that the servos report of the same moment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.control.behaviours.range_finder import CameraAim
from waychair.geometry import transform_points
from waychair.planning.seen.laser_sight import LaserSight, SightMemory, look
from waychair.types import FloatArray, PanTiltAngles, Picture, Pose2, Scan, ServoMessage

_SAME_NS = 60_000_000
"""Greatest time between a picture and the servos' report that is used for it."""

_WAIT_NS = 120_000_000
"""Time for which pictures wait for the servos' report: they may come in any order."""

_COMPARED_NS = 200_000_000
"""Age above which the lidar's scan is not compared with the line: the chair has moved meanwhile."""

_SILENT_NS = 1_000_000_000
"""Time without a picture, while the servos report, after which the camera counts as silent."""

NO_PICTURES = "the camera on the servos sends no pictures: see its cable"


@dataclass(frozen=True, slots=True)
class ServoCameraTold:
    """The camera's news: its aim if the servos have reported, its fault (empty: none), and the look of a picture at
    `stamp_ns`, None without one.

    `odom_from_base` is the chair's pose at the picture.
    """

    aim: CameraAim | None
    fault: str
    sight: LaserSight | None
    stamp_ns: int
    odom_from_base: Pose2


class ServoCameraSight:
    """The camera on servos of one chair. A chair that has none never hears of one, and pays nothing."""

    def __init__(self) -> None:
        self._memory, self._fault = SightMemory(), ""
        self._angles: PanTiltAngles | None = None
        self._reported = False
        self._picture: tuple[Picture, Pose2] | None = None
        self._pictured_ns: int | None = None
        self._waits_since_ns = 0
        self._began_ns: int | None = None
        self._others: tuple[int, FloatArray] | None = None

    def take(self, message: ServoMessage, odom_from_base: Pose2) -> None:
        """Take in a report of the servos or a picture, with the odometry at its stamp."""
        if isinstance(message, Picture):
            if self._picture is None:
                self._waits_since_ns = message.stamp_ns
            self._picture, self._pictured_ns = (message, odom_from_base), message.stamp_ns
        else:
            self._angles, self._reported = message, True
            self._began_ns = message.stamp_ns if self._began_ns is None else self._began_ns

    def compare(self, scan: Scan, base_from_laser: Pose2) -> None:
        """Take in a lidar's scan, with which the line must agree."""
        if self._angles is None and self._picture is None:
            return
        met = np.isfinite(scan.ranges) & (scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max)
        ranges, angles = scan.ranges[met].astype(np.float64), scan.angles()[met]
        points = ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        self._others = scan.stamp_ns, transform_points(base_from_laser, points)

    def told(self, now_ns: int) -> ServoCameraTold | None:
        """Return the news since the last call; None where there is none."""
        picture, angles, reported = self._picture, self._angles, self._reported
        self._reported = False
        if picture is not None and not self._fits(picture[0]) and now_ns - self._waits_since_ns <= _WAIT_NS:
            picture = None
        if picture is None and not reported:
            return None
        aim = CameraAim(angles.pan, angles.tilt, angles.settled) if angles is not None and reported else None
        if picture is None:
            self._fault = NO_PICTURES if self._is_silent(now_ns) else self._fault
            return ServoCameraTold(aim, self._fault, None, now_ns, Pose2())
        self._picture, (shown, odom_from_base) = None, picture
        others = self._others_at(shown.stamp_ns)
        seen, self._memory = look(shown, angles if self._fits(shown) else None, odom_from_base, others, self._memory)
        self._fault = seen.fault if seen is not None else self._memory.fault
        sight = seen if seen is not None and not seen.fault and len(seen.points) else None
        return ServoCameraTold(aim, self._fault, sight, shown.stamp_ns, odom_from_base)

    def _fits(self, picture: Picture) -> bool:
        """Return whether the servos' last report is of the moment of a picture."""
        return self._angles is not None and abs(self._angles.stamp_ns - picture.stamp_ns) <= _SAME_NS

    def _others_at(self, stamp_ns: int) -> FloatArray | None:
        """Return the points of the last scan if it is of about the same time."""
        if self._others is None or abs(stamp_ns - self._others[0]) > _COMPARED_NS:
            return None
        return self._others[1]

    def _is_silent(self, now_ns: int) -> bool:
        since_ns = self._pictured_ns if self._pictured_ns is not None else self._began_ns
        return since_ns is not None and now_ns - since_ns > _SILENT_NS
