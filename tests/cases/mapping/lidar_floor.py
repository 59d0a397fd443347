"""A small floor driven once with a lidar that sweeps as the chair moves, as bags of scans or of point clouds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.bags import SECOND, Bag
from waychair.recordings.recording import Recording
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.types import FloatArray

START = 1_690_000_000 * SECOND
MOUNT = (0.15, 0.0)
"""The lidar's place on the base [m]."""

_ROOMS = (  # corner and opposite corner [m] of boxes, seen from inside or from outside
    (-1.0, -1.1, 9.2, 8.0),
    (-1.0, 1.1, 3.1, 8.0),
    (3.7, 1.1, 6.8, 8.0),
    (1.2, -1.1, 2.0, -0.75),
    (4.4, -1.1, 4.9, -0.6),
    (7.3, 3.2, 6.8, 4.0),
    (9.2, 5.2, 8.8, 6.1),
    (-1.0, 0.2, -0.6, 0.7),
)
_LEGS = ((6.4, 0.0), (0.0, math.pi / 2), (4.2, 0.0))  # metres ahead, radians to the left
_V, _OMEGA, _REST, _STEP = 0.8, 0.8, 0.6, 0.01  # m/s, rad/s, s at either end, s


@dataclass(frozen=True, slots=True)
class Lidar:
    """A lidar of `beams` over `view` [rad] from `first`; a beam beyond `reach` [m] gives `nothing`."""

    beams: int = 240
    first: float = -math.pi
    view: float = math.tau
    period: float = 0.2
    reach: float = 12.0
    nothing: float = math.inf
    noise: float = 0.01

    @property
    def step(self) -> float:
        return self.view / self.beams


def walls(*more: tuple[float, float, float, float]) -> FloatArray:
    """The sides (N, 4) of the floor's boxes, and of more of them."""
    sides = []
    for x0, y0, x1, y1 in (*_ROOMS, *more):
        sides += [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]
    return np.array(sides)


def seen(sides: FloatArray, places: FloatArray, angles: FloatArray) -> FloatArray:
    """The distance (N,) of the nearest side from places (N, 2) in directions (N,)."""
    start, along = sides[:, :2], sides[:, 2:] - sides[:, :2]
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    to = start[None] - places[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = ray[:, None, 0] * along[None, :, 1] - ray[:, None, 1] * along[None, :, 0]
        far = (to[..., 0] * along[None, :, 1] - to[..., 1] * along[None, :, 0]) / cross
        part = (to[..., 0] * ray[:, None, 1] - to[..., 1] * ray[:, None, 0]) / cross
        hit = (far > 1e-6) & (part >= 0.0) & (part <= 1.0)
    return np.where(hit, far, np.inf).min(axis=1)


class Drive:
    """The poses of the base over time: legs ahead and turns on the spot, smooth in between."""

    def __init__(self, legs: tuple[tuple[float, float], ...] = _LEGS) -> None:
        rows = [np.zeros(3)] * round(_REST / _STEP)
        for ahead, turn in legs:
            steps = max(round(max(ahead / _V, abs(turn) / _OMEGA) / _STEP), 1)
            ramp = 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, steps + 1)[1:])
            x, y, theta = rows[-1]
            rows += [
                np.array([x + ahead * part * math.cos(theta), y + ahead * part * math.sin(theta), theta + turn * part])
                for part in ramp
            ]
        rows += [rows[-1]] * round(_REST / _STEP)
        self._poses = np.array(rows)
        self.seconds = _STEP * (len(rows) - 1)

    def at(self, seconds: FloatArray) -> FloatArray:
        """The poses (N, 3) at times (N,) [s]."""
        times = _STEP * np.arange(len(self._poses))
        return np.stack([np.interp(seconds, times, column) for column in self._poses.T], axis=1)


def sweeps(drive: Drive, lidar: Lidar, sides: FloatArray) -> Iterator[tuple[float, FloatArray]]:
    """The time [s] and the ranges of each sweep; each beam is measured at its own time."""
    rng = np.random.default_rng(11)
    angles, later = (
        lidar.first + lidar.step * np.arange(lidar.beams),
        lidar.period / lidar.beams * np.arange(lidar.beams),
    )
    for begin in np.arange(0.02, drive.seconds - lidar.period, lidar.period):
        base = drive.at(begin + later)
        c, s = np.cos(base[:, 2]), np.sin(base[:, 2])
        places = base[:, :2] + np.stack([c * MOUNT[0] - s * MOUNT[1], s * MOUNT[0] + c * MOUNT[1]], axis=1)
        ranges = seen(sides, places, angles + base[:, 2]) + lidar.noise * rng.standard_normal(lidar.beams)
        yield float(begin), np.where(ranges > lidar.reach, lidar.nothing, ranges)


Change = Callable[[int, dict[str, Any]], dict[str, Any]]


def write_scans(
    path: Path,
    change: Change | None = None,
    lidar: Lidar | None = None,
    drive: Drive | None = None,
    sides: FloatArray | None = None,
    *,
    odometry: bool = True,
) -> Drive:
    """Write a bag whose LaserScans are sound but for `change`, which gets the number and the fields of each."""
    lidar, drive = lidar or Lidar(), drive or Drive()
    bag = Bag(path)
    bag.mount(START, ("base_link", "laser", (*MOUNT, 0.0), (0.0, 0.0, 0.0, 1.0)))
    if odometry:
        _write_odometry(bag, drive)
    for number, (begin, ranges) in enumerate(sweeps(drive, lidar, walls() if sides is None else sides)):
        fields: dict[str, Any] = {
            "angle_min": lidar.first,
            "angle_max": lidar.first + lidar.step * (lidar.beams - 1),
            "angle_increment": lidar.step,
            "time_increment": lidar.period / lidar.beams,
            "scan_time": lidar.period,
            "range_min": 0.1,
            "range_max": lidar.reach,
            "ranges": ranges,
        }
        fields = fields if change is None else change(number, fields)
        stamp = START + round(begin * SECOND)
        fields["ranges"] = np.asarray(fields["ranges"], np.float32)
        message = bag.types["sensor_msgs/msg/LaserScan"](
            header=bag.header(stamp, "laser"), intensities=np.zeros(0, np.float32), **fields
        )
        bag.put("/scan", stamp + round(1.05 * lidar.period * SECOND), message)
    bag.close()
    return drive


@dataclass(frozen=True, slots=True)
class PointTime:
    """A cloud's time field: its name, its PointField type and numpy kind, and its value from seconds after the stamp [s] and the stamp [s]."""

    name: str
    code: int
    kind: str
    value: Callable[[FloatArray, float], FloatArray]


def write_clouds(
    path: Path,
    elevations: tuple[float, ...] = (0.0,),
    time: PointTime | None = None,
    height: float | None = None,
    *,
    change: Callable[[int, Any], None] | None = None,
    scale: float = 1.0,
    beams: int = 240,
    over_floor: float = math.inf,
    odometry: bool = True,
) -> Drive:
    """Write a bag of point clouds of one ring for each elevation [rad]; without a `height` [m] no /tf tells the mount."""
    drive, bag, lidar = Drive(), Bag(path), Lidar(beams=beams)
    if height is not None:
        bag.mount(START, ("base_link", "lidar", (*MOUNT, height), (0.0, 0.0, 0.0, 1.0)))
    if odometry:
        _write_odometry(bag, drive)
    names = ["x", "y", "z"] + ([time.name] if time else [])
    kinds = ["<f4"] * 3 + (["<" + time.kind] if time else [])
    layout = np.dtype(list(zip(names, kinds, strict=True)))
    codes = [7, 7, 7] + ([time.code] if time else [])
    field = bag.types["sensor_msgs/msg/PointField"]
    declared = [field(name, layout.fields[name][1], code, 1) for name, code in zip(names, codes, strict=True)]  # type: ignore[index]
    angles, later = lidar.first + lidar.step * np.arange(beams), lidar.period / beams * np.arange(beams)
    for number, (begin, ranges) in enumerate(sweeps(drive, lidar, walls())):
        rings = []
        for elevation in elevations:
            far = np.minimum(ranges, over_floor / math.tan(-elevation)) if elevation < 0.0 else ranges
            rings.append(
                np.stack([far * np.cos(angles), far * np.sin(angles), far * math.tan(elevation), later], axis=1)
            )
        points = np.stack(rings, axis=1).reshape(-1, 4)
        points = points[np.isfinite(points).all(axis=1)]
        records = np.zeros(len(points), layout)
        for name, column in zip("xyz", points.T, strict=False):
            records[name] = column * scale
        if time is not None:
            records[time.name] = time.value(points[:, 3], START / SECOND + begin)
        stamp = START + round(begin * SECOND)
        message = bag.types["sensor_msgs/msg/PointCloud2"](
            bag.header(stamp, "lidar"), 1, len(points), declared, False, layout.itemsize, layout.itemsize * len(points),
            records.view(np.uint8).ravel(), True,
        )  # fmt: skip
        if change is not None:
            change(number, message)
        bag.put("/cloud", stamp + round(1.05 * lidar.period * SECOND), message)
    bag.close()
    return drive


def _write_odometry(bag: Bag, drive: Drive) -> None:
    """Wheels that measure one percent too long."""
    make = bag.types
    for seconds in np.arange(0.0, drive.seconds, 0.05).tolist():
        (x, y, theta), before = drive.at(np.array([seconds]))[0], drive.at(np.array([max(0.0, seconds - 0.05)]))[0]
        stamp = START + round(seconds * SECOND)
        turn = make["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2))
        pose = make["geometry_msgs/msg/Pose"](make["geometry_msgs/msg/Point"](1.01 * x, 1.01 * y, 0.0), turn)
        vector = make["geometry_msgs/msg/Vector3"]
        speed = 1.01 * math.hypot(x - before[0], y - before[1]) / 0.05
        twist = make["geometry_msgs/msg/Twist"](vector(speed, 0.0, 0.0), vector(0.0, 0.0, (theta - before[2]) / 0.05))
        message = make["nav_msgs/msg/Odometry"](
            bag.header(stamp, "odom"),
            "base_link",
            make["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            make["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        )
        bag.put("/odom", stamp, message)


def mapped_error(recording: Recording, drive: Drive, base_from_laser: tuple[float, float] = (0.0, 0.0)) -> float:
    """The RMSE [m] of the mapped positions, of the base or of a place on it, aligned with the true ones."""
    mapper = Mapper(MapperSettings(), recording.base_from_laser)
    for frame in recording.frames:
        mapper.process(frame)
    trajectory = mapper.result().trajectory
    truth = drive.at((trajectory.stamps_ns - START) / SECOND)
    x, y = base_from_laser
    c, s = np.cos(truth[:, 2]), np.sin(truth[:, 2])
    true = truth[:, :2] + np.stack([c * x - s * y, s * x + c * y], axis=1)
    mapped = trajectory.poses[:, :2]
    a, b = mapped - mapped.mean(axis=0), true - true.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1.0, np.linalg.det(u @ v)]) @ v
    return float(np.sqrt(((a @ turn - b) ** 2).sum(axis=1).mean()))


def replaced(**fields: Any) -> Change:
    """A change of every message: a field becomes a value, or the result of a function of it."""

    def change(number: int, told: dict[str, Any]) -> dict[str, Any]:
        return {**told, **{name: value(told[name]) if callable(value) else value for name, value in fields.items()}}

    return change


def only(which: int, change: Change) -> Change:
    """A change of one message."""
    return lambda number, told: change(number, told) if number == which else told


def short_sighted(nothing: float) -> Lidar:
    """A lidar that reaches 3 m and gives `nothing` beyond."""
    return replace(Lidar(), reach=3.0, nothing=nothing)
