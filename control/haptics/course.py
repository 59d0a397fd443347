"""The course of a chair along a leg of a plan and through its door, as geometry: poses on the leg, errors of aim, room."""

from __future__ import annotations

import math

from waychair.calibration.chair_body import ChairBody
from waychair.control.haptics.guide_numbers import (
    BESIDE_MIDDLE,
    GATE_OFFSET,
    GATE_TURN,
    HOLDS_S,
    IN_DOOR,
    KEEPS_WAITING_S,
    LEAST_AIM,
    LEAST_ASKEW,
    LEAST_ERROR,
    LOOK_AHEAD,
    MOST_TOLERANT,
    NEAR_END,
    NUDGE_SHARE,
    PER_MISTAKE,
    TURN_BEFORE_WALL,
)
from waychair.control.haptics.guide_types import Aim, GuideInputs
from waychair.control.haptics.rider import SEEN_TO_OBEY, RiderModel
from waychair.geometry import wrap_angle
from waychair.planning.steps.door_steps import HALF_WALL
from waychair.planning.steps.step import Step
from waychair.types import Pose2


def on_leg(leg: Step, pose: Pose2) -> tuple[float, float, float]:
    """Return along and left of the leg [m] and the heading to it [rad]."""
    local = leg.start.inverse() @ pose
    return local.x, local.y, local.theta


def before_wall(step: Step, along: float, body: ChairBody) -> float:
    """Return the distance [m] of the chair's front from the wall of a step's door, `along` [m] the leg."""
    assert step.door is not None
    at = step.start.inverse() @ step.door.map_from_door
    return at.x - HALF_WALL - body.front - along


def veered(veer: float, way: float, front: float = 0.0) -> tuple[float, float]:
    """Return how far aside [m] and round [rad], left positive, a veer [rad/m] takes a chair on `way` [m].

    With `front`, the way ends in a door: of the chair's middle line in it, midway between the one when the front is there, so far [m]
    before the drive axle, and the one when the axle is.
    """
    passing = min(way, front)
    return veer * (0.5 * way * way - 0.25 * passing * passing), veer * (way - 0.5 * passing)


def off_aim(step: Step, there: Pose2, body: ChairBody, veer: float) -> float:
    """Return how far [rad, left positive] the aim of a step lies off the course of a chair at a pose on its leg.

    A door's aim is its middle, or a little beside it where the chair would pass the middle askew, and elsewhere a point ahead on the
    leg. The chair is led against its veer: it comes there in an arc.
    """
    if step.door is None or before_wall(step, there.x, body) <= -IN_DOOR:
        aside, _ = veered(veer, LOOK_AHEAD)
        return wrap_angle(math.atan2(-there.y - aside, LOOK_AHEAD) - there.theta)
    at = step.start.inverse() @ step.door.map_from_door
    way = max(at.x - there.x, LEAST_AIM)
    aside, bend = veered(veer, way, body.front)
    course = math.atan2(at.y - there.y - aside, way)
    return wrap_angle(course + _straighter(step, course + bend - at.theta, way, body) - there.theta)


def _straighter(step: Step, turned: float, way: float, body: ChairBody) -> float:
    """Return by how much [rad] a chair aims beside a door's middle on `way` [m], because it would pass it `turned` [rad] to its axis."""
    most = BESIDE_MIDDLE * room_askew(step, turned, body) / way
    return -math.copysign(min(max(abs(turned) - LEAST_ASKEW, 0.0), most), turned)


def course_error(step: Step, now: GuideInputs, body: ChairBody, veer: float) -> float:
    """Return the error of the course [rad, left positive] when a stick that is held now takes effect."""
    way = Pose2(max(now.twist.v, 0.0) * HOLDS_S, 0.0, now.twist.omega * HOLDS_S)
    return off_aim(step, step.start.inverse() @ now.pose @ way, body, veer)


def tolerated_error(rider: RiderModel, v: float, error: float) -> float:
    """Return the error of the course [rad] up to which a rider who drives at `v` [m/s] is not nudged.

    It is less to the side from which the chair veers away: the error grows by itself until the next nudge can be said. It is more
    for a rider who mixes symbols up.
    """
    mistakes = max(SEEN_TO_OBEY - rider.sure, 0.0)
    limit = max(LEAST_ERROR, NUDGE_SHARE * rider.nudge) * min(1.0 + PER_MISTAKE * mistakes, MOST_TOLERANT)
    grows = -math.copysign(1.0, error) * rider.veer_per_m * v * KEEPS_WAITING_S
    return max(limit - max(grows, 0.0), 0.5 * limit)


def room_askew(step: Step, turned: float, body: ChairBody) -> float:
    """Return the room [m] beside a chair that passes the door at an angle to its axis: less by the wall's thickness."""
    assert step.door is not None
    gap = step.door.width * math.cos(turned) - 2.0 * HALF_WALL * abs(math.sin(turned))
    return max(0.5 * (gap - body.width), 0.0)


def aims_well(step: Step, aim: Aim, body: ChairBody) -> bool:
    """Return whether a chair with this aim passes the door of a step with some room on either side."""
    return abs(aim.offset) <= GATE_OFFSET * room_askew(step, aim.turned, body) and abs(aim.turned) <= GATE_TURN


def may_swivel(step: Step, along: float, body: ChairBody) -> bool:
    """Return whether a turn on the spot is free `along` [m] the leg: not with the front in a door."""
    if step.door is None:
        return True
    return before_wall(step, along, body) > TURN_BEFORE_WALL or along > step.length - NEAR_END


def is_hopeless(step: Step, along: float, aside: float, body: ChairBody) -> bool:
    """Return whether the straight way to the door's middle is more askew than the gate allows, with room to turn here.

    `along`, `aside`: the chair on the leg [m].
    """
    assert step.door is not None
    at = step.start.inverse() @ step.door.map_from_door
    needed = abs(math.atan2(at.y - aside, max(at.x - along, 1e-3)))
    return before_wall(step, along, body) > TURN_BEFORE_WALL and needed > GATE_TURN


def front_at_door(step: Step, along: float, body: ChairBody) -> bool:
    """Return whether the front of a chair `along` [m] the leg stands close before a door or in it."""
    return step.door is not None and -body.length < before_wall(step, along, body) < TURN_BEFORE_WALL
