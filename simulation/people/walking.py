"""One short step of all people, one after the other: each person's motion, without collisions.

People are rows of PERSON, discs that are updated in place. A move never creates an overlap with a wall, the chair or
another person, and never deepens an overlap that the chair made; a blocked person moves up to contact and waits.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.simulation.people import social_force
from waychair.simulation.people.person_surroundings import (
    FAR,
    Walls,
    chair_of,
    nearest_on_chair,
    nearest_wall,
    nearest_walls,
    velocity_at,
)
from waychair.simulation.people.rails import ACCELERATION, SPACING, rail_at
from waychair.simulation.people.social_force import capped, goal_force, repulsion, veered, wall_repulsion, weight
from waychair.simulation.scene.scene import PersonBehaviour
from waychair.types import FloatArray

PERSON = np.dtype(
    [
        ("behaviour", np.int64),  # its number in Behaviour
        ("yields", np.bool_),
        ("radius", np.float64),  # m
        ("speed", np.float64),  # m/s, preferred
        ("trigger", np.float64),  # m
        ("rest", np.float64),  # s at each end of its rail
        ("veer", np.float64),  # rad, see social_force.veered
        ("first", np.int64),  # rows of its rail
        ("last", np.int64),
        ("along", np.float64),  # m along its rail, of the person or of the point that it walks towards
        ("sign", np.float64),  # 1 along the rail, -1 back
        ("x", np.float64),  # m, map
        ("y", np.float64),
        ("heading", np.float64),  # rad
        ("vx", np.float64),  # m/s, map
        ("vy", np.float64),
        ("walked", np.float64),  # m in all
        ("waited", np.float64),  # s without moving
        ("startled", np.bool_),  # SUDDEN: has stepped out
    ],
    align=True,
)
"""The fields of one person."""

Crowd: TypeAlias = NDArray[np.void]
"""(N,) of PERSON."""

Person: TypeAlias = Any
"""A row of a Crowd; numba reads and writes its fields as attributes."""

PATH, SOCIAL, SEATED, SUDDEN, BOUNCE = (
    tuple(PersonBehaviour).index(behaviour)
    for behaviour in (
        PersonBehaviour.PATH,
        PersonBehaviour.SOCIAL,
        PersonBehaviour.SEATED,
        PersonBehaviour.SUDDEN,
        PersonBehaviour.BOUNCE,
    )
)

TURN_RATE = 3.0
"""Turn rate of a person [rad/s]: about a second for the half turn at the end of its path."""

BRAKING = 2.5
"""Deceleration of a person for a sudden obstacle [m/s^2]."""

STOP_DISTANCE = 0.4
"""Distance along its rail [m] at which a yielding person stops before the chair or another person."""

SIDE_CLEARANCE = 0.1
"""Least side clearance [m] at which a yielding person passes the chair or another person."""

CHAIR_GAP = 0.05
"""Least gap [m] that a yielding person keeps to the chair, however narrow the passage."""

SUDDEN_STAY = 5.0
"""Time [s] after which a person who stepped out suddenly goes back for good."""

WAIT_LIMIT = 8.0
"""Time [s] for which a person waits for an obstacle before it turns back."""

LOOKAHEAD = 1.0
"""A social walker walks towards the point of its rail at this distance [m]."""

TURN_BACK_DISTANCE = 0.3
"""Distance [m] from the end of its rail at which a social walker turns back."""

WALL_REACH = 0.8
"""Distance [m] beyond which the repulsion of walls is less than 0.04 m/s^2."""

OVERLAP_TOLERANCE = 1e-9
"""Overlaps up to this [m] are ignored, so that a person in contact can slide along the obstacle."""

TOP_SPEED = 1.5
"""Greatest walking speed [m/s]; no person runs."""


class WalkingSpace(NamedTuple):
    """The surroundings of the people: the rails of all of them in one array, the walls, and `chair_rows` (N, 10)."""

    rails: FloatArray
    walls: Walls
    chairs: FloatArray


@njit(cache=True, nogil=True)
def move_people(people: Crowd, space: WalkingSpace, seconds: float) -> None:
    """Move all people on by `seconds`, in the order of `people`, with the chairs at rest."""
    for i in range(len(people)):
        person = people[i]
        before_x, before_y = person.x, person.y
        if person.behaviour == SOCIAL:
            _move_socially(people, i, space, seconds)
        elif person.behaviour == BOUNCE:
            _move_bouncing(people, i, space, seconds)
        elif person.behaviour == PATH:
            _walk_along_rail(people, i, space, seconds)
        elif person.behaviour == SUDDEN:
            person.startled = person.startled or is_startled(person, space)
            if person.startled:
                _walk_along_rail(people, i, space, seconds)
        moved = math.hypot(person.x - before_x, person.y - before_y)
        person.walked += moved
        person.waited = 0.0 if moved > 0.1 * person.speed * seconds else person.waited + seconds


@njit(cache=True)
def obstruction(people: Crowd, i: int, space: WalkingSpace, x: float, y: float) -> tuple[bool, float, float]:
    """Return whether person `i` cannot move to (x, y) [m, map], and the unit vector away from the worst obstacle there.

    An existing overlap blocks only moves that deepen it. The vector away from the chair or a person is that at the
    person's present place: a move at right angles to it passes round bodies and corners without cutting into them.
    """
    person = people[i]
    deepest, away_x, away_y = -OVERLAP_TOLERANCE, 0.0, 0.0
    distance, nx, ny = nearest_wall(space.walls, x, y, person.radius)
    if distance - person.radius < deepest:
        before, _, _ = nearest_wall(space.walls, person.x, person.y, person.radius)
        if distance < before:
            deepest, away_x, away_y = distance - person.radius, nx, ny
    keep = person.radius + (CHAIR_GAP if person.yields and person.behaviour != BOUNCE else 0.0)
    for row in space.chairs:
        distance, _, _ = nearest_on_chair(chair_of(row), x, y)
        if distance - keep < deepest:
            before, nx, ny = nearest_on_chair(chair_of(row), person.x, person.y)
            if distance < before:
                deepest, away_x, away_y = distance - keep, nx, ny
    for j in range(len(people)):
        other = people[j]
        distance = math.hypot(x - other.x, y - other.y)
        if j != i and distance - person.radius - other.radius < deepest:
            dx, dy = person.x - other.x, person.y - other.y
            before = math.hypot(dx, dy)
            if distance < before:
                deepest, away_x, away_y = distance - person.radius - other.radius, dx / before, dy / before
    return deepest < -OVERLAP_TOLERANCE, away_x, away_y


@njit(cache=True)
def is_startled(person: Person, space: WalkingSpace) -> bool:
    """Return whether a chair is within `trigger` [m] of the person's rail and comes nearer."""
    for chair in space.chairs:
        best, to_x, to_y, at_x, at_y = FAR, 0.0, 0.0, 0.0, 0.0
        for row in range(person.first, person.last):
            x, y = space.rails[row, 1], space.rails[row, 2]
            distance, nx, ny = nearest_on_chair(chair_of(chair), x, y)
            if distance < best:
                best, to_x, to_y, at_x, at_y = distance, nx, ny, x - distance * nx, y - distance * ny
        vx, vy = velocity_at(chair_of(chair), at_x, at_y)
        if best <= person.trigger and vx * to_x + vy * to_y > 0.0:
            return True
    return False


@njit(cache=True)
def _walk_along_rail(people: Crowd, i: int, space: WalkingSpace, seconds: float) -> None:
    """Walk along the rail within its speed limit and the free distance; turn after the rest at its end or a long wait."""
    person = people[i]
    length = space.rails[person.last - 1, 0]
    if length == 0.0:
        return
    at_end = person.along == (length if person.sign > 0.0 else 0.0)
    if person.behaviour == PATH and (person.waited >= person.rest if at_end else person.waited > WAIT_LIMIT):
        person.sign, person.waited = -person.sign, 0.0
    if person.behaviour == SUDDEN and person.along == length and person.waited > SUDDEN_STAY:
        person.sign = -1.0
    _, _, direction, limit = rail_at(space.rails, person.first, person.last, person.along)
    off = _turn_towards(person, direction if person.sign > 0.0 else direction + math.pi, seconds)
    speed = math.hypot(person.vx, person.vy)
    # No person walks backwards: first the half turn, then the first step.
    wanted = min(limit, math.sqrt(2.0 * ACCELERATION * _free_distance(people, i, space, speed))) if off < 1.0 else 0.0
    speed = min(max(wanted, speed - BRAKING * seconds), speed + ACCELERATION * seconds)
    begin = person.along
    end = min(max(begin + person.sign * speed * seconds, 0.0), length)
    x, y, _, _ = rail_at(space.rails, person.first, person.last, end)
    if obstruction(people, i, space, x, y)[0]:
        # Up to contact, to 0.1 mm.
        free, blocked = begin, end
        while abs(blocked - free) > 1e-4:
            middle = 0.5 * (free + blocked)
            x, y, _, _ = rail_at(space.rails, person.first, person.last, middle)
            if obstruction(people, i, space, x, y)[0]:
                blocked = middle
            else:
                free = middle
        end = free
        x, y, _, _ = rail_at(space.rails, person.first, person.last, end)
    person.vx, person.vy = (x - person.x) / seconds, (y - person.y) / seconds
    person.x, person.y, person.along = x, y, end


@njit(cache=True)
def _free_distance(people: Crowd, i: int, space: WalkingSpace, speed: float) -> float:
    """Return the free distance [m] of person `i` along its rail, up to a wall or short of people and chair; else FAR.

    Only a yielding person stops short of people and the chair, and not for those it passes with SIDE_CLEARANCE or leaves.
    """
    person = people[i]
    here = _gap_to_others(people, i, space, person.x, person.y)
    reach = STOP_DISTANCE + 2.0 * SPACING + speed * speed / (2.0 * ACCELERATION)
    for step in range(1, math.ceil(reach / SPACING) + 1):
        along = person.along + person.sign * step * SPACING
        if not 0.0 <= along <= space.rails[person.last - 1, 0]:
            break
        x, y, _, _ = rail_at(space.rails, person.first, person.last, along)
        if nearest_wall(space.walls, x, y, person.radius)[0] < person.radius:
            return (step - 1) * SPACING
        if person.yields and _gap_to_others(people, i, space, x, y) < min(SIDE_CLEARANCE, here):
            return max(0.0, (step - 1) * SPACING - STOP_DISTANCE)
    return FAR


@njit(cache=True)
def _gap_to_others(people: Crowd, i: int, space: WalkingSpace, x: float, y: float) -> float:
    """Return the gap [m] from person `i` at (x, y) to the nearest chair or other person."""
    person = people[i]
    room = FAR
    for row in space.chairs:
        room = min(room, nearest_on_chair(chair_of(row), x, y)[0] - person.radius)
    for j in range(len(people)):
        if j != i:
            gap = math.hypot(x - people[j].x, y - people[j].y) - person.radius - people[j].radius
            room = min(room, gap)
    return float(room)


@njit(cache=True)
def _move_socially(people: Crowd, i: int, space: WalkingSpace, seconds: float) -> None:
    """Move by the social forces; slide along obstacles."""
    person = people[i]
    if person.waited > WAIT_LIMIT:
        person.sign, person.waited = -person.sign, 0.0
    goal_x, goal_y = _goal(person, space.rails)
    fx, fy = _social_forces(people, i, space, goal_x - person.x, goal_y - person.y)
    vx, vy = capped(
        person.vx + fx * seconds, person.vy + fy * seconds, min(TOP_SPEED, social_force.FASTEST * person.speed)
    )
    for _ in range(3):
        x, y = person.x + vx * seconds, person.y + vy * seconds
        blocked, nx, ny = obstruction(people, i, space, x, y)
        if not blocked:
            person.x, person.y = x, y
            break
        into = min(vx * nx + vy * ny, 0.0)
        vx, vy = vx - into * nx, vy - into * ny
    else:
        vx, vy = 0.0, 0.0
    person.vx, person.vy = vx, vy
    if math.hypot(vx, vy) > 0.1:
        _turn_towards(person, math.atan2(vy, vx), seconds)


@njit(cache=True)
def _goal(person: Person, rails: FloatArray) -> tuple[float, float]:
    """The point that runs ahead of a social walker along its rail, there and back, LOOKAHEAD from it."""
    length = rails[person.last - 1, 0]
    x, y, _, _ = rail_at(rails, person.first, person.last, person.along)
    if (
        person.along == (length if person.sign > 0.0 else 0.0)
        and math.hypot(x - person.x, y - person.y) < TURN_BACK_DISTANCE
    ):
        person.sign = -person.sign
    while math.hypot(x - person.x, y - person.y) < LOOKAHEAD and person.along != (length if person.sign > 0.0 else 0.0):
        person.along = min(max(person.along + person.sign * SPACING, 0.0), length)
        x, y, _, _ = rail_at(rails, person.first, person.last, person.along)
    return x, y


@njit(cache=True)
def _social_forces(people: Crowd, i: int, space: WalkingSpace, to_x: float, to_y: float) -> tuple[float, float]:
    """Return the acceleration [m/s^2] of person `i` with a goal (x, y) [m] away."""
    person = people[i]
    fx, fy = goal_force(to_x, to_y, person.vx, person.vy, person.speed)
    for j in range(len(people)):
        if j != i:
            other = people[j]
            x, y = veered(person.x - other.x, person.y - other.y, person.veer)
            px, py = repulsion(x, y, other.vx - person.vx, other.vy - person.vy, person.radius + other.radius)
            part = weight(to_x, to_y, px, py)
            fx, fy = fx + part * px, fy + part * py
    if person.yields:
        for row in space.chairs:
            chair = chair_of(row)
            # A chair acts from its nearest point, with the velocity of that point.
            distance, nx, ny = nearest_on_chair(chair, person.x, person.y)
            cx, cy = velocity_at(chair, person.x - distance * nx, person.y - distance * ny)
            # A person under a chair is pushed out as if just in front of it.
            distance = max(distance, 0.01)
            x, y = veered(distance * nx, distance * ny, person.veer)
            px, py = repulsion(x, y, cx - person.vx, cy - person.vy, person.radius)
            part = weight(to_x, to_y, px, py)
            fx, fy = fx + part * px, fy + part * py
    for vector in nearest_walls(space.walls, person.x, person.y, WALL_REACH):
        wx, wy = wall_repulsion(vector[0], vector[1])
        fx, fy = fx + wx, fy + wy
    return capped(fx, fy, social_force.STRONGEST)


@njit(cache=True)
def _move_bouncing(people: Crowd, i: int, space: WalkingSpace, seconds: float) -> None:
    """Move straight at constant speed; a contact reflects the disc like a ball, and also a disc that it hits."""
    person = people[i]
    vx, vy = person.speed * math.cos(person.heading), person.speed * math.sin(person.heading)
    left = seconds
    for _ in range(4):
        part = _free_part(people, i, space, vx * left, vy * left)
        person.x, person.y = person.x + part * vx * left, person.y + part * vy * left
        left *= 1.0 - part
        if left == 0.0:
            break
        _, nx, ny = obstruction(people, i, space, person.x + vx * left, person.y + vy * left)
        vx, vy = _reflected(vx, vy, nx, ny)
        _reflect_other(people, i, nx, ny)
    person.vx, person.vy = vx, vy
    person.heading = math.atan2(vy, vx)


@njit(cache=True)
def _free_part(people: Crowd, i: int, space: WalkingSpace, dx: float, dy: float) -> float:
    """Return the part of the move (dx, dy) [m] that person `i` can make up to contact, to 0.1 %."""
    if not obstruction(people, i, space, people[i].x + dx, people[i].y + dy)[0]:
        return 1.0
    free, blocked = 0.0, 1.0
    while blocked - free > 1e-3:
        middle = 0.5 * (free + blocked)
        if obstruction(people, i, space, people[i].x + middle * dx, people[i].y + middle * dy)[0]:
            blocked = middle
        else:
            free = middle
    return free


@njit(cache=True)
def _reflect_other(people: Crowd, i: int, nx: float, ny: float) -> None:
    """Reflect the disc that person `i` has hit, if it was approaching; (nx, ny) points away from it."""
    for j in range(len(people)):
        other = people[j]
        dx, dy = people[i].x - other.x, people[i].y - other.y
        distance = math.hypot(dx, dy)
        touching = distance < people[i].radius + other.radius + 1e-3 and dx * nx + dy * ny > 0.99 * distance
        if j != i and other.behaviour == BOUNCE and touching:
            vx, vy = _reflected(math.cos(other.heading), math.sin(other.heading), -nx, -ny)
            other.heading = math.atan2(vy, vx)


@njit(cache=True)
def _reflected(vx: float, vy: float, nx: float, ny: float) -> tuple[float, float]:
    """Return a velocity after reflection by an obstacle; the unit vector (nx, ny) points away from the obstacle."""
    into = min(vx * nx + vy * ny, 0.0)
    return vx - 2.0 * into * nx, vy - 2.0 * into * ny


@njit(cache=True)
def _turn_towards(person: Person, direction: float, seconds: float) -> float:
    """Turn towards a direction [rad] at TURN_RATE at most; return the angle [rad] that remains."""
    off = (direction - person.heading + math.pi) % math.tau - math.pi
    turn = min(max(off, -TURN_RATE * seconds), TURN_RATE * seconds)
    person.heading = (person.heading + turn + math.pi) % math.tau - math.pi
    return float(abs(off - turn))
