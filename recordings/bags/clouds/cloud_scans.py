"""Scans from point clouds: a band of heights of a cloud in space, or the one level of a planar lidar's cloud.

Points are put right for the motion of the chair by their own times, where the driver gives them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.geometry import compose, invert
from waychair.recordings.bags.clouds.cloud_decoding import Cloud
from waychair.recordings.plausibility.findings import Finding
from waychair.recordings.plausibility.point_times import PointTimes, point_times
from waychair.recordings.plausibility.sweep_readings import scan_interval
from waychair.recordings.plausibility.told_scans import ToldScan
from waychair.recordings.scan_merging import OdometryInterpolation
from waychair.recordings.scans import scan_from_points
from waychair.types import Float32Array, FloatArray, Scan

CLOUD_RANGE_MIN, CLOUD_RANGE_MAX = 0.3, 30.0  # m; points of a cloud that are nearer or farther are left out
SAMPLE = 40
"""Clouds at the beginning of a topic that tell what kind of clouds it holds."""

_FLAT = 0.02  # m; a planar lidar's points are that level in its own frame
_AT_HEIGHT = 0.05  # m; height of a planar lidar's points in its own frame, and of the floor in that of the base
_FLAT_TILT = 0.01  # of the distance; the same for a cloud that the driver has tilted a little
_BAND_STEPS = tuple(math.radians(step) for step in (0.25, 0.5, 1.0, 2.0))
"""Steps [rad] between the beams of scans that are made from clouds in space."""

_CLOSED = 0.8  # share of the beams with points whose next beam has points as well, if the step is not too fine
_LEAST_FLOOR = 0.04  # share of the points that lie on the floor, if it is in view
_FLOOR = (0.1, 2.5)  # m; possible heights of a lidar above the floor
_COARSEST_STEP = math.radians(5.0)


@dataclass(frozen=True, slots=True)
class CloudKind:
    """The kind of a topic's clouds: metres in their unit, the times of their points, and whether they are flat.

    `step` [rad] between the beams of the scans that they become; of a flat cloud those of the lidar, positive
    counter-clockwise, with `first` [rad], the direction of its first beam in time.
    """

    unit: float = 1.0
    times: PointTimes | None = None
    flat: bool = False
    step: float = _BAND_STEPS[0]
    first: float = 0.0


def kind_of_clouds(
    topic: str, sample: Sequence[tuple[int, Cloud]], unit: float, findings: list[Finding], *, in_base: bool = False
) -> CloudKind:
    """Return the kind of a topic's clouds in a unit [m] from a sample of them, with their stamps [ns].

    `in_base`: their points are in axes of the base.
    """
    filled = [(stamp, cloud) for stamp, cloud in sample if len(cloud.points)]
    if not filled:
        return CloudKind(unit)
    points = np.concatenate([cloud.points for _, cloud in filled])
    interval = scan_interval([stamp for stamp, _ in filled])
    times = None
    told = [(stamp, cloud.times) for stamp, cloud in filled if cloud.times is not None]
    if told:
        times = point_times(told, interval)
        if times is None and any(np.ptp(part) > 0.0 for _, part in told):
            text = "the times of the points fit no unit and are left out of account: the clouds bend in fast turns"
            findings.append(Finding("point times", topic, text, "check the driver's time field"))
    level, middle = float(np.ptp(points[:, 2])) * unit <= _FLAT, float(np.median(points[:, 2])) * unit
    own_height = abs(middle) <= _AT_HEIGHT or (in_base and middle > _AT_HEIGHT)  # else it is the floor
    if not (level and own_height) and _deviation(points) > _FLAT_TILT:
        return CloudKind(unit, times, step=_closed_step([cloud.points for _, cloud in filled]))
    near = [cloud.points[np.hypot(*cloud.points[:, :2].T) * unit <= CLOUD_RANGE_MAX] for _, cloud in filled]
    step, first = _beams_of(near)
    return CloudKind(unit, times, True, step, first)


def _deviation(points: FloatArray) -> float:
    """Return the largest height of points (N, 3) over their distance."""
    distance = np.hypot(points[:, 0], points[:, 1])
    far = distance > 0.0
    return float(np.abs(points[far, 2] / distance[far]).max(initial=0.0))


def _closed_step(clouds: Sequence[FloatArray]) -> float:
    """Return the finest step of `_BAND_STEPS` at which the points of clouds leave no gaps between neighbouring beams."""
    for step in _BAND_STEPS:
        count = round(math.tau / step)
        closed = []
        for points in clouds:
            filled = np.zeros(count, np.bool_)
            filled[np.rint(np.arctan2(points[:, 1], points[:, 0]) / step).astype(np.int64) % count] = True
            closed.append(float((filled & np.roll(filled, -1)).sum()) / max(1, int(filled.sum())))
        if np.median(closed) >= _CLOSED:
            return step
    return _BAND_STEPS[-1]


def _beams_of(clouds: Sequence[FloatArray]) -> tuple[float, float]:
    """Return the signed step [rad] between the beams of a planar lidar's clouds, and the direction of its first beam."""
    angles = [np.arctan2(cloud[:, 1], cloud[:, 0]) for cloud in clouds]
    gaps = np.concatenate([np.diff(np.sort(part)) for part in angles])
    gaps = gaps[gaps > math.radians(0.02)]
    step = min(float(np.median(gaps)), _COARSEST_STEP) if len(gaps) else math.radians(1.0)
    order = np.concatenate([np.remainder(np.diff(part) + math.pi, math.tau) - math.pi for part in angles])
    turn = 1.0 if np.median(order) >= 0.0 else -1.0
    starts = np.array([part[0] for part in angles if len(part)])
    middle = math.atan2(float(np.sin(starts).mean()), float(np.cos(starts).mean()))
    late = turn * (np.remainder(starts - middle + math.pi, math.tau) - math.pi)  # first beams may have no echo
    return turn * step, float(middle + turn * late.min())


def told_scan(stamp_ns: int, cloud: Cloud, kind: CloudKind) -> ToldScan:
    """Return a planar lidar's cloud as the scan that it is: nan where a beam has no point."""
    points = cloud.points[:, :2] * kind.unit
    count = max(2, round(math.tau / abs(kind.step)))
    distances = np.hypot(points[:, 0], points[:, 1])
    away = (np.arctan2(points[:, 1], points[:, 0]) - kind.first) / kind.step
    beams = np.rint(away).astype(np.int64) % count
    ranges = np.full(count, np.inf)
    np.minimum.at(ranges, beams, np.where(distances > 0.0, distances, np.inf))
    ranges[np.isinf(ranges)] = np.nan
    increment, delay = 0.0, 0.0
    if kind.times is not None and cloud.times is not None and len(beams) > 2:
        near = distances <= CLOUD_RANGE_MAX  # a point that is none lies in a direction of its own
        if near.sum() > 2:
            increment, delay = _line(beams[near], kind.times.seconds(cloud.times, stamp_ns)[near])
    single: Float32Array = ranges.astype(np.float32)
    return ToldScan(
        stamp_ns=stamp_ns + round(delay * 1e9),
        ranges=single,
        angle_min=kind.first,
        angle_max=kind.first + (count - 1) * kind.step,
        angle_increment=kind.step,
        time_increment=increment,
        range_max=CLOUD_RANGE_MAX,
    )


def _line(beams: np.ndarray, seconds: FloatArray) -> tuple[float, float]:
    """Return the time [s] between two beams, and that of beam 0, by a line through the points' times."""
    slope, start = np.polyfit(beams.astype(np.float64), seconds, 1)
    return float(slope), float(start)


@dataclass(slots=True)
class CloudBand:
    """The band of heights of one topic's clouds that becomes scans.

    - `base_from_sensor` (4, 4); `low` and `high` [m] over the base; `track` puts points right by their times.
    - `below`, `above`, `inside`: points so far outside the band, and in it.
    """

    base_from_sensor: FloatArray
    low: float
    high: float
    kind: CloudKind
    track: OdometryInterpolation | None = None
    below: int = 0
    above: int = 0
    inside: int = 0

    def scan(self, stamp_ns: int, cloud: Cloud) -> Scan:
        """Return the nearest points in the band by direction, as a level scan at the sensor's position, in axes of the base."""
        matrix = self.base_from_sensor
        in_base = cloud.points * self.kind.unit @ matrix[:3, :3].T + matrix[:3, 3]
        self._put_right(in_base, stamp_ns, cloud)
        low, high = in_base[:, 2] < self.low, in_base[:, 2] > self.high
        inside = ~(low | high)
        self.below, self.above = self.below + int(low.sum()), self.above + int(high.sum())
        self.inside += int(inside.sum())
        flat = in_base[:, :2] - matrix[:2, 3]
        return scan_from_points(
            stamp_ns=stamp_ns,
            hits=flat[inside],
            misses=flat[~inside],
            step=self.kind.step,
            range_min=CLOUD_RANGE_MIN,
            range_max=CLOUD_RANGE_MAX,
        )

    def _put_right(self, in_base: FloatArray, stamp_ns: int, cloud: Cloud) -> None:
        """Move points (N, 3) to where they were seen from the base at the stamp."""
        if self.track is None or self.kind.times is None or cloud.times is None or not len(in_base):
            return
        seconds = self.kind.times.seconds(cloud.times, stamp_ns)
        stamps = stamp_ns + np.rint(seconds * 1e9).astype(np.int64)
        poses = compose(invert(self.track.at(np.array([stamp_ns]))), self.track.at(stamps))
        poses[:, 2] = np.remainder(poses[:, 2] + math.pi, math.tau) - math.pi
        moved = compose(poses, np.column_stack([in_base[:, :2], np.zeros(len(in_base))]))
        in_base[:, :2] = moved[:, :2]

    def outside(self) -> str:
        """Return where the points lie if none is in the band, else an empty text."""
        total = self.below + self.above
        if self.inside or not total:
            return ""
        if self.below == total:
            return f"all points lie below {self.low:g} m over the base"
        if self.above == total:
            return f"all points lie above {self.high:g} m over the base"
        return f"no point lies from {self.low:g} to {self.high:g} m over the base"


def height_over_floor(sample: Sequence[tuple[int, Cloud]], unit: float) -> float | None:
    """Return the height [m] of a sensor without a known mount over the floor that its clouds show; None without a floor."""
    heights = np.concatenate([cloud.points[:, 2] for _, cloud in sample] or [np.zeros(0)]) * unit
    if len(heights) < 100:
        return None
    counts, edges = np.histogram(heights, bins=np.arange(-_FLOOR[1], -_FLOOR[0] + 0.05, 0.05))
    floors = np.flatnonzero(counts >= _LEAST_FLOOR * len(heights))
    if not len(floors):
        return None
    lowest = int(floors[0])
    within = heights[(heights >= edges[lowest]) & (heights < edges[min(lowest + 2, len(edges) - 1)])]
    return -float(np.median(within))
