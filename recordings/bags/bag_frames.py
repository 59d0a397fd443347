"""Sensor frames of a bag: a frame for each scan, with the odometry and the IMU samples since the scan before."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

from waychair.geometry import interpolate
from waychair.recordings.bags.bag_topics import ODOMETRY_TYPE
from waychair.types import ImuSample, Odometry, Scan, SensorFrame, Twist


def sensor_frames(
    scans: Sequence[Scan], odometry: Sequence[Odometry], imu: Sequence[ImuSample], warnings: list[str]
) -> tuple[SensorFrame, ...]:
    """Return a frame for each scan, with its odometry; scans outside the odometry's time span are left out."""
    stamps, imu_stamps = [reading.stamp_ns for reading in odometry], [sample.stamp_ns for sample in imu]
    inside = [scan for scan in scans if stamps and stamps[0] <= scan.stamp_ns <= stamps[-1]]
    if not inside:
        warnings.append(_no_odometry(scans, stamps))
    elif len(inside) < len(scans):
        missing = len(scans) - len(inside)
        warnings.append(f"{missing} scans before the first or after the last odometry were left out")
    frames, done, imu_done = [], 0, 0
    for scan in inside or scans:
        imu_until = max(imu_done, bisect_right(imu_stamps, scan.stamp_ns))
        wheels: list[Odometry] = []
        if inside:
            until = bisect_right(stamps, scan.stamp_ns)
            wheels = list(odometry[done:until])
            if stamps[until - 1] != scan.stamp_ns:
                wheels.append(_between(odometry[until - 1], odometry[until], scan.stamp_ns))
            elif not wheels:
                wheels = [odometry[until - 1]]  # two scans at one stamp
            done = max(done, until)
        samples = tuple(imu[imu_done:imu_until])
        frames.append(SensorFrame(scan.stamp_ns, scan=scan, wheels=tuple(wheels), imu=samples))
        imu_done = imu_until
    return tuple(frames)


def _no_odometry(scans: Sequence[Scan], stamps: Sequence[int]) -> str:
    why = f"no {ODOMETRY_TYPE} and no /tf that moves the base"
    if stamps:
        late = (stamps[0] - scans[0].stamp_ns) * 1e-9
        why = f"no odometry at the time of the scans (its first stamp is {late:+.1f} s from theirs)"
    return f"the bag holds {why}: the motion is estimated by scan matching alone"


def _between(before: Odometry, after: Odometry, at_ns: int) -> Odometry:
    """Return the odometry at a stamp between two readings: pose and speeds interpolated, the later covariance."""
    part = (at_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    v = before.twist.v + part * (after.twist.v - before.twist.v)
    omega = before.twist.omega + part * (after.twist.omega - before.twist.omega)
    pose = interpolate(before.odom_from_base, after.odom_from_base, part)
    return Odometry(at_ns, pose, Twist(v, omega), after.covariance)
