"""The social force model: the forces on a walking person, as accelerations [m/s^2].

Helbing and Molnar, Social force model for pedestrian dynamics, Physical Review E 51 (1995) 4282; equation numbers are
theirs, and so are the values of RELAXATION, V0, SIGMA, STEP_TIME, U0, SIGHT, BEHIND and FASTEST. Three things differ.
The ellipses of equation 4 follow the other person's velocity relative to one's own (Johansson, Helbing and Shukla,
Advances in Complex Systems 10, 2007), so that a follower does not push the person ahead. They begin where bodies touch,
as in Helbing, Farkas and Vicsek (Nature 407, 2000), because the people of 1995 were points. `veered` replaces the random
fluctuations. WALL_RANGE and STRONGEST are our values: with the paper's range of 0.2 m the jambs of a 0.80 m door would
stop a person with a preferred speed of 1 m/s.
"""

from __future__ import annotations

import math

from numba import njit

RELAXATION = 0.5
"""Time constant [s] in which a person reaches its preferred velocity (tau)."""

V0 = 2.1
"""Strength of the repulsion between people [m^2/s^2]."""

SIGMA = 0.3
"""Range of the repulsion between people [m]."""

STEP_TIME = 2.0
"""Time [s] for which the other person's motion is predicted (delta t)."""

U0 = 10.0
"""Strength of the repulsion of walls [m^2/s^2]."""

WALL_RANGE = 0.1
"""Range of the repulsion of walls [m]."""

SIGHT = math.radians(100.0)
"""Half of the field of view (phi)."""

BEHIND = 0.5
"""Weight of forces from outside the field of view (c)."""

FASTEST = 1.3
"""A person's greatest speed, as a multiple of its preferred speed."""

STRONGEST = 2.5
"""Cap on the sum of all forces [m/s^2]: the greatest acceleration of a person."""


@njit(cache=True)
def goal_force(to_goal_x: float, to_goal_y: float, vx: float, vy: float, speed: float) -> tuple[float, float]:
    """Return the force towards a goal that is (x, y) [m] away, from velocity (vx, vy) to `speed` [m/s] (equation 2).

    The wanted speed falls with the distance once the goal is nearer than `speed` times RELAXATION, so that a person
    comes to rest there.
    """
    distance = math.hypot(to_goal_x, to_goal_y)
    per = min(speed / distance, 1.0 / RELAXATION) if distance > 0.0 else 0.0
    return (to_goal_x * per - vx) / RELAXATION, (to_goal_y * per - vy) / RELAXATION


@njit(cache=True)
def repulsion(x: float, y: float, vx: float, vy: float, bodies: float) -> tuple[float, float]:
    """Return the force on a person at (x, y) [m] from another at the origin with the velocity (vx, vy) [m/s].

    It is the negative gradient of V0 exp((bodies - b) / SIGMA). The levels are ellipses with the other person's present
    position and its position after STEP_TIME as foci (equations 3 and 4); b is their half minor axis, `bodies` the sum
    of both radii [m]. Between the foci the force has no direction and is zero.
    """
    ahead_x, ahead_y = vx * STEP_TIME, vy * STEP_TIME
    near, far = math.hypot(x, y), math.hypot(x - ahead_x, y - ahead_y)
    b = 0.5 * math.sqrt(max((near + far) ** 2 - ahead_x * ahead_x - ahead_y * ahead_y, 0.0))
    if min(near, far, b) < 1e-9:
        return 0.0, 0.0
    strength = V0 / SIGMA * math.exp((bodies - b) / SIGMA) * (near + far) / (4.0 * b)
    return strength * (x / near + (x - ahead_x) / far), strength * (y / near + (y - ahead_y) / far)


@njit(cache=True)
def wall_repulsion(x: float, y: float) -> tuple[float, float]:
    """Return the force of a wall, with its nearest point at the origin, on a person at (x, y) [m] (equation 5)."""
    distance = math.hypot(x, y)
    if distance < 1e-9:
        return 0.0, 0.0
    strength = U0 / WALL_RANGE * math.exp(-distance / WALL_RANGE) / distance
    return strength * x, strength * y


@njit(cache=True)
def weight(look_x: float, look_y: float, force_x: float, force_y: float) -> float:
    """Return the weight of a force: 1 if its source is in the field of view about the gaze (x, y), else BEHIND.

    Equations 7 and 8; the source is opposite to the direction of the force.
    """
    along = -(look_x * force_x + look_y * force_y)
    reach = math.hypot(look_x, look_y) * math.hypot(force_x, force_y)
    return 1.0 if along >= reach * math.cos(SIGHT) else BEHIND


@njit(cache=True)
def veered(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return the vector from another person to oneself, turned by `angle` [rad] to the left.

    People who see others slightly to the left pass them on the right, so that two people who meet head-on do not stop
    each other.
    """
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


@njit(cache=True)
def capped(x: float, y: float, limit: float) -> tuple[float, float]:
    """Return the vector, shortened to `limit` if it is longer."""
    length = math.hypot(x, y)
    part = limit / length if length > limit else 1.0
    return x * part, y * part
