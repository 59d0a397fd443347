"""Poses and angles as people type them: `1.5,-2,0.78`, `1.5,-2,45deg`; angles also as `45°` and `0.78rad`.

More than a full turn is a slip of the unit, since 90 radians are no heading that anybody means.
"""

from __future__ import annotations

import math
import re

from waychair.geometry import MAX_COORDINATE, is_possible_pose
from waychair.types import Pose2

POSE_SHAPE = "X,Y or X,Y,YAW in metres and radians (such as 1.5,-2,0.78 or 1.5,-2,45deg)"

_NUMBER_AND_UNIT = re.compile(
    r"(?P<number>.*?)\s*(?P<unit>°|deg|degs|degree|degrees|rad|rads|radian|radians)?", re.IGNORECASE
)
_SLACK = 1e-3  # [rad] a full turn is typed with few decimals


class NoPoseText(ValueError):
    """A text is no pose, or no angle."""


class ImpossiblePose(NoPoseText):
    """The numbers of a pose or an angle are too large; the error is a clause with the remedy."""


def angle_from_text(text: str) -> float:
    """Return the angle [rad] of a number of radians, or of a number with the unit `deg`, `°` or `rad`.

    Raises:
        ImpossiblePose: it is more than a full turn.
        NoPoseText: it is no angle.
    """
    match = _NUMBER_AND_UNIT.fullmatch(text.strip())
    assert match is not None  # since the number may be any text
    value = _number(match["number"])
    if (match["unit"] or "rad").lower().startswith("rad"):
        return checked_turn(value)
    if abs(value) > 360.0:
        raise ImpossiblePose(f"{value:g}deg is more than a full turn; give -360deg to 360deg")
    return math.radians(value)


def checked_turn(angle: float) -> float:
    """Return an angle [rad] that is at most a full turn.

    Raises:
        ImpossiblePose: it is more, or not a number.
    """
    if abs(angle) <= math.tau + _SLACK:
        return angle
    much = f"{angle:g} rad is {math.degrees(angle):.0f} degrees, more than a full turn"
    if abs(angle) <= 360.0:
        raise ImpossiblePose(f"{much}; for {angle:g} degrees write {angle:g}deg or {math.radians(angle):.4g}")
    raise ImpossiblePose(f"{much}; give -6.283 to 6.283, or degrees such as 90deg")


def pose_from_text(text: str) -> Pose2:
    """Return the pose of `X,Y` or `X,Y,YAW`.

    Raises:
        ImpossiblePose: a coordinate is too large, or the angle more than a full turn.
        NoPoseText: it has another form.
    """
    x, y, *yaw = text.split(",") if text.count(",") in (1, 2) else ("", "")
    pose = Pose2(_number(x), _number(y), *map(angle_from_text, yaw))
    if not is_possible_pose(pose.x, pose.y):
        raise ImpossiblePose(f"X and Y may be up to {MAX_COORDINATE:g} m from 0")
    return pose


def is_like_pose(text: str) -> bool:
    """Return whether a text reads as coordinates: two or more numbers with commas between, perhaps with units."""
    parts = text.split(",")
    return len(parts) > 1 and all(_is_number(part) for part in parts[:2])


def _is_number(text: str) -> bool:
    try:
        _number(text)
    except NoPoseText:
        return False
    return True


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise NoPoseText(f"'{text}' is not a number") from error
    if not math.isfinite(value):
        raise NoPoseText(f"'{text}' is not a number")
    return value
