"""The Range finder (paper 3.3): the laser line in the picture, its range by triangulation, and the camera's aim.

The laser is a horizontal plane, parallel to the optical axis and a baseline below it; both are on the same servos. The
picture itself is searched for the line outside the network: a trace would not hold pictures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.commands import between
from waychair.control.behaviours.paper_settings import CameraLimits
from waychair.types import FloatArray, Pose2

LINE_ERROR = 0.3
"""px; one sigma of the row of a line that is found to a part of a pixel."""

_LEAST_OFFSET = 1.0
"""px; a line nearer to the horizon than this has no range."""


@dataclass(frozen=True, slots=True)
class CameraAim:
    """Angles that the servos report: pan to the left, tilt up [rad]; `settled`: they do not move."""

    pan: float
    tilt: float
    settled: bool


@dataclass(frozen=True, slots=True)
class LaserLine:
    """The line in one picture: columns and rows (K,) [px] where it was found, and the aim at that moment."""

    columns: FloatArray
    rows: FloatArray
    aim: CameraAim


@dataclass(frozen=True, slots=True)
class Depth:
    """Ranges that the laser line shows: bearings (K,) [rad] and ranges (K,) [m] in the plane from base."""

    bearings: FloatArray
    metres: FloatArray


@dataclass(frozen=True, slots=True)
class LookRequest:
    """A wish of a cell to aim the camera."""

    pan: float
    tilt: float = 0.0


OBJECT_TRACKER, DOOR_RANGE, WAY_FINDER = "Object tracker", "Range finder", "Way finder"
PRIORITY = (OBJECT_TRACKER, DOOR_RANGE, WAY_FINDER)
"""Clients of the camera, the most important first."""


@dataclass(frozen=True, slots=True)
class SensorCommand:
    """The camera's order: its client, pan and tilt [rad], whether the servos have settled there, and a fault's words."""

    client: str
    pan: float
    tilt: float = 0.0
    settled: bool = False
    fault: str = ""


@dataclass(frozen=True, slots=True)
class CameraMemory:
    """Dynamic data of the aim's check: the last trusted report and its stamp; `doubtful`: the report leapt."""

    pan: float | None = None
    stamp_ns: int = 0
    doubtful: bool = False


def triangulated(line: LaserLine, limits: CameraLimits) -> tuple[FloatArray, FloatArray]:
    """Return points (M, 2) [m] in the camera's level frame (x along its axis, y left), and one sigma (M,) of x.

    z = f b / (row - middle row); its error is z^2 sigma / (f b). The tilt is that of the line's aim; a line at or above
    the horizon has no range.
    """
    offset = np.asarray(line.rows, np.float64) - limits.middle_row
    seen = np.isfinite(offset) & (offset >= _LEAST_OFFSET) & np.isfinite(np.asarray(line.columns, np.float64))
    ahead = limits.focal * limits.baseline / offset[seen]
    aside = -ahead * (np.asarray(line.columns, np.float64)[seen] - limits.middle_column) / limits.focal
    points = np.column_stack([ahead * math.cos(line.aim.tilt), aside])
    return points, ahead**2 * LINE_ERROR / (limits.focal * limits.baseline)


def find_range(
    line: Reading[LaserLine], aim: CameraAim, constants: CameraLimits, dynamic: CameraMemory, now_ns: int
) -> tuple[Depth | None, CameraMemory]:
    """Return what the line shows; None while the camera moves, or where its reported angle cannot be believed.

    A report that leaps faster than a servo can turn is doubted until two in a row agree.
    """
    memory = _checked(aim, constants, dynamic, now_ns)
    taken = line.value.aim
    steady = aim.settled and taken.settled and between(taken.pan, aim.pan) <= constants.aimed
    if memory.doubtful or not steady:
        return None, memory
    points, _ = triangulated(line.value, constants)
    if not len(points):
        return None, memory
    camera = Pose2(constants.forward, constants.left, aim.pan)
    c, s = math.cos(camera.theta), math.sin(camera.theta)
    x = camera.x + c * points[:, 0] - s * points[:, 1]
    y = camera.y + s * points[:, 0] + c * points[:, 1]
    return Depth(np.arctan2(y, x), np.hypot(x, y)), memory


def _checked(aim: CameraAim, limits: CameraLimits, memory: CameraMemory, now_ns: int) -> CameraMemory:
    if not (math.isfinite(aim.pan) and math.isfinite(aim.tilt)):
        return CameraMemory(memory.pan, memory.stamp_ns, doubtful=True)
    if memory.pan is None:
        return CameraMemory(aim.pan, now_ns)
    seconds = max(now_ns - memory.stamp_ns, 1) * 1e-9
    leapt = abs(aim.pan - memory.pan) > limits.fastest * seconds + limits.aimed
    return CameraMemory(aim.pan, now_ns, doubtful=leapt)
