"""Planar geometry on arrays: poses (..., 3) float64 [m, m, rad], points (..., 2) [m], transforms `a_from_b`."""

from __future__ import annotations

import math

import numpy as np

from waychair.types import FloatArray, Pose2, Pose3

MAX_COORDINATE = 1e6
"""Largest coordinate on a map [m]. Beyond it float32 cannot tell cells of a few centimetres apart."""

MAX_ANGLE = 1000.0
"""Largest angle that is accepted from a file or a message [rad]."""


def is_possible_pose(x: float, y: float, theta: float = 0.0) -> bool:
    """Return whether this can be a pose on a map: finite, within `MAX_COORDINATE` and within `MAX_ANGLE`."""
    return abs(x) <= MAX_COORDINATE and abs(y) <= MAX_COORDINATE and abs(theta) <= MAX_ANGLE


def wrap_angle(angle: float) -> float:
    """Return the same angle in (-pi, pi]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def wrap_angles(angles: FloatArray) -> FloatArray:
    """Return angles (...) wrapped to (-pi, pi]."""
    wrapped: FloatArray = np.pi - np.mod(np.pi - angles, 2 * np.pi)
    return wrapped


def compose(a_from_b: FloatArray, b_from_c: FloatArray) -> FloatArray:
    """Return `a_from_c` of poses (..., 3), broadcast against each other."""
    a, b = np.asarray(a_from_b, float), np.asarray(b_from_c, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    theta = wrap_angles(a[..., 2] + b[..., 2])
    a_from_c = np.empty((*theta.shape, 3))
    a_from_c[..., 0] = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    a_from_c[..., 1] = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    a_from_c[..., 2] = theta
    return a_from_c


def invert(a_from_b: FloatArray) -> FloatArray:
    """Return `b_from_a` of poses (..., 3)."""
    a = np.asarray(a_from_b, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack([-c * a[..., 0] - s * a[..., 1], s * a[..., 0] - c * a[..., 1], wrap_angles(-a[..., 2])], axis=-1)


def transform_points(a_from_b: Pose2, points_b: FloatArray) -> FloatArray:
    """Return points (N, 2) of frame b in frame a."""
    return points_b @ rotation(a_from_b.theta).T + (a_from_b.x, a_from_b.y)


def arc_lengths(points: FloatArray) -> FloatArray:
    """Return the distance (N,) along a polyline (N, 2) from its first point to each point."""
    return np.concatenate([[0.0], np.hypot(*np.diff(points, axis=0).T).cumsum()])


def bends(path: FloatArray, tolerance: float) -> list[int]:
    """Return the indices, without the ends, at which a path (N, 2) bends (Douglas and Peucker 1973).

    The straight lines between them are nowhere farther than `tolerance`, in the path's unit, from the path.
    """

    def between(first: int, last: int) -> list[int]:
        if last - first < 2:
            return []
        chord = path[last] - path[first]
        away = path[first + 1 : last] - path[first]
        length = float(np.hypot(*chord))
        off = np.hypot(*away.T) if length < 1e-09 else np.abs(chord[0] * away[:, 1] - chord[1] * away[:, 0]) / length
        at = int(np.argmax(off))
        if off[at] <= tolerance:
            return []
        middle = first + 1 + at
        return [*between(first, middle), middle, *between(middle, last)]

    return between(0, len(path) - 1)


def nearest_step(points: FloatArray, at: FloatArray) -> tuple[int, float]:
    """Return the step of a polyline (N, 2), N >= 2, that is nearest to a point (2,), and the nearest place's share of it."""
    steps = np.diff(points, axis=0)
    lengths = np.maximum(np.hypot(*steps.T), 1e-9)
    share = np.clip(((at - points[:-1]) * steps).sum(axis=1) / lengths**2, 0.0, 1.0)
    k = int(np.argmin(np.hypot(*(points[:-1] + share[:, None] * steps - at).T)))
    return k, float(share[k])


def evenly_spaced(points: FloatArray, spacing: float) -> FloatArray:
    """Return points along a polyline, evenly spaced by at most `spacing` in their unit, both ends included."""
    along = arc_lengths(points)
    count = max(math.ceil(along[-1] / spacing - 1e-9), 1) + 1
    at = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, points[:, 0]), np.interp(at, along, points[:, 1])])


def limit_slope(most: FloatArray, rise: FloatArray) -> FloatArray:
    """Return the largest profile (N,) of limited slope below an upper bound.

    The bound is `most` (N,). Between two points the profile changes by at most the difference of `rise` (N,), which grows
    along the profile: with `rise` as twice the acceleration times the distance, squared speeds become drivable ones.
    """
    risen = np.minimum.accumulate(most - rise) + rise
    eased: FloatArray = np.minimum.accumulate((risen + rise)[::-1])[::-1] - rise
    return eased


def rotation(theta: float) -> FloatArray:
    """Return the (2, 2) rotation matrix of an angle [rad]."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s], [s, c]])


def rotations(quaternions: FloatArray) -> FloatArray:
    """Return the rotation matrices (N, 3, 3) of quaternions (N, 4) x, y, z, w of any length but 0."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def quaternions(rotations: FloatArray) -> FloatArray:
    """Return the unit quaternions (N, 4) x, y, z, w of rotation matrices (N, 3, 3), by their largest component.

    Shepperd, Journal of Guidance and Control 1978. Of the two quaternions of a rotation, the one whose largest component
    is positive.
    """
    turns = np.asarray(rotations, np.float64).reshape(-1, 3, 3)
    diagonal = turns[:, [0, 1, 2], [0, 1, 2]]
    trace = diagonal.sum(axis=1, keepdims=True)
    # four times the products of the components, of which the row with the largest square is used
    products = np.empty((len(turns), 4, 4))
    products[:, [0, 1, 2], [0, 1, 2]] = 1.0 + 2.0 * diagonal - trace
    products[:, 3, 3] = 1.0 + trace[:, 0]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[:, i, j] = products[:, j, i] = turns[:, i, j] + turns[:, j, i]
        products[:, k, 3] = products[:, 3, k] = turns[:, j, i] - turns[:, i, j]
    largest = products[:, range(4), range(4)].argmax(axis=1)
    rows = products[np.arange(len(turns)), largest]
    found: FloatArray = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return found


def in_space(pose: Pose2, height: float = 0.0) -> Pose3:
    """Return a planar pose as a pose in space: upright, `height` [m] above the plane."""
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    return Pose3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([pose.x, pose.y, height]))


def pose_from_array(pose: FloatArray) -> Pose2:
    """Return the `Pose2` of a (3,) array."""
    return Pose2(float(pose[0]), float(pose[1]), float(pose[2]))


def arc(distance: float, turn: float) -> Pose2:
    """Return the end of a circular arc of length `distance` [m] that turns by `turn` [rad], in the frame of its start."""
    half = turn / 2
    # the chord avoids the cancellation in 1 - cos(turn)
    chord = distance * math.sin(half) / half if abs(half) > 1e-12 else distance
    return Pose2(chord * math.cos(half), chord * math.sin(half), turn)


def arcs(distances: FloatArray, turns: FloatArray) -> FloatArray:
    """Return `arc` for distances (...) [m] and turns (...) [rad]: poses (..., 3), theta the unwrapped turn."""
    half = 0.5 * turns
    chords = distances * np.sinc(half / np.pi)
    return np.stack([chords * np.cos(half), chords * np.sin(half), turns], axis=-1)


def interpolate(start: Pose2, end: Pose2, fraction: float) -> Pose2:
    """Return the pose between start (fraction 0) and end (1): linear in x and y, the short way round in theta."""
    return Pose2(
        start.x + fraction * (end.x - start.x),
        start.y + fraction * (end.y - start.y),
        wrap_angle(start.theta + fraction * wrap_angle(end.theta - start.theta)),
    )


def rectangle(front: float, rear: float, half_width: float) -> FloatArray:
    """Return the corners (4, 2) [m], counter-clockwise, of a rectangle `front` ahead of and `rear` behind its origin."""
    return np.array([[front, half_width], [-rear, half_width], [-rear, -half_width], [front, -half_width]])
