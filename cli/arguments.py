"""Arguments that are written as comma-separated numbers."""

from __future__ import annotations

import math

from waychair.errors import WaychairError
from waychair.types import Pose2


class BadArgument(WaychairError):
    """An argument on the command line cannot be understood."""


def pose_from_text(text: str, name: str) -> Pose2:
    """`X,Y` or `X,Y,THETA` in metres and radians."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not all(math.isfinite(value) for value in values):
        raise BadArgument(f"{name} must be X,Y or X,Y,THETA in metres and radians (such as 1.5,-2,0.78), not '{text}'")
    return Pose2(*values)
