"""The answer to "where am I?": one or two sentences for ear and page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from waychair.control.behaviours.commands import sector_of
from waychair.geometry import wrap_angle
from waychair.runtime.haptics.haptic_state import RiderSurroundings
from waychair.types import Place, Pose2

AT_PLACE = 0.7
"""m; so near to a place the chair is at it."""

FARTHEST = 15.0
"""m; places farther away tell nothing of where the chair is."""

MOST_NEAR = 3
"""Most sentences about the surroundings: more are not remembered."""

_SIDES = (
    "ahead",
    "ahead on the left",
    "on the left",
    "behind on the left",
    "behind",
    "behind on the right",
    "on the right",
    "ahead on the right",
)


def where_words(pose: Pose2 | None, round_me: RiderSurroundings, step: str = "") -> str:
    """Return the chair's place, things near it, and the present step in words; `pose` None: it is not known."""
    told = [_place_words(pose, round_me.places), *round_me.near[:MOST_NEAR]]
    if step:
        told.append(f"Now: {step}.")
    return " ".join(told)


def _place_words(pose: Pose2 | None, places: Sequence[Place]) -> str:
    if pose is None:
        return "The chair does not know where it is."
    near = min(places, key=lambda place: _away(pose, place), default=None)
    if near is None or _away(pose, near) > FARTHEST:
        return "No place with a name is near."
    away = _away(pose, near)
    if away <= AT_PLACE:
        return f"You are at {near.name}."
    bearing = wrap_angle(math.atan2(near.pose.y - pose.y, near.pose.x - pose.x) - pose.theta)
    return f"{near.name} is {away:.0f} m away, {_SIDES[sector_of(bearing)]}."


def _away(pose: Pose2, place: Place) -> float:
    return math.hypot(place.pose.x - pose.x, place.pose.y - pose.y)
