"""Further effects of chairs' electronics, beyond gains, dead bands and ramps; the default figures switch them off.

No single form of calibration describes all of these effects, so the families test a calibration's limits. A function
says where documents of real controllers mention its effect; all figures are plausible, not measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated

from waychair.simulation.plant.figure_limits import Limits, check_limits

SWING_END = 3.7
"""A caster has swung round when ln tan(phi / 2) of its angle phi reaches this: 3 degrees short of trailing exactly."""

AT_REST = 0.01
"""Wheel speed [m/s] below which the parking brake may engage."""

BRAKE_REST_S = 0.5
"""Time at rest without a command after which the parking brake engages."""

CASTER_TRAIL = 0.055
"""Distance [m] of a caster's axle behind its pivot, in the kinematic plant."""

ROLLING_LOAD = 0.3
"""Load of the motors at full speed on the level, in the kinematic plant."""


@dataclass(frozen=True, slots=True)
class PlantFamily:
    """The figures of one family; the defaults change nothing."""

    stick_curve: Annotated[float, Limits(0.0, 1.0)] = 0.0  # S-curve of the stick: 0 straight, 1 smoothstep
    turn_cut: Annotated[float, Limits(0.0, 0.9)] = 0.0  # part of the speed lost at full turn
    turn_fade: Annotated[float, Limits(0.0, 0.9)] = 0.0  # part of the turn lost at full speed
    dial: Annotated[float, Limits(0.2, 1.0)] = 1.0  # speed dial: part of the greatest speed and turn
    profile_speed: Annotated[float, Limits(0.1, 1.0)] = 1.0  # drive profile: part of the greatest speed and turn
    profile_ramp: Annotated[float, Limits(0.1, 1.0)] = 1.0  # drive profile: part of all ramps
    charge: Annotated[float, Limits(0.0, 1.0)] = 1.0  # charge of the battery: 0 empty, 1 full
    sag_empty: Annotated[float, Limits(0.0, 0.5)] = 0.0  # part of the voltage that an empty battery lacks
    sag_load: Annotated[float, Limits(0.0, 0.5)] = 0.0  # part of the voltage that full load takes
    brake_release_s: Annotated[float, Limits(0.0, 2.0)] = 0.0  # s; delay of the parking brake's release; 0: no brake
    caster_flip: Annotated[float, Limits(0.0, 1.0)] = 0.0  # rad; yaw by one swing of the casters (kinematic plant only)
    thermal_fade: Annotated[float, Limits(0.0, 0.9)] = 0.0  # part of the power that hot motors lack
    thermal_from: Annotated[float, Limits(0.0, 0.5)] = 0.01  # mean square load at which the power begins to fade
    thermal_full: Annotated[float, Limits(0.01, 1.0)] = 0.10  # mean square load at which all of `thermal_fade` is lost
    thermal_s: Annotated[float, Limits(1.0, 3600.0)] = 60.0  # s; time constant of warming up and cooling down

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def speed(self) -> float:
        """Part of the greatest speeds that dial and profile allow."""
        return self.dial * self.profile_speed


FAMILIES: Mapping[str, PlantFamily] = MappingProxyType(
    {
        "s_curve": PlantFamily(stick_curve=0.8),
        "turn_cut": PlantFamily(turn_cut=0.4, turn_fade=0.5),
        "dial_20": PlantFamily(dial=0.2),
        "dial_60": PlantFamily(dial=0.6, profile_speed=0.9, profile_ramp=0.6),
        "sag": PlantFamily(charge=0.3, sag_empty=0.12, sag_load=0.10),
        "brake_release": PlantFamily(brake_release_s=0.35),
        "caster_flip": PlantFamily(caster_flip=0.12),
        "thermal_fade": PlantFamily(thermal_fade=0.4),
    }
)
"""Eight controllers by name, each with one effect that a rider would notice."""


def stick_response(deflection: float, curve: float) -> float:
    """Return the S-curve (1 - c) u + c u^2 (3 - 2 u) of a deflection u in [-1, 1] beyond the dead band.

    It is odd and monotonic, and makes the stick less sensitive near the middle; plausible, not measured.
    """
    u = abs(deflection)
    return math.copysign((1.0 - curve) * u + curve * u * u * (3.0 - 2.0 * u), deflection)


def cut_speed_and_turn(forward: float, turn: float, settings: PlantFamily) -> tuple[float, float]:
    """Return both axes in [-1, 1] after turn reduces the speed and speed reduces the turn.

    The chair slows down in a curve, and its curves are wider at speed. Each axis loses a part that grows linearly with
    the other's deflection. Owners report that controllers lower the speed with turn (wheelchairdriver.com, thread
    3261); the linear form is plausible, not measured.
    """
    return (
        forward * (1.0 - settings.turn_cut * abs(turn)),
        turn * (1.0 - settings.turn_fade * abs(forward)),
    )


def voltage(load: float, settings: PlantFamily) -> float:
    """Return the battery's voltage at a load in [0, 1], relative to a full battery; speeds are proportional to it.

    The chair is slower at the end of the day and uphill. The open-circuit voltage falls linearly with the charge, and
    the inner resistance takes a drop proportional to the load; both are plausible, not measured.
    """
    return 1.0 - settings.sag_empty * (1.0 - settings.charge) - settings.sag_load * load


class ParkingBrake:
    """The parking brakes on the motors, with their release and engage delays.

    A rider notices a short wait and a click before the chair moves off. Springs engage the brakes and a current
    releases them: they open `brake_release_s` after a command to the motors (0.2 to 0.5 s is plausible, not measured),
    and shut BRAKE_REST_S after the chair has come to rest without a command.
    """

    def __init__(self, settings: PlantFamily, step_s: float) -> None:
        self._settings = settings
        self._step_s = step_s
        self._changing_s = 0.0
        self.shut = settings.brake_release_s > 0.0

    def step(self, asked: bool, speed: float) -> bool:
        """Return whether the brakes are shut after one step, given a command `asked` or not and the wheels' `speed`."""
        s = self._settings
        if s.brake_release_s == 0.0:
            return False
        about_to_change = asked if self.shut else not asked and speed < AT_REST
        self._changing_s = self._changing_s + self._step_s if about_to_change else 0.0
        # half a step more, so that the rounded sum of many steps is not short of the time
        if self._changing_s + 0.5 * self._step_s > (s.brake_release_s if self.shut else BRAKE_REST_S):
            self.shut, self._changing_s = not self.shut, 0.0
        return self.shut


class Casters:
    """The casters' direction, and the yaw of the chair while they swing round.

    The chair lurches sideways when it starts to reverse. A caster follows its pivot like a trailer:
    phi' = -(v / trail) sin(phi) for the angle phi from trailing forwards, so ln tan(phi / 2) falls by the distance
    driven over the trail. The chair yaws by `caster_flip` over the half turn of phi, in proportion to its progress, to
    the side of its last turn. The yaw is plausible, not measured.
    """

    def __init__(self, settings: PlantFamily) -> None:
        self._settings = settings
        self._swing = -SWING_END
        self._side = 1.0

    def step(self, v: float, omega: float, step_s: float) -> float:
        """Return the yaw rate [rad/s] from the casters in one step at speed v [m/s] and turn rate omega [rad/s]."""
        if abs(omega) > 0.02:
            self._side = math.copysign(1.0, omega)
        before = self._swing
        self._swing = min(SWING_END, max(-SWING_END, before - v * step_s / CASTER_TRAIL))
        swung = abs(_angle(self._swing) - _angle(before))
        return self._side * self._settings.caster_flip * swung / (_angle(SWING_END) - _angle(-SWING_END)) / step_s


class Heat:
    """The motors' heat, as their mean square load over the last minutes.

    The chair weakens on a long climb and recovers on the level. Copper heats with the square of its current and cools
    with one time constant; the controller reduces the current between two temperatures. Plausible, not measured.
    """

    def __init__(self, settings: PlantFamily, step_s: float) -> None:
        self._settings = settings
        self._part = 1.0 - math.exp(-step_s / settings.thermal_s)
        self._mean_square = 0.0

    def step(self, load: float) -> float:
        """Return the part of the power that is left after one step at a load in [0, 1]."""
        s = self._settings
        self._mean_square += self._part * (load * load - self._mean_square)
        hot = (self._mean_square - s.thermal_from) / max(s.thermal_full - s.thermal_from, 1e-9)
        return 1.0 - s.thermal_fade * min(1.0, max(0.0, hot))


def _angle(swing: float) -> float:
    """Return the angle phi [rad] of a caster from `swing` = ln tan(phi / 2)."""
    return 2.0 * math.atan(math.exp(swing))
