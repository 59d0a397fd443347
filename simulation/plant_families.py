"""What chairs' electronics do beyond gains, dead bands and ramps, each by a figure that is neutral by default.

No single form of calibration describes all of it: that is what these families are for. Where the documents of real
controllers mention an effect, its function says so; all figures are plausible, not measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from waychair.config import Settings, setting

SWING_END = 3.7
"""A caster has swung round when ln tan(phi / 2) of its angle phi is here: 3 degrees short of trailing exactly."""

AT_REST = 0.01
"""Wheels slower than this [m/s] are held by the parking brake."""


@dataclass(frozen=True, slots=True)
class FamilySettings(Settings):
    """One member of the families; the defaults change nothing."""

    stick_curve: float = setting(0.0, "", "S-curve of the stick: 0 straight, 1 smoothstep", low=0.0, high=1.0)
    turn_cut: float = setting(0.0, "", "part of the speed that is lost at full turn", low=0.0, high=0.9)
    turn_fade: float = setting(0.0, "", "part of the turn that is lost at full speed", low=0.0, high=0.9)
    dial: float = setting(1.0, "", "speed dial: part of the greatest speed and turn", low=0.2, high=1.0)
    profile_speed: float = setting(1.0, "", "drive profile: part of the greatest speed and turn", low=0.1, high=1.0)
    profile_ramp: float = setting(1.0, "", "drive profile: part of all ramps", low=0.1, high=1.0)
    charge: float = setting(1.0, "", "of the battery: 0 empty, 1 full", low=0.0, high=1.0)
    sag_empty: float = setting(0.0, "", "part of its voltage that an empty battery lacks", low=0.0, high=0.5)
    sag_load: float = setting(0.0, "", "part of its voltage that full load takes", low=0.0, high=0.5)
    brake_release_s: float = setting(0.0, "s", "parking brake opens so late; 0 without a brake", low=0.0, high=2.0)
    brake_rest_s: float = setting(0.5, "s", "parking brake shuts after so long at rest", low=0.0, high=10.0)
    caster_flip: float = setting(0.0, "rad", "yaw by one swing of the casters (kinematic only)", low=0.0, high=1.0)
    caster_trail: float = setting(0.055, "m", "caster's axle behind its pivot (kinematic only)", low=0.01, high=0.2)
    thermal_fade: float = setting(0.0, "", "part of the power that hot motors lack", low=0.0, high=0.9)
    thermal_from: float = setting(0.01, "", "mean square load at which power begins to fade", low=0.0, high=0.5)
    thermal_full: float = setting(0.10, "", "mean square load at which the whole of it is lost", low=0.01, high=1.0)
    thermal_s: float = setting(60.0, "s", "time constant of warming up and cooling down", low=1.0, high=3600.0)
    rolling_load: float = setting(0.3, "", "load at full speed on the level (kinematic only)", low=0.0, high=1.0)

    @property
    def speed(self) -> float:
        """Part of the greatest speeds that dial and profile leave."""
        return self.dial * self.profile_speed


FAMILIES: Mapping[str, FamilySettings] = MappingProxyType(
    {
        "s_curve": FamilySettings(stick_curve=0.8),
        "turn_cut": FamilySettings(turn_cut=0.4, turn_fade=0.5),
        "dial_20": FamilySettings(dial=0.2),
        "dial_60": FamilySettings(dial=0.6, profile_speed=0.9, profile_ramp=0.6),
        "sag": FamilySettings(charge=0.3, sag_empty=0.12, sag_load=0.10),
        "brake_release": FamilySettings(brake_release_s=0.35),
        "caster_flip": FamilySettings(caster_flip=0.12),
        "thermal_fade": FamilySettings(thermal_fade=0.4),
    }
)
"""Eight controllers, each with one effect that a rider would notice."""


def stick_response(deflection: float, curve: float) -> float:
    """Answer to a deflection in [-1, 1] beyond the dead band: gentle at first and at the end, odd and monotonic.

    A rider feels a stick that is calm near the middle. (1 - c) u + c u^2 (3 - 2 u); plausible, not measured.
    """
    u = abs(deflection)
    return math.copysign((1.0 - curve) * u + curve * u * u * (3.0 - 2.0 * u), deflection)


def cut_by_each_other(forward: float, turn: float, settings: FamilySettings) -> tuple[float, float]:
    """Axes in [-1, 1] after the speed is cut with turn and the turn with speed.

    A rider feels the chair slow down into a curve, and wide curves at speed. Each axis loses a part that grows with
    the other's deflection. That controllers lower the speed with turn is told by owners (wheelchairdriver.com, thread
    3261); the straight line is plausible, not measured.
    """
    return (
        forward * (1.0 - settings.turn_cut * abs(turn)),
        turn * (1.0 - settings.turn_fade * abs(forward)),
    )


def voltage(load: float, settings: FamilySettings) -> float:
    """Part of the full battery's voltage at a load in [0, 1]; speeds are in proportion to it.

    A rider feels a tired chair: slower at the end of the day and uphill. An open-circuit voltage that falls with the
    charge, less a drop at the inner resistance; both straight lines are plausible, not measured.
    """
    return 1.0 - settings.sag_empty * (1.0 - settings.charge) - settings.sag_load * load


class ParkingBrake:
    """Whether the brakes on the motors are shut, and for how long that has been about to change.

    A rider feels a short wait and a click before the chair sets off. The brakes are shut by springs and opened by a
    current: they open `brake_release_s` after something is asked of the motors (0.2 to 0.5 s is plausible, not
    measured), and shut `brake_rest_s` after the chair has come to rest with nothing asked.
    """

    def __init__(self, settings: FamilySettings, step_s: float) -> None:
        self._settings = settings
        self._step_s = step_s
        self._changing_s = 0.0
        self.shut = settings.brake_release_s > 0.0

    def step(self, asked: bool, speed: float) -> bool:
        """Whether they are shut after one step: is anything `asked` of the motors, do the wheels turn at `speed`?"""
        s = self._settings
        if s.brake_release_s == 0.0:
            return False
        about_to_change = asked if self.shut else not asked and speed < AT_REST
        self._changing_s = self._changing_s + self._step_s if about_to_change else 0.0
        # half a step more, so that a sum of many steps does not fall short of the time by its last digit
        if self._changing_s + 0.5 * self._step_s > (s.brake_release_s if self.shut else s.brake_rest_s):
            self.shut, self._changing_s = not self.shut, 0.0
        return self.shut


class Casters:
    """Which way the casters trail, and to which side they push when they swing round.

    A rider feels the chair lurch sideways on setting off backwards. A caster follows its pivot like a trailer:
    phi' = -(v / trail) sin(phi) for the angle phi from trailing forwards, which is solved by
    ln tan(phi / 2) falling by the way over the trail; the chair yaws by `caster_flip` over the half turn of phi, in
    proportion to its progress, to the side to which it turned last. The yaw is plausible, not measured.
    """

    def __init__(self, settings: FamilySettings) -> None:
        self._settings = settings
        self._swing = -SWING_END
        self._side = 1.0

    def step(self, v: float, omega: float, step_s: float) -> float:
        """Yaw rate [rad/s] added by the casters in one step at speed v [m/s] and turn rate omega [rad/s]."""
        if abs(omega) > 0.02:
            self._side = math.copysign(1.0, omega)
        before = self._swing
        self._swing = min(SWING_END, max(-SWING_END, before - v * step_s / self._settings.caster_trail))
        swung = abs(_angle(self._swing) - _angle(before))
        return self._side * self._settings.caster_flip * swung / (_angle(SWING_END) - _angle(-SWING_END)) / step_s


class Heat:
    """Mean square load of the motors over the last minutes.

    A rider feels the chair grow weak after long climbing and recover on the level. Copper heats with the square of
    its current and cools like a body of one time constant; the controller folds the current back between two
    temperatures. The scheme is plausible, not measured.
    """

    def __init__(self, settings: FamilySettings, step_s: float) -> None:
        self._settings = settings
        self._part = 1.0 - math.exp(-step_s / settings.thermal_s)
        self._mean_square = 0.0

    def step(self, load: float) -> float:
        """Part of the power that is left after one step at a load in [0, 1]."""
        s = self._settings
        self._mean_square += self._part * (load * load - self._mean_square)
        hot = (self._mean_square - s.thermal_from) / max(s.thermal_full - s.thermal_from, 1e-9)
        return 1.0 - s.thermal_fade * min(1.0, max(0.0, hot))


def _angle(swing: float) -> float:
    """Angle [rad] of a caster whose ln tan(phi / 2) is `swing`."""
    return 2.0 * math.atan(math.exp(swing))
