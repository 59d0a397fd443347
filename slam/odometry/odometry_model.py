"""Motion and measurement model of the odometry filter, as pure functions.

Wheels have two kinds of error. Systematic errors (wrong or unequal wheel radii, a wrong track) distort every stretch by
the same factor, so that their effect grows with the distance; random slip grows with the root of the distance. The
systematic errors are therefore constants in the state, whose initial covariance is the uncertainty that a calibration
leaves (Antonelli, Chiaverini and Fusco, IEEE T-RO 2005). Random slip is process noise that depends on the motion
(Thrun, Burgard and Fox, Probabilistic Robotics, 2005, chapter 5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.config import Settings, setting
from waychair.types import FloatArray, Pose2

X, Y, THETA, V, OMEGA, BIAS, SCALE, DRIFT, TRACK, GAIN = range(10)
"""The state: pose in odom; twist; gyro bias [rad/s]; relative error of the wheels' distance; their turn per metre
[rad/m]; relative error of the wheels' turn; relative error of the gyro's scale. The errors of distance and turn are
true / measured - 1, the gyro's is measured / true - 1."""

POSE, MARK = slice(0, 3), slice(10, 13)
"""The present pose, and the mark: the pose at the end of the last measured motion, where the next one starts."""

SIZE = 13

_TURN_STEP = 0.0005  # rad; rounding of a reading's turn by encoder counts
_SURGE = 0.7  # m/s^2/sqrt(Hz); random acceleration while nothing measures the speed
_SWING = 1.5  # rad/s^2/sqrt(Hz); random angular acceleration while nothing measures the turn


@dataclass(frozen=True, slots=True)
class OdometrySettings(Settings):
    """Uncertainty of wheels and gyro; the defaults are those of a calibrated chair.

    The white noise of the wheels models slip of 0.3 % that persists for 0.3 s. The gyro is a MEMS unit of the class of
    Bosch's BMI088, whose bias also follows its temperature.
    """

    wheel_scale: float = setting(
        0.002, "",
        "relative uncertainty (one sigma) of calibrated wheel radii; larger: scan matches correct them faster",
        low=0.0, high=0.5,
    )  # fmt: skip
    wheel_drift: float = setting(
        0.0023, "rad/m",
        "uncertainty (one sigma) of the turn per metre by unequal wheels; larger: the gyro counts more",
        low=0.0, high=0.5,
    )  # fmt: skip
    track_scale: float = setting(
        0.003, "", "relative uncertainty (one sigma) of the calibrated track; larger: the gyro counts more in turns",
        low=0.0, high=1.0,
    )  # fmt: skip
    distance_noise: float = setting(
        0.002, "m/sqrt(m)", "random error of the wheels' distance by slip; larger: the odometry is less certain",
        low=0.0, high=1.0,
    )  # fmt: skip
    drift_noise: float = setting(
        0.005, "rad/sqrt(m)", "random error of the wheels' heading per distance; larger: the gyro counts more",
        low=0.0, high=1.0,
    )  # fmt: skip
    turn_noise: float = setting(
        0.005, "rad/sqrt(rad)", "random error of the wheels' heading per turn; larger: the gyro counts more",
        low=0.0, high=1.0,
    )  # fmt: skip
    stamp_error: float = setting(
        0.02, "s", "time offset between wheel and gyro stamps; larger: the wheels' turn counts less in fast turns",
        low=0.0, high=0.5,
    )  # fmt: skip
    gyro_bias: float = setting(
        0.02, "rad/s", "bias of the gyro at switch-on (one sigma); larger: it is learnt faster", low=0.0, high=1.0
    )
    gyro_wander: float = setting(
        2e-5,
        "rad/s/sqrt(s)",
        "random walk of the gyro's bias; larger: the bias follows temperature faster",
        low=0.0,
        high=0.01,
    )
    gyro_noise: float = setting(
        3e-4, "rad/s/sqrt(Hz)", "white noise density of the gyro; larger: the wheels' turn counts more",
        low=1e-7, high=0.1,
    )  # fmt: skip
    gyro_scale: float = setting(
        0.003, "", "relative uncertainty (one sigma) of the gyro's scale; larger: the gyro counts less in turns",
        low=0.0, high=0.2,
    )  # fmt: skip
    slip_speed: float = setting(
        0.35, "m/s",
        "difference of wheel speed and accelerometer that counts as slip; larger: rough ground is tolerated",
        low=0.05, high=2.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class OdometryStep:
    """The state (13,) after a step, its Jacobian (13, 13), and the covariance (13, 13) of the step's noise."""

    state: FloatArray
    jacobian: FloatArray
    noise: FloatArray


def initial_covariance(settings: OdometrySettings) -> FloatArray:
    """Return the initial covariance (13, 13): the pose is certain, the constants have the calibration's uncertainty."""
    s, sigma = settings, np.zeros(SIZE)
    sigma[[V, OMEGA]] = 1.0
    sigma[[BIAS, SCALE, DRIFT, TRACK, GAIN]] = s.gyro_bias, s.wheel_scale, s.wheel_drift, s.track_scale, s.gyro_scale
    return np.diag(sigma**2)


def predict_step(
    state: FloatArray, seconds: float, wheels: Pose2 | None, gyro: float | None, settings: OdometrySettings
) -> OdometryStep:
    """Return the step of `seconds` in which the wheels moved by `wheels` and the gyro's readings add up to `gyro` [rad].

    Either may be None, for unknown: without the gyro the wheels give the turn; without both the twist is kept.
    """
    jacobian, noises = np.eye(SIZE), np.zeros((SIZE, 4))  # four independent noises: along, across, turn, twist
    turn, by_turn = _turn(state, seconds, wheels=wheels, gyro=gyro, s=settings, noises=noises)
    x, y, by_motion = _chord(state, seconds, wheels=wheels, turn=turn, s=settings, noises=noises)
    by_motion += np.outer((-0.5 * y, 0.5 * x), by_turn)  # an error of the turn rotates the chord by half of it
    noises[:2] += np.outer((-0.5 * y, 0.5 * x), noises[THETA])
    c, s = math.cos(state[THETA]), math.sin(state[THETA])
    rotation = np.array([[c, -s], [s, c]])
    east, north = c * x - s * y, s * x + c * y
    after = state.copy()
    after[:3] = state[X] + east, state[Y] + north, state[THETA] + turn
    jacobian[:2] += rotation @ by_motion
    jacobian[X, THETA], jacobian[Y, THETA] = -north, east
    jacobian[THETA] += by_turn
    noises[:2] = rotation @ noises[:2]
    if wheels is not None:  # the twist is that of the measured motion
        after[V] = (1.0 + state[SCALE]) * forward(wheels) / seconds
        jacobian[V] = 0.0
        jacobian[V, SCALE] = forward(wheels) / seconds
        noises[V, 0] = settings.distance_noise * math.sqrt(abs(forward(wheels))) / seconds
    if wheels is not None or gyro is not None:
        after[OMEGA] = turn / seconds
        jacobian[OMEGA], noises[OMEGA] = by_turn / seconds, noises[THETA] / seconds
    noise = noises @ noises.T
    noise[BIAS, BIAS] += settings.gyro_wander**2 * seconds
    return OdometryStep(after, jacobian, noise)


def turn_by_wheels(
    state: FloatArray, seconds: float, wheels: Pose2, settings: OdometrySettings
) -> tuple[float, FloatArray, float]:
    """Return the wheels' expected turn in a step driven by the gyro [rad], its Jacobian (13,), and the variance of the
    wheels' reading [rad^2]."""
    distance, row = forward(wheels), np.zeros(SIZE)
    turn = (state[OMEGA] * seconds - state[DRIFT] * distance) / (1.0 + state[TRACK])
    row[[OMEGA, DRIFT, TRACK]] = seconds, -distance, -turn
    row /= 1.0 + state[TRACK]
    return float(turn), row, _slip_variance(wheels, settings) + _TURN_STEP**2


def motion_since_mark(state: FloatArray, mark_to: Pose2, base_to: Pose2) -> tuple[FloatArray, FloatArray]:
    """Return the expected motion (3,) between two moments, and its Jacobian (3, 13).

    At the first moment the chair was at `mark_to` in the frame of the mark, at the second at `base_to` in the frame of
    the present pose.
    """
    begin, end = Pose2(*state[MARK]) @ mark_to, Pose2(*state[:3]) @ base_to
    motion = begin.inverse() @ end
    c, s = math.cos(begin.theta), math.sin(begin.theta)
    jacobian = np.zeros((3, SIZE))
    for columns, sign, at, pose in ((slice(0, 3), 1.0, end, state[:3]), (MARK, -1.0, begin, state[MARK])):
        swing = np.array([[1.0, 0.0, pose[1] - at.y], [0.0, 1.0, at.x - pose[0]], [0.0, 0.0, 1.0]])
        jacobian[:, columns] = sign * np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ swing
    jacobian[:2, MARK.stop - 1] += motion.y, -motion.x
    return motion.array(), jacobian


def forward(motion: Pose2) -> float:
    """Return the signed length [m] of the arc to a pose: its chord along the mean heading, times arc over chord."""
    half = 0.5 * motion.theta
    chord = motion.x * math.cos(half) + motion.y * math.sin(half)
    return chord * half / math.sin(half) if abs(half) > 1e-9 else chord


def _turn(
    state: FloatArray, seconds: float, wheels: Pose2 | None, gyro: float | None, s: OdometrySettings, noises: FloatArray
) -> tuple[float, FloatArray]:
    """Return the turn [rad] of a step and its gradient (13,); add its noise to `noises`."""
    row = np.zeros(SIZE)
    if gyro is not None:
        turn = (gyro - state[BIAS] * seconds) * (1.0 - state[GAIN])
        row[BIAS], row[GAIN] = -seconds * (1.0 - state[GAIN]), -(gyro - state[BIAS] * seconds)
        noises[THETA, 2] = s.gyro_noise * math.sqrt(seconds)
    elif wheels is not None:
        turn = wheels.theta * (1.0 + state[TRACK]) + state[DRIFT] * forward(wheels)
        row[TRACK], row[DRIFT] = wheels.theta, forward(wheels)
        noises[THETA, 2] = math.sqrt(_slip_variance(wheels, s))
    else:
        turn, row[OMEGA] = state[OMEGA] * seconds, seconds
        noises[OMEGA, 2] = _SWING * math.sqrt(seconds)
        noises[THETA, 2] = 0.5 * noises[OMEGA, 2] * seconds
    return float(turn), row


def _chord(
    state: FloatArray, seconds: float, wheels: Pose2 | None, turn: float, s: OdometrySettings, noises: FloatArray
) -> tuple[float, float, FloatArray]:
    """Return the chord x, y [m] of a step in its start frame, and its gradient (2, 13) without the part by the turn."""
    gradient = np.zeros((2, SIZE))
    if wheels is not None:
        swing, scale = 0.5 * (turn - wheels.theta), 1.0 + state[SCALE]
        c, d = math.cos(swing), math.sin(swing)
        x, y = c * wheels.x - d * wheels.y, d * wheels.x + c * wheels.y
        gradient[:, SCALE] = x, y
        # two readings far apart leave open where between them the chair turned
        bend = 0.125 * forward(wheels) * wheels.theta
        noises[0, 0] = noises[1, 1] = s.distance_noise * math.sqrt(math.hypot(wheels.x, wheels.y))
        noises[1, 1] = math.hypot(noises[1, 1], bend)
        return scale * x, scale * y, gradient
    c, d = math.cos(0.5 * turn), math.sin(0.5 * turn)
    gradient[:, V] = seconds * c, seconds * d
    noises[V, 3] = _SURGE * math.sqrt(seconds)
    noises[:2, 3] = 0.5 * noises[V, 3] * gradient[:, V]
    return state[V] * seconds * c, state[V] * seconds * d, gradient


def _slip_variance(wheels: Pose2, s: OdometrySettings) -> float:
    """Return the variance [rad^2] of the wheels' turn by slip."""
    return s.drift_noise**2 * abs(forward(wheels)) + s.turn_noise**2 * abs(wheels.theta)
