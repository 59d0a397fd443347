"""The chair's motion as measured: odometry, tilt, and its pose in map by localiser and odometry."""

from __future__ import annotations

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc
from waychair.slam.localising.localisation import Localisation
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.slam.odometry.tilt import Tilt, TiltFilter
from waychair.slam.odometry.wheel_counts import wheel_paths
from waychair.topics import ODOMETRY
from waychair.types import FloatArray, ImuSample, Odometry, Pose2, Twist, WheelTicks


class MeasuredMotion:
    """Motion and pose of one chair; `odometry` is the latest one, None before the first wheel reading."""

    def __init__(self, body: ChairBody, start: Pose2) -> None:
        """`start`: the chair's assumed pose in map until the localiser has found one."""
        self.odometry: Odometry | None = None
        self._body = body
        self._filter = OdometryFilter(body)
        self._wheels: tuple[WheelTicks, WheelTicks] | None = None  # at the last call of `wheel_paths`, and the latest
        self._tilt = TiltFilter(body)
        self._twists: list[Twist] = []  # since the last tick
        self._mean = Twist()
        self._start = start
        self._localisation: Localisation | None = None

    @property
    def twist(self) -> Twist:
        """The chair's twist as measured by wheels and gyro."""
        return Twist() if self.odometry is None else self.odometry.twist

    @property
    def wheels(self) -> WheelTicks | None:
        """The wheels' latest counts, continued over restarts of their counters; None before the first."""
        return None if self._wheels is None else self._wheels[1]

    @property
    def twist_covariance(self) -> FloatArray:
        """Covariance (3, 3) of forward speed, lateral speed and turn rate [m^2/s^2, m rad/s^2, rad^2/s^2]."""
        return self._filter.twist_covariance

    @property
    def tilt(self) -> Tilt | None:
        """The chair's tilt; None before the first IMU message."""
        return self._tilt.tilt

    def hear(self, message: WheelTicks | ImuSample) -> None:
        """Take in a reading of the wheels or the IMU."""
        if isinstance(message, WheelTicks):
            self.odometry = self._filter.update_wheels(message)
            self._twists.append(self.odometry.twist)
            wheels = self._filter.wheels or message
            self._wheels = (wheels if self._wheels is None else self._wheels[0]), wheels
        else:
            self._filter.update_imu(message)
            self._tilt.update(message, self.twist)

    def locate(self, localisation: Localisation) -> None:
        """Take in the localiser's result."""
        self._localisation = localisation

    def change_map(self, start: Pose2) -> None:
        """Forget the pose on the last map; the chair is assumed at `start` in the new one."""
        self._localisation, self._start = None, start

    def odom_from_base(self, stamp_ns: int) -> Pose2:
        """Return the odometry at a stamp, extrapolated by at most 0.1 s; the origin before the first wheel reading."""
        if self.odometry is None:
            return Pose2()
        seconds = min(max((stamp_ns - self.odometry.stamp_ns) * 1e-9, -0.1), 0.1)
        twist = self.odometry.twist
        return self.odometry.odom_from_base @ arc(twist.v * seconds, twist.omega * seconds)

    def fresh_pose(self, now_ns: int) -> Pose2 | None:
        """Return the odometry now; None where the wheels have been silent for too long."""
        stamp_ns = None if self.odometry is None else self.odometry.stamp_ns
        return None if ODOMETRY.is_stale(stamp_ns, now_ns) else self.odom_from_base(now_ns)

    def map_from_base(self, now_ns: int) -> Pose2:
        """Return the chair's pose in map by localiser and odometry."""
        if self._localisation is None:
            return self._start
        return self._localisation.map_from_odom @ self.odom_from_base(now_ns)

    def wheel_paths(self) -> tuple[float, float] | None:
        """Return the paths [m] of the left and right wheel since the last call; None without a reading since."""
        if self._wheels is None or self._wheels[0] is self._wheels[1]:
            return None
        before, now = self._wheels
        self._wheels = now, now
        return wheel_paths(before, now, self._body)

    def mean_twist(self) -> Twist:
        """Return the mean twist since the last call, because one encoder sample is coarse; without any, the last mean."""
        twists, self._twists = self._twists, []
        if twists:
            v, omega = sum(twist.v for twist in twists), sum(twist.omega for twist in twists)
            self._mean = Twist(v / len(twists), omega / len(twists))
        return self._mean
