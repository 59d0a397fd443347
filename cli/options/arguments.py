"""Types of command-line arguments: counts, file names, and poses as comma-separated numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from cyclopts import Parameter, Token, validators

from waychair.errors import MapError, OutputError, WaychairError
from waychair.files import path_exists
from waychair.geometry import MAX_ANGLE, MAX_COORDINATE, is_possible_pose
from waychair.types import Pose2
from waychair.yaml_files import quoted


class BadArgument(WaychairError):
    """An argument on the command line cannot be understood."""


def _whole(kind: type, tokens: Sequence[Token]) -> Any:
    """Convert a whole number; cyclopts alone would round other numbers."""
    for token in tokens:
        if "." in token.value:
            raise ValueError(f"'{token.value}' is not a whole number.")
    return cyclopts.convert(kind, [token.value for token in tokens])


NonNegativeInt = Annotated[int, Parameter(converter=_whole, validator=validators.Number(gte=0))]
"""A whole number from 0, such as a count or a seed."""

PositiveInt = Annotated[int, Parameter(converter=_whole, validator=validators.Number(gte=1))]
"""A whole number from 1."""


def _named(kind: type, tokens: Sequence[Token]) -> Any:
    """Convert a path; cyclopts alone would take an empty text for the current folder."""
    if not all(token.value for token in tokens):
        raise ValueError("the path is empty: give a name.")
    return cyclopts.convert(kind, [token.value for token in tokens])


NonEmptyPath = Annotated[Path, Parameter(converter=_named)]
"""A path that is not empty."""


def pose_from_text(text: str, name: str) -> Pose2:
    """Return the pose of `X,Y` or `X,Y,THETA` in metres and radians."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not all(math.isfinite(value) for value in values):
        raise BadArgument(
            f"{name} must be X,Y or X,Y,THETA in metres and radians (such as 1.5,-2,0.78), not {quoted(text)}"
        )
    if not is_possible_pose(*values):
        raise BadArgument(
            f"{name} is {quoted(text)}; X and Y may be up to {MAX_COORDINATE:g} m from 0, THETA {MAX_ANGLE:g} rad"
        )
    return Pose2(*values)


def check_picture(path: Path | None, name: str, *sources: Path) -> None:
    """Check that a picture goes to a .png file and overwrites none of its source files.

    Raises:
        BadArgument: it has another suffix, or it is one of `sources`.
    """
    if path is None:
        return
    if path.suffix.lower() != ".png":
        raise BadArgument(f"{name} must be a .png file, not '{path}'")
    if path_exists(path, OutputError) and any(path_exists(each, MapError) and path.samefile(each) for each in sources):
        raise BadArgument(f"{name} would overwrite '{path}', a file of the map: choose another file")
