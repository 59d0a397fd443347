"""Goals with a pose and with tolerances that a chair can keep, as the navigator needs them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from waychair.errors import GoalOutsideMap, GoalTooExact
from waychair.geometry import is_possible_pose, wrap_angle
from waychair.maps.drawn.places import CLOSEST_M, CLOSEST_RAD, find
from waychair.planning.window.motion_limits import DwaSettings, GoalTolerances
from waychair.types import Goal, Place, Pose2


def posed(goal: Goal, places: Mapping[str, Place]) -> Goal:
    """Return the goal with the pose and tolerances of the place that it names.

    Raises:
        UnknownPlace: it names none of the places.
        GoalOutsideMap: its pose lies on no possible map.
        GoalTooExact: its tolerances are closer than a chair can stop.
    """
    if not isinstance(goal.target, Pose2):
        place = find(places, goal.target)
        goal = Goal(place.pose, place.tolerance_m, place.tolerance_rad)
    pose = goal.target
    assert isinstance(pose, Pose2)
    if not is_possible_pose(pose.x, pose.y, pose.theta):
        raise GoalOutsideMap(
            f"the goal ({pose.x:g}, {pose.y:g}, {pose.theta:g}) is on no map: give metres and radians on the map"
        )
    if not (goal.tolerance_m >= CLOSEST_M and goal.tolerance_rad >= CLOSEST_RAD):
        raise GoalTooExact(
            f"the goal asks for {goal.tolerance_m:g} m and {goal.tolerance_rad:g} rad: a chair stops within "
            f"{CLOSEST_M:g} m and {CLOSEST_RAD:g} rad at best, give it those or more"
        )
    return goal


def limits_to(goal: Goal, limits: DwaSettings) -> DwaSettings:
    """Return the motion's limits to a goal; the rest of its tolerances is left to the localisation's error."""
    return replace(
        limits,
        tolerances=GoalTolerances(
            position=min(limits.tolerances.position, 0.6 * goal.tolerance_m),
            heading=min(limits.tolerances.heading, goal.tolerance_rad / 2),
        ),
    )


def is_missed(goal: Goal, pose: Pose2) -> bool:
    """Return whether a chair at a pose in map is outside the tolerances of a goal that is a pose."""
    assert isinstance(goal.target, Pose2)
    away = math.hypot(goal.target.x - pose.x, goal.target.y - pose.y)
    return away > goal.tolerance_m or abs(wrap_angle(goal.target.theta - pose.theta)) > goal.tolerance_rad


IN_PLACE, AT_GOAL = 0.8, 0.75
"""Shares of a goal's tolerances: a chair within the first of the distance only turns, since driving a few centimetres
takes two turns; a chair that stands within the second of both has arrived. The rest is left to the localisation."""


def is_in_place(goal: Goal, pose: Pose2) -> bool:
    """Return whether a chair at a pose in map is so near to a goal that is a pose that it need only turn."""
    assert isinstance(goal.target, Pose2)
    return math.hypot(goal.target.x - pose.x, goal.target.y - pose.y) <= IN_PLACE * goal.tolerance_m


def is_at(goal: Goal, pose: Pose2) -> bool:
    """Return whether a chair that stands at a pose in map has arrived at a goal that is a pose."""
    within = replace(goal, tolerance_m=AT_GOAL * goal.tolerance_m, tolerance_rad=AT_GOAL * goal.tolerance_rad)
    return not is_missed(within, pose)


def how_far_off(goal: Goal, pose: Pose2) -> str:
    """Return a sentence on how far a chair stands from a goal that it could not meet as exactly as its tolerances."""
    assert isinstance(goal.target, Pose2)
    away = math.hypot(goal.target.x - pose.x, goal.target.y - pose.y)
    turn = math.degrees(abs(wrap_angle(goal.target.theta - pose.theta)))
    return (
        f"the chair stands {away:.2f} m and {turn:.0f} degrees from the goal and cannot stop more exactly: give the place "
        "a larger tolerance, or drive the rest by hand"
    )
