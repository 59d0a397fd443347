"""The cells of today's sensors: each turns what its sensor gives into fans, and one names the sensors not to be believed.

Nothing that is doubted counts as free ground. A blind lidar gives no fan; a sonar that is silent or stuck gives none, and
an echo that no second one bears out is an obstacle and frees nothing.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from waychair.calibration.chair_body import ChairBody, sonar_mounts
from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.doorway import OdometryPose
from waychair.control.behaviours.range_finder import CameraAim
from waychair.control.behaviours.view.local_view import Beams, Fans, Thing, leaps
from waychair.slam.scan.scan_points import beam_ends
from waychair.types import Float32Array, FloatArray, Pose2, Scan, SonarReadings, Twist

_NOTHING_SEEN = 3.0
"""m; a beam without an echo is free up to here at most: dark things return none from farther away."""

_FARTHEST = 30.0
"""m; beams beyond this are not used: the view is far smaller."""

_SPARSE = 0.25
"""Part of the beams that must have a range: below it a lidar is blind, and nothing is free by it."""

SONAR_RANGE, HALF_CONE = 4.0, math.radians(15.0)
"""m, rad; the sonars of `sonar_mounts`: farthest echo, and half the angle of the cone."""

_CONE_STEP = math.radians(2.0)
_CONE = np.arange(-HALF_CONE, HALF_CONE + 1e-9, _CONE_STEP)

_STUCK_MOVED = 0.3
"""m; a sonar that reads the very same finite range while the chair moves by this is stuck."""

_SAME_ECHO = 0.15
"""m; greatest difference between two echoes of one thing, from noise and the chair's motion."""

_READINGS, _ALONE = 20, 8
"""A sonar of whose last readings so many have no second one at their range hears others: a passer-by costs it a few."""

SILENT_NS = 1_000_000_000
"""Time without a message after which a sensor that was heard before counts as silent: ten scans."""

_LEAP_TOLD_NS = 5_000_000_000
"""Time for which a leap of the pose is named: long enough to be read or spoken."""


_MEAN_BEAMS, _ON_LINE = 2, 0.06
"""Beams on either side over which a range is averaged, and the greatest difference [m] between two of them and twice the one
between: five times that of a usual lidar's noise. Noise would show a wall farther away than it is."""


def is_blind(scan: Scan) -> bool:
    """Return whether a scan has so few ranges that its lidar is covered, dazzled or out of order."""
    return not len(scan.ranges) or bool(np.isfinite(scan.ranges).mean() < _SPARSE)


def smoothed(ranges: Float32Array) -> Float32Array:
    """Return ranges (N,) [m], each the mean over as many beams on both sides as lie on a line with it; all others as they are."""
    smooth, total, same = ranges.copy(), ranges.copy(), np.isfinite(ranges)
    with np.errstate(invalid="ignore"):
        for w in range(1, _MEAN_BEAMS + 1):
            both = ranges[2 * w :] + ranges[: -2 * w]
            total[w:-w] += both
            same[:w] = same[-w:] = False
            same[w:-w] &= np.abs(both - 2.0 * ranges[w:-w]) < _ON_LINE
            smooth = np.where(same, total / np.float32(2 * w + 1), smooth)
    return smooth


def lidar_fans(scan: Scan, odometry: OdometryPose | None, constants: ChairBody) -> Fans | None:
    """Return a scan as a fan in base; None where the lidar is blind.

    With odometry the chair's motion during the sweep is taken out, and base is that of the scan's stamp. Without, base is
    that of its middle beam.
    """
    if is_blind(scan):
        return None
    mount = constants.base_from_laser
    reach = min(_NOTHING_SEEN, scan.range_max)
    hits = np.isfinite(scan.ranges) & (scan.ranges <= scan.range_max)
    far = replace(scan, ranges=np.where(np.isposinf(scan.ranges), np.float32(reach), smoothed(scan.ranges)))
    twist = Twist() if odometry is None else Twist(odometry.v, odometry.omega)
    ends, valid = beam_ends(far, mount, _FARTHEST, twist)
    halfway_ns = round(scan.time_step * len(scan.ranges) / 2 * 1e9) if odometry is None else 0
    beams = Beams(np.array([mount.x, mount.y]), ends[valid].astype(np.float32), hits[valid], abs(scan.angle_step) / 2)
    return Fans((beams,), scan.stamp_ns + halfway_ns)


def pass_fans(part: Fans) -> Fans:
    """Return a part that comes ranged: depth at the body's heights, drop-offs, people."""
    return part


class Echo(enum.IntEnum):
    """The standing of a sonar's reading. BORNE_OUT: as the one before. ALONE: it is not. STUCK, SILENT: not believed."""

    BORNE_OUT = 0
    ALONE = 1
    STUCK = 2
    SILENT = 3


@dataclass(frozen=True, slots=True)
class CheckedEchoes:
    """The sonars' ranges [m] at a stamp, the standing of each, and the numbers of those that seem to hear other sonars."""

    stamp_ns: int
    ranges: tuple[float, ...]
    standing: tuple[Echo, ...]
    crosstalk: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class EchoMemory:
    """Dynamic data of the check: the ranges before, the chair's place where each last changed, readings that were alone."""

    ranges: tuple[float, ...] = ()
    changed_at: tuple[tuple[float, float], ...] = ()
    alone: tuple[tuple[bool, ...], ...] = ()


def check_echoes(
    readings: SonarReadings, odometry: OdometryPose, dynamic: EchoMemory
) -> tuple[CheckedEchoes, EchoMemory]:
    """Return the sonars' readings with their standing.

    A reading is borne out by a second one at its range: crosstalk comes alone. A sonar that reads the very same finite
    range while the chair moves is stuck.
    """
    values = tuple(float(each) for each in readings.ranges)
    count, here = len(values), (odometry.x, odometry.y)
    memory = dynamic if len(dynamic.ranges) == count else EchoMemory()
    before = memory.ranges or (math.nan,) * count
    places = memory.changed_at or (here,) * count
    changed_at = tuple(
        place if value == was else here for value, was, place in zip(values, before, places, strict=True)
    )
    standing = tuple(
        _standing(value, was, math.hypot(here[0] - place[0], here[1] - place[1]))
        for value, was, place in zip(values, before, places, strict=True)
    )
    notes = memory.alone or ((),) * count
    alone = tuple(
        (*note[1 - _READINGS :], each is Echo.ALONE and not math.isnan(was))
        for note, each, was in zip(notes, standing, before, strict=True)
    )
    crosstalk = tuple(k for k, note in enumerate(alone) if sum(note) >= _ALONE)
    return CheckedEchoes(readings.stamp_ns, values, standing, crosstalk), EchoMemory(values, changed_at, alone)


def _standing(value: float, was: float, moved: float) -> Echo:
    if math.isnan(value):
        return Echo.SILENT
    if value == was:
        return Echo.STUCK if math.isfinite(value) and moved > _STUCK_MOVED else Echo.BORNE_OUT
    return Echo.BORNE_OUT if abs(value - was) <= _SAME_ECHO else Echo.ALONE


def echo_fans(checked: CheckedEchoes, constants: ChairBody) -> Fans:
    """Return the echoes as fans, one for each sonar: the whole arc of an echo is hit, the cone before it free."""
    fans = []
    for (origin, directions), value, standing in zip(_cones(constants), checked.ranges, checked.standing, strict=False):
        if standing in (Echo.STUCK, Echo.SILENT):
            continue
        ends = (origin + min(max(value, 0.0), SONAR_RANGE) * directions).astype(np.float32)
        hits = np.full(len(ends), value <= SONAR_RANGE)
        clears = standing is Echo.BORNE_OUT
        fans.append(Beams(origin, ends, hits, _CONE_STEP / 2, int(Thing.SOLID), clears))
    return Fans(tuple(fans), checked.stamp_ns)


@lru_cache(maxsize=8)
def _cones(body: ChairBody) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return the place (2,) [m] of each sonar in base, and the directions (N, 2) of the beams of its cone."""
    bearings = [mount.theta + _CONE for mount in sonar_mounts(body)]
    directions = [np.column_stack([np.cos(each), np.sin(each)]) for each in bearings]
    places = [np.array([mount.x, mount.y]) for mount in sonar_mounts(body)]
    return tuple(zip(places, directions, strict=True))


@dataclass(frozen=True, slots=True)
class SensorTroubles:
    """What is wrong with the sensors, one sentence each; `leapt`: the pose leapt since the watch looked before."""

    sentences: tuple[str, ...] = ()
    leapt: bool = False


@dataclass(frozen=True, slots=True)
class WatchMemory:
    """Dynamic data of the sensor watch: the last pose of the odometry, and the latest leap: its stamp and length [m]."""

    last: tuple[tuple[int, Pose2], ...] = ()
    leapt_ns: int | None = None
    leapt: float = 0.0


def watch_sensors(
    lidar: Reading[Scan] | None,
    echoes: Reading[CheckedEchoes] | None,
    depth: Reading[Fans] | None,
    odometry: Reading[OdometryPose] | None,
    aim: Reading[CameraAim] | None,
    camera_fault: str | None,
    dynamic: WatchMemory,
    now_ns: int,
) -> tuple[SensorTroubles, WatchMemory]:
    """Return a sentence for each sensor that is blind, silent, stuck or hears others, and for a pose that leapt.

    A sensor that was never heard is no trouble: the chair may have none. Odometry and one sensor that sees are needed.
    """
    memory = _with_pose(dynamic, odometry)
    told = [*_odometry_troubles(odometry, memory, now_ns), *_lidar_troubles(lidar, now_ns)]
    told += _sonar_troubles(echoes, now_ns)
    if depth is not None and now_ns - depth.stamp_ns > SILENT_NS:
        told.append("the depth camera is silent, so nothing is free by it: see its cable")
    if camera_fault:
        told.append(camera_fault)
    elif aim is not None and now_ns - aim.stamp_ns > SILENT_NS:
        told.append("the camera on servos is silent, so it cannot be aimed and shows nothing: see its cable")
    if lidar is None and echoes is None and depth is None:
        told.append("no sensor that looks round the chair is heard yet, so nothing is free")
    return SensorTroubles(tuple(told), memory.leapt_ns != dynamic.leapt_ns), memory


def _with_pose(memory: WatchMemory, odometry: Reading[OdometryPose] | None) -> WatchMemory:
    if odometry is None:
        return memory
    pose, stamp_ns = odometry.value.pose(), odometry.stamp_ns
    if memory.last and memory.last[0][0] >= stamp_ns:
        return memory
    if not leaps(memory.last, stamp_ns, pose):
        return WatchMemory(((stamp_ns, pose),), memory.leapt_ns, memory.leapt)
    last = memory.last[0][1]
    return WatchMemory(((stamp_ns, pose),), stamp_ns, math.hypot(pose.x - last.x, pose.y - last.y))


def _odometry_troubles(odometry: Reading[OdometryPose] | None, memory: WatchMemory, now_ns: int) -> list[str]:
    told = []
    if odometry is None or now_ns - odometry.stamp_ns > SILENT_NS:
        told.append("the odometry is silent, so nothing tells where things lie, and nothing is free: see the encoders")
    elif not np.isfinite(odometry.value.pose().array()).all():
        told.append("the odometry gives no numbers, so nothing is free: see the encoders")
    if memory.leapt_ns is not None and now_ns - memory.leapt_ns <= _LEAP_TOLD_NS:
        told.append(f"the pose leapt by {memory.leapt:.1f} m, so what was seen before no longer counts")
    return told


def _lidar_troubles(lidar: Reading[Scan] | None, now_ns: int) -> list[str]:
    if lidar is None:
        return []
    if now_ns - lidar.stamp_ns > SILENT_NS:
        return ["the lidar is silent, so nothing is free by it: see its cable"]
    if is_blind(lidar.value):
        return ["the lidar is blind: too few of its beams have a range, so nothing is free by it; clean its window"]
    return []


def _sonar_troubles(echoes: Reading[CheckedEchoes] | None, now_ns: int) -> list[str]:
    if echoes is None:
        return []
    if now_ns - echoes.stamp_ns > SILENT_NS:
        return ["the sonars are silent, so nothing is free by them: see their cable"]
    checked = echoes.value
    stuck, silent = (
        [k for k, standing in enumerate(checked.standing) if standing is each] for each in (Echo.STUCK, Echo.SILENT)
    )
    told = []
    if stuck:
        told.append(f"{_sonars(stuck)} read the very same range while the chair moves, so they are not believed")
    if silent:
        told.append(f"{_sonars(silent)} do not answer, so nothing is free by them: see their cables")
    if checked.crosstalk:
        told.append(
            f"{_sonars(checked.crosstalk)} give ranges that no second one bears out: they may hear other sonars"
        )
    return told


def _sonars(numbers: list[int] | tuple[int, ...]) -> str:
    return f"the sonars {', '.join(str(each + 1) for each in numbers)}"
