"""The places, zones and erased parts that people draw on a saved map, with undo.

All are text files beside `map.yaml`, which may also be edited by hand: `places.yaml`, `zones.yaml`, `erased.yaml`,
their `anchors.yaml`, and `undo.yaml` with the former texts of those files. Each file is replaced as a whole, one after
another. After an interruption between two files the old anchors do not fit the new poses, which then count as written.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from waychair.errors import MapError, PlaceError, ZoneError
from waychair.files import path_exists, read_text, remove, write_text
from waychair.maps.drawn.anchors import ANCHORS_YAML
from waychair.maps.drawn.erased import ERASED_YAML, clear_erased, load_erased, save_erased
from waychair.maps.drawn.places import PLACES_YAML, checked_place, find, load_places, places_path, save_places
from waychair.maps.drawn.zones import ZONES_YAML, Zone, checked_polygon, checked_zone, load_zones, save_zones
from waychair.maps.folders.depth_layer import drop_offs, load_depth_layer
from waychair.maps.folders.map_files import load_map
from waychair.types import FloatArray, Place
from waychair.yaml_files import yaml_from_text

UNDO_YAML = "undo.yaml"
MOST_UNDONE = 20
"""The number of changes that can be undone."""

_FILES = (PLACES_YAML, ZONES_YAML, ERASED_YAML, ANCHORS_YAML)
DRAWN_FILES = (*_FILES, UNDO_YAML)
"""The files of everything drawn on the map of a folder."""

_NOTHING = ("", "{}", "[]")


@dataclass(frozen=True, slots=True)
class MapDrawing:
    """Places by name, zones and erased polygons (N, 2) [m], at their present poses in map."""

    places: dict[str, Place]
    zones: tuple[Zone, ...] = ()
    erased: tuple[FloatArray, ...] = ()

    def has_same_zones(self, other: MapDrawing) -> bool:
        """Return whether both have the same zones at the same poses."""
        return [_content(zone) for zone in self.zones] == [_content(zone) for zone in other.zones]

    def has_same_erased(self, other: MapDrawing) -> bool:
        """Return whether both have the same erased polygons."""
        return [polygon.tolist() for polygon in self.erased] == [polygon.tolist() for polygon in other.erased]


class DrawnFiles:
    """The state of a map's drawings on disk, to notice that another program has changed them."""

    def __init__(self, map_folder: Path) -> None:
        """Note the present state of the files beside the map at a folder or YAML file."""
        self._folder = places_path(map_folder).parent
        self._known = self._state()

    def note(self) -> None:
        """Note the present state, since it is about to be read."""
        self._known = self._state()

    def changed(self) -> bool:
        """Return whether a file was changed, made or removed since the last call or `note`."""
        before, self._known = self._known, self._state()
        return self._known != before

    def _state(self) -> list[tuple[int, int] | None]:
        return [_state_of(self._folder / name) for name in _FILES]


def _state_of(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ino


def forget(folder: Path) -> None:
    """Remove everything drawn on a map, before another map takes its place.

    Raises:
        OutputError: a file cannot be removed.
    """
    for name in DRAWN_FILES:
        remove(folder / name)


def is_drawn_on(folder: Path) -> bool:
    """Return whether there are places, zones or erased parts, or damaged files of them.

    Raises:
        MapError: a file cannot be read.
    """
    paths = [folder / name for name in (PLACES_YAML, ZONES_YAML, ERASED_YAML)]
    return any(path_exists(path, MapError) and read_text(path, MapError).strip() not in _NOTHING for path in paths)


class DrawingEditor:
    """The drawing in one map's folder. Every change reads the files anew, since they may have been edited by hand."""

    def __init__(self, map_folder: Path) -> None:
        """Read the drawing of a map, given its folder or its map.yaml.

        Raises:
            MapError, PlaceError, ZoneError: a file is broken.
        """
        self._map, self._folder = map_folder, places_path(map_folder).parent
        self.drawing = self._read()

    @property
    def undoable(self) -> bool:
        """Whether there is a change to undo."""
        return bool(self._history())

    def draw(self, drawing: MapDrawing) -> None:
        """Replace the whole drawing by another.

        Raises:
            WaychairError: a file is broken or cannot be written.
        """
        self._change(lambda now: drawing)

    def set_place(self, place: Place, replaces: bool = False) -> None:
        """Add a place; with `replaces`, change the place of that name if there is one.

        Raises:
            PlaceError: the name is taken, or a name or a number is impossible.
            WaychairError: a file is broken or cannot be written.
        """
        checked_place(place)

        def added(now: MapDrawing) -> MapDrawing:
            if not replaces:
                _refuse_taken(place.name, now)
            return replace(now, places={**now.places, place.name: place})

        self._change(added)

    def rename_place(self, name: str, new_name: str) -> None:
        """Rename a place, in one change.

        Raises:
            UnknownPlace: there is none of that name.
            PlaceError: the other name is taken or impossible.
            WaychairError: a file is broken or cannot be written.
        """

        def renamed(now: MapDrawing) -> MapDrawing:
            place = checked_place(replace(find(now.places, name), name=new_name))
            _refuse_taken(new_name, now)
            places = (place if known == name else other for known, other in now.places.items())
            return replace(now, places={each.name: each for each in places})

        self._change(renamed)

    def remove_place(self, name: str) -> None:
        """Remove a place.

        Raises:
            UnknownPlace: there is none of that name.
            WaychairError: a file is broken or cannot be written.
        """

        def removed(now: MapDrawing) -> MapDrawing:
            find(now.places, name)
            return replace(now, places={known: place for known, place in now.places.items() if known != name})

        self._change(removed)

    def set_zone(self, zone: Zone, replaces: bool = False) -> None:
        """Draw a zone; with `replaces`, change the zone of that name if there is one.

        Raises:
            ZoneError: the name is taken, or a name, a corner or a number is impossible.
            WaychairError: a file is broken or cannot be written.
        """
        zone = checked_zone(zone)

        def drawn(now: MapDrawing) -> MapDrawing:
            others = tuple(other for other in now.zones if other.name != zone.name)
            if len(others) < len(now.zones) and not replaces:
                raise ZoneError(
                    f"there is a zone '{zone.name}' already: choose another name, or remove the other zone first"
                )
            return replace(now, zones=(*others, zone))

        self._change(drawn)

    def remove_zone(self, name: str) -> None:
        """Remove a zone.

        Raises:
            ZoneError: there is none of that name.
            WaychairError: a file is broken or cannot be written.
        """

        def removed(now: MapDrawing) -> MapDrawing:
            left = tuple(zone for zone in now.zones if zone.name != name)
            if len(left) == len(now.zones):
                raise ZoneError(f"there is no zone '{name}': it was already removed")
            return replace(now, zones=left)

        self._change(removed)

    def erase(self, polygon: FloatArray) -> None:
        """Clear the map within a polygon (N, 2) [m] in map.

        Raises:
            ZoneError: it is no polygon, or there is a drop-off in it.
            WaychairError: a file is broken or cannot be written.
        """
        polygon = checked_polygon("the part to be erased", np.asarray(polygon).tolist())
        grid = load_map(self._map, lambda _: None)
        layer = load_depth_layer(self._map, grid)
        if layer is not None and (clear_erased(layer, [polygon]).cells != layer.cells)[drop_offs(layer)].any():
            raise ZoneError("there is a drop-off in this part of the map: erase a part without it")
        self._change(lambda now: replace(now, erased=(*now.erased, polygon)))

    def undo(self) -> None:
        """Undo the latest change, and with it all edits by hand since then.

        Raises:
            PlaceError: there is no change to undo.
            WaychairError: a file is broken or cannot be written.
        """
        history = self._history()
        if not history:
            raise PlaceError("there is nothing to undo: no place, zone or erased part was changed")
        for name in _FILES:
            self._put(name, history[-1].get(name))
        self._keep(history[:-1])
        self.drawing = self._read()

    def _change(self, changed: Callable[[MapDrawing], MapDrawing]) -> None:
        before = {name: text for name in _FILES if (text := self._text(name)) is not None}
        drawing = changed(self._read())
        self._keep([*self._history(), before][-MOST_UNDONE:])
        folder = self._folder
        save_places(folder, drawing.places)
        save_zones(folder, drawing.zones)
        save_erased(folder, drawing.erased)
        self.drawing = drawing

    def _read(self) -> MapDrawing:
        folder = self._folder
        return MapDrawing(load_places(folder), load_zones(folder), load_erased(folder))

    def _history(self) -> list[dict[str, str]]:
        """Return the files' texts before each change, the latest last; empty if `undo.yaml` is damaged."""
        try:
            text = self._text(UNDO_YAML)
            known = None if text is None else yaml_from_text(text, UNDO_YAML, MapError)
        except MapError:
            return []
        texts = known if isinstance(known, list) else []
        return [each for each in texts if isinstance(each, dict) and all(isinstance(v, str) for v in each.values())]

    def _keep(self, history: list[dict[str, str]]) -> None:
        write_text(self._folder / UNDO_YAML, yaml.safe_dump(history, allow_unicode=True, width=10_000))

    def _text(self, name: str) -> str | None:
        path = self._folder / name
        return read_text(path, MapError) if path_exists(path, MapError) else None

    def _put(self, name: str, text: str | None) -> None:
        if not text:
            remove(self._folder / name)
        else:
            write_text(self._folder / name, text)


def _refuse_taken(name: str, drawing: MapDrawing) -> None:
    if name in drawing.places:
        raise PlaceError(f"there is a place '{name}' already: choose another name, or replace it")


def _content(zone: Zone) -> tuple[object, ...]:
    return zone.name, zone.rule, zone.value, zone.polygon.tolist()
