"""Detection of a door's two jambs in the live scan, to the centimetre and independent of map and localisation.

A map's cells are centimetres wide and the localised pose wanders by as much, but a door of 0.80 m leaves a chair of
0.70 m only 5 cm on each side. The wall on both sides gives the direction, a line through hundreds of points. The jambs'
edges give the middle, because blur affects both edges alike. Scans are averaged in odom, which never jumps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import interpolate, transform_points
from waychair.types import FloatArray, Pose2


@dataclass(frozen=True, slots=True)
class DoorwaySettings(Settings):
    """The search area of a door, and the conditions for trusting a detection."""

    off: float = setting(0.25, "m", "a jamb may be this far from where the map has it", low=0.05, high=1.0)
    turned: float = setting(0.2, "rad", "the wall may be turned by this much against the map", low=0.02, high=1.0)
    wall: float = setting(0.5, "m", "wall beside the opening that gives the direction", low=0.1, high=2.0)
    least: int = setting(6, "", "points that an edge and a wall consist of", low=2, high=1000)
    memory: int = setting(8, "scans", "averaged over about so many", low=1, high=100)
    seen: int = setting(3, "scans", "in which it must have been found before it is believed", low=1, high=100)
    nearest: float = setting(
        0.25,
        "m",
        "from nearer before it the wall is seen at too flat an angle to tell its direction",
        low=0.0,
        high=1.0,
    )
    surprise: float = setting(0.08, "m", "one found farther from the average is not believed", low=0.01, high=1.0)


@dataclass(frozen=True, slots=True)
class Doorway:
    """A door found in one scan: its pose in the frame of the points, and its clear width [m]."""

    pose: Pose2
    width: float


def find_doorway(
    points: FloatArray, door: Pose2, width: float, settings: DoorwaySettings = DoorwaySettings()
) -> Doorway | None:
    """Return the door's middle and direction from one scan's points (N, 2) [m], near its expected pose `door`.

    Points and `door` (x leads through it) are in one frame; `width` [m] is the map's clear width. The chair sees the
    near face only, so the middle keeps the expected place along the door's x. None if the jambs are not both in view,
    or the opening's width is far from the map's.
    """
    local = transform_points(door.inverse(), points)
    half = width / 2
    near = local[
        (np.abs(local[:, 0]) < settings.off + 0.1) & (np.abs(local[:, 1]) < half + settings.off + settings.wall)
    ]
    sides = []
    for side in (1.0, -1.0):
        out = near[side * near[:, 1] > half - settings.off]
        if len(out) < 2 * settings.least:
            return None
        inner = np.partition(side * out[:, 1], settings.least // 2)[settings.least // 2]
        if inner > half + settings.off:
            return None
        sides.append((out, inner))
    turn = _direction([out for out, _ in sides], [inner for _, inner in sides], settings)
    if turn is None:
        return None
    # The jambs' edges across the door's true direction.
    across = np.array([-math.sin(turn), math.cos(turn)])
    edges = []
    for side, (out, _) in zip((1.0, -1.0), sides, strict=True):
        off = np.sort(side * (out @ across))
        edge = off[off < off[settings.least // 2] + 0.03]  # the jamb's inner face, or the end of the wall
        edges.append(side * float(np.percentile(edge, 25)))
    left, right = edges
    if abs(left - right - width) > settings.off:
        return None
    middle = across * (left + right) / 2
    return Doorway(door @ Pose2(float(middle[0]), float(middle[1]), turn), left - right)


def _direction(sides: list[FloatArray], inner: list[float], settings: DoorwaySettings) -> float | None:
    """Return the door's turn [rad] against its expected direction, from a line through both walls' near faces.

    On each side only points beyond the edge and on the near face count: the foremost ones, within noise and the wall's
    greatest turn.
    """
    faces = []
    for points, edge in zip(sides, inner, strict=True):
        face = points[np.abs(points[:, 1]) > edge + 0.02]
        if len(face) < settings.least:
            return None
        faces.append(face)
    slope = 0.0
    wall = np.concatenate(faces)
    within = np.ones(len(wall), np.bool_)
    foremost = min(float(np.percentile(face[:, 0], 20)) for face in faces)
    within = np.abs(wall[:, 0] - foremost) < 0.05 + settings.turned * np.abs(wall[:, 1])
    for width in (0.04, 0.025):
        if within.sum() < 2 * settings.least or min((within & (s * wall[:, 1] > 0)).sum() for s in (1, -1)) < 4:
            return None
        slope, offset = np.polyfit(wall[within, 1], wall[within, 0], 1)
        within = np.abs(wall[:, 0] - (slope * wall[:, 1] + offset)) < width
    turn = -math.atan(slope)
    return turn if abs(turn) < settings.turned else None


class DoorWatch:
    """The average of a door's pose and width over scans, in odom."""

    def __init__(self, odom_from_door: Pose2, width: float, settings: DoorwaySettings) -> None:
        self._settings = settings
        self._mapped = width
        self._found = 0
        self.odom_from_door, self.width = odom_from_door, width

    @property
    def sure(self) -> bool:
        """Whether the door was seen often enough to drive by it."""
        return self._found >= self._settings.seen

    def believe(self, odom_from_door: Pose2) -> None:
        """Take the door's pose from the map; it counts until the door is seen."""
        if self._found == 0:
            self.odom_from_door = odom_from_door

    def see(self, points: FloatArray, odom_from_laser: Pose2) -> None:
        """Take in one scan's points (N, 2) [m] in odom; a scan from within the door counts only while it is unsure."""
        before_it = -(self.odom_from_door.inverse() @ odom_from_laser).x
        if self.sure and before_it < self._settings.nearest:
            return
        found = find_doorway(points, self.odom_from_door, self._mapped, self._settings)
        before = self.odom_from_door
        if found is None or (self.sure and _apart(before, found.pose) > self._settings.surprise):
            return
        self._found += 1
        share = 1.0 / min(self._found, self._settings.memory)
        self.odom_from_door = interpolate(before, found.pose, share)
        self.width += share * (found.width - self.width)


def _apart(first: Pose2, second: Pose2) -> float:
    return math.hypot(first.x - second.x, first.y - second.y)
