"""Decoding of ROS messages without ROS: scans, odometry, IMU samples and pictures of common encodings.

Ranges follow REP-117, depths REP-118 (16UC1 in millimetres, 32FC1 in metres), IMU samples REP-145. Compressed depth has
the layout of image_transport's compressed_depth plugin: a header of 12 bytes (an enumeration, and two floats for the
quantisation of the depth), then a PNG.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import cv2
import numpy as np

from waychair.errors import RecordingError
from waychair.recordings.bags.ros_transforms import planar, pose_matrix, stamp_ns
from waychair.recordings.plausibility.told_scans import MOST_BEAMS, ToldScan
from waychair.recordings.scans import ascending, without_overflow_codes
from waychair.types import Bytes, Float32Array, FloatArray, ImuSample, Odometry, Scan, Twist

_PLANAR = [0, 1, 5]  # x, y and yaw among x, y, z, roll, pitch, yaw
_DEPTH_HEADER = 12
_BAYER = {
    "bayer_rggb8": cv2.COLOR_BayerRGGB2RGB,
    "bayer_bggr8": cv2.COLOR_BayerBGGR2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGBRG2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGRBG2RGB,
}
_YUV = {"yuv422": cv2.COLOR_YUV2RGB_UYVY, "uyvy": cv2.COLOR_YUV2RGB_UYVY, "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2, "yuyv": cv2.COLOR_YUV2RGB_YUY2}  # fmt: skip
_CHANNELS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "8UC4": 4, "mono8": 1, "8UC1": 1}


def scan_from_message(message: Any) -> Scan | None:
    """Return the scan of a sensor_msgs/LaserScan, by ascending angle; None when it has no beams or no angles.

    Ranges beyond `range_max` become +inf (`without_overflow_codes`).
    """
    step = float(message.angle_increment)
    ranges = np.array(message.ranges, dtype=np.float32)
    if len(ranges) < 2 or step == 0.0 or not math.isfinite(step + message.angle_min):
        return None
    time_step, nearest, farthest = (float(v) for v in (message.time_increment, message.range_min, message.range_max))
    scan = Scan(
        stamp_ns=stamp_ns(message.header.stamp),
        ranges=ranges,
        angle_min=float(message.angle_min),
        angle_step=step,
        time_step=time_step if math.isfinite(time_step) else 0.0,
        range_min=max(0.0, nearest),
        range_max=farthest if farthest > 0.0 else math.inf,
    )
    return ascending(without_overflow_codes(scan))


def told_scan_from_message(message: Any) -> ToldScan:
    """Return a sensor_msgs/LaserScan as it is told; `recordings.plausibility` judges it together with the others of its topic."""
    ranges = np.asarray(message.ranges, dtype=np.float32)
    return ToldScan(
        stamp_ns=stamp_ns(message.header.stamp),
        ranges=ranges.copy() if len(ranges) <= MOST_BEAMS else ranges[:0],  # a view would keep the message in memory
        angle_min=float(message.angle_min),
        angle_max=float(message.angle_max),
        angle_increment=float(message.angle_increment),
        time_increment=float(message.time_increment),
        scan_time=float(message.scan_time),
        range_min=float(message.range_min),
        range_max=float(message.range_max),
    )


def first_echoes(message: Any) -> Float32Array:
    """Return the range (N,) [m] of each beam of a sensor_msgs/MultiEchoLaserScan; nan for a beam without an echo.

    It is the nearest echo within the lidar's limits, which may be of glass; a farther one is of things behind it.
    """
    ranges = np.full(len(message.ranges), np.nan, np.float32)
    for beam, echo in enumerate(message.ranges):
        echoes = np.asarray(echo.echoes, np.float32)
        valid = echoes[(echoes >= message.range_min) & (echoes <= message.range_max)]
        if len(echoes):
            ranges[beam] = valid.min() if len(valid) else echoes[0]
    return ranges


def odometry_from_message(message: Any) -> Odometry | None:
    """Return the planar odometry of a nav_msgs/Odometry, None when its pose is not finite; a covariance of zeros means
    that it is unknown.
    """
    twist = message.twist.twist
    pose = planar(pose_matrix(message.pose.pose.position, message.pose.pose.orientation))
    speeds = Twist(float(twist.linear.x), float(twist.angular.z))
    if not math.isfinite(pose.x + pose.y + pose.theta):
        return None
    covariance = np.array(message.pose.covariance, dtype=np.float64).reshape(6, 6)[np.ix_(_PLANAR, _PLANAR)]
    known = covariance.any() and np.isfinite(covariance).all()
    return Odometry(
        stamp_ns(message.header.stamp),
        pose,
        speeds if math.isfinite(speeds.v + speeds.omega) else Twist(),
        covariance if known else None,
    )


def imu_from_message(message: Any) -> ImuSample | None:
    """Return the sample of a sensor_msgs/Imu in the sensor's axes; None when a value is not finite."""
    rates, force = message.angular_velocity, message.linear_acceleration
    gyro = np.array([rates.x, rates.y, rates.z], np.float64)
    accel = np.array([force.x, force.y, force.z], np.float64)
    if not np.isfinite(gyro).all() or not np.isfinite(accel).all():
        return None
    return ImuSample(stamp_ns(message.header.stamp), accel, gyro)


def camera_matrix_from_message(message: Any) -> FloatArray | None:
    """Return the camera matrix (3, 3) of a sensor_msgs/CameraInfo; None when the camera is uncalibrated (K of zeros)."""
    matrix = np.array(message.k if hasattr(message, "k") else message.K, np.float64).reshape(3, 3)
    return matrix if matrix[0, 0] > 0.0 else None


def picture_from_message(message: Any) -> Bytes:
    """Return the pixels (H, W, 3) RGB or (H, W) grey of a sensor_msgs/Image or CompressedImage.

    Raises:
        RecordingError: the encoding is unknown, or the bytes are not a picture.
    """
    if hasattr(message, "format"):
        image = _decompressed(np.asarray(message.data, np.uint8), message.format)
        return image if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])  # OpenCV decodes to BGR
    encoding = message.encoding
    if encoding in ("mono16", "16UC1"):
        return np.asarray(_rows(message, "u2", 1) >> 8, np.uint8)
    if encoding in _BAYER:
        return np.asarray(cv2.cvtColor(_rows(message, "u1", 1), _BAYER[encoding]), np.uint8)
    if encoding in _YUV:
        return np.asarray(cv2.cvtColor(_rows(message, "u1", 2), _YUV[encoding]), np.uint8)
    if encoding not in _CHANNELS:
        raise RecordingError(f"pictures of encoding '{encoding}' cannot be read; record rgb8, bgr8, mono8 or JPEG")
    pixels: Bytes = _rows(message, "u1", _CHANNELS[encoding])
    if pixels.ndim == 2:
        return pixels
    return np.ascontiguousarray(pixels[..., :3] if encoding.startswith("rgb") else pixels[..., 2::-1])


def depth_from_message(message: Any) -> Float32Array:
    """Return the depth (H, W) float32 [m], nan for none, of a sensor_msgs/Image or CompressedImage.

    Raises:
        RecordingError: the encoding is not a depth encoding, or the bytes are not a picture.
    """
    compressed = hasattr(message, "format")
    encoding = message.format.split(";")[0].strip() if compressed else message.encoding
    if encoding not in ("16UC1", "mono16", "32FC1"):
        raise RecordingError(f"a depth of encoding '{encoding}' cannot be read; record 16UC1 [mm] or 32FC1 [m]")
    if not compressed:
        return _metres(_rows(message, "f4" if encoding == "32FC1" else "u2", 1))
    data = np.asarray(message.data, np.uint8)
    if "rvl" in message.format.lower():
        raise RecordingError("depth in the RVL compression cannot be read; record compressedDepth as PNG")
    header = _DEPTH_HEADER if "compressedDepth" in message.format else 0
    raw = _decompressed(data[header:], message.format)
    if encoding != "32FC1":
        return _metres(raw)
    # Floats are stored as 16-bit inverse depths: depth = a / (stored - b), with 0 for none.
    _, a, b = struct.unpack_from("<iff", data.tobytes()[:_DEPTH_HEADER])
    stored = raw.astype(np.float32)
    with np.errstate(divide="ignore"):
        return np.where(raw > 0, np.float32(a) / (stored - np.float32(b)), np.float32(np.nan)).astype(np.float32)


def _metres(raw: np.ndarray) -> Float32Array:
    """Return depth [m] from integer millimetres or from metres; values <= 0 become nan."""
    depth = raw.astype(np.float32) * np.float32(1e-3) if raw.dtype.kind == "u" else raw.astype(np.float32)
    return np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(np.nan)).astype(np.float32)


def _rows(message: Any, kind: str, channels: int) -> Any:
    """Return the pixels (H, W) or (H, W, channels) of an Image with padded rows, in this machine's byte order."""
    kind = (">" if message.is_bigendian else "<") + kind
    height, width = message.height, message.width
    data = np.asarray(message.data, np.uint8)
    wide = width * channels * np.dtype(kind).itemsize
    if height < 1 or width < 1 or message.step < wide or len(data) < height * message.step:
        raise RecordingError(f"a picture of {width} x {height} pixels has only {len(data)} bytes; leave its topic out")
    rows = np.ascontiguousarray(data[: height * message.step].reshape(height, -1)[:, :wide]).view(kind)
    pixels = rows.astype(np.dtype(kind).newbyteorder("="), copy=False)
    return pixels if channels == 1 else pixels.reshape(height, width, channels)


def _decompressed(data: Bytes, what: str) -> Any:
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    except cv2.error:
        image = None
    if image is None:
        raise RecordingError(f"a compressed picture ('{what}', {len(data)} bytes) is damaged; leave its topic out")
    return image
