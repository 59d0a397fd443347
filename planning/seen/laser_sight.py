"""What a camera on servos sees by its laser's line: points in base, or a fault in one sentence and no point at all.

Four faults are told: the servos report no angles, the lens is covered, the line is missing on things that other sensors see near, and the camera
looks elsewhere than its servos report. The last shows in the pictures, which must move by as much as the servos say,
and in the line itself, which must agree with other ranges. A camera at a constant wrong angle on a chair without other
ranges is not noticed: nothing there contradicts it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from waychair.calibration.servo_camera_mount import SERVO_CAMERA, ServoCameraMount
from waychair.geometry import transform_points, wrap_angle
from waychair.planning.seen.laser_line import LaserPlane, points_of_line
from waychair.planning.seen.laser_picture import line_in_light, line_in_picture, redness, rows_of_ranges
from waychair.planning.seen.range_views import RangeView
from waychair.types import Bytes, Float32Array, FloatArray, PanTiltAngles, Picture, Pose2

NEAREST, FARTHEST = 0.25, 10.0
"""m; depths at which the line is searched: nearer it leaves the picture, farther it is too faint even at rest."""

VAGUE, SURELY = 0.30, 2.0
"""m, sigmas; a point whose error is larger shows no surface any more, only that the beam goes on to so many sigmas before
it."""

MOST_PAIRS = 4
"""Pairs of a lit and a dark picture that are averaged while chair and camera rest: at 10 pictures a second 0.8 s."""

FRESH_NS = 300_000_000
"""A dark picture serves for this time."""

MOVED, TURNED = 0.005, math.radians(0.2)
"""m, rad; a chair that moved more between two pictures shows other pixels: the line is then sought in one alone."""

COVERED_LEVEL, COVERED_SPREAD = 60.0, 12.0
"""Grey levels: a picture that is darker than this and shows nothing but noise is that of a covered lens."""

BLIND = 4
"""Pictures with the laser on, but without a line on something near, after which the laser is doubted."""

SEEN_BY_OTHERS = 2.5
"""m; the line is expected on what other sensors see within this distance, in the middle of the picture."""

BESIDE = math.radians(5.0)
"""rad; a camera that looks this far beside its reported angle is at fault."""

AGREES, BEST, BETTER = 0.75, 0.9, 0.2
"""Parts of the line's points that other ranges bear out: from the first on the reported angle is right; it is wrong if
another angle has the second, and the third more than it."""

ALIKE = 0.7
"""Correlation from which two pictures show the same."""

_SAME = 0.12
"""m; two ranges in one direction that agree."""

_SMALL = (160, 120)
_NOTHING = np.zeros((0, 3))

DARK = "the camera on the servos sees nothing but darkness: see whether its lens is covered"

SILENT = "the servos of the camera do not report their angles: see their cable"


@dataclass(frozen=True, slots=True)
class LaserSight:
    """One look by the laser's line. With a `fault` there are no points.

    `points` (N, 3) [m] in base and their `errors` (N,) [m], one sigma along the ray; `columns` and `rows` (N,) [pixels] of
    the line; `camera` is the camera's pose in the plane.
    """

    angles: PanTiltAngles
    camera: Pose2
    points: FloatArray = field(default_factory=lambda: _NOTHING)
    errors: FloatArray = field(default_factory=lambda: np.zeros(0))
    columns: FloatArray = field(default_factory=lambda: np.zeros(0))
    rows: FloatArray = field(default_factory=lambda: np.zeros(0))
    fault: str = ""

    def view(self) -> RangeView:
        """Return the beams of this look, in base: each ends at a point of the line, or goes on at least to there."""
        order = np.argsort(-self.columns)
        origin = np.array([self.camera.x, self.camera.y])
        return line_view(origin, self.points[order, :2], self.errors[order])


def line_view(origin: FloatArray, ends: FloatArray, errors: FloatArray) -> RangeView:
    """Return the beams from `origin` (2,) to lit points (N, 2) [m] with their errors (N,) [m], in order to the left.

    Points with too large an error tell only how far their beam goes on at the least.
    """
    met = errors <= VAGUE
    away = np.hypot(*(ends - origin).T)
    known = np.where(met, away, np.maximum(away - SURELY * errors, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return RangeView(origin, origin + (ends - origin) * (known / away)[:, None], met)


@dataclass(frozen=True, slots=True)
class _Light:
    """The sums of the red light in lit and in dark pictures of one rest, and how many pictures each sum holds."""

    lit: Float32Array | None = None
    dark: Float32Array | None = None
    lits: float = 0.0
    darks: float = 0.0

    def with_picture(self, red: Float32Array, laser: bool) -> _Light:
        """Return the light with one picture more; earlier ones fade once there are enough."""
        before, count = (self.lit, self.lits) if laser else (self.dark, self.darks)
        kept = min(count, MOST_PAIRS - 1.0)
        total = red if before is None else red + before * np.float32(kept / count)
        if laser:
            return replace(self, lit=total, lits=kept + 1.0)
        return replace(self, dark=total, darks=kept + 1.0)

    def added(self) -> Float32Array | None:
        """Return the mean light that the laser adds; None without pictures of both kinds."""
        if self.lit is None or self.dark is None:
            return None
        return self.lit / np.float32(self.lits) - self.dark / np.float32(self.darks)


@dataclass(frozen=True, slots=True)
class _Still:
    """A dark picture of a camera at rest: its stamp, the reported pan, the chair's pose and the small picture."""

    picture: Picture
    pan: float
    tilt: float
    odom_from_base: Pose2
    small: Float32Array


@dataclass(frozen=True, slots=True)
class SightMemory:
    """What a look keeps for the next one; `aim_fault` stays until the pictures or the ranges bear the angle out."""

    still: _Still | None = None
    light: _Light = field(default_factory=_Light)
    blind: int = 0
    blind_fault: str = ""
    aim_fault: str = ""

    @property
    def fault(self) -> str:
        """The fault that still holds; empty: none."""
        return self.aim_fault or self.blind_fault


def look(
    picture: Picture,
    angles: PanTiltAngles | None,
    odom_from_base: Pose2,
    others: FloatArray | None,
    memory: SightMemory,
    mount: ServoCameraMount = SERVO_CAMERA,
) -> tuple[LaserSight | None, SightMemory]:
    """Return the sight of the line in a picture; None while the camera turns, or in a picture without the line.

    Args:
        picture: one picture of the camera.
        angles: the servos' report at the same moment; None: they are silent.
        odom_from_base: the chair's pose at that moment.
        others: points (M, 2) [m] in base that other range sensors see now; None: there are none.
        memory: what the last look returned.
    """
    if angles is None or not (math.isfinite(angles.pan) and math.isfinite(angles.tilt)):
        unknown = PanTiltAngles(picture.stamp_ns, math.nan, math.nan, settled=False)
        return LaserSight(unknown, Pose2(mount.forward, mount.left), fault=SILENT), SightMemory()
    camera = Pose2(mount.forward, mount.left, wrap_angle(angles.pan))
    if _is_covered(picture.image):
        return LaserSight(angles, camera, fault=DARK), replace(memory, still=None)
    if not angles.settled:
        return None, memory
    if not picture.laser:
        still = _Still(picture, angles.pan, angles.tilt, odom_from_base, _small(picture.image))
        fault = _aim_fault_by_pictures(memory, still, mount)
        told = LaserSight(angles, camera, fault=fault) if fault else None
        light = memory.light if _at_rest(picture, angles, odom_from_base, memory.still) else _Light()
        light = light.with_picture(redness(picture.image, _rows(picture, mount)), laser=False)
        return told, replace(memory, still=still, light=light, aim_fault=fault)
    light = _Light()
    if _at_rest(picture, angles, odom_from_base, memory.still):
        light = memory.light.with_picture(redness(picture.image, _rows(picture, mount)), laser=True)
    sight = _line_sight(picture, angles, camera, light, mount)
    memory = _with_ranges(replace(memory, light=light), sight, others)
    blind = memory.blind + 1 if not len(sight.points) and _something_near(others, camera, mount) else 0
    memory = replace(memory, blind=blind, blind_fault=_no_line(others, camera) if blind >= BLIND else "")
    return (LaserSight(angles, camera, fault=memory.fault) if memory.fault else sight), memory


def _is_covered(image: Bytes) -> bool:
    blocks = cv2.resize(image, (40, 30), interpolation=cv2.INTER_AREA).mean(axis=2)
    low, high = np.percentile(blocks, [5, 95])
    return bool(blocks.mean() < COVERED_LEVEL and high - low < COVERED_SPREAD)


def _small(image: Bytes) -> Float32Array:
    return np.asarray(
        cv2.cvtColor(cv2.resize(image, _SMALL, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY), np.float32
    )


def _at_rest(picture: Picture, angles: PanTiltAngles, odom_from_base: Pose2, still: _Still | None) -> bool:
    """Return whether chair and camera have not moved since the last dark picture, a short while ago."""
    if still is None or not 0 <= picture.stamp_ns - still.picture.stamp_ns <= FRESH_NS:
        return False
    step = still.odom_from_base.inverse() @ odom_from_base
    moved = math.hypot(step.x, step.y) > MOVED or abs(step.theta) > TURNED
    turned = abs(angles.pan - still.pan) > 1e-6 or abs(angles.tilt - still.tilt) > 1e-6
    return not moved and not turned and still.picture.image.shape == picture.image.shape


def _rows(picture: Picture, mount: ServoCameraMount) -> tuple[int, int]:
    matrix = picture.camera_matrix
    return rows_of_ranges(NEAREST, FARTHEST, float(matrix[1, 1]), float(matrix[1, 2]), mount.baseline)


def _line_sight(
    picture: Picture, angles: PanTiltAngles, camera: Pose2, light: _Light, mount: ServoCameraMount
) -> LaserSight:
    """Return the look by the light that the laser adds, or by the one picture where there is no dark one like it."""
    matrix, rows, added = picture.camera_matrix, _rows(picture, mount), light.added()
    if added is None:
        line = line_in_picture(picture.image, None, rows)
    else:
        line = line_in_light(added, min(light.lits, light.darks), rows)
    pixels = line.pixels()
    found = points_of_line(pixels, matrix, LaserPlane(np.array([0.0, 1.0, 0.0]), mount.baseline))
    kept = np.isfinite(found.errors) & (found.points[:, 2] <= FARTHEST)
    pose = mount.base_from_camera(angles.pan, angles.tilt)
    points = found.points[kept] @ pose.rotation.T + pose.translation
    return LaserSight(angles, camera, points, found.errors[kept], pixels[kept, 0], pixels[kept, 1])


def _something_near(others: FloatArray | None, camera: Pose2, mount: ServoCameraMount) -> bool:
    """Return whether other sensors see something near in the middle half of the picture."""
    if others is None or not len(others):
        return False
    ahead = transform_points(camera.inverse(), others)
    half = 0.5 * mount.camera_matrix[0, 2] / mount.focal
    near = (ahead[:, 0] > 2 * NEAREST) & (ahead[:, 0] < SEEN_BY_OTHERS) & (np.abs(ahead[:, 1]) < half * ahead[:, 0])
    return int(near.sum()) >= 5


def _no_line(others: FloatArray | None, camera: Pose2) -> str:
    assert others is not None  # otherwise nothing was near
    away = float(np.hypot(*(others - [camera.x, camera.y]).T).min())
    return (
        f"the laser's line is not seen although something stands {away:.1f} m from the camera: the laser is off or "
        "covered, the light is too bright, or the thing is black or of glass"
    )


def _aim_fault_by_pictures(memory: SightMemory, still: _Still, mount: ServoCameraMount) -> str:
    """Return the fault if the picture has moved by another angle than the servos report; else the fault as it was.

    The earlier picture is turned by the reported angle, by none, and by others: the right angle makes both alike.
    """
    before = memory.still
    if before is None or abs(before.tilt - still.tilt) > math.radians(0.5):
        return memory.aim_fault
    step = before.odom_from_base.inverse() @ still.odom_from_base
    if math.hypot(step.x, step.y) > 0.02:
        return memory.aim_fault
    told = wrap_angle(still.pan - before.pan)
    if abs(told) < BESIDE:
        return memory.aim_fault
    angles = [told, *(k * BESIDE for k in range(-8, 9))]
    alike = [_alike(before.small, still.small, angle + step.theta, mount) for angle in angles]
    best = int(np.argmax(alike))
    if alike[0] >= ALIKE and alike[best] - alike[0] < 0.1:
        return ""
    if alike[best] < ALIKE or abs(wrap_angle(angles[best] - told)) < BESIDE or alike[best] - alike[0] < 0.2:
        return memory.aim_fault
    if abs(angles[best]) < BESIDE / 2:
        return (
            f"the camera's pan servo reports a turn by {math.degrees(told):.0f} degrees, but the picture has not moved: "
            "the servo is stuck and its report is wrong"
        )
    return (
        f"the camera's pan servo reports a turn by {math.degrees(told):.0f} degrees, but the picture moved by "
        f"{math.degrees(angles[best]):.0f}: its report is wrong"
    )


def _alike(before: Float32Array, after: Float32Array, turn: float, mount: ServoCameraMount) -> float:
    """Return the correlation of two small pictures after the earlier one is turned to the left by an angle [rad].

    0 where they share less than a quarter of their columns, or show nothing.
    """
    scale = _SMALL[0] / (2 * mount.camera_matrix[0, 2] + 1)
    columns = (np.arange(_SMALL[0]) + 0.5) / scale - 0.5
    seen = np.arctan((columns - mount.camera_matrix[0, 2]) / mount.focal)  # to the right
    there = (np.tan(seen - turn) * mount.focal + mount.camera_matrix[0, 2] + 0.5) * scale - 0.5
    inside = (there >= 0.0) & (there <= _SMALL[0] - 1) & (np.abs(seen - turn) < 1.2)
    if inside.sum() < _SMALL[0] // 4:
        return 0.0
    rows = np.arange(30, 90)  # the middle, where a turn moves the picture sideways only
    at = there[inside]
    left = np.clip(at.astype(np.int64), 0, _SMALL[0] - 2)
    part = (at - left).astype(np.float32)
    turned = before[rows][:, left] * (1 - part) + before[rows][:, left + 1] * part
    now = after[rows][:, inside]
    a, b = turned - turned.mean(), now - now.mean()
    size = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / size if size > 2.0 * a.size else 0.0


def _with_ranges(memory: SightMemory, sight: LaserSight, others: FloatArray | None) -> SightMemory:
    """Return the memory with the aim's fault found, or taken back, by comparing the line with other ranges."""
    if others is None or len(sight.points) < 40:
        return memory
    line, rest = sight.points[:, :2] - [sight.camera.x, sight.camera.y], others - [sight.camera.x, sight.camera.y]
    nearest = _ranges_by_bearing(rest)
    bearings, metres = np.arctan2(line[:, 1], line[:, 0]), np.hypot(line[:, 0], line[:, 1])
    at = np.floor(np.degrees(bearings)).astype(int)
    shares = []
    for offset in range(360):
        told = nearest[(at + offset) % 360]
        known = np.isfinite(told)
        agree = known & (np.abs(told - metres) < _SAME)
        shares.append(float(agree.sum()) / len(at) if known.mean() > 0.5 else 0.0)
    best = int(np.argmax(shares))
    here = max(shares[k] for k in (-2, -1, 0, 1, 2))
    off = math.remainder(math.radians(best), math.tau)
    if shares[best] >= BEST and shares[best] - here >= BETTER and abs(off) >= BESIDE:
        fault = (
            f"the camera looks about {math.degrees(abs(off)):.0f} degrees to the {'left' if off > 0 else 'right'} of the "
            "angle that its pan servo reports: the line shows things where other sensors see none"
        )
        return replace(memory, aim_fault=fault)
    return replace(memory, aim_fault="") if here >= AGREES else memory


def _ranges_by_bearing(points: FloatArray) -> FloatArray:
    """Return the nearest range (360,) [m] in each degree from -180 on, as index modulo 360; nan where there is none."""
    nearest = np.full(360, np.inf)
    at = np.floor(np.degrees(np.arctan2(points[:, 1], points[:, 0]))).astype(int) % 360
    np.minimum.at(nearest, at, np.hypot(points[:, 0], points[:, 1]))
    return np.where(np.isfinite(nearest), nearest, np.nan)
