"""Encoding of waychair's types as ROS 2 messages without ROS: frames by REP-103 and REP-105, ranges by REP-117, IMU by
REP-145.

The message classes come from a `rosbags` typestore. Nothing here reads a clock or a file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from waychair.geometry import in_space
from waychair.types import FloatArray, ImuSample, Pose2, Pose3, PressureSample, RgbdFrame, Scan, Twist, WheelTicks

MAP_FRAME, ODOM_FRAME, BASE_FRAME = "map", "odom", "base_link"
LASER_FRAME, IMU_FRAME = "laser", "imu_link"
CAMERA_FRAME, OPTICAL_FRAME = "camera_link", "camera_color_optical_frame"
"""Frames of the message headers. `base_link` lies on the floor below the middle of the drive axle."""

SONAR_FRAME = "sonar_{}"
WHEEL_JOINTS = ("left_wheel_joint", "right_wheel_joint")

CAMERA_FROM_OPTICAL = Pose3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
"""REP-103: an optical frame has z forward and x right; a body frame has x forward and y left."""

UNREPORTED = np.concatenate([[-1.0], np.zeros(8)])
"""Covariance (9,) that marks an IMU field as not measured (REP-145)."""

SONAR_CONE = math.radians(30.0)
SONAR_RANGE = (0.02, 4.0)
"""Full opening angle [rad] and range [m] of small ultrasonic sensors; the simulated sonars have the same."""

TYPES = get_typestore(Stores.ROS2_JAZZY)
"""The message definitions, with which writers declare their topics."""

_ULTRASOUND = 0


def serialised(message: Any) -> bytes | memoryview:
    """Return the message's CDR bytes."""
    return TYPES.serialize_cdr(message, message.__msgtype__)


def laser_scan(scan: Scan) -> Any:
    """Return a sensor_msgs/LaserScan."""
    return make(
        "sensor_msgs/msg/LaserScan",
        header=header(scan.stamp_ns, LASER_FRAME),
        angle_min=scan.angle_min,
        angle_max=scan.angle_min + scan.angle_step * (len(scan.ranges) - 1),
        angle_increment=scan.angle_step,
        time_increment=scan.time_step,
        scan_time=abs(scan.time_step) * len(scan.ranges),
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=scan.ranges.astype(np.float32, copy=False),
        intensities=np.zeros(0, np.float32),
    )


def odometry(
    stamp_ns: int,
    parent: str,
    parent_from_base: Pose2,
    twist: Twist,
    covariance: FloatArray | None = None,
    twist_covariance: FloatArray | None = None,
) -> Any:
    """Return a nav_msgs/Odometry of the base in frame `parent`.

    `covariance` (3, 3) is of x, y, theta; `twist_covariance` of their rates in the base; None is written as zeros.
    """
    at = parent_from_base
    pose = make("geometry_msgs/msg/Pose", point(np.array([at.x, at.y, 0.0])), quaternion(in_space(at).rotation))
    speed = make("geometry_msgs/msg/Twist", vector((twist.v, 0.0, 0.0)), vector((0.0, 0.0, twist.omega)))
    return make(
        "nav_msgs/msg/Odometry",
        header(stamp_ns, parent),
        BASE_FRAME,
        make("geometry_msgs/msg/PoseWithCovariance", pose, covariance_in_space(covariance)),
        make("geometry_msgs/msg/TwistWithCovariance", speed, covariance_in_space(twist_covariance)),
    )


def imu(sample: ImuSample) -> Any:
    """Return a sensor_msgs/Imu: rates and specific force with unknown covariances (zeros), no orientation."""
    return make(
        "sensor_msgs/msg/Imu",
        header=header(sample.stamp_ns, IMU_FRAME),
        orientation=make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
        orientation_covariance=UNREPORTED,
        angular_velocity=vector(sample.gyro),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(sample.accel),
        linear_acceleration_covariance=np.zeros(9),
    )


def pressure(sample: PressureSample) -> Any:
    """Return a sensor_msgs/FluidPressure with unknown variance (0)."""
    return make("sensor_msgs/msg/FluidPressure", header(sample.stamp_ns, IMU_FRAME), sample.pascal, 0.0)


def colour_image(frame: RgbdFrame) -> Any:
    """Return a sensor_msgs/Image, rgb8 or mono8."""
    encoding = "rgb8" if frame.image.ndim == 3 else "mono8"
    return image(frame.stamp_ns, frame.image, encoding)


def depth_image(frame: RgbdFrame) -> Any:
    """Return a sensor_msgs/Image, 16UC1 in millimetres with 0 for none (REP-118), as RealSense cameras send it.

    It is half the size of 32FC1, and a millimetre is below the noise of such cameras except at their nearest range.
    """
    millimetres = frame.depth * np.float32(1000.0)
    told = (millimetres >= 0.0) & (millimetres < 65535.5)  # false for nan
    return image(frame.stamp_ns, np.where(told, millimetres + np.float32(0.5), 0.0).astype("<u2"), "16UC1")


def camera_info(frame: RgbdFrame) -> Any:
    """Return a sensor_msgs/CameraInfo of a rectified picture: no distortion, projection equal to the camera matrix."""
    height, width = frame.depth.shape
    return intrinsics(frame.stamp_ns, frame.camera_matrix, width, height)


def intrinsics(stamp_ns: int, camera_matrix: FloatArray, width: int, height: int, frame: str = OPTICAL_FRAME) -> Any:
    """Return a sensor_msgs/CameraInfo of a camera without distortion, with its matrix (3, 3) [pixels]."""
    k = np.asarray(camera_matrix, np.float64)
    return make(
        "sensor_msgs/msg/CameraInfo",
        header=header(stamp_ns, frame),
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([k, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False),
    )


def sonar_range(
    stamp_ns: int, index: int, distance: float, limits: tuple[float, float] = SONAR_RANGE, cone: float = SONAR_CONE
) -> Any:
    """Return a sensor_msgs/Range of one sonar, with its REP-117 codes, range limits [m] and whole cone [rad]."""
    return make(
        "sensor_msgs/msg/Range",
        header=header(stamp_ns, SONAR_FRAME.format(index)),
        radiation_type=_ULTRASOUND,
        field_of_view=cone,
        min_range=limits[0],
        max_range=limits[1],
        range=distance,
        variance=0.0,
    )


def joint_states(ticks: WheelTicks, ticks_per_turn: int) -> Any:
    """Return a sensor_msgs/JointState: angles [rad] of the drive wheels, from counts wrapped to signed 32 bits."""
    counts = [(count + (1 << 31)) % (1 << 32) - (1 << 31) for count in (ticks.left, ticks.right)]
    angles = np.array(counts) * (math.tau / ticks_per_turn)
    nothing = np.zeros(0)
    joints = list(WHEEL_JOINTS)
    return make("sensor_msgs/msg/JointState", header(ticks.stamp_ns, ""), joints, angles, nothing, nothing)


def transforms(stamp_ns: int, parent_from_child: Mapping[tuple[str, str], Pose3]) -> Any:
    """Return a tf2_msgs/TFMessage of transforms by (parent, child)."""
    stamped = [
        make(
            "geometry_msgs/msg/TransformStamped",
            header(stamp_ns, parent),
            child,
            make("geometry_msgs/msg/Transform", vector(pose.translation), quaternion(pose.rotation)),
        )
        for (parent, child), pose in parent_from_child.items()
    ]
    return make("tf2_msgs/msg/TFMessage", stamped)


def image(stamp_ns: int, pixels: Any, encoding: str, frame: str = OPTICAL_FRAME) -> Any:
    """Return a sensor_msgs/Image of pixels (H, W) or (H, W, C)."""
    height, width = pixels.shape[:2]
    row = pixels.nbytes // height
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
    return make(
        "sensor_msgs/msg/Image",
        header=header(stamp_ns, frame),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=row,
        data=data,
    )


def make(name: str, /, *fields: Any, **named: Any) -> Any:
    """Return a message of the given type from its fields, in their order or by name."""
    return TYPES.types[name](*fields, **named)


def header(stamp_ns: int, frame: str) -> Any:
    """Return a std_msgs/Header."""
    stamp = make("builtin_interfaces/msg/Time", *divmod(stamp_ns, 1_000_000_000))
    return make("std_msgs/msg/Header", stamp, frame)


def vector(xyz: FloatArray | Sequence[float]) -> Any:
    """Return a geometry_msgs/Vector3."""
    return make("geometry_msgs/msg/Vector3", *map(float, xyz))


def point(xyz: FloatArray) -> Any:
    """Return a geometry_msgs/Point."""
    return make("geometry_msgs/msg/Point", *map(float, xyz))


def quaternion(rotation: FloatArray) -> Any:
    """Return a geometry_msgs/Quaternion with w >= 0, computed from its largest component (Shepperd 1978)."""
    m = rotation
    squares = np.array(
        [
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
            1 + m[0, 0] + m[1, 1] + m[2, 2],
        ]
    )
    products = np.array(
        [
            [squares[0], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], squares[1], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[2], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], squares[3]],
        ]
    )
    largest = int(np.argmax(squares))
    xyzw = products[largest] / (2 * math.sqrt(squares[largest]))
    return make("geometry_msgs/msg/Quaternion", *map(float, xyzw if xyzw[3] >= 0 else -xyzw))


def covariance_in_space(covariance: FloatArray | None) -> FloatArray:
    """Return the covariance (36,) of x, y, z, roll, pitch, yaw from that of x, y, yaw (3, 3); None gives zeros."""
    full = np.zeros((6, 6))
    if covariance is not None:
        full[np.ix_([0, 1, 5], [0, 1, 5])] = covariance
    return full.ravel()
