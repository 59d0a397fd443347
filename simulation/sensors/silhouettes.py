"""The cross-sections of people and other chairs for lidar and sonars: circles (K, 3), x, y, radius [m].

Sizes are plausible for an average adult, not taken from a table.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import transform_points
from waychair.simulation.scene.scene import Mover, OtherChair, PersonBehaviour
from waychair.simulation.sensors.rays import NO_CIRCLES
from waychair.types import FloatArray, Pose2

LEG_RADIUS = 0.06
"""Radius of a trousered leg below the knee [m]."""

HIP = 0.09
"""Distance from the middle of a person to the middle of either leg [m]."""

SWING = 0.25
"""Swing of a leg ahead of and behind the hip [m] at shin height, for steps of 0.7 m."""

FULL_STRIDE_SPEED = 0.6
"""Speed [m/s] below which people take shorter steps; a standing person's legs are side by side."""

CHAIR_LEG_RADIUS = 0.015
CHAIR_LEGS = ((0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2))
SHINS = ((0.4, HIP), (0.4, -HIP))
"""Legs of a chair relative to the middle of its seat, and the shins of a seated person [m]."""

FROM_FRONT = 0.20
TUBE_FROM_FRONT = 0.10
TUBE_RADIUS = 0.015
"""Distances of the rider's shins and the leg rests' tubes behind a wheelchair's front end, and the tubes' radius [m]."""


OUTLINE_RADIUS, OUTLINE_SPACING = 0.05, 0.06
"""Radius and distance [m] of the circles that stand for the sides of another wheelchair; they stay within its outline."""


def legs_of(person: Mover) -> FloatArray:
    """Return a person's circles (K, 3) in map at the height of a lidar; K depends on the behaviour only.

    A walker's two legs swing in opposite directions by the sine of the stride's phase; at phase 0 they are side by side
    and the left one goes ahead. A seated person has two shins and the chair's four legs. A BOUNCE mover is a disc.
    """
    if isinstance(person, OtherChair):
        own = sides_of(person.body)
        return np.column_stack([transform_points(person.pose, own[:, :2]), own[:, 2]])
    if person.behaviour is PersonBehaviour.BOUNCE:
        return _placed(person.pose, [(0.0, 0.0, person.radius)])
    if person.behaviour is PersonBehaviour.SEATED:
        shins = [(x, y, LEG_RADIUS) for x, y in SHINS]
        return _placed(person.pose, shins + [(x, y, CHAIR_LEG_RADIUS) for x, y in CHAIR_LEGS])
    ahead = SWING * min(1.0, abs(person.speed) / FULL_STRIDE_SPEED) * math.sin(person.stride)
    return _placed(person.pose, [(ahead, HIP, LEG_RADIUS), (-ahead, -HIP, LEG_RADIUS)])


@lru_cache
def sides_of(body: ChairBody) -> FloatArray:
    """Return the circles (K, 3) in the base frame along the inside of a chair's outline: frame, wheels and leg rests."""
    low, high, half = OUTLINE_RADIUS - body.rear, body.front - OUTLINE_RADIUS, body.width / 2 - OUTLINE_RADIUS
    x = np.linspace(low, high, math.ceil((high - low) / OUTLINE_SPACING) + 1)
    y = np.linspace(-half, half, math.ceil(2 * half / OUTLINE_SPACING) + 1)[1:-1]
    sides = [(each, side) for side in (half, -half) for each in x] + [(end, each) for end in (low, high) for each in y]
    return np.array([(*each, OUTLINE_RADIUS) for each in sides])


def legs(people: Iterable[Mover]) -> FloatArray:
    """Return the circles (K, 3) in map of all people and chairs, in order."""
    return np.concatenate([NO_CIRCLES, *(legs_of(person) for person in people)])


def bodies(people: Iterable[Mover]) -> FloatArray:
    """Return each person as one disc, and chairs by their sides, (K, 3) in map: for sonars, above the knee."""
    discs = [
        legs_of(p) if isinstance(p, OtherChair) else np.array([(p.pose.x, p.pose.y, p.radius)], np.float64)
        for p in people
    ]
    return np.concatenate([NO_CIRCLES, *discs])


def rider_legs(body: ChairBody) -> FloatArray:
    """Return the rider's shins and the leg rests' tubes, (4, 3) in the base frame."""
    shin, tube = body.front - FROM_FRONT, body.front - TUBE_FROM_FRONT
    return np.array(
        [
            (shin, 0.2 * body.width, LEG_RADIUS),
            (shin, -0.2 * body.width, LEG_RADIUS),
            (tube, 0.35 * body.width, TUBE_RADIUS),
            (tube, -0.35 * body.width, TUBE_RADIUS),
        ]
    )


def _placed(map_from_person: Pose2, circles: list[tuple[float, float, float]]) -> FloatArray:
    own = np.array(circles)
    return np.column_stack([transform_points(map_from_person, own[:, :2]), own[:, 2]])
