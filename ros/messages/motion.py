"""Conversion of poses, twists, paths, odometry, transforms and speed limits to and from ROS messages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from waychair.errors import MessageError
from waychair.geometry import MAX_COORDINATE, is_possible_pose
from waychair.recordings.bags.ros_decoding import odometry_from_message
from waychair.recordings.bags.ros_messages import (
    BASE_FRAME,
    MAP_FRAME,
    ODOM_FRAME,
    covariance_in_space,
    header,
    make,
    transforms,
    vector,
)
from waychair.recordings.bags.ros_transforms import BASE_FRAMES, frame_name, planar, pose_matrix
from waychair.ros.messages.wire import require_finite, require_frame, stamp_of
from waychair.types import FloatArray, Odometry, Path, Pose2, Pose3, Twist

_PLANAR = np.ix_([0, 1, 5], [0, 1, 5])  # x, y and yaw among x, y, z, roll, pitch, yaw
_UNIT = 0.1  # a quaternion whose length differs from 1 by more is invalid


def pose(at: Pose2) -> Any:
    """Return a geometry_msgs/Pose in the plane."""
    half = math.remainder(at.theta, math.tau) / 2  # so that w >= 0
    point = make("geometry_msgs/msg/Point", float(at.x), float(at.y), 0.0)
    return make(
        "geometry_msgs/msg/Pose", point, make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(half), math.cos(half))
    )


def read_pose(message: Any) -> Pose2:
    """Return x, y and yaw of a geometry_msgs/Pose.

    Raises:
        MessageError: a value is not finite, or the quaternion is invalid, e.g. all zeros.
    """
    at, turn = message.position, message.orientation
    require_finite("a pose", at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w)
    length = math.hypot(turn.x, turn.y, turn.z, turn.w)
    if abs(length - 1.0) > _UNIT:
        raise MessageError(f"a pose's quaternion has length {length:.3g}: it must be 1; (0, 0, 0, 1) is no rotation")
    return planar(pose_matrix(at, turn))


def pose_stamped(stamp_ns: int, at: Pose2, frame: str = MAP_FRAME) -> Any:
    """Return a geometry_msgs/PoseStamped, e.g. for a goal."""
    return make("geometry_msgs/msg/PoseStamped", header(stamp_ns, frame), pose(at))


def read_pose_stamped(message: Any, *frames: str) -> Pose2:
    """Return the pose of a geometry_msgs/PoseStamped in one of `frames` (default: map).

    Raises:
        MessageError: another frame, an invalid pose (`read_pose`), or a pose too far away for a map.
    """
    require_frame(message, *(frames or (MAP_FRAME,)))
    return _on_a_map(read_pose(message.pose))


def pose_with_covariance(stamp_ns: int, at: Pose2, covariance: FloatArray | None = None) -> Any:
    """Return a geometry_msgs/PoseWithCovarianceStamped in map; covariance (3, 3) of x, y, theta; None gives zeros."""
    estimate = make("geometry_msgs/msg/PoseWithCovariance", pose(at), covariance_in_space(covariance))
    return make("geometry_msgs/msg/PoseWithCovarianceStamped", header(stamp_ns, MAP_FRAME), estimate)


def read_pose_with_covariance(message: Any) -> tuple[Pose2, FloatArray | None]:
    """Return the pose in map, and the covariance (3, 3) of x, y, theta; None where it is all zeros.

    Raises:
        MessageError: another frame, an invalid pose, a pose too far away for a map, or an invalid covariance.
    """
    require_frame(message, MAP_FRAME)
    full = np.array(message.pose.covariance, np.float64).reshape(6, 6)
    covariance: FloatArray = full[_PLANAR]
    if not np.isfinite(covariance).all() or (np.diag(covariance) < 0.0).any():
        raise MessageError("a pose's covariance is not finite or negative: send zeros where it is not known")
    return _on_a_map(read_pose(message.pose.pose)), covariance if covariance.any() else None


def _on_a_map(pose: Pose2) -> Pose2:
    if not is_possible_pose(pose.x, pose.y):
        raise MessageError(f"a pose at ({pose.x:g}, {pose.y:g}) m is too far away: {MAX_COORDINATE:g} m is the limit")
    return pose


def read_odometry(message: Any, frame: str = ODOM_FRAME) -> Odometry:
    """Return the odometry of a nav_msgs/Odometry of the base in `frame`.

    Raises:
        MessageError: other frames, or an invalid pose or twist.
    """
    stamp_of(message)
    require_frame(message, frame)
    child = frame_name(message.child_frame_id)
    if child not in BASE_FRAMES:
        raise MessageError(f"odometry is of '{child}', not of {BASE_FRAME}: set the driver's child_frame_id")
    read_pose(message.pose.pose)
    twist = message.twist.twist
    require_finite("odometry's twist", twist.linear.x, twist.angular.z)
    odometry = odometry_from_message(message)
    if odometry is None or not is_possible_pose(*odometry.odom_from_base.array()):
        raise MessageError("the pose of the odometry is impossibly far away: restart its sender")
    return odometry


def twist(command: Twist) -> Any:
    """Return a geometry_msgs/Twist."""
    return make("geometry_msgs/msg/Twist", vector((command.v, 0.0, 0.0)), vector((0.0, 0.0, command.omega)))


def twist_stamped(stamp_ns: int, command: Twist) -> Any:
    """Return a geometry_msgs/TwistStamped in base_link."""
    return make("geometry_msgs/msg/TwistStamped", header(stamp_ns, BASE_FRAME), twist(command))


def read_twist(message: Any) -> Twist:
    """Return forward speed and turn rate of a geometry_msgs/Twist; the other components are ignored.

    Raises:
        MessageError: one of them is not finite.
    """
    v, omega = float(message.linear.x), float(message.angular.z)
    require_finite("a twist", v, omega)
    return Twist(v, omega)


def read_twist_stamped(message: Any) -> tuple[int, Twist]:
    """Return stamp [ns] and twist of a geometry_msgs/TwistStamped in base_link.

    Raises:
        MessageError: another frame, or a value that is not finite.
    """
    require_frame(message, BASE_FRAME, "")
    return stamp_of(message), read_twist(message.twist)


def path(stamp_ns: int, way: Path, frame: str = MAP_FRAME) -> Any:
    """Return a nav_msgs/Path."""
    head = header(stamp_ns, frame)
    stamped = [make("geometry_msgs/msg/PoseStamped", head, pose(Pose2(*row))) for row in way.poses.tolist()]
    return make("nav_msgs/msg/Path", head, stamped)


def points(stamp_ns: int, at: FloatArray, frame: str = MAP_FRAME) -> Any:
    """Return a geometry_msgs/PoseArray of points (N, 2) [m]."""
    poses = [pose(Pose2(x, y)) for x, y in at.tolist()]
    return make("geometry_msgs/msg/PoseArray", header(stamp_ns, frame), poses)


def polygon(stamp_ns: int, corners: FloatArray, frame: str) -> Any:
    """Return a geometry_msgs/PolygonStamped of corners (N, 2) [m]."""
    around = [make("geometry_msgs/msg/Point32", x, y, 0.0) for x, y in corners.tolist()]
    return make("geometry_msgs/msg/PolygonStamped", header(stamp_ns, frame), make("geometry_msgs/msg/Polygon", around))


def read_points(message: Any, frame: str = MAP_FRAME) -> FloatArray:
    """Return the points (N, 2) [m] of a geometry_msgs/PoseArray.

    Raises:
        MessageError: another frame, or a coordinate that is not finite.
    """
    require_frame(message, frame)
    at = np.array([[each.position.x, each.position.y] for each in message.poses], np.float64).reshape(-1, 2)
    require_finite("a point", *at.ravel().tolist())
    return at


def read_path(message: Any) -> Path:
    """Return the path of a nav_msgs/Path in map.

    Raises:
        MessageError: another frame, or an invalid pose.
    """
    require_frame(message, MAP_FRAME)
    poses = [read_pose(stamped.pose).array() for stamped in message.poses]
    return Path(np.array(poses).reshape(-1, 3))


def transform(stamp_ns: int, parent: str, child: str, parent_from_child: Pose3) -> Any:
    """Return a tf2_msgs/TFMessage of one transform."""
    return transforms(stamp_ns, {(parent, child): parent_from_child})


def speed_limit(stamp_ns: int, metres_per_second: float) -> Any:
    """Return a nav2_msgs/SpeedLimit; +inf lifts the limit."""
    limit = 0.0 if math.isinf(metres_per_second) else metres_per_second
    return make("nav2_msgs/msg/SpeedLimit", header(stamp_ns, MAP_FRAME), False, limit)


def read_speed_limit(message: Any, full_speed: float) -> float:
    """Return the limit [m/s] of a nav2_msgs/SpeedLimit; percentages are of `full_speed`; +inf where it is lifted.

    Raises:
        MessageError: the limit is negative or not finite.
    """
    limit = float(message.speed_limit)
    require_finite("a speed limit", limit)
    if limit < 0.0:
        raise MessageError(f"a speed limit of {limit:g} is impossible: send 0 to lift it, or use stop to stop")
    if limit == 0.0:
        return math.inf
    return full_speed * limit / 100.0 if message.percentage else limit
