"""Caps on the rider's stick from the lidar, as the guard wants them: how far each direction may be pushed now.

The board copies the stick, clamped to these caps (`clamped`): never more than the rider pushes, never another sign. A cap is
the largest deflection whose arc still stops free: first `RUN_ON_S` of the measured motion, then `HELD_S` of the command,
then to rest. Nearer to things than the margins the chair may only creep along or away from them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.safety.collision_monitor import points_now, valid_beams
from waychair.geometry import arcs
from waychair.simulation.plant.plant import PlantSettings
from waychair.types import BoolArray, FloatArray, JoystickInput, Scan, Twist

RUN_ON_S, HELD_S = 0.12, 0.22
"""s; a new cap acts after the first; the command holds for the second before the next cap counts."""

BESIDE, AHEAD = 0.012, 0.015
"""m; kept free at the sides, and in the direction of motion."""

BRAKING, TURN_BRAKING = 1.2, 2.4
"""m/s^2, rad/s^2; below the weakest chair's, with its lag counted in `HELD_S`."""

CREEP = 0.05
"""m/s; within the margins the chair comes no faster past things."""

_SHARES = np.array([1.0, 0.85, 0.7, 0.55, 0.42, 0.3, 0.2, 0.12])
_REVERSE = 0.22
"""Most of the swing backwards, about 0.15 m/s: nothing sees behind the chair."""

_NEAR = 1.6
"""m; farther points do not matter at a stick's speeds indoors."""


@dataclass(frozen=True, slots=True)
class StickCaps:
    """Largest deflections, as shares of the swing."""

    forward: float = 1.0
    reverse: float = 1.0
    left: float = 1.0
    right: float = 1.0


NO_CAPS = StickCaps()


def clamped(stick: JoystickInput, caps: StickCaps) -> JoystickInput:
    """Return the stick within its caps, as the board puts it on the lines."""
    forward = min(max(stick.forward, -caps.reverse), caps.forward)
    turn = min(max(stick.turn, -caps.right), caps.left)
    return JoystickInput(stick.stamp_ns, forward, turn)


class CapsByScan:
    """Caps from points in base. `plant` are the chair's nominal figures, from its calibration."""

    def __init__(self, body: ChairBody, plant: PlantSettings | None = None) -> None:
        self._body, self._plant = body, plant or PlantSettings()

    def twist_of(self, forward: float, turn: float) -> Twist:
        """Return the steady twist of a stick's deflections."""
        p = self._plant
        v = _beyond(forward * p.swing_volts, p.forward_dead_band) * p.forward_gain
        return Twist(v, _beyond(turn * p.swing_volts, p.turn_dead_band) * p.turn_gain / self._body.track)

    def caps(self, points: FloatArray, measured: Twist, stick: JoystickInput) -> StickCaps:
        """Return the caps now, for points (N, 2) [m] in base, the measured twist and the stick as it is pushed."""
        near = np.hypot(points[:, 0] - self._middle, points[:, 1]) < _NEAR
        points = points[near]
        forward, turn = stick.forward, stick.turn
        if not len(points):
            return StickCaps(reverse=_REVERSE)
        both = self._share(points, measured, forward, turn)
        cap_ahead = abs(forward) * both if forward else 1.0
        cap_turn = abs(turn) * both if turn else 1.0
        return StickCaps(
            forward=cap_ahead if forward > 0.0 and both < 1.0 else 1.0,
            reverse=min(_REVERSE, cap_ahead if forward < 0.0 and both < 1.0 else 1.0),
            left=cap_turn if turn > 0.0 and both < 1.0 else 1.0,
            right=cap_turn if turn < 0.0 and both < 1.0 else 1.0,
        )

    def points(self, scan: Scan, measured: Twist, now_ns: int) -> FloatArray:
        """Return a scan's points (N, 2) [m] in base now."""
        return points_now(scan, valid_beams(scan, np.zeros(len(scan.ranges), np.bool_)), self._body, measured, now_ns)

    @property
    def _middle(self) -> float:
        return 0.5 * (self._body.front - self._body.rear)

    def _share(self, points: FloatArray, measured: Twist, forward: float, turn: float) -> float:
        """Return the largest share of the stick that stops free; 0 if none."""
        for share in _SHARES.tolist():
            if self._is_free(points, measured, self.twist_of(share * forward, share * turn)):
                return float(share)
        return 0.0

    def _is_free(self, points: FloatArray, measured: Twist, wanted: Twist) -> bool:
        poses = _way(measured, wanted)
        slow = abs(wanted.v) + abs(wanted.omega) * self._body.circumscribed_radius < CREEP
        before = self._inside(points, poses[:1], BESIDE, AHEAD)
        after = self._inside(points, poses, 0.0 if slow else BESIDE, 0.0 if slow else AHEAD)
        if slow:
            return not after.any()
        return not (after & ~before).any() and not self._inside(points, poses, 0.0, 0.0).any()

    def _inside(self, points: FloatArray, poses: FloatArray, beside: float, ahead: float) -> BoolArray:
        """Return (N,) whether points enter the outline, grown by margins, at any of the poses (P, 3)."""
        c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
        dx, dy = points[:, 0] - poses[:, :1], points[:, 1] - poses[:, 1:2]
        x, y = c * dx + s * dy, c * dy - s * dx
        body = self._body
        within = (np.abs(y) < body.width / 2 + beside) & (x < body.front + ahead) & (x > -body.rear - ahead)
        return np.asarray(within.any(axis=0), np.bool_)


def _way(measured: Twist, wanted: Twist) -> FloatArray:
    """Return poses (P, 3) in base now: on with the measured motion, on with the wanted one, and to rest."""
    poses = [np.zeros(3)]

    def add(v: float, omega: float, seconds: float, count: int) -> None:
        times = np.linspace(0.0, seconds, count + 1)[1:]
        moved = arcs(v * times, omega * times)
        at = poses[-1]
        c, s = math.cos(at[2]), math.sin(at[2])
        for x, y, theta in moved:
            poses.append(np.array([at[0] + c * x - s * y, at[1] + s * x + c * y, at[2] + theta]))

    add(measured.v, measured.omega, RUN_ON_S, 1)
    add(wanted.v, wanted.omega, HELD_S, 2)
    half = 0.5 * max(abs(wanted.v) / BRAKING, abs(wanted.omega) / TURN_BRAKING)
    add(wanted.v, wanted.omega, half, 3)
    return np.array(poses)


def _beyond(volts: float, dead_band: float) -> float:
    return math.copysign(max(abs(volts) - dead_band, 0.0), volts)
