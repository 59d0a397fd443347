"""Alignment of a trajectory with the truth, in the plane and in space, and the truth at the trajectory's stamps.

The alignment minimises the squared distances of the positions (Umeyama 1991, without scale and reflection), as the TUM
RGB-D benchmark does (Sturm et al., IROS 2012).
"""

from __future__ import annotations

import math

import numpy as np

from waychair.types import BoolArray, FloatArray, IntArray, Pose2, Pose3, Trajectory3

MAX_TRUTH_GAP = 0.05  # s; a pose that is this near a true pose counts, however far the next one is
MAX_TRUTH_STEP = 0.2  # s; between true poses this close in time, a chair's motion is a straight line to 3 mm
_MOST_INTERPOLATED = 1.0  # s; across a longer pause of the truth, the nearest true pose is taken
_ROUNDING_NS = 1_000_000  # stamps may be rounded to a millisecond

_PLANE_HEIGHT = 0.03  # m; a floor and a tracking system vary by less
_PLANE_TILT = math.radians(3.0)
_LINE = 1e-3  # positions whose second spread is below this share of the first lie on a line
_STANDS = 1e-3  # m; spread of the positions of something that only turns


def leaves_plane(trajectory: Trajectory3) -> bool:
    """Return whether a trajectory is in space: its height changes, or it rolls or pitches."""
    if len(trajectory.stamps_ns) == 0:
        return False
    if float(np.ptp(trajectory.positions[:, 2])) > _PLANE_HEIGHT:
        return True
    turned = trajectory.rotations @ trajectory.rotations[0].T
    return float(turned[:, 2, 2].min()) < math.cos(_PLANE_TILT)


def truth_between(stamps: IntArray, times: IntArray) -> tuple[BoolArray, IntArray, IntArray, FloatArray]:
    """Return which times (N,) have a truth, the true poses before and after them, and the part of the way between.

    `stamps` ascend. A time has a truth within the truth's span, where the true poses around it are at most
    `MAX_TRUTH_STEP` apart, or one of them is at most `MAX_TRUTH_GAP` away.
    """
    after = np.clip(np.searchsorted(stamps, times), min(1, len(stamps) - 1), len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    step = stamps[after] - stamps[before]
    part = np.clip((times - stamps[before]) / np.maximum(step, 1), 0.0, 1.0)
    part = np.where(step > _MOST_INTERPOLATED * 1e9, np.rint(part), part)
    near = np.minimum(np.abs(times - stamps[before]), np.abs(times - stamps[after])) <= MAX_TRUTH_GAP * 1e9
    inside = (times >= stamps[0] - _ROUNDING_NS) & (times <= stamps[-1] + _ROUNDING_NS)
    usable: BoolArray = inside & (near | (step <= MAX_TRUTH_STEP * 1e9 + _ROUNDING_NS))
    return usable, before, after, part


def rotations_between(first: FloatArray, second: FloatArray, part: FloatArray) -> FloatArray:
    """Return rotations (N, 3, 3) between others (N, 3, 3), `part` of the shortest turn from the first to the second."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(np.swapaxes(first, 1, 2) @ second).as_rotvec()
    between: FloatArray = first @ Rotation.from_rotvec(part[:, None] * turn).as_matrix()
    return between


def alignment_in_plane(points: FloatArray, onto: FloatArray) -> Pose2:
    """Return the pose that moves points (N, 2) onto others with the least sum of squared distances."""
    a, b = points - points.mean(axis=0), onto - onto.mean(axis=0)
    theta = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    turned = Pose2(0.0, 0.0, theta) @ Pose2(*points.mean(axis=0).tolist())
    x, y = onto.mean(axis=0).tolist()
    return Pose2(x - turned.x, y - turned.y, theta)


def alignment_in_space(points: FloatArray, turns: FloatArray, onto: FloatArray, onto_turns: FloatArray) -> Pose3:
    """Return the pose that moves points (N, 3) onto others with the least sum of squared distances.

    Points on a line leave the turn about it open; the rotations (N, 3, 3) of both then tell it. They tell the whole turn
    where the points do not move.
    """
    a, b = points - points.mean(axis=0), onto - onto.mean(axis=0)
    if min(np.linalg.norm(a, axis=1).max(), np.linalg.norm(b, axis=1).max()) < _STANDS:
        rotation = _nearest_rotation((onto_turns @ np.swapaxes(turns, 1, 2)).sum(axis=0))
    else:
        u, spread, _ = np.linalg.svd(b.T @ a)
        rotation = _nearest_rotation(b.T @ a)
        if spread[1] < _LINE * spread[0]:
            rotation = _about_line(u[:, 0], rotation, turns, onto_turns) @ rotation
    return Pose3(rotation, onto.mean(axis=0) - rotation @ points.mean(axis=0))


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    u, _, vt = np.linalg.svd(matrix)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation: FloatArray = u @ mirror @ vt
    return rotation


def _about_line(line: FloatArray, rotation: FloatArray, turns: FloatArray, onto_turns: FloatArray) -> FloatArray:
    """Return the turn about a line that brings rotated turns nearest to others: largest trace, in closed form."""
    from scipy.spatial.transform import Rotation

    m = ((rotation @ turns) @ np.swapaxes(onto_turns, 1, 2)).sum(axis=0)
    cross = np.array([[0.0, -line[2], line[1]], [line[2], 0.0, -line[0]], [-line[1], line[0], 0.0]])
    cosine = float(np.trace(m) - line @ m @ line)
    sine = float(np.trace(cross @ m))
    turn: FloatArray = Rotation.from_rotvec(math.atan2(sine, cosine) * line).as_matrix()
    return turn
