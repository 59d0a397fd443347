"""Types of command-line arguments: counts, file names, and poses as comma-separated numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import cyclopts
from cyclopts import Parameter, Token, validators

from waychair import pose_text
from waychair.errors import MapError, OutputError, UnknownPlace, WaychairError
from waychair.files import path_exists
from waychair.pose_text import POSE_SHAPE, ImpossiblePose, NoPoseText, is_like_pose
from waychair.types import Place, Pose2
from waychair.yaml_files import quoted

if TYPE_CHECKING:
    from waychair.calibration.chair_body import ChairBody


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


def _minutes(kind: type, tokens: Sequence[Token]) -> Any:
    text = tokens[0].value
    try:
        minutes = float(text)
    except ValueError:
        minutes = math.nan
    if not (math.isfinite(minutes) and minutes > 0.0):
        raise ValueError(f"'{text}' is no time in minutes above zero")
    return minutes


Minutes = Annotated[float, Parameter(converter=_minutes, allow_leading_hyphen=True)]
"""A time above zero [min]."""


def _named(kind: type, tokens: Sequence[Token]) -> Any:
    """Convert a path; cyclopts alone would take an empty text for the current folder."""
    if not all(token.value for token in tokens):
        raise ValueError("the path is empty: give a name.")
    return cyclopts.convert(kind, [token.value for token in tokens])


NonEmptyPath = Annotated[Path, Parameter(converter=_named)]
"""A path that is not empty."""


def body_named(name: str) -> ChairBody:
    """Return the chair that `--body` names.

    Raises:
        BadArgument: there is none of this name.
    """
    from waychair.calibration.chair_body import BODIES

    if name not in BODIES:
        raise BadArgument(f"--body {quoted(name)} is unknown: give one of {', '.join(BODIES)}")
    return BODIES[name]


def pose_from_text(text: str, name: str) -> Pose2:
    """Return the pose of `X,Y` or `X,Y,YAW`, whose angle is in radians or has a unit; `name` names the option.

    Raises:
        BadArgument: it has another form, a coordinate is too large, or the angle is more than a full turn.
    """
    try:
        return pose_text.pose_from_text(text)
    except ImpossiblePose as error:
        raise BadArgument(f"{name} is {quoted(text)}: {error}") from error
    except NoPoseText as error:
        raise BadArgument(f"{name} must be {POSE_SHAPE}, not {quoted(text)}") from error


def place_from_text(places: Mapping[str, Place], text: str, name: str, owner: str = "the map") -> Place:
    """Return the place of this name, or the pose that the text gives, called as the text.

    A name may begin with a digit or hold commas: only a text that begins with two numbers is a pose. `name` names the
    option, `owner` the owner of the places.

    Raises:
        BadArgument: it reads as a pose, but is none.
        UnknownPlace: there is no place of this name; the message gives the most similar names.
    """
    from waychair.maps.drawn.places import find

    if text not in places and is_like_pose(text):
        return Place(text, pose_from_text(text, name))
    try:
        return find(places, text, owner)
    except UnknownPlace as error:
        if text[:1].isalpha() or ("," not in text and any(map(str.isalpha, text))):
            raise
        raise UnknownPlace(f"{error} A pose is {POSE_SHAPE}.") from error


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
