"""The bodies of people, and of other wheelchairs with their riders, for the camera: limbs (rounded tubes) placed by pose and stride, in clothes chosen by seed.

Legs are where `silhouettes.py` puts them for the lidar; the other sizes are plausible for an adult.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.simulation.scene.scene import Mover, OtherChair, PersonBehaviour
from waychair.simulation.scene.seeds import seed_from_names
from waychair.simulation.sensors.silhouettes import (
    CHAIR_LEG_RADIUS,
    CHAIR_LEGS,
    FULL_STRIDE_SPEED,
    HIP,
    LEG_RADIUS,
    SHINS,
    SWING,
)
from waychair.types import FloatArray, IntArray

MOVER_HEIGHT = 0.5
"""Height [m] of a BOUNCE mover, an upright drum."""

HIP_HEIGHT, SHOULDER_HEIGHT, HEAD_HEIGHT = 0.86, 1.40, 1.62
SEAT_HEIGHT, SEATED_SHOULDER_HEIGHT, SEATED_HEAD_HEIGHT = 0.52, 1.02, 1.24
SHIN_HEIGHT = 0.30
"""Height [m] at which `silhouettes.SWING` is measured."""

ARM_RADIUS = 0.05

SIDES = 8
"""Corners of a tube."""

RINGS = np.array([(0, -1.0, 0.0), (0, -0.6, 0.8), (0, 0.0, 1.0), (1, 0.0, 1.0), (1, 0.6, 0.8), (1, 1.0, 0.0)])
"""Rings of a tube with round ends: part of its length, radii beyond that end, part of its radius."""

PARTS = {"jacket": "clothes", "trousers": "clothes", "head": "skin", "chair": "metal"}
"""The look of each body part; limbs of one part have one colour."""

_Point: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class _Limb:
    """A tube between two points [m, person's frame], its ends rounded beyond them or flat; `part` is a key of PARTS."""

    begin: _Point
    end: _Point
    radius: float
    part: str
    round: bool = True


@dataclass(frozen=True, slots=True)
class BodyMeshes:
    """Triangles (T, 3) of V vertices: positions (V, 3) [m, map], coordinates on the surface (V, 2) [m], the normal's
    upward component (V,) from -1 to 1, look numbers (V,), seeds (V,), and the index of the person (V,)."""

    positions: FloatArray
    on_surface: FloatArray
    upward: FloatArray
    looks: IntArray
    seeds: IntArray
    owners: IntArray
    triangles: IntArray


def body_meshes(people: Sequence[Mover], looks: Sequence[str]) -> BodyMeshes:
    """Return the bodies of all people and chairs; a look's number is its index in `looks`."""
    limbs = [(owner, number, limb) for owner, person in enumerate(people) for number, limb in enumerate(_limbs(person))]
    begins = _placed(people, [(owner, limb.begin) for owner, _, limb in limbs])
    ends = _placed(people, [(owner, limb.end) for owner, _, limb in limbs])
    radii = np.array([limb.radius for _, _, limb in limbs])
    rounded = np.array([float(limb.round) for _, _, limb in limbs])
    angles = np.linspace(0.0, math.tau, SIDES + 1)  # the first angle again: the seam of the surface
    along = ends - begins
    lengths = np.linalg.norm(along, axis=1)
    along = along / lengths[:, None]
    right = np.cross(along, np.where(np.abs(along[:, 2:]) > 0.9, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]]))
    right /= np.linalg.norm(right, axis=1)[:, None]
    out = np.cross(right, along)
    outward = np.cos(angles)[:, None] * right[:, None] + np.sin(angles)[:, None] * out[:, None]  # (L, SIDES + 1, 3)
    height = RINGS[:, 0] * lengths[:, None] + RINGS[:, 1] * (radii * rounded)[:, None]  # (L, rings)
    spread = RINGS[:, 2] * radii[:, None]
    positions = begins[:, None, None] + height[..., None, None] * along[:, None, None]
    positions = positions + spread[..., None, None] * outward[:, None]
    on_surface = np.stack(np.broadcast_arrays(angles * radii[:, None, None], height[..., None]), axis=-1)
    ends_up = (np.sign(RINGS[:, 1]) * (1.0 - RINGS[:, 2]))[:, None] * along[:, None, None, 2]
    upward = RINGS[:, 2, None] * outward[:, None, :, 2] + ends_up
    each = len(RINGS) * len(angles)
    return BodyMeshes(
        positions=positions.reshape(-1, 3),
        on_surface=on_surface.reshape(-1, 2),
        upward=upward.reshape(-1),
        looks=np.repeat(np.array([looks.index(PARTS[limb.part]) for _, _, limb in limbs], np.int64), each),
        seeds=np.repeat(
            np.array([_seed(people[owner], number, limb.part) for owner, number, limb in limbs], np.int64), each
        ),
        owners=np.repeat(np.array([owner for owner, _, _ in limbs], np.int64), each),
        triangles=(np.arange(len(limbs))[:, None, None] * each + _triangles()).reshape(-1, 3),
    )


def _limbs(person: Mover) -> list[_Limb]:
    """Return a person's limbs; a walker's legs swing by the sine of the stride and the arms against them."""
    if isinstance(person, OtherChair):
        return _rider_and_chair(person.body)
    if person.behaviour is PersonBehaviour.BOUNCE:
        return [_Limb((0.0, 0.0, 0.0), (0.0, 0.0, MOVER_HEIGHT), person.radius, "jacket", round=False)]
    build = 0.72 * person.radius
    if person.behaviour is PersonBehaviour.SEATED:
        shins = [_Limb((x, y, LEG_RADIUS), (x, y, SEAT_HEIGHT), LEG_RADIUS, "trousers") for x, y in SHINS]
        thighs = [_Limb((x, y, SEAT_HEIGHT), (0.0, y, SEAT_HEIGHT), 1.3 * LEG_RADIUS, "trousers") for x, y in SHINS]
        chair = [_Limb((x, y, CHAIR_LEG_RADIUS), (x, y, SEAT_HEIGHT), CHAIR_LEG_RADIUS, "chair") for x, y in CHAIR_LEGS]
        return [*_trunk(SEAT_HEIGHT, SEATED_SHOULDER_HEIGHT, SEATED_HEAD_HEIGHT, build, 0.15), *shins, *thighs, *chair]
    swing = SWING * min(1.0, abs(person.speed) / FULL_STRIDE_SPEED) * math.sin(person.stride)
    foot = swing * HIP_HEIGHT / (HIP_HEIGHT - SHIN_HEIGHT)
    legs = [
        _Limb((side * foot, side * HIP, LEG_RADIUS), (0.0, side * HIP, HIP_HEIGHT), LEG_RADIUS, "trousers")
        for side in (1.0, -1.0)
    ]
    return [*_trunk(HIP_HEIGHT, SHOULDER_HEIGHT, HEAD_HEIGHT, build, -swing), *legs]


RIDER_BUILD = 0.19
"""Radius [m] of a rider's trunk."""

FRAME_RADIUS, FRAME_HEIGHTS = 0.03, (0.25, 0.40, 0.55)
"""Radius [m] of the tubes of a wheelchair's frame, and their heights [m]."""


def _rider_and_chair(body: ChairBody) -> list[_Limb]:
    """Return the drive wheels, the frame's tubes along the outline, and the rider, in the base frame."""
    r, half, low, high = (
        FRAME_RADIUS,
        body.width / 2 - FRAME_RADIUS,
        FRAME_RADIUS - body.rear,
        body.front - FRAME_RADIUS,
    )
    wheel = body.wheel_radius
    wheels = [
        _Limb((0.0, side * half - r, wheel), (0.0, side * half + r, wheel), wheel, "chair", round=False)
        for side in (1.0, -1.0)
    ]
    frame = [
        tube
        for z in FRAME_HEIGHTS
        for tube in (
            *(_Limb((low, side * half, z), (high, side * half, z), r, "chair") for side in (1.0, -1.0)),
            *(_Limb((end, -half, z), (end, half, z), r, "chair") for end in (low, high)),
        )
    ]
    knee = min(0.45, high)
    legs = [
        limb
        for y in (HIP, -HIP)
        for limb in (
            _Limb((knee, y, LEG_RADIUS), (knee, y, SEAT_HEIGHT), LEG_RADIUS, "trousers"),
            _Limb((knee, y, SEAT_HEIGHT), (0.0, y, SEAT_HEIGHT), 1.3 * LEG_RADIUS, "trousers"),
        )
    ]
    return [*_trunk(SEAT_HEIGHT, SEATED_SHOULDER_HEIGHT, SEATED_HEAD_HEIGHT, RIDER_BUILD, 0.15), *legs, *wheels, *frame]


def _trunk(low: float, shoulder: float, head: float, build: float, swing: float) -> list[_Limb]:
    """Return body, head and arms; the left hand is `swing` [m] ahead, the right hand as far behind."""
    arms = []
    for side in (1.0, -1.0):
        hand, joint = (side * swing, side * (build + 0.07), shoulder - 0.55), (0.0, side * (build + 0.03), shoulder)
        arms.append(_Limb(hand, joint, ARM_RADIUS, "jacket"))
    body = _Limb((0.0, 0.0, low + 0.5 * build), (0.0, 0.0, shoulder - 0.4 * build), build, "jacket")
    return [body, _Limb((0.0, 0.0, head - 0.05), (0.0, 0.0, head + 0.03), 0.1, "head"), *arms]


def _placed(people: Sequence[Mover], points: Sequence[tuple[int, _Point]]) -> FloatArray:
    """Return points (L, 3) in map, from points in their owners' frames."""
    poses = np.array([people[owner].pose.array() for owner, _ in points]).reshape(-1, 3)
    x, y, z = np.array([point for _, point in points]).reshape(-1, 3).T
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return np.stack([poses[:, 0] + c * x - s * y, poses[:, 1] + s * x + c * y, z], axis=1)


def _seed(person: Mover, number: int, part: str) -> int:
    """Return a limb's seed; those of one part differ in the last bits only: same colour, different pattern."""
    owner = person.number if isinstance(person, OtherChair) else person.seed
    return (seed_from_names(part, owner) << 4 & 0xFFFFFFF0) | number


def _triangles() -> IntArray:
    """Return the triangles (T, 3) of one tube, ring by ring, counter-clockwise as seen in the image."""
    ring, side = np.divmod(np.arange((len(RINGS) - 1) * SIDES), SIDES)
    first = ring * (SIDES + 1) + side
    after = first + SIDES + 1
    return np.concatenate([np.stack([first, first + 1, after], 1), np.stack([first + 1, after + 1, after], 1)])
