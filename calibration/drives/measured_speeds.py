"""A chair's speeds by its own sensors: encoders or, on the many chairs without them, lidar and gyro."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Protocol

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.sweep import Sample
from waychair.errors import CalibrationError
from waychair.geometry import arc
from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_points
from waychair.slam.scan.scan_matching import BEAM_SIGMA, MatchSettings, Window, match
from waychair.slam.scan.scan_points import MIN_POINTS, ScanPoints, scan_points
from waychair.types import ImuSample, Pose2, Scan, SensorMessage, Twist, WheelTicks

STILL_S = 3.0
"""Rest before a drive, for the gyro's bias."""

_MOST_TURN = 0.05  # [rad/s]: a larger spread of the gyro's readings means that the chair turns
_KEY_DISTANCE = 0.7  # [m]: a scan this far from the key scan becomes the next key scan
_KEY_ANGLE = 0.7  # [rad]
_LEAST_INLIERS = 0.5
_MOST_POINTS = 360


class SpeedMeter(Protocol):
    """Computes speeds from sensor messages."""

    @property
    def ready(self) -> bool:
        """Whether the initial rest is over."""

    def add_messages(self, messages: Iterable[SensorMessage]) -> list[Sample]:
        """Add messages and return the new speeds in time order; none before `ready`.

        Raises:
            CalibrationError: the messages give no speed.
        """


class EncoderSpeeds:
    """Speeds by encoder counts with nominal wheels and track; each is stamped in the middle of its interval."""

    def __init__(self, body: ChairBody) -> None:
        self._track = body.track
        self._metres_per_count = math.tau * body.wheel_radius / body.ticks_per_turn
        self._last: WheelTicks | None = None

    @property
    def ready(self) -> bool:
        """Whether the first counts have arrived."""
        return self._last is not None

    def add_messages(self, messages: Iterable[SensorMessage]) -> list[Sample]:
        """Return one sample per encoder reading after the first; readings out of order are dropped."""
        samples = []
        for message in messages:
            if not isinstance(message, WheelTicks):
                continue
            last = self._last
            if last is not None and message.stamp_ns <= last.stamp_ns:
                continue
            self._last = message
            if last is not None:
                samples.append(self._between(last, message))
        return samples

    def _between(self, last: WheelTicks, now: WheelTicks) -> Sample:
        per_second = self._metres_per_count / ((now.stamp_ns - last.stamp_ns) * 1e-9)
        left, right = _steps(last.left, now.left) * per_second, _steps(last.right, now.right) * per_second
        return Sample((now.stamp_ns + last.stamp_ns) // 2, 0.5 * (left + right), (right - left) / self._track)


class ScanSpeeds:
    """Speeds without encoders: v by scan matching, omega by the gyro, with its bias taken at rest.

    Each scan is matched to a recent key scan, from a guess by the last speeds. So errors do not add up within a hold,
    and a featureless corridor shows as a failed match.
    """

    def __init__(self, body: ChairBody) -> None:
        self._mount = body.base_from_laser
        self._settings = MatchSettings()
        self._still: list[ImuSample] = []
        self._bias: float | None = None
        self._gyro: list[ImuSample] = []
        self._key: ScanReference | None = None
        self._key_from_base = Pose2()
        self._twist = Twist()
        self._last_ns = 0

    @property
    def ready(self) -> bool:
        """Whether the gyro was read at rest for `STILL_S`."""
        return self._bias is not None

    def add_messages(self, messages: Iterable[SensorMessage]) -> list[Sample]:
        """Return one sample per scan, stamped in the middle between it and the previous scan.

        Raises:
            CalibrationError: a scan did not match, or the chair turned during its rest.
        """
        samples = []
        for message in messages:
            if isinstance(message, ImuSample) and self._bias is None:
                self._stand_still(message)
            elif isinstance(message, ImuSample):
                self._gyro.append(message)
            elif isinstance(message, Scan) and self._bias is not None:
                before_ns, self._last_ns = self._last_ns, message.stamp_ns
                if self._match(message, before_ns):
                    middle_ns = (message.stamp_ns + before_ns) // 2
                    samples.append(Sample(middle_ns, self._twist.v, self._twist.omega))
        return samples

    def _stand_still(self, reading: ImuSample) -> None:
        self._still.append(reading)
        if (reading.stamp_ns - self._still[0].stamp_ns) * 1e-9 < STILL_S:
            return
        rates = np.array([still.gyro[2] for still in self._still], float)
        if (spread := float(rates.std())) > _MOST_TURN:
            raise CalibrationError(
                f"the gyro's readings spread by {spread:.3f} rad/s while the chair should rest: let it stand still for "
                f"{STILL_S:g} s and start again"
            )
        self._bias = float(rates.mean())

    def _match(self, scan: Scan, before_ns: int) -> bool:
        """Update pose and twist by a scan; return False for the first scan, which has no predecessor."""
        points = scan_points(scan, self._mount, self._settings.range_max, self._twist)
        if len(points) < MIN_POINTS:
            raise CalibrationError("a scan shows no walls to match: calibrate in a smaller room")
        if self._key is None:
            self._become_key(points)
            return False
        seconds = (scan.stamp_ns - before_ns) * 1e-9
        turn = self._turn(before_ns, scan.stamp_ns)
        guess = self._key_from_base @ arc(self._twist.v * seconds, turn)
        window = Window(0.25, 0.05)
        # The gyro measures the turn better than scan matching, so only the displacement is free.
        trust = np.diag([1.0, 1.0, 1.0 / 0.01**2])
        found = match(
            scan=points.thinned(_MOST_POINTS),
            reference=self._key,
            guess=guess,
            guess_information=trust,
            window=window,
            settings=self._settings,
        )
        if found.inliers < _LEAST_INLIERS:
            raise CalibrationError("a scan does not match the previous one: calibrate in a static room")
        moved = self._key_from_base.inverse() @ found.pose
        self._twist = Twist(_arc_length(moved) / seconds, turn / seconds)
        self._key_from_base = found.pose
        if np.hypot(found.pose.x, found.pose.y) > _KEY_DISTANCE or abs(found.pose.theta) > _KEY_ANGLE:
            self._become_key(points)
        return True

    def _become_key(self, points: ScanPoints) -> None:
        settings = self._settings
        self._key = reference_from_points(points.points, points.normals, settings.resolution, BEAM_SIGMA)
        self._key_from_base = Pose2()

    def _turn(self, begin_ns: int, end_ns: int) -> float:
        """Return the turn [rad] between two stamps by the gyro, and drop the older readings."""
        assert self._bias is not None
        self._gyro = [reading for reading in self._gyro if reading.stamp_ns >= begin_ns - 20_000_000]
        turn = 0.0
        for before, after in pairwise(self._gyro):
            overlap = min(after.stamp_ns, end_ns) - max(before.stamp_ns, begin_ns)
            turn += max(overlap, 0) * 1e-9 * (float(after.gyro[2]) - self._bias)
        return turn


def _steps(before: int, now: int) -> int:
    """Return the signed step of a counter that wraps at 32 bits."""
    return (now - before + 2**31) % 2**32 - 2**31


def _arc_length(moved: Pose2) -> float:
    """Return the signed length [m] of the arc to a pose: the chord along the mean heading, corrected for the bend."""
    half = 0.5 * moved.theta
    chord = moved.x * np.cos(half) + moved.y * np.sin(half)
    return float(chord / np.sinc(half / np.pi))
