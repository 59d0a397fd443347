"""The limits of a command: wheels, comfort, collision monitor, sight, measured stops and slow zones."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.stopping import StopTable, permitted_speed
from waychair.control.safety.collision_monitor import permitted_share, stale_stop
from waychair.control.safety.sight_speed import Sector, sectors_of_scan, sight_share
from waychair.control.safety.stops import STOPS, Braking, halt
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.control.speed.kinematics import saturate, twist_from_wheel_speeds, wheel_speeds_from_twist
from waychair.control.speed.limiter import Limiter, is_possible
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Zone, zone_speed_limit
from waychair.runtime.base_settings import BaseSettings
from waychair.runtime.measured_motion import MeasuredMotion
from waychair.runtime.monitor_process import MonitorPort
from waychair.types import Pose2, Scan, Twist


class CommandLimits:
    """From an asked twist to the command of a tick; `zones` may be replaced at any time."""

    def __init__(
        self,
        body: ChairBody,
        stops: StopTable | None,
        settings: BaseSettings,
        monitor: MonitorPort,
        zones: Sequence[Zone] = (),
    ) -> None:
        self.zones = tuple(zones)
        self._body = body
        self._stops = stops
        self._settings = settings
        self._monitor = monitor
        self._limiter = Limiter(settings.limiter)
        self._sectors: list[Sector] = []  # directions in which the latest scan measured something

    def see(self, scan: Scan) -> None:
        """Take in a scan without the beams that the chair itself stops."""
        self._sectors = sectors_of_scan(scan, self._body.base_from_laser)

    @property
    def sectors(self) -> Sequence[Sector]:
        """The directions in which the latest scan measured something."""
        return self._sectors

    def rest(self) -> None:
        """Start the next command from standstill, because the lines were released."""
        self._limiter.rest()

    def gate(self, now_ns: int) -> str:
        """Return why the bridge may send no speed, by the age of the monitor's verdict and scan; empty if it may."""
        stop_id = stale_stop(self._monitor.verdict, now_ns)
        return halt(stop_id).text if stop_id else ""

    def command(
        self,
        now_ns: int,
        verdict: SupervisorVerdict,
        asked: Twist | None,
        motion: MeasuredMotion,
        speed_limit: float,
        *,
        counts_down: bool,
    ) -> Twist | None:
        """Return the asked twist within all limits, or a step towards rest; None to let go of the lines.

        `speed_limit` [m/s] is that of control loop and sensors. `counts_down`: the confirmed drive may not move yet.
        """
        limiter, driving = self._limiter, verdict.computer_drives and asked is not None
        braking = None if driving else verdict.braking
        wanted = limiter.command
        if driving and counts_down:
            wanted, braking = Twist(), Braking.COMFORT
        elif driving and asked is not None:
            wanted = self._within_wheels(Twist(verdict.share * asked.v, verdict.share * asked.omega))
        self._monitor.judge(wanted, motion.twist, now_ns)
        if not driving and (braking is Braking.RELEASE or not limiter.moving):
            limiter.rest()
            return None
        found = self._monitor.verdict
        if found is not None and found.stop:
            braking = STOPS[found.stop].braking
        if self.gate(now_ns):  # the bridge sends zero, so there is no command to limit
            braking = Braking.RELEASE
        cap = min(speed_limit, permitted_speed(self._stops), self._zone_limit(motion.map_from_base(now_ns)))
        share = 0.0 if found is None else permitted_share(wanted, found)
        seen = sight_share(wanted, self._body, self._sectors, self._settings.unseen)
        in_sight = Twist(seen * wanted.v, seen * wanted.omega)  # at once: nothing is known of unseen space
        return limiter.step(in_sight, now_ns, cap, min(1.0, share / max(seen, share, 1e-9)), braking)

    def _within_wheels(self, twist: Twist) -> Twist:
        """Slow a twist down along its arc to the greatest wheel speed; an impossible twist is returned as it is."""
        track = self._body.track
        speeds = wheel_speeds_from_twist(twist, track)
        slower = saturate(speeds, self._settings.bridge.max_wheel_speed)
        return twist if slower is speeds or not is_possible(twist) else twist_from_wheel_speeds(slower, track)

    def _zone_limit(self, here: Pose2) -> float:
        """Return the speed limit [m/s] of the slow zones under the chair, here and where it could have slowed down."""
        v, limits = self._limiter.command.v, self._settings.limiter
        seconds = limits.braking / limits.jerk / 2 + self._settings.monitor.reaction_s  # the chair lags its command
        slows_down_in = math.copysign(abs(v) * seconds + v * v / (2.0 * limits.braking), v)
        there = here @ Pose2(slows_down_in)
        outline = np.concatenate([transform_points(pose, self._body.outline()) for pose in (here, there)])
        return zone_speed_limit(self.zones, outline)
