"""Checks whether the chair is fit to drive: sensor ages, tilt, seat, charger, battery and localisation.

Each row of the fault table that needs no planner is judged here (F11, F13, F15, F23, F24) and named by `stops`. A fault
that ends or prevents a drive is a `Halt`; a fault that only slows a drive is a speed limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, setting
from waychair.control.safety.sensor_timing import (
    SLOW_AGE_S,
    WRONG_CLOCK_S,
    ScanTiming,
    SensorTiming,
    TickGaps,
    difference_of,
)
from waychair.control.safety.stops import Halt, halt
from waychair.errors import ConfigError
from waychair.slam.localising.localiser import Localisation, LocalisationState
from waychair.slam.odometry.tilt import TiltFilter
from waychair.topics import CAMERA, IMU, SCAN, STATUS, WHEELS
from waychair.types import ChairStatus, ImuSample, Pose2, RgbdFrame, Scan, Twist, WheelTicks

_CONTACTS = ("seated", "charging", "battery")
"""Fields of `ChairStatus` whose last known value is kept, because each message may hold only some of them."""

REACTIONS = ("slow", "stop")
"""Possible reactions of a drive to a sensor that it can do without falling silent."""

SLOW_SPEED = 0.3
"""m/s; speed of a drive that is slow for want of a sensor, of a certain pose or of level ground."""

SLOW_TILT, MOST_TILT, TILTED_S = 0.09, 0.14, 0.2
"""rad, rad, s; a tilt beyond the first, a little steeper than a ramp of 1:12, slows a drive. Beyond the second, 8 degrees,
chairs begin to slide or tip: after the third, so that no sill counts, it ends a drive."""

LEAST_HEALTH = 0.31
"""Pose probability from which a scan confirms the pose from which the chair started, as by default in the localiser."""

POSE_JUMP = 0.5
"""m; a localised pose that jumps farther was wrong before."""

_WHEELS_AGE_S, _SCAN_AGE_S = 0.08, 0.18
"""s; wheel readings and scans that arrive older than this are held up; usual ones are 0.02 and 0.1 s old."""

Sensed: TypeAlias = WheelTicks | Scan | ImuSample | RgbdFrame | ChairStatus


@dataclass(frozen=True, slots=True)
class FitnessSettings(Settings):
    """Limits, and the contacts that are fitted to the chair."""

    seat_switch: bool = setting(
        False, "", "true: the chair has a seat switch, and its silence ends or prevents a drive"
    )
    power_monitor: bool = setting(
        False, "", "true: the chair has a battery and charger monitor, and its silence ends or prevents a drive"
    )
    least_battery: float = setting(
        0.15,
        "",
        "share of battery charge below which no drive begins; larger: the chair refuses drives earlier",
        low=0.0,
        high=1.0,
    )
    imu_silent: str = setting("slow", "", "reaction when an IMU falls silent during a drive: slow or stop")
    depth_silent: str = setting(
        "slow", "", "reaction when a depth camera falls silent, so that drop-offs are unseen: slow or stop"
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        for name in ("imu_silent", "depth_silent"):
            if getattr(self, name) not in REACTIONS:
                raise ConfigError(f"{name} = '{getattr(self, name)}' is unknown: take {' or '.join(REACTIONS)}")


def has_valid_reading(message: Sensed) -> bool:
    """Return whether a message holds any valid reading; of a depth image every sixteenth pixel is checked."""
    if isinstance(message, ImuSample):
        return all(map(math.isfinite, (*message.accel.tolist(), *message.gyro.tolist())))
    return not isinstance(message, RgbdFrame) or bool(np.isfinite(message.depth[::4, ::4]).any())


class Fitness:
    """The latest stamp of each sensor, the chair's lean, and its latest localised pose."""

    def __init__(self, body: ChairBody, settings: FitnessSettings | None = None) -> None:
        self._settings = settings or FitnessSettings()
        self._tilt = TiltFilter(body)
        self._heard_ns: dict[type, int] = {}
        self._scans, self._wheels, self._gaps = ScanTiming(), SensorTiming(), TickGaps()
        self._dismissed: dict[type, tuple[int, float]] = {}  # time and age [s] of messages of another clock
        self._status = ChairStatus(0)  # each contact's last value
        self._contact_ns: dict[str, int] = {}
        self._tilted_since_ns: int | None = None
        self._lean = 0.0
        self._localisation: Localisation | None = None
        self._is_placed = False  # whether scans have ever confirmed a pose
        self._is_elsewhere = False  # whether the map has been changed
        self._jump_m = 0.0

    def hear(self, message: Sensed, twist: Twist) -> None:
        """Take in a sensor's message while the chair moved by `twist`; the IMU's axes are the base's.

        A message without a valid reading counts as silence.
        """
        if not has_valid_reading(message):
            return
        self._heard_ns[type(message)] = message.stamp_ns
        if isinstance(message, Scan | WheelTicks):
            (self._scans if isinstance(message, Scan) else self._wheels).hear(message.stamp_ns)
        if isinstance(message, ChairStatus):
            known = {name: value for name in _CONTACTS if (value := getattr(message, name)) is not None}
            self._status = replace(self._status, **known)
            self._contact_ns |= dict.fromkeys(known, message.stamp_ns)
        elif isinstance(message, ImuSample):
            tilt = self._tilt.update(message, twist)
            lean = math.acos(min(1.0, max(-1.0, math.cos(tilt.roll) * math.cos(tilt.pitch))))
            if lean <= MOST_TILT:
                self._tilted_since_ns = None
            elif self._tilted_since_ns is None:
                self._tilted_since_ns = message.stamp_ns
            self._lean = lean

    def dismiss(self, message: Sensed, age_s: float, now_ns: int) -> None:
        """Note a message that cannot be used because its stamp, so much older [s] than now, is of another clock."""
        self._dismissed[type(message)] = now_ns, age_s

    def locate(self, localisation: Localisation, odom_from_base: Pose2) -> None:
        """Take in the localised pose now; a jump since the last call is remembered until `settle`."""
        before, self._localisation = self._localisation, localisation
        confirmed = localisation.state is LocalisationState.OK or localisation.health >= LEAST_HEALTH
        self._is_placed = self._is_placed or (confirmed and not localisation.lost)
        if before is None:
            return
        expected = before.map_from_odom @ odom_from_base
        found = localisation.map_from_odom @ odom_from_base
        pending = math.hypot(localisation.remaining.x, localisation.remaining.y)
        self._jump_m = max(self._jump_m, pending, math.hypot(found.x - expected.x, found.y - expected.y))

    def change_map(self) -> None:
        """Forget the pose on the last map: scans must confirm one on the new map first."""
        self._localisation, self._is_placed, self._jump_m = None, False, 0.0
        self._is_elsewhere = True

    def settle(self) -> None:
        """Forget jumps of the pose, because nothing drives."""
        self._jump_m = 0.0

    def halts(self, now_ns: int) -> tuple[Halt, ...]:
        """Return the faults that end a drive or keep one from beginning; called once a tick."""
        for timing in (self._scans, self._wheels, self._gaps):
            timing.tick(now_ns)
        return (*self._silent(now_ns), *self._contacts(now_ns), *self._lost(), *self._steep(now_ns))

    def speed_limit(self, now_ns: int) -> float:
        """Return the highest speed [m/s] of a drive that may go on; +inf when all is well."""
        missed = self._is_missed(ImuSample, now_ns) or self._is_missed(RgbdFrame, now_ns)
        doubtful = self._localisation is not None and self._localisation.state is LocalisationState.DEGRADED
        old = self._scans.oldest_s() > SLOW_AGE_S
        return SLOW_SPEED if missed or doubtful or old or self._lean > SLOW_TILT else math.inf

    def _is_missed(self, sensor: type[ImuSample | RgbdFrame], now_ns: int) -> bool:
        """Return whether a sensor that the chair can do without was heard before and has fallen silent."""
        topic = IMU if sensor is ImuSample else CAMERA
        heard = self._heard_ns.get(sensor)
        return heard is not None and topic.is_stale(heard, now_ns)

    def _silent(self, now_ns: int) -> tuple[Halt, ...]:
        """Return the halts of F11 and F13: sensors that are silent, late or too slow."""
        s = self._settings
        halts = [found for found in (self._slow_lidar(now_ns), self._slow_wheels(now_ns)) if found is not None]
        if s.imu_silent == "stop" and self._is_missed(ImuSample, now_ns):
            halts.append(halt("imu_stale"))
        if s.depth_silent == "stop" and self._is_missed(RgbdFrame, now_ns):
            halts.append(halt("depth_stale"))
        return tuple(halts)

    def _slow_lidar(self, now_ns: int) -> Halt | None:
        """Return the halt of a lidar that is silent, or late again and again, by its cause."""
        late = self._scans.halt(self._gaps.often() or self._wheels.delay_s() > _WHEELS_AGE_S)
        stamp_ns, longest_ns = self._heard_ns.get(Scan), SCAN.max_age_ns() or 0
        if late is not None and self._scans.keeps_coming(now_ns, max(longest_ns, round(2e9 * self._scans.period_s()))):
            return late
        if not SCAN.is_stale(stamp_ns, now_ns):
            return None
        if (age_s := self._age_of_dismissed(Scan, now_ns)) is not None:
            delayed = 0.0 < age_s <= WRONG_CLOCK_S
            return halt("lidar_delayed" if delayed else "lidar_clock", difference_of(age_s))
        busy = stamp_ns is not None and self._gaps.explain(now_ns, now_ns - stamp_ns)
        return halt("computer_slow" if busy else "lidar_stale")

    def _slow_wheels(self, now_ns: int) -> Halt | None:
        """Return the halt of silent or late wheel encoders, by its cause."""
        stamp_ns, longest_ns = self._heard_ns.get(WheelTicks), WHEELS.max_age_ns() or 0
        if not WHEELS.is_stale(stamp_ns, now_ns):
            return None
        if stamp_ns is not None and self._gaps.explain(now_ns, now_ns - stamp_ns):
            return halt("computer_slow")
        if (age_s := self._age_of_dismissed(WheelTicks, now_ns)) is not None:
            return halt("wheels_delayed", f"their clock is {difference_of(age_s)}")
        if self._wheels.keeps_coming(now_ns, longest_ns):
            alike = self._scans.delay_s() > max(_SCAN_AGE_S, 0.5 * self._wheels.delay_s())
            return halt("computer_slow" if alike else "wheels_delayed", f"they are {self._wheels.delay_s():.2f} s old")
        return halt("wheels_stale")

    def _age_of_dismissed(self, sensor: type, now_ns: int) -> float | None:
        """Return the age [s] of a sensor's latest message of another clock; None without one in the last moments."""
        when_ns, age_s = self._dismissed.get(sensor, (0, None))
        return age_s if age_s is not None and not SCAN.is_stale(when_ns, now_ns) else None

    def _contacts(self, now_ns: int) -> tuple[Halt, ...]:
        """Return the halts of F24 and the seat switch; a contact's last value counts even if it is not set as
        fitted."""
        s, status, halts = self._settings, self._status, []
        fitted = (("seated", s.seat_switch), ("charging", s.power_monitor))
        if any(is_fitted and STATUS.is_stale(self._contact_ns.get(name), now_ns) for name, is_fitted in fitted):
            halts.append(halt("status_stale"))
        if status.charging:
            halts.append(halt("charging"))
        if status.seated is False:
            halts.append(halt("seat_empty"))
        if status.battery is not None and not status.battery >= s.least_battery:
            halts.append(halt("battery_low", f"{100.0 * status.battery:.0f} %"))
        return tuple(halts)

    def _lost(self) -> tuple[Halt, ...]:
        """Return the halts of F15: a pose that scans never confirmed, a lost one, or a jumping one."""
        if (self._localisation is not None or self._is_elsewhere) and not self._is_placed:
            return (halt("unplaced"),)
        if self._localisation is not None and self._localisation.lost:
            return (halt("lost"),)
        if self._jump_m > POSE_JUMP:
            return (halt("pose_jump", f"{self._jump_m:.1f} m away"),)
        return ()

    def _steep(self, now_ns: int) -> tuple[Halt, ...]:
        """Return the halts of F23: tilt."""
        if self._tilted_since_ns is None or now_ns - self._tilted_since_ns < TILTED_S * 1e9:
            return ()
        return (halt("tilt", f"{math.degrees(self._lean):.0f} degrees"),)
