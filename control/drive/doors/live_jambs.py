"""Both jambs of a door that the chair is about to pass, in the live scan: to the centimetre, without the map's blur.

Doors that nothing tells of are found by `doorway_tracker.py`.

A map's cells are centimetres wide and the localised pose wanders by as much, but a door of 0.80 m leaves a chair of
0.70 m only 5 cm on each side. The wall on both sides gives the direction, a line through hundreds of points. The jambs'
edges give the middle, because blur affects both edges alike. Scans are averaged in odom, which never jumps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.geometry import interpolate, transform_points
from waychair.types import FloatArray, Pose2

JAMB_OFF, WALL_TURNED = 0.25, 0.2
"""m, rad; largest error of a jamb's place and of the wall's direction on the map."""

WALL_LENGTH = 0.5
"""m; length of wall beside the opening that gives the direction."""

LEAST_POINTS = 6
"""Fewest points of a jamb's edge and of a wall."""

AVERAGED_SCANS, SEEN_SCANS = 8, 3
"""Scans to average a door over, and scans that must show it before it is trusted."""

NEAREST = 0.25
"""m; nearer before the door the wall is seen at too flat an angle to tell its direction."""

OUTLIER = 0.08
"""m; a detection farther than this from the average is an outlier."""


@dataclass(frozen=True, slots=True)
class LiveJambs:
    """A door found in one scan: its pose in the frame of the points, and its clear width [m]."""

    pose: Pose2
    width: float


def find_doorway(points: FloatArray, door: Pose2, width: float) -> LiveJambs | None:
    """Return the door's middle and direction from one scan's points (N, 2) [m], near its expected pose `door`.

    Points and `door` (x leads through it) are in one frame; `width` [m] is the map's clear width. The chair sees the
    near face only, so the middle keeps the expected place along the door's x. None if the jambs are not both in view,
    or the opening's width is far from the map's.
    """
    local = transform_points(door.inverse(), points)
    half = width / 2
    near = local[(np.abs(local[:, 0]) < JAMB_OFF + 0.1) & (np.abs(local[:, 1]) < half + JAMB_OFF + WALL_LENGTH)]
    sides = []
    for side in (1.0, -1.0):
        out = near[side * near[:, 1] > half - JAMB_OFF]
        if len(out) < 2 * LEAST_POINTS:
            return None
        inner = np.partition(side * out[:, 1], LEAST_POINTS // 2)[LEAST_POINTS // 2]
        if inner > half + JAMB_OFF:
            return None
        sides.append((out, inner))
    turn = _direction([out for out, _ in sides], [inner for _, inner in sides])
    if turn is None:
        return None
    # The jambs' edges across the door's true direction.
    across = np.array([-math.sin(turn), math.cos(turn)])
    edges = []
    for side, (out, _) in zip((1.0, -1.0), sides, strict=True):
        off = np.sort(side * (out @ across))
        edge = off[off < off[LEAST_POINTS // 2] + 0.03]  # the jamb's inner face, or the end of the wall
        edges.append(side * float(np.percentile(edge, 25)))
    left, right = edges
    if abs(left - right - width) > JAMB_OFF:
        return None
    middle = across * (left + right) / 2
    return LiveJambs(door @ Pose2(float(middle[0]), float(middle[1]), turn), left - right)


def _direction(sides: list[FloatArray], inner: list[float]) -> float | None:
    """Return the door's turn [rad] against its expected direction, from a line through both walls' near faces.

    On each side only points beyond the edge and on the near face count: the foremost ones, within noise and the wall's
    greatest turn.
    """
    faces = []
    for points, edge in zip(sides, inner, strict=True):
        face = points[np.abs(points[:, 1]) > edge + 0.02]
        if len(face) < LEAST_POINTS:
            return None
        faces.append(face)
    slope = 0.0
    wall = np.concatenate(faces)
    within = np.ones(len(wall), np.bool_)
    foremost = min(float(np.percentile(face[:, 0], 20)) for face in faces)
    within = np.abs(wall[:, 0] - foremost) < 0.05 + WALL_TURNED * np.abs(wall[:, 1])
    for width in (0.04, 0.025):
        if within.sum() < 2 * LEAST_POINTS or min((within & (s * wall[:, 1] > 0)).sum() for s in (1, -1)) < 4:
            return None
        slope, offset = np.polyfit(wall[within, 1], wall[within, 0], 1)
        within = np.abs(wall[:, 0] - (slope * wall[:, 1] + offset)) < width
    turn = -math.atan(slope)
    return turn if abs(turn) < WALL_TURNED else None


class DoorWatch:
    """The average of a door's pose and width over scans, in odom."""

    def __init__(self, odom_from_door: Pose2, width: float) -> None:
        self._mapped = width
        self._found = 0
        self.odom_from_door, self.width = odom_from_door, width

    @property
    def sure(self) -> bool:
        """Whether the door was seen often enough to drive by it."""
        return self._found >= SEEN_SCANS

    def believe(self, odom_from_door: Pose2) -> None:
        """Take the door's pose from the map; it counts until the door is seen."""
        if self._found == 0:
            self.odom_from_door = odom_from_door

    def see(self, points: FloatArray, odom_from_laser: Pose2) -> None:
        """Take in one scan's points (N, 2) [m] in odom; a scan from within the door counts only while it is unsure."""
        before_it = -(self.odom_from_door.inverse() @ odom_from_laser).x
        if self.sure and before_it < NEAREST:
            return
        found = find_doorway(points, self.odom_from_door, self._mapped)
        before = self.odom_from_door
        if found is None or (self.sure and _apart(before, found.pose) > OUTLIER):
            return
        self._found += 1
        share = 1.0 / min(self._found, AVERAGED_SCANS)
        self.odom_from_door = interpolate(before, found.pose, share)
        self.width += share * (found.width - self.width)


def _apart(first: Pose2, second: Pose2) -> float:
    return math.hypot(first.x - second.x, first.y - second.y)
