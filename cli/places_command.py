"""`waychair places`: the named places of a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonNegativeInt

if TYPE_CHECKING:
    from collections.abc import Iterable

    from waychair.types import OccupancyGrid, Place

TwoWords = Annotated[tuple[str, str] | None, Parameter(allow_leading_hyphen=True)]


def places_command(
    *,
    map: Path | None = None,
    add: TwoWords = None,
    move: TwoWords = None,
    rename: TwoWords = None,
    remove: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    yes: bool = False,
    domain: NonNegativeInt | None = None,
    namespace: str = "",
) -> None:
    """List the named places of a map, or change one and list them.

    Parameters
    ----------
    map
        Map folder or its map.yaml; default the map of the running chair, whose places are only listed.
    add
        NAME X,Y,YAW: place to add, in metres and radians in the map; 90deg is understood, too.
    move
        NAME X,Y,YAW: new pose of a place, whose tolerances stay.
    rename
        NAME NEW: new name of a place.
    remove
        NAME of a place to remove.
    yes
        Let --add replace a place of the same name; by default a question in a terminal, else refused.
    domain
        ROS domain of the running chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.maps.drawn.places import load_places
    from waychair.maps.folders.map_files import load_info, yaml_path

    changes = {"--add": add, "--move": move, "--rename": rename, "--remove": remove}
    given = [option for option, value in changes.items() if value is not None]
    if len(given) > 1:
        raise BadArgument(f"{' and '.join(given)} are given: give one at a time")
    if map is None:
        if given:
            raise BadArgument(f"{given[0]} needs the --map whose places to change")
        _print_running_places(domain, namespace)
        return
    load_info(yaml_path(map))  # the map must exist
    if add is not None:
        _add(map, *add, yes=yes)
    elif move is not None:
        _move(map, *move)
    elif rename is not None:
        _rename(map, *rename)
    elif remove is not None:
        _remove(map, remove)
    places = load_places(map)
    print_places(places.values())
    if not places:
        print(f"the map has no places: add one with waychair places --map {map} --add NAME X,Y,YAW")


def _add(map: Path, name: str, text: str, *, yes: bool) -> None:
    """Add a place, or replace one if the user agrees.

    Raises:
        PlaceError: there is a place of this name, or the place is impossible.
    """
    from waychair.cli.options.arguments import pose_from_text
    from waychair.cli.options.messages import is_agreed
    from waychair.errors import PlaceError
    from waychair.maps.drawn.places import add_place, check_place, load_places
    from waychair.types import Place

    name = name.strip()
    place = Place(name, pose_from_text(text, "--add"))
    check_place(_grid(map), place)
    known = load_places(map).get(name)
    if known is not None and not yes:
        there = f"there is a place '{name}' already, at {_pose(known)}"
        if not is_agreed(f"{there}. Replace it?"):
            raise PlaceError(f"{there}: give another name, or replace it with --yes")
    add_place(map, name, place.pose, replace=True)


def _move(map: Path, name: str, text: str) -> None:
    from dataclasses import replace

    from waychair.cli.options.arguments import pose_from_text
    from waychair.maps.drawn.places import check_place, find, load_places, save_places

    places = load_places(map)
    place = replace(find(places, name), pose=pose_from_text(text, "--move"))
    check_place(_grid(map), place)
    save_places(map, {**places, name: place})


def _rename(map: Path, name: str, new: str) -> None:
    """Rename a place, which stays where it is in the list.

    Raises:
        UnknownPlace: there is none of this name.
        PlaceError: the new name is taken or impossible.
    """
    from dataclasses import replace

    from waychair.errors import PlaceError
    from waychair.maps.drawn.places import find, load_places, save_places

    places, new = load_places(map), new.strip()
    place = replace(find(places, name), name=new)
    if new in places and new != name:
        raise PlaceError(f"there is a place '{new}' already, at {_pose(places[new])}: give another name")
    save_places(map, {each.name: each for each in (place if key == name else known for key, known in places.items())})


def _remove(map: Path, name: str) -> None:
    from waychair.maps.drawn.places import find, load_places, save_places

    places = load_places(map)
    find(places, name)
    save_places(map, {key: place for key, place in places.items() if key != name})


def _grid(map: Path) -> OccupancyGrid:
    from waychair.cli.options.messages import warn
    from waychair.maps.folders.map_files import load_map

    return load_map(map, warn)


def print_places(places: Iterable[Place]) -> None:
    """Print a line for each place."""
    for place in places:
        print(f"{place.name}: {_pose(place)}")


def _pose(place: Place) -> str:
    return f"{place.pose.x:.2f}, {place.pose.y:.2f}, {place.pose.theta:.2f}"


def _print_running_places(domain: int | None, namespace: str) -> None:
    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain, namespace=namespace) as client:
        print_places(client.places().values())
