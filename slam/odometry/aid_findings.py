"""Findings about the aids of a drive, and their sentences: which part, its fault, since when, the consequence."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from waychair.slam.odometry.broken_steps import Break, BreakKind
from waychair.types import Json


class AidPart(Enum):
    """The part of an aid that a finding is about."""

    WHEELS = "odometry"
    WHEEL_TURN = "headings"
    WHEEL_WAY = "positions"
    TWIST = "speeds"
    SCALES = "scales"
    GYRO = "turn rates"
    GRAVITY = "acceleration"
    LIDAR = "lidar"


class AidState(Enum):
    """What follows for the aid."""

    CORRECTED = "corrected"
    LEFT_OUT = "left out"
    NOTED = "noted"


class Cause(Enum):
    """The look of a fault."""

    DEGREES = "degrees"
    OTHER_WAY = "the other way round"
    MIRRORED_HEADINGS = "mirrored headings"
    UPSIDE_DOWN = "upside down"
    ON_EDGE = "on edge"
    SCALE = "scale"
    BIAS = "bias"
    DELAY = "delay"
    NOTHING = "nothing"
    STUCK = "stuck"
    MISSING = "missing"
    UNLIKE = "unlike"
    LEANING = "leaning"
    FALSE_SLIPS = "false slips"
    NO_GRAVITY = "no gravity"
    IN_G = "in g"
    IN_MILLI_G = "in mg"
    IN_CENTIMETRES = "in cm/s^2"
    MILLIMETRES = "millimetres"
    CENTIMETRES = "centimetres"
    EXCHANGED = "exchanged axes"
    AXES = "other axes"
    BACKWARD = "backward"
    LONG = "long wheels"
    SCALES_DIFFER = "scales differ"
    MIRRORED = "mirrored"
    MIRRORED_OR_WHEELS = "mirrored, or wheels exchanged"
    MOUNT = "mount"
    WILD = "wild readings"
    RESTART = "restart"
    JUMP = "jump"


@dataclass(frozen=True, slots=True)
class AidNames:
    """The topics of the aids, or what else to call them."""

    lidar: str = "the lidar"
    wheels: str = "the odometry"
    imu: str = "the IMU"


@dataclass(frozen=True, slots=True)
class AidFinding:
    """One finding about an aid.

    `since_s` and `until_s` [s] after the first scan; None: from the beginning, to the end. `value` is the factor, bias
    [rad/s], delay [s], lever or jump [m] by which the aid is off, with its `sigma` (a turn for jumps [rad], mounts [deg]). `gain_m` [m]: what the correction moves the
    map by, where that is known. `count` messages are concerned. `advice` is an option that confirms the correction.
    """

    part: AidPart
    state: AidState
    cause: Cause
    since_s: float | None = None
    until_s: float | None = None
    value: float = 0.0
    sigma: float = 0.0
    gain_m: float | None = None
    count: int = 0
    advice: str = ""

    def data(self, names: AidNames) -> Json:
        """Return the finding as JSON."""
        return {
            "name": name_of(self.part, names),
            "part": self.part.value,
            "state": self.state.value,
            "cause": self.cause.value,
            "since_s": None if self.since_s is None else round(self.since_s, 3),
            "until_s": None if self.until_s is None else round(self.until_s, 3),
            "value": round(self.value, 6),
            "sigma": round(self.sigma, 6),
            "gain_m": None if self.gain_m is None else round(self.gain_m, 3),
            "count": self.count,
        }


def finding_from_break(found: Break) -> AidFinding:
    """Return the finding about broken steps of wheel odometry."""
    cause = {BreakKind.MESSAGES: Cause.WILD, BreakKind.RESTART: Cause.RESTART, BreakKind.JUMP: Cause.JUMP}[found.kind]
    state = AidState.LEFT_OUT if cause is Cause.WILD else AidState.CORRECTED
    return AidFinding(
        AidPart.WHEELS,
        state,
        cause,
        found.begin_s,
        found.end_s,
        value=found.metres,
        sigma=found.radians,
        count=found.messages,
    )


def name_of(part: AidPart, names: AidNames) -> str:
    """Return the topic of a part; of the scales, which two parts share, both topics."""
    if part is AidPart.SCALES:
        return f"{names.wheels} and {names.lidar}"
    return {AidPart.LIDAR: names.lidar, AidPart.GYRO: names.imu, AidPart.GRAVITY: names.imu}.get(part, names.wheels)


def sentence(finding: AidFinding, names: AidNames) -> str:
    """Return a finding as one sentence that names the topic, the fault, since when, and the consequence."""
    return f"{name_of(finding.part, names)}: {clause(finding)}{_advice(finding)}"


def clause(finding: AidFinding) -> str:
    """Return a finding without the topic: the fault, since when, and the consequence."""
    if finding.part is AidPart.SCALES:
        return _scales(finding)
    if finding.cause is Cause.WILD and finding.part is not AidPart.WHEELS:
        return _wild(finding)
    if finding.cause in (Cause.WILD, Cause.RESTART, Cause.JUMP):
        return _broken(finding)
    return f"{_wrong(finding)}: {_follows(finding)}, {_when(finding)}"


def remedy(finding: AidFinding) -> str:
    """Return what the user can do about the cause."""
    if finding.advice:
        return finding.advice
    if finding.part is AidPart.SCALES:
        return "measure a wall on the map, and correct the wheel radius or the scale of the lidar's ranges"
    if finding.part is AidPart.LIDAR:
        return "check the lidar's mount, and its angles"
    if finding.part in (AidPart.GYRO, AidPart.GRAVITY):
        if finding.cause in (Cause.LEANING, Cause.ON_EDGE, Cause.UPSIDE_DOWN, Cause.OTHER_WAY):
            return "give the IMU's mount on /tf_static"
        return "check the IMU's driver; --imu none leaves it out from the start"
    return "check the wheels' driver; --odom none leaves it out from the start"


def _broken(finding: AidFinding) -> str:
    at, far = max(finding.since_s or 0.0, 0.0), _distance(finding.value, finding.sigma)
    if finding.cause is Cause.WILD:
        until = finding.until_s or at
        times = f"at {at:.1f} s" if until - at < 0.15 else f"from {at:.1f} to {until:.1f} s"
        count = "one message" if finding.count <= 1 else f"{finding.count} messages"
        return f"{count} {times} {'is' if finding.count <= 1 else 'are'} {far} off, and left out"
    what = f"begins anew at zero, {far} away," if finding.cause is Cause.RESTART else f"jumps by {far}"
    return f"it {what} at {at:.1f} s: that is no motion, and is bridged by its speeds and the scans"


def _scales(finding: AidFinding) -> str:
    """Return the clause about ways by wheels and by scans that differ: neither is known to be the right one."""
    longer = "longer" if finding.value > 1.0 else "shorter"
    return (
        f"the way by wheels is about {abs(finding.value - 1.0):.0%} {longer} than by scans, so one of both has a wrong scale; "
        "the map follows the scans: check the wheel radius, or the scale of the lidar's ranges"
    )


def _wild(finding: AidFinding) -> str:
    """Return the clause about single readings that no chair can cause."""
    begin, end = max(finding.since_s or 0.0, 0.0), max(finding.until_s or 0.0, 0.0)
    units = {AidPart.GYRO: "rad/s", AidPart.GRAVITY: "m/s^2"}
    size = f"{finding.value:.3g} {units.get(finding.part, 'm/s or rad/s')}"
    if finding.count == 1:
        return f"one message at {begin:.1f} s has wild {finding.part.value} ({size}), and is left out"
    times = f"{finding.count} messages from {begin:.1f} to {end:.1f} s"
    return f"{times} have wild {finding.part.value} (up to {size}), and are left out"


def _distance(metres: float, radians: float) -> str:
    turn = f"{radians * 57.29578:.0f} degrees"
    if metres < 0.2:
        return turn
    if metres >= 1e9:
        return "more than a million km"
    return f"{metres / 1000:.0f} km" if metres >= 10_000 else f"{metres:.0f} m" if metres >= 20 else f"{metres:.1f} m"


def _wrong(finding: AidFinding) -> str:
    """Return what is wrong with a part, as a clause."""
    value, part = finding.value, finding.part.value
    if finding.part is AidPart.GRAVITY and finding.cause is Cause.SCALE:
        return f"the {part} is {9.80665 * value:.2f} at rest instead of 9.81 m/s^2"
    if finding.part is AidPart.LIDAR:
        return _wrong_lidar(finding)
    if finding.part is AidPart.WHEELS and finding.cause is Cause.STUCK:
        return "the readings are stuck, and stay the same while the scans move"
    clauses = {
        Cause.DEGREES: f"the {part} are {abs(value):.1f} times too large, as in degrees",
        Cause.OTHER_WAY: f"the {part} go the other way than the scans",
        Cause.MIRRORED_HEADINGS: f"the {part} turn the other way than its own positions and the scans",
        Cause.UPSIDE_DOWN: "gravity points the wrong way, as where the IMU hangs upside down",
        Cause.SCALE: f"the {part} are {_factor(value)} times the true ones",
        Cause.BIAS: f"the {part} have a constant error of {value:.3f} rad/s",
        Cause.DELAY: f"the stamps are {abs(value):.2f} s {'late' if value > 0 else 'early'} against the scans",
        Cause.NOTHING: f"the {part} stand still while the scans move",
        Cause.STUCK: f"the {part} are stuck at one value",
        Cause.MISSING: "there are no messages while the scans move",
        Cause.UNLIKE: f"the {part} do not follow the scans",
        Cause.NO_GRAVITY: f"gravity is missing (mean {9.80665 * value:.2f} m/s^2 instead of 9.81)",
        Cause.FALSE_SLIPS: f"the {part} shows slips of the wheels, {value:.1f} m in all, where the scans show none",
        Cause.LEANING: f"gravity is {value:.0f} degrees from upright, as where the IMU is not mounted level",
        Cause.IN_G: f"the {part} is {9.80665 * value:.2f} at rest instead of 9.81 m/s^2, as in g",
        Cause.IN_MILLI_G: f"the {part} is {9.80665 * value:.0f} at rest instead of 9.81 m/s^2, as in thousandths of g",
        Cause.IN_CENTIMETRES: f"the {part} is {9.80665 * value:.0f} at rest instead of 9.81 m/s^2, as in cm/s^2",
        Cause.MILLIMETRES: f"the {part} are 1000 times too large, as in millimetres",
        Cause.CENTIMETRES: f"the {part} are 100 times too large, as in centimetres",
        Cause.EXCHANGED: f"the {part} are mirrored against the headings, as where x and y are exchanged",
        Cause.AXES: f"the {part} are turned by {value:.0f} degrees against the headings",
        Cause.BACKWARD: f"the {part} go backward while the scans go forward",
        Cause.LONG: f"the wheels measure {value:.3f} times the way of the scans",
    }
    if finding.cause is Cause.ON_EDGE:
        return "gravity points sideways, as where the IMU is mounted on edge" if finding.part is AidPart.GRAVITY else (
            "the chair's turns are on another axis than z, as where the IMU is mounted on edge"
        )  # fmt: skip
    return clauses[finding.cause]


def _factor(value: float) -> str:
    return f"{abs(value):.0f}" if abs(value) >= 100.0 else f"{abs(value):.3g}"


def _wrong_lidar(finding: AidFinding) -> str:
    clauses = {
        Cause.MIRRORED: "the scans turn against wheels and IMU, as where it hangs upside down",
        Cause.MIRRORED_OR_WHEELS: (
            "the scans turn against the odometry, as where it hangs upside down (or where the left and the right "
            "wheel are exchanged; then the map is mirrored)"
        ),
        Cause.SCALE: f"its scans turn {finding.value:.2f} times as far as wheels and IMU, which agree with each other",
        Cause.MOUNT: f"its mount is not as told (the scans disagree with the odometry by "
        f"{abs(finding.sigma):.0f} degrees in the direction of travel and by {finding.value:.2f} m in turns)",
    }
    return clauses[finding.cause]


def _follows(finding: AidFinding) -> str:
    if finding.state is AidState.LEFT_OUT:
        if finding.cause is Cause.MISSING or (finding.part is AidPart.WHEELS and finding.cause is Cause.STUCK):
            return "the scans stand in for them"
        return "the turn rates are used, the tilt is not" if finding.part is AidPart.GRAVITY else "left out"
    if finding.gain_m is not None:
        return f"corrected, which moves the map by up to {finding.gain_m:.2f} m"
    return "corrected"


def _when(finding: AidFinding) -> str:
    if finding.since_s is None and finding.until_s is None:
        return "for the whole recording"
    since = "from the beginning" if finding.since_s is None else f"since {finding.since_s:.0f} s"
    return since if finding.until_s is None else f"{since} until {finding.until_s:.0f} s"


def _advice(finding: AidFinding) -> str:
    return f". {finding.advice}" if finding.advice else ""
