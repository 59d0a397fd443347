"""What people draw on a saved map: places, zones, and ghosts that they erase; each change can be taken back.

All of it is text beside `map.yaml`, which may be edited by hand as well: `places.yaml`, `zones.yaml`, `erased.yaml`,
what they hang on (`anchors.yaml`), and in `undo.yaml` what those files were before the latest changes. A change is
written aside and then put in place file by file; after an interruption between two of them the older anchors do not fit
the newer poses, which then count as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from waychair.errors import MapError, PlaceError, ZoneError
from waychair.files import is_there, read_text, remove, write_text
from waychair.maps.anchors import ANCHORS_YAML
from waychair.maps.depth_layer import drop_offs, load_depth_layer
from waychair.maps.erased import ERASED_YAML, load_erased, save_erased, without
from waychair.maps.map_files import load_map
from waychair.maps.places import PLACES_YAML, checked_place, find, load_places, places_path, save_places
from waychair.maps.zones import ZONES_YAML, Zone, checked_polygon, checked_zone, load_zones, save_zones
from waychair.types import FloatArray, Place
from waychair.yaml_files import yaml_from_text

UNDO_YAML = "undo.yaml"
MOST_UNDONE = 20
"""So many changes can be taken back."""

_FILES = (PLACES_YAML, ZONES_YAML, ERASED_YAML, ANCHORS_YAML)
DRAWN_FILES = (*_FILES, UNDO_YAML)
"""All that people have drawn on the map of a folder."""

_NOTHING = ("", "{}", "[]")


@dataclass(frozen=True, slots=True)
class Drawing:
    """Places by name, zones and erased polygons (N, 2) [m] in map, where they are by now."""

    places: dict[str, Place]
    zones: tuple[Zone, ...] = ()
    erased: tuple[FloatArray, ...] = ()

    def has_zones_of(self, other: Drawing) -> bool:
        """Whether both have the same zones, each where the other has it."""
        return [_facts(zone) for zone in self.zones] == [_facts(zone) for zone in other.zones]

    def has_erased_as(self, other: Drawing) -> bool:
        """Whether the same is erased in both."""
        return [polygon.tolist() for polygon in self.erased] == [polygon.tolist() for polygon in other.erased]


def forget(folder: Path) -> None:
    """Remove all that was drawn on a map, since another one takes its place.

    Raises:
        OutputError: that cannot be.
    """
    for name in DRAWN_FILES:
        remove(folder / name)


def is_drawn_on(folder: Path) -> bool:
    """Whether there are places, zones or erased parts, or what may have been some.

    Raises:
        MapError: that cannot be known.
    """
    paths = [folder / name for name in (PLACES_YAML, ZONES_YAML, ERASED_YAML)]
    return any(is_there(path, MapError) and read_text(path, MapError).strip() not in _NOTHING for path in paths)


class Layout:
    """The drawing of one map's folder. Files are read anew for every change, for others may have edited them."""

    def __init__(self, map_folder: Path) -> None:
        """`map_folder`: or its map.yaml.

        Raises:
            MapError, PlaceError, ZoneError: a file is broken.
        """
        self._map, self._folder = map_folder, places_path(map_folder).parent
        self.drawing = self._read()

    @property
    def undoable(self) -> bool:
        """Whether there is a change to take back."""
        return bool(self._history())

    def draw(self, drawing: Drawing) -> None:
        """Put another drawing in the place of this one.

        Raises:
            WaychairError: a file is broken or cannot be written.
        """
        self._change(lambda now: drawing)

    def set_place(self, place: Place, replaces: bool = False) -> None:
        """Add a place; `replaces`: or change the one of that name.

        Raises:
            PlaceError: the name is taken, or a name or a number is impossible.
            WaychairError: a file is broken or cannot be written.
        """
        checked_place(place)

        def added(now: Drawing) -> Drawing:
            if not replaces:
                _refuse_taken(place.name, now)
            return replace(now, places={**now.places, place.name: place})

        self._change(added)

    def rename_place(self, name: str, new_name: str) -> None:
        """Give a place another name, in one change.

        Raises:
            UnknownPlace: there is none of that name.
            PlaceError: the other name is taken or impossible.
            WaychairError: a file is broken or cannot be written.
        """

        def renamed(now: Drawing) -> Drawing:
            place = checked_place(replace(find(now.places, name), name=new_name))
            _refuse_taken(new_name, now)
            places = (place if known == name else other for known, other in now.places.items())
            return replace(now, places={each.name: each for each in places})

        self._change(renamed)

    def remove_place(self, name: str) -> None:
        """
        Raises:
            UnknownPlace: there is none of that name.
            WaychairError: a file is broken or cannot be written.
        """

        def removed(now: Drawing) -> Drawing:
            find(now.places, name)
            return replace(now, places={known: place for known, place in now.places.items() if known != name})

        self._change(removed)

    def set_zone(self, zone: Zone, replaces: bool = False) -> None:
        """Draw a zone; `replaces`: or draw the one of that name anew.

        Raises:
            ZoneError: the name is taken, or a name, a corner or a number is impossible.
            WaychairError: a file is broken or cannot be written.
        """
        zone = checked_zone(zone)

        def drawn(now: Drawing) -> Drawing:
            others = tuple(other for other in now.zones if other.name != zone.name)
            if len(others) < len(now.zones) and not replaces:
                raise ZoneError(f"there is a zone '{zone.name}' already: choose another name, or remove that one first")
            return replace(now, zones=(*others, zone))

        self._change(drawn)

    def remove_zone(self, name: str) -> None:
        """
        Raises:
            ZoneError: there is none of that name.
            WaychairError: a file is broken or cannot be written.
        """

        def removed(now: Drawing) -> Drawing:
            left = tuple(zone for zone in now.zones if zone.name != name)
            if len(left) == len(now.zones):
                raise ZoneError(f"there is no zone '{name}': it was removed already")
            return replace(now, zones=left)

        self._change(removed)

    def erase(self, polygon: FloatArray) -> None:
        """Clear what the map shows within a polygon (N, 2) [m] in map.

        Raises:
            ZoneError: it is no polygon, or the floor ends in it.
            WaychairError: a file is broken or cannot be written.
        """
        polygon = checked_polygon("what is to be erased", np.asarray(polygon).tolist())
        grid = load_map(self._map)
        layer = load_depth_layer(self._map, grid)
        if layer is not None and (without(layer, [polygon]).cells != layer.cells)[drop_offs(layer)].any():
            raise ZoneError("the floor ends in there, which is no ghost: draw a part without the drop-off")
        self._change(lambda now: replace(now, erased=(*now.erased, polygon)))

    def undo(self) -> None:
        """Take the latest change back; what was edited by hand since is lost with it.

        Raises:
            PlaceError: there is none.
            WaychairError: a file is broken or cannot be written.
        """
        history = self._history()
        if not history:
            raise PlaceError("there is nothing to undo: no place, zone or erased part was changed")
        for name in _FILES:
            self._put(name, history[-1].get(name))
        self._keep(history[:-1])
        self.drawing = self._read()

    def _change(self, changed: Callable[[Drawing], Drawing]) -> None:
        before = {name: text for name in _FILES if (text := self._text(name)) is not None}
        drawing = changed(self._read())
        self._keep([*self._history(), before][-MOST_UNDONE:])
        folder = self._folder
        save_places(folder, drawing.places)
        save_zones(folder, drawing.zones)
        save_erased(folder, drawing.erased)
        self.drawing = drawing

    def _read(self) -> Drawing:
        folder = self._folder
        return Drawing(load_places(folder), load_zones(folder), load_erased(folder))

    def _history(self) -> list[dict[str, str]]:
        """The files' texts before each change, the latest last; none where that file is damaged."""
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
        return read_text(path, MapError) if is_there(path, MapError) else None

    def _put(self, name: str, text: str | None) -> None:
        if not text:
            remove(self._folder / name)
        else:
            write_text(self._folder / name, text)


def _refuse_taken(name: str, drawing: Drawing) -> None:
    if name in drawing.places:
        raise PlaceError(f"there is a place '{name}' already: choose another name, or replace it")


def _facts(zone: Zone) -> tuple[object, ...]:
    return zone.name, zone.rule, zone.value, zone.polygon.tolist()
