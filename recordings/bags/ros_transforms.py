"""The transform tree of a recording's /tf and /tf_static (REP-105): mounts along chains, and odometry from tf."""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from waychair.errors import RecordingError
from waychair.geometry import in_space, wrap_angle
from waychair.recordings.scans import LaserMount
from waychair.types import FloatArray, IntArray, Odometry, Pose2, Pose3, Twist

BASE_FRAMES = ("base_link", "base_footprint", "base", "base_frame")
"""Usual names of the base frame (REP-105, REP-120), by preference."""

WORLD_FRAMES = ("map", "world", "earth")
"""Frames above odom. Motion in them is not dead reckoning: it jumps with corrections, or is a simulator's truth."""

_LONGEST_STEP_S = 0.5  # no twist is computed across a longer gap
_FARTHEST = 2.0  # m; no lidar on a chair is further from the base along one axis
_LEVEL = math.cos(math.radians(5.0))


@dataclass(slots=True)
class _Edge:
    """All poses of one child frame in its parent: stamps [ns], and x y z qx qy qz qw for each."""

    parent: str
    stamps: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    _sorted: tuple[IntArray, FloatArray] | None = None

    def add(self, stamp_ns: int, values: Sequence[float]) -> None:
        """Append a pose; of a run of equal poses only the first and the last stamp are kept."""
        self._sorted = None
        last = list(values)
        if len(self.stamps) > 1 and list(self.values[-7:]) == last == list(self.values[-14:-7]):
            self.stamps[-1] = stamp_ns
            return
        self.stamps.append(stamp_ns)
        self.values.extend(last)

    def rows(self) -> tuple[IntArray, FloatArray]:
        """Return the stamps (N,) in ascending order and the values (N, 7)."""
        if self._sorted is None:
            stamps = np.array(self.stamps, np.int64)
            order = np.argsort(stamps, kind="stable")
            self._sorted = stamps[order], np.array(self.values).reshape(-1, 7)[order]
        return self._sorted

    def moves(self) -> bool:
        return bool((np.ptp(self.rows()[1], axis=0) > 1e-6).any())


class TransformTree:
    """All transforms of a recording, by child frame."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}

    def add(self, message: Any) -> None:
        """Add the transforms of a tf2_msgs/TFMessage; transforms that are not finite are left out."""
        for stamped in message.transforms:
            move, turn = stamped.transform.translation, stamped.transform.rotation
            values = (move.x, move.y, move.z, *_unit(turn.x, turn.y, turn.z, turn.w))
            parent, child = frame_name(stamped.header.frame_id), frame_name(stamped.child_frame_id)
            if not math.isfinite(sum(values)) or parent == child:
                continue
            edge = self._edges.setdefault(child, _Edge(parent))
            if edge.parent == parent:
                edge.add(stamp_ns(stamped.header.stamp), values)

    def __contains__(self, frame: str) -> bool:
        return frame in self._edges or any(edge.parent == frame for edge in self._edges.values())

    def chain(self, upper: str, lower: str, at_ns: int) -> FloatArray | None:
        """Return `upper_from_lower` (4, 4) at a stamp, through their common ancestor; None if they are not connected."""
        up, down = self._ancestry(upper), self._ancestry(lower)
        common = next((frame for frame in down if frame in up), None)
        if common is None:
            return None
        return np.linalg.inv(self._from_ancestor(common, upper, at_ns)) @ self._from_ancestor(common, lower, at_ns)

    def bodies(self, above: Collection[str] = ()) -> dict[str, int]:
        """Return the number of the body of each frame: frames that are connected below odom, map and the like.

        `above` are further frames that connect nothing, such as those of odometry messages.
        """
        number: dict[str, int] = {}
        for child in self._edges:
            way = []
            for frame in self._ancestry(child):
                if is_above_base(frame) or frame in above:
                    break
                way.append(frame)
            known = next((number[frame] for frame in way if frame in number), len(number))
            for frame in way:
                number.setdefault(frame, known)
        return number

    def base_above(self, frame: str) -> str | None:
        """Return the nearest ancestor of a frame with a usual name of the base, such as robot1/base_link."""
        way = [name for name in self._ancestry(frame) if _is_base(name)]
        return min(way, key=lambda name: BASE_FRAMES.index(_base_name(name)), default=None)

    def moves_between(self, upper: str, lower: str) -> bool:
        """Return whether the pose of one frame in the other changes during the recording."""
        up, down = self._ancestry(upper), self._ancestry(lower)
        common = next((frame for frame in down if frame in up), "")
        way = [*up[: up.index(common)], *down[: down.index(common)]] if common else []
        return any(self._edges[frame].moves() for frame in way)

    def odometry_frame(self, base: str) -> str | None:
        """Return the frame of the dead reckoning: the nearest ancestor in which the base moves; None if it is a world frame."""
        for child in self._ancestry(base)[:-1]:
            edge = self._edges[child]
            if edge.moves():
                return None if edge.parent.rpartition("/")[2] in WORLD_FRAMES else edge.parent
        return None

    def odometry(self, odom: str, base: str) -> list[Odometry]:
        """Return `odom_from_base` at every stamp of its moving transforms, with the twist since the reading before."""
        way = self._ancestry(base)
        if odom not in way:
            return []
        moving = [child for child in way[: way.index(odom)] if self._edges[child].moves()]
        stamps = np.unique(
            np.concatenate([self._edges[child].rows()[0] for child in moving] or [np.zeros(0, np.int64)])
        )
        poses = [planar(self._from_ancestor(odom, base, int(stamp))) for stamp in stamps]
        readings = []
        for k, (stamp, pose) in enumerate(zip(stamps.tolist(), poses, strict=True)):
            before = max(k - 1, 0)
            readings.append(Odometry(stamp, pose, mean_twist(poses[before], pose, stamp - int(stamps[before]))))
        return readings

    def _ancestry(self, frame: str) -> list[str]:
        """Return the frame and its ancestors, from the frame upwards."""
        way = [frame]
        while way[-1] in self._edges and self._edges[way[-1]].parent not in way:
            way.append(self._edges[way[-1]].parent)
        return way

    def _from_ancestor(self, ancestor: str, frame: str, at_ns: int) -> FloatArray:
        result = np.eye(4)
        while frame != ancestor:
            edge = self._edges[frame]
            result = _at(*edge.rows(), at_ns) @ result
            frame = edge.parent
        return result


def is_above_base(frame: str) -> bool:
    """Return whether a frame is odom, map or the like, with or without the name of a robot before it."""
    last = frame.rpartition("/")[2]
    return last in WORLD_FRAMES or last.startswith("odom") or last.endswith(("_odom", "_map"))


def _base_name(frame: str) -> str:
    last = frame.rpartition("/")[2]
    return next((name for name in BASE_FRAMES if last == name or last.endswith(f"_{name}")), "")


def _is_base(frame: str) -> bool:
    return bool(_base_name(frame))


def _at(stamps: IntArray, values: FloatArray, at_ns: int) -> FloatArray:
    """Return the pose (4, 4) at a stamp: interpolated linearly, and constant beyond the first and last."""
    after = int(np.searchsorted(stamps, at_ns))
    if after == 0 or after == len(stamps):
        return _matrix(values[min(after, len(stamps) - 1)])
    start, end = values[after - 1], values[after].copy()
    if start[3:] @ end[3:] < 0.0:  # q and -q are the same rotation: take the nearer one
        end[3:] *= -1.0
    part = (at_ns - int(stamps[after - 1])) / max(1, int(stamps[after]) - int(stamps[after - 1]))
    return _matrix(start + part * (end - start))


def _matrix(values: FloatArray) -> FloatArray:
    """Return the homogeneous transform (4, 4) of x y z qx qy qz qw."""
    x, y, z, w = _unit(*values[3:].tolist())
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), values[0]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), values[1]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), values[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def pose_matrix(translation: Any, rotation: Any) -> FloatArray:
    """Return the homogeneous transform (4, 4) of a geometry_msgs vector and quaternion; a zero quaternion is no rotation."""
    return _matrix(
        np.array([translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w])
    )


def planar(matrix: FloatArray) -> Pose2:
    """Return x, y and yaw of a (4, 4) transform."""
    return Pose3(matrix[:3, :3], matrix[:3, 3]).planar()


def frame_name(name: str) -> str:
    """Return a frame's name without the leading slash that ROS 1 allowed."""
    return str(name).lstrip("/")


def stamp_ns(stamp: Any) -> int:
    """Return the nanoseconds of a builtin_interfaces/Time."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _unit(x: float, y: float, z: float, w: float) -> tuple[float, float, float, float]:
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return (x / norm, y / norm, z / norm, w / norm) if norm > 0.0 else (0.0, 0.0, 0.0, 1.0)


def mean_twist(before: Pose2, after: Pose2, step_ns: int) -> Twist:
    """Return the mean twist of the base between two poses; zero across a gap."""
    seconds = step_ns * 1e-9
    if not 0.0 < seconds <= _LONGEST_STEP_S:
        return Twist()
    step = before.inverse() @ after
    return Twist(step.x / seconds, wrap_angle(step.theta) / seconds)


def laser_mount(tree: TransformTree, base: str, laser: str, first_ns: int, warnings: list[str]) -> LaserMount:
    """Return the mount of a laser on the base at its first stamp, with warnings where it is doubtful.

    Raises:
        RecordingError: no chair is as large as the mount says.
    """
    matrix = tree.chain(base, laser, first_ns)
    if matrix is None:
        warnings.append(unknown_mount(base, laser))
        return LaserMount()
    if tree.moves_between(base, laser):
        warnings.append(f"the laser '{laser}' moves on the base by /tf: its pose at the first scan is used for all")
    far = float(np.abs(matrix[:2, 3]).max())
    if not far <= _FARTHEST:
        raise RecordingError(
            f"/tf_static: the mount of the laser '{laser}' is {far:.6g} m from {base}, and no chair is that large: "
            "correct it, or give it with --base-from-laser X,Y,YAW"
        )
    upright = float(matrix[2, 2])
    if abs(upright) < _LEVEL:
        tilt = math.degrees(math.acos(min(1.0, abs(upright))))
        warnings.append(f"the laser '{laser}' is tilted by {tilt:.0f} degrees: its scans are used as if it were level")
    return LaserMount(planar(matrix), upright < 0.0)


def unknown_mount(base: str, laser: str) -> str:
    """Return the warning about a laser whose mount is not known."""
    return (
        f"/tf and /tf_static do not connect {base} with '{laser}': the laser is assumed at the base; "
        "give its mount with --base-from-laser X,Y[,Z],YAW (and ,upside-down if it hangs upside down)"
    )


def matrix_from_mount(mount: LaserMount) -> FloatArray:
    """Return `base_from_laser` (4, 4) of a mount."""
    matrix = np.eye(4)
    at = in_space(mount.base_from_laser, mount.height)
    matrix[:3, :3], matrix[:3, 3] = at.rotation, at.translation
    if mount.upside_down:
        matrix[:3, :3] = matrix[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    return matrix
