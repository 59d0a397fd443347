"""Drives during which the chair was carried: two parts of a recording, over which the odometry goes on as if nothing had happened."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from waychair.slam.mapping.tracking import odometry_of
from waychair.types import Odometry, Pose2, SensorFrame


def spliced(before: Sequence[SensorFrame], after: Sequence[SensorFrame]) -> Iterator[SensorFrame]:
    """Yield the frames of both parts; the odometry of the first one `after` is that of the last one `before`."""
    yield from before
    lifted, put_down = odometry_in(before[-1]), odometry_in(after[0])
    for frame in after:
        step = put_down.odom_from_base.inverse() @ odometry_in(frame).odom_from_base
        yield with_odometry(frame, lifted.odom_from_base @ step)


def with_odometry(frame: SensorFrame, odom_from_base: Pose2) -> SensorFrame:
    """Return a frame whose odometry says this pose."""
    return replace(frame, wheels=(replace(odometry_in(frame), odom_from_base=odom_from_base),))


def odometry_in(frame: SensorFrame) -> Odometry:
    """Return the odometry of a frame that has some."""
    reading = odometry_of(frame)
    assert reading is not None
    return reading
