"""Headings of the chair by encoders, by lidar and by camera, for comparison with the gyro."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.time_offset import Heading
from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_points
from waychair.slam.scan.scan_matching import BEAM_SIGMA, MatchSettings, Window, match
from waychair.slam.scan.scan_points import MIN_POINTS, ScanPoints, scan_points
from waychair.types import Bytes, FloatArray, Odometry, Pose2, RgbdFrame, Scan, Twist, WheelTicks

_COUNTS = 2**32  # encoder counters wrap here
_KEY_DISTANCE = 0.7  # [m]: a scan this far from the key scan becomes the next key scan
_KEY_ANGLE = 0.7  # [rad]
_LEAST_INLIERS = 0.5
_MOST_POINTS = 360
_WINDOW = Window(0.25, 0.15)
_FREE = np.eye(3)  # information of the guess: 1 m, 1 rad, so that the match is nearly free

_CORNERS = 400
_LEAST_TRACKED = 20
_BACK_AND_FORTH = 0.5  # [pixels]: greatest error of a corner after tracking forth and back
_REPROJECTION = 1.5  # [pixels]


def heading_from_wheels(readings: Sequence[WheelTicks | Odometry], body: ChairBody) -> Heading:
    """Return the heading by encoder counts with nominal wheels and track, or by odometry; old readings are dropped."""
    newer: list[WheelTicks | Odometry] = []
    for reading in readings:
        if not newer or reading.stamp_ns > newer[-1].stamp_ns:
            newer.append(reading)
    stamps = np.array([reading.stamp_ns for reading in newer], np.int64)
    ticks = [reading for reading in newer if isinstance(reading, WheelTicks)]
    if len(ticks) < len(newer):
        thetas = [reading.odom_from_base.theta for reading in newer if isinstance(reading, Odometry)]
        return Heading(stamps, np.unwrap(np.array(thetas)))
    difference = np.array([reading.right - reading.left for reading in ticks], np.int64)
    steps = (np.diff(difference, prepend=difference[:1]) + _COUNTS // 2) % _COUNTS - _COUNTS // 2
    per_count = math.tau * body.wheel_radius / (body.ticks_per_turn * body.track)
    return Heading(stamps, np.cumsum(steps) * per_count)


def heading_from_scans(scans: Sequence[Scan], gyro: Heading, base_from_laser: Pose2, delay_ns: int = 0) -> Heading:
    """Return the heading by scans: each is deskewed and matched to a recent key scan; nan where a match fails.

    The stamps of the scans are about `delay_ns` later than those of the gyro. The gyro gives the guess of the match and
    the turn during the sweep; the heading comes from the match alone.
    """
    times = (gyro.stamps_ns - gyro.stamps_ns[0]) * 1e-9
    lidar = _LidarHeading(base_from_laser)
    headings, last = [], -math.inf
    for scan in scans:
        now = (scan.stamp_ns - delay_ns - gyro.stamps_ns[0]) * 1e-9
        sweep = max(abs(scan.time_step) * (len(scan.ranges) - 1), 0.01)
        before, begin, end = np.interp([last, now, now + sweep], times, gyro.headings).tolist()
        headings.append(lidar.add(scan, now - last, begin - before, (end - begin) / sweep))
        last = now
    return Heading(np.array([scan.stamp_ns for scan in scans], np.int64), np.array(headings))


class _LidarHeading:
    """Tracks the heading by scans; keeps the key scan, and the chair's pose in it and speed at the last scan."""

    def __init__(self, base_from_laser: Pose2) -> None:
        self._base_from_laser = base_from_laser
        self._settings = MatchSettings()
        self._key: ScanReference | None = None
        self._key_heading = 0.0
        self._key_from_base = Pose2()
        self._speed = 0.0

    def add(self, scan: Scan, seconds: float, turn: float, rate: float) -> float:
        """Return the heading [rad] at a scan, `seconds` after the last one; nan if no match is found.

        The chair has turned by about `turn` [rad] since then, and turns at `rate` [rad/s] during the sweep.
        """
        points = scan_points(scan, self._base_from_laser, self._settings.range_max, Twist(self._speed, rate))
        if len(points) < MIN_POINTS or seconds <= 0.0:
            self._key = None
            return math.nan
        if self._key is None:
            self._become_key(points, self._key_heading)
            self._speed = 0.0
            return self._key_heading
        guess = self._key_from_base @ Pose2(self._speed * seconds, 0.0, turn)
        found = match(
            scan=points.thinned(_MOST_POINTS),
            reference=self._key,
            guess=guess,
            guess_information=_FREE,
            window=_WINDOW,
            settings=self._settings,
        )
        if found.inliers < _LEAST_INLIERS:
            self._key = None
            return math.nan
        self._speed = (self._key_from_base.inverse() @ found.pose).x / seconds
        self._key_from_base = found.pose
        heading = self._key_heading + found.pose.theta
        if math.hypot(found.pose.x, found.pose.y) > _KEY_DISTANCE or abs(found.pose.theta) > _KEY_ANGLE:
            self._become_key(points, heading)
        return heading

    def _become_key(self, points: ScanPoints, heading: float) -> None:
        settings = self._settings
        self._key = reference_from_points(points.points, points.normals, settings.resolution, BEAM_SIGMA)
        self._key_heading, self._key_from_base = heading, Pose2()


class CameraHeading:
    """The heading by a depth camera, from picture to picture.

    Corners are tracked (Lucas and Kanade); their 3D points in the previous picture and their pixels in the new one give
    the motion (perspective-n-point with RANSAC). Keeps the last picture only.
    """

    def __init__(self, body: ChairBody) -> None:
        self._base_from_camera = body.base_from_camera.rotation
        self._last: tuple[Bytes, RgbdFrame] | None = None
        self._stamps: list[int] = []
        self._headings: list[float] = []
        self._heading = 0.0

    def add(self, frame: RgbdFrame) -> None:
        """Add the next picture; its heading is nan if it shares too little with the previous one."""
        if self._stamps and frame.stamp_ns <= self._stamps[-1]:
            return
        grey = _grey(frame.image)
        turn = 0.0 if self._last is None else self._turn(*self._last, grey)
        self._last = (grey, frame)
        self._stamps.append(frame.stamp_ns)
        self._headings.append(self._heading + turn)
        self._heading += 0.0 if math.isnan(turn) else turn

    def heading(self) -> Heading:
        """Return the heading of all pictures so far."""
        return Heading(np.array(self._stamps, np.int64), np.array(self._headings))

    def _turn(self, before: Bytes, frame: RgbdFrame, now: Bytes) -> float:
        """Return the yaw [rad] about the base's z axis since the previous picture; nan if it is unknown."""
        there, here = _tracked(before, now, np.isfinite(frame.depth))
        if len(there) < _LEAST_TRACKED:
            return math.nan
        points = _points(there, frame)
        found, vector, _, inliers = cv2.solvePnPRansac(
            points, here, frame.camera_matrix, None, iterationsCount=100, reprojectionError=_REPROJECTION
        )
        if not found or inliers is None or len(inliers) < _LEAST_TRACKED:
            return math.nan
        now_from_before = cv2.Rodrigues(vector)[0]
        before_from_now = self._base_from_camera @ now_from_before.T @ self._base_from_camera.T
        return math.atan2(before_from_now[1, 0], before_from_now[0, 0])


def _grey(image: Bytes) -> Bytes:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8) if image.ndim == 3 else image


def _tracked(before: Bytes, now: Bytes, usable: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the corners (N, 2) [pixels] in a picture and in the next one, if tracking back confirms them."""
    nothing = np.empty((0, 2))
    corners = cv2.goodFeaturesToTrack(before, _CORNERS, 0.01, 7, mask=usable.astype(np.uint8))
    if corners is None:
        return nothing, nothing
    onwards, seen, _ = cv2.calcOpticalFlowPyrLK(before, now, corners, corners.copy())
    back, seen_back, _ = cv2.calcOpticalFlowPyrLK(now, before, onwards, corners.copy())
    home = np.linalg.norm((back - corners).reshape(-1, 2), axis=1) < _BACK_AND_FORTH
    good = home & (seen.ravel() == 1) & (seen_back.ravel() == 1)
    return corners.reshape(-1, 2)[good].astype(np.float64), onwards.reshape(-1, 2)[good].astype(np.float64)


def _points(pixels: FloatArray, frame: RgbdFrame) -> FloatArray:
    """Return the points (N, 3) [m] in the camera's frame of pixels with depth."""
    columns, rows = np.rint(pixels).astype(np.int64).T
    depth = frame.depth[rows, columns].astype(np.float64)
    k = frame.camera_matrix
    x, y = (pixels[:, 0] - k[0, 2]) / k[0, 0], (pixels[:, 1] - k[1, 2]) / k[1, 1]
    return np.stack([x * depth, y * depth, depth], axis=1)
