"""Decoding of sensor_msgs/PointCloud2 without ROS: the points, and the time of each where the driver gives it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from waychair.errors import RecordingError
from waychair.types import FloatArray

_FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # sensor_msgs/PointField
TIME_FIELDS = ("time", "t", "timestamp", "time_stamp", "timestamps", "offset_time", "time_offset", "ts", "point_time")
"""Names under which drivers give the time of each point: Velodyne time, Ouster t, Hesai and RoboSense timestamp, Livox offset_time."""


class CloudDamaged(RecordingError):
    """The layout of a point cloud contradicts the size of its data."""


@dataclass(frozen=True, slots=True)
class Cloud:
    """Finite points (N, 3) [m] in the sensor's frame, in the order of the message.

    `times` (N,) are the points' times as told, in whatever unit and from whatever origin; None if there are none.
    """

    points: FloatArray
    times: FloatArray | None = None


def cloud_from_message(message: Any) -> Cloud:
    """Return the points of a sensor_msgs/PointCloud2; its sizes are checked before anything is copied.

    Raises:
        CloudDamaged: the sizes in the message do not fit its data, or it has no x, y and z.
    """
    fields = {field.name: field for field in message.fields}
    if not {"x", "y", "z"} <= set(fields):
        raise CloudDamaged(f"a point cloud holds the fields {', '.join(fields) or 'none'}, but no x, y, z")
    time = next((name for name in TIME_FIELDS if name in fields and fields[name].datatype in _FIELD_TYPES), None)
    names = ["x", "y", "z"] if time is None else ["x", "y", "z", time]
    order = ">" if message.is_bigendian else "<"
    kinds = [order + _FIELD_TYPES.get(fields[name].datatype, "f4") for name in names]
    offsets = [int(fields[name].offset) for name in names]
    step, width, height, row = (int(v) for v in (message.point_step, message.width, message.height, message.row_step))
    data = np.asarray(message.data, np.uint8)
    row = width * step if height == 1 else row
    ends = [offset + np.dtype(kind).itemsize for offset, kind in zip(offsets, kinds, strict=True)]
    if step < max(ends) or row < width * step or len(data) < height * row:
        raise CloudDamaged(
            f"a point cloud of {width} x {height} points of {step} bytes in rows of {row} bytes has {len(data)} bytes of data"
        )
    layout = np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": step})
    rows = data[: height * row].reshape(height, row)
    records = np.ascontiguousarray(rows[:, : width * step]).reshape(-1).view(layout)
    points = np.stack([records[name].astype(np.float64) for name in "xyz"], axis=1)
    finite = np.isfinite(points).all(axis=1)
    if time is None:
        return Cloud(points[finite])
    times = records[time].astype(np.float64)
    finite &= np.isfinite(times)
    return Cloud(points[finite], times[finite])
