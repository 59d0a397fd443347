"""The social force model: what pushes and pulls a walking person, as accelerations [m/s^2].

Helbing and Molnar, Social force model for pedestrian dynamics, Physical Review E 51 (1995) 4282; equation numbers are
theirs, and so are the values of RELAXATION, V0, SIGMA, STEP_TIME, U0, SIGHT, BEHIND and FASTEST. Three things differ:
the ellipses of equation 4 follow the velocity of the other relative to one's own (Johansson, Helbing and Shukla,
Advances in Complex Systems 10, 2007), so that who follows pushes nobody aside; they begin where bodies touch, as in
Helbing, Farkas and Vicsek (Nature 407, 2000), for the people of 1995 were points; and `veered` stands for the random
fluctuations. WALL_RANGE and STRONGEST are ours: at the paper's range of 0.2 m the two jambs of a 0.80 m door are too
steep a hill for a person who wants to walk at 1 m/s.
"""

from __future__ import annotations

import math

from numba import njit

RELAXATION = 0.5
"""Time [s] in which a person takes up the velocity it wants (tau)."""

V0 = 2.1
"""Strength of the repulsion between people [m^2/s^2]."""

SIGMA = 0.3
"""Range of the repulsion between people [m]."""

STEP_TIME = 2.0
"""How far ahead in time [s] the other's way is kept clear (delta t)."""

U0 = 10.0
"""Strength of the repulsion of walls [m^2/s^2]."""

WALL_RANGE = 0.1
"""Range of the repulsion of walls [m]."""

SIGHT = math.radians(100.0)
"""Half of the field of view (phi)."""

BEHIND = 0.5
"""Weight of what is out of sight (c)."""

FASTEST = 1.3
"""A person's greatest speed, as a multiple of the speed it likes."""

STRONGEST = 2.5
"""Cap on the sum of all forces [m/s^2]: nobody starts or stops quicker."""


@njit(cache=True)
def goal_force(to_goal_x: float, to_goal_y: float, vx: float, vy: float, speed: float) -> tuple[float, float]:
    """Towards a goal that is (x, y) [m] away, from the velocity (vx, vy) to `speed` [m/s] (equation 2).

    The wanted speed falls with the distance once the goal is nearer than `speed` times RELAXATION, so that a person
    comes to rest there.
    """
    distance = math.hypot(to_goal_x, to_goal_y)
    per = min(speed / distance, 1.0 / RELAXATION) if distance > 0.0 else 0.0
    return (to_goal_x * per - vx) / RELAXATION, (to_goal_y * per - vy) / RELAXATION


@njit(cache=True)
def repulsion(x: float, y: float, vx: float, vy: float, bodies: float) -> tuple[float, float]:
    """From another that is at the origin and comes with (vx, vy) [m/s], seen from a person at (x, y) [m].

    The negative gradient of V0 exp((bodies - b) / SIGMA), whose levels are ellipses about the other and where it will be
    after STEP_TIME (equations 3 and 4); b is their half minor axis, `bodies` the sum of both radii [m]. Zero, for want
    of a direction, on the straight line between the two foci.
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
    """From the nearest point of a wall, at the origin, on a person at (x, y) [m] (equation 5)."""
    distance = math.hypot(x, y)
    if distance < 1e-9:
        return 0.0, 0.0
    strength = U0 / WALL_RANGE * math.exp(-distance / WALL_RANGE) / distance
    return strength * x, strength * y


@njit(cache=True)
def weight(look_x: float, look_y: float, force_x: float, force_y: float) -> float:
    """1 of a force that comes from within the field of view about the way (x, y) that one looks, else BEHIND.

    Equations 7 and 8 with the force's source where it must be, on the side that the force pushes away from.
    """
    along = -(look_x * force_x + look_y * force_y)
    reach = math.hypot(look_x, look_y) * math.hypot(force_x, force_y)
    return 1.0 if along >= reach * math.cos(SIGHT) else BEHIND


@njit(cache=True)
def veered(x: float, y: float, angle: float) -> tuple[float, float]:
    """The vector from another to oneself, turned by `angle` [rad] to the left.

    Whoever takes others to be a little to the left of where they are goes past them on the right; two who meet exactly
    head-on do not push each other to a stop.
    """
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


@njit(cache=True)
def capped(x: float, y: float, limit: float) -> tuple[float, float]:
    """The vector, made no longer than `limit`."""
    length = math.hypot(x, y)
    part = limit / length if length > limit else 1.0
    return x * part, y * part
