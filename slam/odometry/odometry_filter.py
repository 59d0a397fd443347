"""Odometry: an extended Kalman filter over drive wheels, gyro and, optionally, motions measured by scan matching.

With a gyro, the gyro drives the turn and the wheels' turn is a measurement; its innovations estimate the gyro's bias and
the wheels' constants, and reveal slip. While the wheels stand still the chair does not turn, so the gyro reads pure bias
(zero-velocity update; Skog et al., IEEE T-BME 2010). State and motion model are in `odometry_model`; filterpy provides
the filter.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import CalibrationError
from waychair.geometry import (
    arc,
    interpolate,
    wrap_angle,
)
from waychair.slam.odometry.odometry_model import (
    BIAS,
    MARK,
    OMEGA,
    POSE,
    SIZE,
    OdometrySettings,
    OdometryStep,
    V,
    forward,
    initial_covariance,
    motion_since_mark,
    predict_step,
    turn_by_wheels,
)
from waychair.slam.odometry.slip import SlipDetector
from waychair.slam.odometry.wheel_counts import WheelCounts, wheel_paths
from waychair.types import FloatArray, ImuSample, Odometry, Pose2, Twist, WheelTicks

REACH_NS = 100_000_000
"""Longest extrapolation of the pose, and longest gap of a gyro that is used."""

_CLOCK_RESET_NS = (
    1_000_000_000  # a stamp older by more means that a clock was set back; by less, that a reading is late
)
_KEPT_OUTPUTS = 200  # outputs kept for `predict`
_COAST_NS = 500_000_000  # the filter goes on without wheels that are silent for longer
_SHOWN_NS = 300_000_000  # `slipping` stays true for this long
_SLIP_CORRELATION_S = 0.5  # correlation time of a slipping wheel's error
_MOTION_GATE = 25.0  # squared sigmas; gate beyond which a measured motion is weighted down
_FASTEST = 5.0  # [m/s]; wheels that are faster have lost count
_STILL_S = 0.3  # at rest for so long, the chair stands still
_STILL_SPEED = 0.003  # [m/s]; slower wheels are at rest
_STILL_TURN = 0.0005  # [rad/s]; turn rate that a chair at rest may have
_SLIP_GATE = 5.0  # [sigma]; gate of the wheels' turn against the gyro
_SLIP_SHARE = 0.5  # share of a slipping wheel's distance that may be wrong
_FASTEST_TURN = 10.0  # [rad/s]; faster readings are faults


@dataclass(frozen=True, slots=True)
class _Estimate:
    """Copies from the filter's state for the outputs; the covariance (3, 3) is that of the pose."""

    pose: Pose2 = field(default_factory=Pose2)
    twist: Twist = field(default_factory=Twist)
    bias: float = 0.0
    covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(slots=True)
class _Gyro:
    """The gyro's readings since the state's time."""

    stamp_ns: int | None = None  # of the last reading
    rate: float = 0.0  # rad/s; last reading
    rate_before: float = 0.0  # rad/s; last reading at the step before
    turned: float = 0.0  # rad; turn from the state's time to the last reading
    complete: bool = True  # whether there was no gap since the state's time


class OdometryFilter:
    """Pose of the base in odom, starting at the origin, with its twist and a consistent covariance.

    The inputs may be wheels only, wheels and gyro, measured motions only, or a mix that changes over time. Readings that
    are not finite, repeat a stamp or come too late are ignored. After a clock was set back, or wheels lost count, the
    filter starts again at the present pose; encoders that start again from zero after a silence are taken to have stood.
    """

    def __init__(self, body: ChairBody | None = None, settings: OdometrySettings | None = None) -> None:
        """Encoder counts need the chair's `body`."""
        from filterpy.kalman import ExtendedKalmanFilter

        self.settings = settings or OdometrySettings()
        self._counts = None if body is None else WheelCounts(body)
        self._filter = ExtendedKalmanFilter(SIZE, 1)
        self._filter.x = np.zeros(SIZE)
        self._filter.P = initial_covariance(self.settings)
        self._slip_detector = SlipDetector(self.settings.slip_speed)
        self._estimate = _Estimate()
        self._now_ns: int | None = None  # time of the state
        self._outputs: deque[Odometry] = deque(maxlen=_KEPT_OUTPUTS)
        self._wheels: WheelTicks | Odometry | None = None
        self._gyro = _Gyro()
        self._still_s = 0.0
        self._feels = True  # whether the last IMU sample had an acceleration
        self._slipped_ns: int | None = None
        self.innovation: float | None = None
        """Normalised innovation [sigma] of the wheels' last turn against the gyro; None without a comparison."""
        self._mark_ns: int | None = None
        self._mark_to = Pose2()  # from the marked pose to the end of the last measured motion

    @property
    def slipping(self) -> bool:
        """Whether gyro or accelerometer have shown wheel slip within the last 0.3 s."""
        return self._slipped_ns is not None and self._outputs[-1].stamp_ns - self._slipped_ns < _SHOWN_NS

    @property
    def gyro_bias(self) -> tuple[float, float]:
        """Bias of the gyro about z [rad/s], and its standard deviation."""
        return float(self._filter.x[BIAS]), math.sqrt(self._filter.P[BIAS, BIAS])

    @property
    def wheels(self) -> WheelTicks | None:
        """The latest encoder counts, continued over restarts of their counters; None before the first, or without encoders."""
        return self._wheels if isinstance(self._wheels, WheelTicks) else None

    @property
    def twist_covariance(self) -> FloatArray:
        """Present covariance (3, 3) of forward speed, lateral speed and turn rate [m^2/s^2, m rad/s^2, rad^2/s^2].

        It has a floor: a chair at rest may still creep, and the wheels may roll sideways by as much.
        """
        known: FloatArray = np.diag([_STILL_SPEED, _STILL_SPEED, _STILL_TURN]) ** 2
        known[np.ix_([0, 2], [0, 2])] += self._filter.P[np.ix_([V, OMEGA], [V, OMEGA])]
        return known

    def update_wheels(self, reading: WheelTicks | Odometry) -> Odometry:
        """Add a reading of the wheels, and return the odometry; of an `Odometry` only the motion since the last is used.

        Raises:
            CalibrationError: the reading holds encoder counts, and the filter has no chair body.
        """
        if isinstance(reading, WheelTicks) and self._counts is None:
            raise CalibrationError("encoder counts need the chair's wheel data: give the chair's body")
        if isinstance(reading, Odometry) and not np.isfinite(reading.odom_from_base.array()).all():
            return self._last_output(reading.stamp_ns)
        before = self._wheels
        if before is not None and reading.stamp_ns <= before.stamp_ns:
            if before.stamp_ns - reading.stamp_ns < _CLOCK_RESET_NS:
                return self._last_output(reading.stamp_ns)
            self._begin(reading.stamp_ns)
            before = None
        if self._now_ns is None or (before is None and self._mark_ns is None):
            self._begin(reading.stamp_ns)  # before the first wheel reading the chair is taken to stand
        if isinstance(reading, WheelTicks) and self._counts is not None:
            reading = self._counts.update(reading)
        self._wheels = reading
        if before is None or type(before) is not type(reading) or reading.stamp_ns <= self._state_ns:
            return self._output(reading.stamp_ns)
        motion, seconds = self._motion_between(before, reading), (reading.stamp_ns - before.stamp_ns) * 1e-9
        too_far = math.hypot(motion.x, motion.y) > _FASTEST * seconds
        if too_far or abs(motion.theta) > _FASTEST_TURN * seconds:
            self._advance(reading.stamp_ns, None)
        else:
            self._advance(reading.stamp_ns, self._motion_after_state(motion, before.stamp_ns, reading.stamp_ns))
        return self._output(reading.stamp_ns)

    def update_imu(self, sample: ImuSample) -> Odometry:
        """Add an IMU sample in axes of the base, and return the odometry at its stamp.

        A sample gives the motion since the last sample; one whose acceleration is all nan shows no slip of both wheels. A
        sample more than a second ahead of all other readings comes
        from another clock, and is ignored until the wheels catch up.
        """
        rate, accel, stamp_ns = float(sample.gyro[2]), float(sample.accel[0]), sample.stamp_ns
        feels = not bool(np.isnan(sample.accel).all())
        if not math.isfinite(rate + (accel if feels else 0.0)) or abs(rate) > _FASTEST_TURN:
            return self._last_output(stamp_ns)
        if self._now_ns is None:
            self._begin(stamp_ns)
        if self._gyro.stamp_ns is not None and stamp_ns <= self._gyro.stamp_ns:
            if self._gyro.stamp_ns - stamp_ns < _CLOCK_RESET_NS:
                return self._last_output(stamp_ns)
            self._begin(stamp_ns)
        since = self._state_ns if self._gyro.stamp_ns is None else max(self._gyro.stamp_ns, self._state_ns)
        if self._wheels is not None and stamp_ns - since > _CLOCK_RESET_NS:
            return self._last_output(stamp_ns)
        fresh_ns = max(stamp_ns - since, 0)
        fresh = self._gyro.stamp_ns is None or self._gyro.stamp_ns <= self._state_ns
        self._gyro.complete = (fresh or self._gyro.complete) and fresh_ns <= REACH_NS
        self._gyro.turned += rate * fresh_ns * 1e-9
        self._feels = feels
        if self._feels:
            self._slip_detector.add_acceleration(accel, fresh_ns * 1e-9)
        self._gyro.stamp_ns, self._gyro.rate = stamp_ns, rate
        if stamp_ns - self._state_ns > _COAST_NS:
            self._advance(stamp_ns, None)
        return self._output(stamp_ns)

    def update_motion(self, begin_ns: int, end_ns: int, begin_from_end: Pose2, covariance: FloatArray) -> Odometry:
        """Add a motion of the base measured between two stamps, as by scan matching, and return the odometry.

        Args:
            begin_ns: its start, which must be the end of the motion before; otherwise only `end_ns` is kept, as the
                start of the next motion.
            end_ns: its end.
            begin_from_end: pose of the base at the end, in the base at the start.
            covariance: (3, 3) of x, y, theta [m^2, m rad, rad^2] in the base at the start.
        """
        values = np.concatenate([begin_from_end.array(), np.ravel(covariance)])
        if end_ns <= begin_ns or not np.isfinite(values).all():
            return self._last_output(end_ns)
        if self._now_ns is None:
            self._begin(begin_ns)
            self._set_mark(begin_ns)
        if self._wheels is None or end_ns - self._wheels.stamp_ns > _COAST_NS:
            self._advance(end_ns, None)
        if begin_ns == self._mark_ns:
            self._update_motion(begin_from_end, np.asarray(covariance, float), end_ns)
        self._set_mark(end_ns)
        return self._output(end_ns)

    def predict(self, stamp_ns: int) -> Odometry:
        """Return the odometry at a stamp: interpolated between outputs, or extrapolated by at most 0.1 s."""
        if not self._outputs:
            return Odometry(stamp_ns, Pose2(), Twist(), self._estimate.covariance)
        last = self._outputs[-1]
        index = bisect_left(self._outputs, stamp_ns, key=lambda output: output.stamp_ns)
        if 0 < index < len(self._outputs):
            before, after = self._outputs[index - 1], self._outputs[index]
            part = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
            pose = interpolate(before.odom_from_base, after.odom_from_base, part)
            return Odometry(stamp_ns, pose, after.twist, after.covariance)
        nearest = self._outputs[0] if index == 0 else last
        seconds = min(max(stamp_ns - nearest.stamp_ns, -REACH_NS), REACH_NS) * 1e-9
        ahead = arc(nearest.twist.v * seconds, nearest.twist.omega * seconds)
        return Odometry(stamp_ns, nearest.odom_from_base @ ahead, nearest.twist, nearest.covariance)

    @property
    def _stands(self) -> bool:
        """Whether the wheels have been at rest for a while."""
        return self._still_s >= _STILL_S

    @property
    def _state_ns(self) -> int:
        assert self._now_ns is not None
        return self._now_ns

    def _begin(self, stamp_ns: int) -> None:
        """Start the filter's time, or start it again, at this stamp; the pose stays."""
        self._now_ns = stamp_ns
        self._outputs.clear()
        self._wheels = self._gyro.stamp_ns = self._mark_ns = self._slipped_ns = None
        self._gyro.turned, self._gyro.complete, self._still_s = 0.0, True, 0.0

    def _motion_between(self, before: WheelTicks | Odometry, after: WheelTicks | Odometry) -> Pose2:
        """Return the motion of the base between two readings of the same kind."""
        if isinstance(before, Odometry) and isinstance(after, Odometry):
            return before.odom_from_base.inverse() @ after.odom_from_base
        assert isinstance(before, WheelTicks)
        assert isinstance(after, WheelTicks)
        assert self._counts is not None
        left, right = wheel_paths(before, after, self._counts.body)
        return arc((left + right) / 2, (right - left) / self._counts.body.track)

    def _motion_after_state(self, motion: Pose2, begin_ns: int, end_ns: int) -> Pose2:
        """Return the part of a motion after the state's time, to which the state may have advanced without the wheels."""
        if begin_ns >= self._state_ns:
            return motion
        part = (end_ns - self._state_ns) / (end_ns - begin_ns)
        return arc(part * forward(motion), part * motion.theta)

    def _advance(self, end_ns: int, wheels: Pose2 | None) -> None:
        """Advance the state to `end_ns`: by the wheels' motion if given, and by the gyro if it is alive."""
        seconds = (end_ns - self._state_ns) * 1e-9
        if seconds <= 0.0:
            return
        gyro, slip, self.innovation = self._gyro_until(end_ns), None, None
        if wheels is not None and gyro is not None and self._feels:
            slip = self._slip_detector.slip_speed(forward(wheels) / seconds, seconds)
        motion = wheels if slip is None or wheels is None else arc(slip * seconds, wheels.theta)
        if wheels is not None:
            self._update_standstill(wheels, seconds)
        self._move(predict_step(self._filter.x, seconds, motion, gyro, self.settings))
        if wheels is not None and (slip is not None or (gyro is not None and not self._update_turn(wheels, seconds))):
            self._slipped_ns = end_ns
            self._inflate_for_slip(wheels, slip, seconds)
        self._now_ns, self._gyro.rate_before = end_ns, self._gyro.rate
        self._copy_state()

    def _gyro_until(self, end_ns: int) -> float | None:
        """Return the integral of the gyro since the state's time [rad], its last reading held up to `end_ns`.

        None if the gyro had a gap. The part after `end_ns` is kept for the next step.
        """
        alive = self._gyro.stamp_ns is not None and end_ns - self._gyro.stamp_ns <= REACH_NS
        complete, self._gyro.complete = self._gyro.complete and alive, True
        if self._gyro.stamp_ns is None:
            return None
        ahead = (self._gyro.stamp_ns - end_ns) * 1e-9
        held = self._gyro.rate * (ahead if self._gyro.stamp_ns > self._state_ns else (self._state_ns - end_ns) * 1e-9)
        turned, self._gyro.turned = self._gyro.turned - held, max(held, 0.0) if ahead > 0.0 else 0.0
        return turned if complete else None

    def _update_standstill(self, wheels: Pose2, seconds: float) -> None:
        limit = _STILL_SPEED * seconds
        still = math.hypot(wheels.x, wheels.y) <= limit and abs(wheels.theta) <= 4.0 * limit
        self._still_s = self._still_s + seconds if still else 0.0

    def _update_turn(self, wheels: Pose2, seconds: float) -> bool:
        """Update with the wheels' turn unless they slip; return whether they agree with the gyro."""
        s = self.settings
        expected, row, variance = turn_by_wheels(self._filter.x, seconds, wheels, s)
        variance += (s.stamp_error * (self._gyro.rate - self._gyro.rate_before)) ** 2
        if self._stands:
            variance = (_STILL_TURN * seconds) ** 2
        off = wheels.theta - expected
        self.innovation = off / math.sqrt(row @ self._filter.P @ row + variance)
        if abs(self.innovation) > _SLIP_GATE:
            return False
        if self._stands:
            self._update_at_rest(row, off, variance)
        else:
            self._filter.update(np.array([wheels.theta]), lambda _: row[None], lambda _: np.array([expected]), variance)
        return True

    def _update_at_rest(self, row: FloatArray, off: float, variance: float) -> None:
        """Update all but the pose (Schmidt-Kalman): what a rest tells of the gyro's bias must not move a chair that stands."""
        p = self._filter.P
        gain = p @ row / (row @ p @ row + variance)
        gain[POSE] = 0.0
        rest = np.eye(SIZE) - np.outer(gain, row)
        self._filter.x = self._filter.x + gain * off
        self._filter.P = rest @ p @ rest.T + variance * np.outer(gain, gain)  # Joseph's form holds for any gain

    def _inflate_for_slip(self, wheels: Pose2, slip: float | None, seconds: float) -> None:
        """Increase the position's variance for slipping wheels: the errors of a slip are correlated and add up linearly."""
        wrong = abs(forward(wheels)) if slip is None else max(abs(forward(wheels)), abs(slip * seconds))
        grip_steps = max(2.0 * _SLIP_CORRELATION_S / seconds, 1.0)
        self._filter.P[[0, 1], [0, 1]] += (_SLIP_SHARE * wrong) ** 2 * grip_steps

    def _move(self, step: OdometryStep) -> None:
        """Predict the state; the pose of a chair that stands stays, with its covariance."""
        if self._stands:
            step.state[POSE] = self._filter.x[POSE]
            step.jacobian[POSE] = np.eye(SIZE)[POSE]
            step.noise[POSE] = step.noise[:, POSE] = 0.0
        self._filter.F, self._filter.Q = step.jacobian, step.noise
        self._filter.predict()
        self._filter.x = step.state

    def _update_motion(self, measured: Pose2, covariance: FloatArray, end_ns: int) -> None:
        """Update with a motion since the mark; an outlier gets a larger covariance."""
        base_to = self._estimate.pose.inverse() @ self._pose_at(end_ns)
        expected, jacobian = motion_since_mark(self._filter.x, self._mark_to, base_to)
        off = measured.array() - expected
        off[2] = wrap_angle(off[2])
        spread = jacobian @ self._filter.P @ jacobian.T + covariance
        squared_innovation = float(off @ np.linalg.solve(spread, off))
        if squared_innovation > _MOTION_GATE:
            covariance = covariance + (squared_innovation / _MOTION_GATE - 1.0) * spread
        self._filter.update(off, lambda _: jacobian, lambda _: np.zeros(3), covariance)
        self._copy_state()

    def _set_mark(self, stamp_ns: int) -> None:
        """Clone the present pose, with its covariances, into the state as the mark."""
        x, p = self._filter.x, self._filter.P
        x[MARK] = x[POSE]
        p[MARK] = p[POSE]
        p[:, MARK] = p[:, POSE]
        self._mark_ns, self._mark_to = stamp_ns, self._estimate.pose.inverse() @ self._pose_at(stamp_ns)

    def _pose_at(self, stamp_ns: int) -> Pose2:
        if stamp_ns < self._state_ns and self._outputs:
            return self.predict(stamp_ns).odom_from_base
        return self._pose_after(stamp_ns)

    def _pose_after(self, stamp_ns: int) -> Pose2:
        """Return the pose extrapolated from the state: at its speed, and turning by the gyro."""
        seconds = (stamp_ns - self._state_ns) * 1e-9
        turn = self._estimate.twist.omega * seconds
        if self._gyro.stamp_ns is not None and self._state_ns < self._gyro.stamp_ns <= stamp_ns:
            turn = self._gyro.turned - self._estimate.bias * (self._gyro.stamp_ns - self._state_ns) * 1e-9
            turn += (self._gyro.rate - self._estimate.bias) * (stamp_ns - self._gyro.stamp_ns) * 1e-9
        return self._estimate.pose @ arc(self._estimate.twist.v * seconds, turn)

    def _copy_state(self) -> None:
        """Copy pose, twist, bias and covariance of the state for the outputs."""
        x, y, theta, v, omega, bias = self._filter.x[:6].tolist()
        covariance = self._filter.P[POSE, POSE].copy()
        self._estimate = _Estimate(Pose2(x, y, wrap_angle(theta)), Twist(v, omega), bias, covariance)

    def _output(self, stamp_ns: int) -> Odometry:
        """Return the odometry at the latest known time, which is `stamp_ns` unless a reading came late."""
        latest_ns = max(stamp_ns, self._state_ns)
        if self._outputs:
            latest_ns = max(latest_ns, self._outputs[-1].stamp_ns)
            if latest_ns == self._outputs[-1].stamp_ns:
                self._outputs.pop()
        fresh = self._gyro.stamp_ns is not None and self._gyro.stamp_ns > self._state_ns
        twist = Twist(self._estimate.twist.v, self._gyro.rate - self._estimate.bias) if fresh else self._estimate.twist
        self._outputs.append(Odometry(latest_ns, self._pose_after(latest_ns), twist, self._estimate.covariance))
        return self._outputs[-1]

    def _last_output(self, stamp_ns: int) -> Odometry:
        """Return the last output again, for an ignored reading."""
        return self._outputs[-1] if self._outputs else Odometry(stamp_ns, Pose2(), Twist(), self._estimate.covariance)
