"""The doorways near a chair for its cells: the tracker, fed by the sensors that the chair has.

The lidar's scans are used, the depth camera's pictures while there is no lidar, the laser's line beside either, and the
sonars, which hear glass.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.calibration.chair_body import ChairBody, sonar_mounts
from waychair.control.behaviours.view.sensor_cells import SONAR_RANGE
from waychair.control.drive.doors.doorway_tracker import DoorwayTracker
from waychair.control.drive.echo_filter import EchoFilter
from waychair.errors import MessageError
from waychair.maps.depth.depth_scan import DepthSettings, depth_scan, frame_problem
from waychair.planning.seen.doorways import Doorway
from waychair.planning.seen.laser_sight import LaserSight
from waychair.planning.seen.range_views import moved_view, view_from_depth, view_from_scan
from waychair.types import FloatArray, Pose2, RgbdFrame, Scan, SonarReadings

_LIDAR_GONE_NS = 1_000_000_000
"""Silence of the lidar after which doorways are looked for in the depth camera's pictures instead: they are coarser."""

_DEPTH = DepthSettings()


class DoorwaySense:
    """The doorways near one chair, in odom; each sensor's views are told with the odometry at their stamp."""

    def __init__(self, body: ChairBody) -> None:
        self.is_due = False
        """Whether there was a view since `take` was called."""
        self._body = body
        self._tracker, self._echoes = DoorwayTracker(), EchoFilter()
        self._waiting: tuple[Scan, Pose2] | None = None
        self._lidar_ns: int | None = None
        self._found: tuple[Doorway, ...] = ()

    @property
    def found(self) -> tuple[Doorway, ...]:
        """The doorways and candidates at the last `take`."""
        return self._found

    def take(self) -> tuple[Doorway, ...]:
        """Return the doorways and candidates as they are now."""
        self.is_due, self._found = False, self._tracker.doorways
        return self._found

    def forget(self) -> None:
        """Begin anew, as after a leap of the pose."""
        self._tracker, self._found = DoorwayTracker(), ()

    def see(self, scan: Scan, odom_from_base: Pose2) -> None:
        """Keep a scan for the next `work`."""
        self._waiting, self._lidar_ns, self.is_due = (scan, odom_from_base), scan.stamp_ns, True

    def work(self) -> None:
        """Take in the scan that waits; without one, go on with the search in hand."""
        waiting, self._waiting = self._waiting, None
        if waiting is None:
            self._tracker.work()
            return
        scan, odom_from_base = waiting
        laser = odom_from_base @ self._body.base_from_laser
        self._tracker.see(view_from_scan(scan, laser), laser, scan.stamp_ns)

    def look(self, frame: RgbdFrame, level_from_base: FloatArray, odom_from_base: Pose2) -> None:
        """Take in a picture of the depth camera, unless there is a lidar.

        Raises:
            MessageError: nothing can be seen in it.
        """
        if self._lidar_ns is not None and abs(frame.stamp_ns - self._lidar_ns) <= _LIDAR_GONE_NS:
            return
        problem = frame_problem(frame, _DEPTH)
        if problem is not None:
            raise MessageError(problem)
        seen = depth_scan(frame, self._body.base_from_camera, level_from_base, self._body.front, _DEPTH)
        self._tracker.see(view_from_depth(seen, odom_from_base), odom_from_base, frame.stamp_ns, "depth camera")
        self.is_due = True

    def range(self, sight: LaserSight, odom_from_base: Pose2, stamp_ns: int) -> None:
        """Take in a look by the laser's line."""
        view = moved_view(sight.view(), odom_from_base)
        self._tracker.see(view, odom_from_base @ sight.camera, stamp_ns, "laser line")
        self.is_due = True

    def hear(self, readings: SonarReadings, odom_from_base: Pose2) -> None:
        """Take in the sonars' readings."""
        confirmed = self._echoes.confirmed(readings)
        sonars = np.array([(odom_from_base @ mount).array() for mount in sonar_mounts(self._body)])
        ranges = np.where(confirmed.ranges <= SONAR_RANGE, confirmed.ranges, math.inf)
        self._tracker.hear(sonars[: len(ranges)], ranges[: len(sonars)])
