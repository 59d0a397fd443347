"""Named places of a map: `places.yaml` beside `map.yaml`.

    lift: [12.4, 3.1, 1.5708]
    desk: [2.0, 5.5, 180deg, 0.05, 0.02]

A place is x, y [m], yaw [rad] in map, optionally with tolerances of arrival [m], [rad]. Angles may be in degrees.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import replace as changed
from pathlib import Path

import numpy as np
import yaml

from waychair.errors import MapError, PlaceError, UnknownPlace
from waychair.files import is_folder, path_exists, refuse_empty_file
from waychair.geometry import MAX_ANGLE, MAX_COORDINATE, is_possible_pose, wrap_angle
from waychair.maps.drawn.anchors import load_anchors, write_anchored
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points, inside
from waychair.pose_text import ImpossiblePose, angle_from_text, is_like_pose
from waychair.types import OccupancyGrid, Place, Pose2
from waychair.yaml_files import compose_yaml

PLACES_YAML = "places.yaml"

PLACES = "places"
"""The kind of the places' anchors in `anchors.yaml`."""

CLOSEST_M, CLOSEST_RAD = 0.02, 0.02
"""Smallest tolerances of arrival: the chair localises and stops no more accurately."""

_DEFAULT = Place("", Pose2())
_SHAPE = "[x, y, yaw] or [x, y, yaw, tolerance_m, tolerance_rad]"
_ANGLES = (2, 4)
"""Positions of the angles in a place's list; they may have a unit (`90deg`)."""


def places_path(folder: Path) -> Path:
    """Return the path of `places.yaml` of a map, given its folder or YAML file."""
    is_yaml = folder.suffix in (".yaml", ".yml") and not is_folder(folder, MapError)
    return (folder.parent if is_yaml else folder) / PLACES_YAML


def load_places(folder: Path) -> dict[str, Place]:
    """Return the places of a map by name, in the order of the file; none without such a file.

    They are moved with the map's nodes (`maps.drawn.anchors`).

    Raises:
        MapError: the anchors are damaged.
        PlaceError: the file is broken; the message names the line and the place.
    """
    path = places_path(folder)
    if not path_exists(path, PlaceError):
        return {}
    refuse_empty_file(path, PlaceError, "{}")
    root = compose_yaml(path, PlaceError)
    if root is None:
        return {}
    if not isinstance(root, yaml.MappingNode):
        raise PlaceError(f"{path} must hold `name: [x, y, yaw]` lines")
    places: dict[str, Place] = {}
    for key, value in root.value:
        place = _place(path, key, value)
        places[place.name] = place
    anchors = load_anchors(path.parent)
    return {
        name: changed(place, pose=anchors.follow("places", name, [place.pose])[0]) for name, place in places.items()
    }


def save_places(folder: Path, places: Mapping[str, Place]) -> None:
    """Write the places of a map, whole or not at all; default tolerances are left out.

    Raises:
        PlaceError: a name or a number is impossible.
        MapError: the anchors are damaged.
        OutputError: the folder cannot be made or written to.
    """
    write_anchored(places_path(folder), places_text(places), PLACES, place_points(places))


def places_text(places: Mapping[str, Place]) -> str:
    """Return the text of `places.yaml`; raises PlaceError as `save_places`."""
    values = {place.name: _values(checked_place(place)) for place in places.values()}
    return yaml.safe_dump(values, sort_keys=False, default_flow_style=None, allow_unicode=True, width=10_000)


def place_points(places: Mapping[str, Place]) -> dict[str, list[Pose2]]:
    """Return the anchored points of places, by their names."""
    return {place.name: [place.pose] for place in places.values()}


def add_place(folder: Path, name: str, pose: Pose2, *, replace: bool = False) -> Place:
    """Add a place to a map's file and return it; with `replace`, move the place of that name.

    Raises:
        PlaceError: the name is taken or impossible, the pose is not finite, or the file is broken.
        OutputError: the folder cannot be made or written to.
    """
    places = load_places(folder)
    place = checked_place(Place(name.strip(), pose))
    if place.name in places and not replace:
        raise PlaceError(f"there is a place '{place.name}' already; choose another name or replace it")
    save_places(folder, {**places, place.name: place})
    return place


def find(places: Mapping[str, Place], name: str, whose: str = "the map") -> Place:
    """Return the place of this name; `whose` names the owner of the places in the error.

    Raises:
        UnknownPlace: there is none; the message gives the most similar names.
    """
    if name in places:
        return places[name]
    if not places:
        raise UnknownPlace(f"there is no place '{name}': {whose} has no places yet; add one")
    by_folded = {known.casefold(): known for known in places}
    near = difflib.get_close_matches(name.casefold(), by_folded, n=3, cutoff=0.0)
    raise UnknownPlace(f"there is no place '{name}'; did you mean {', '.join(by_folded[match] for match in near)}?")


def check_place(grid: OccupancyGrid, place: Place) -> None:
    """Refuse a place that lies outside the map or in a wall.

    Raises:
        PlaceError: the place lies outside the map or in a wall.
    """
    at = f"the place '{place.name}' at ({place.pose.x:.2f}, {place.pose.y:.2f})"
    cell = cells_from_points(grid, np.array([[place.pose.x, place.pose.y]]))
    if not inside(grid, cell)[0]:
        height, width = (count * grid.resolution for count in grid.cells.shape)
        raise PlaceError(f"{at} lies outside the map of {width:.1f} x {height:.1f} m; choose a point in it")
    if grid.cells[tuple(cell[0])] >= OCCUPIED_FROM:
        raise PlaceError(f"{at} lies in a wall; choose a point in free space")


def checked_place(place: Place) -> Place:
    """Return the place, if it can be written and read again.

    Raises:
        PlaceError: a name or a number is impossible.
    """
    if not place.name or place.name != place.name.strip() or not place.name.isprintable():
        raise PlaceError(f"{place.name!r} cannot be the name of a place; use letters, digits and single spaces")
    if is_like_pose(place.name):
        raise PlaceError(f"'{place.name}' cannot be the name of a place, as it reads as coordinates; use a word in it")
    x, y, yaw = place.pose.x, place.pose.y, place.pose.theta
    if not is_possible_pose(x, y, yaw):
        raise PlaceError(
            f"the place '{place.name}' has no pose on a map (x {x:g}, y {y:g}, yaw {yaw:g}); give metres up to "
            f"{MAX_COORDINATE:g} and radians up to {MAX_ANGLE:g}"
        )
    if not (CLOSEST_M <= place.tolerance_m < math.inf and CLOSEST_RAD <= place.tolerance_rad <= math.tau):
        raise PlaceError(
            f"the tolerances of the place '{place.name}' must be at least {CLOSEST_M:g} m and {CLOSEST_RAD:g} rad, as a "
            "chair stops no closer, and finite; that of the heading at most a full turn"
        )
    return place


def _values(place: Place) -> list[float]:
    pose = [float(place.pose.x), float(place.pose.y), float(place.pose.theta)]
    tolerances = (place.tolerance_m, place.tolerance_rad)
    if tolerances == (_DEFAULT.tolerance_m, _DEFAULT.tolerance_rad):
        return pose
    return [*pose, *map(float, tolerances)]


def _place(path: Path, key: yaml.Node, value: yaml.Node) -> Place:
    """Return a place from its YAML nodes; names stay as written, so that room 007 keeps its zeros."""
    where = f"{path} line {key.start_mark.line + 1}"
    if not isinstance(key, yaml.ScalarNode):
        raise PlaceError(f"{where}: a place's name must be a word; write `name: [x, y, yaw]`")
    items = value.value if isinstance(value, yaml.SequenceNode) else []
    if len(items) not in (3, 5):
        raise PlaceError(f"{where}: '{key.value}' must be {_SHAPE}")
    try:
        x, y, yaw, *tolerances = (
            (angle_from_text if at in _ANGLES else float)(item.value) for at, item in enumerate(items)
        )
    except ImpossiblePose as error:
        raise PlaceError(f"{where}: the place '{key.value}' cannot have this angle: {error}") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise PlaceError(f"{where}: '{key.value}' must be {_SHAPE}, all numbers") from error
    try:
        return checked_place(Place(key.value, Pose2(x, y, wrap_angle(yaw)), *tolerances))
    except PlaceError as error:
        raise PlaceError(f"{where}: {error}") from error
