"""Operations on the places and zones of a storey's map, and texts that replace whole files of the draft."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np

from waychair.errors import BuildingError
from waychair.maps.drawn.places import checked_place
from waychair.maps.drawn.zones import Rule, Zone, checked_zone
from waychair.maps.editing.arc_edits import Operation
from waychair.maps.editing.draft import Draft, graph_texts, graph_with_texts, is_graph_file
from waychair.maps.editing.node_edits import with_place, without_place
from waychair.types import Place, Pose2


class SetPlace(Operation, frozen=True, tag="set_place"):
    """Add a place to a storey's map, or change it: pose [m, m, rad] and tolerances [m, rad]; None as they are."""

    storey: str
    name: str
    x: float
    y: float
    theta: float
    tolerance_m: float | None = None
    tolerance_rad: float | None = None


class DeletePlace(Operation, frozen=True, tag="delete_place"):
    """Delete a place of a storey's map."""

    storey: str
    name: str


class SetZone(Operation, frozen=True, tag="set_zone"):
    """Add a zone to a storey's map, or change it: keep_out, slow (value in m/s) or one_way (value in radians)."""

    storey: str
    name: str
    rule: str
    polygon: tuple[tuple[float, float], ...]
    value: float = 0.0


class DeleteZone(Operation, frozen=True, tag="delete_zone"):
    """Delete a zone of a storey's map."""

    storey: str
    name: str


class Patch(Operation, frozen=True, tag="patch"):
    """Replace texts of the graph and of a generation by relative path, None for those that go; `what` was done, in words.

    It holds the outcome of work that cannot be repeated from its arguments alone: a generation, an import, an alignment.
    `places` (name, x, y, theta, tolerance [m], tolerance [rad]) and `zones` (name, rule, polygon, value) replace all those
    of a storey.
    """

    what: str
    texts: dict[str, str | None]
    places: dict[str, tuple[tuple[str, float, float, float, float, float], ...]] = msgspec.field(default_factory=dict)
    zones: dict[str, tuple[tuple[str, str, tuple[tuple[float, float], ...], float], ...]] = msgspec.field(
        default_factory=dict
    )


def set_place(draft: Draft, asked: SetPlace) -> Draft:
    """Return the draft with a place; raises PlaceError where a name or a number is impossible."""
    if asked.storey not in draft.places:
        raise BuildingError(f"storey '{asked.storey}' has no map: its goals are nodes only")
    known = draft.places_of(asked.storey).get(asked.name, Place(asked.name, Pose2()))
    place = replace(
        known,
        pose=Pose2(asked.x, asked.y, math.remainder(asked.theta, math.tau)),
        tolerance_m=known.tolerance_m if asked.tolerance_m is None else asked.tolerance_m,
        tolerance_rad=known.tolerance_rad if asked.tolerance_rad is None else asked.tolerance_rad,
    )
    return with_place(draft, asked.storey, checked_place(place))


def delete_place(draft: Draft, asked: DeletePlace) -> Draft:
    """Return the draft without a place."""
    if asked.name not in draft.places_of(asked.storey):
        raise BuildingError(f"storey '{asked.storey}' has no place '{asked.name}'")
    return without_place(draft, asked.storey, asked.name)


def set_zone(draft: Draft, asked: SetZone) -> Draft:
    """Return the draft with a zone; raises ZoneError where a name, corner or number is impossible."""
    if asked.storey not in draft.zones:
        raise BuildingError(f"storey '{asked.storey}' has no map to draw a zone on")
    if asked.rule not in {rule.value for rule in Rule}:
        raise BuildingError(f"'{asked.rule}' is no rule of a zone: choose keep_out, slow or one_way")
    corners = np.array(asked.polygon, np.float64).reshape(-1, 2)
    zone = checked_zone(Zone(asked.name.strip(), Rule(asked.rule), corners, asked.value))
    others = tuple(each for each in draft.zones_of(asked.storey) if each.name != zone.name)
    return replace(draft, zones={**draft.zones, asked.storey: (*others, zone)})


def delete_zone(draft: Draft, asked: DeleteZone) -> Draft:
    """Return the draft without a zone."""
    kept = tuple(each for each in draft.zones_of(asked.storey) if each.name != asked.name)
    if len(kept) == len(draft.zones_of(asked.storey)):
        raise BuildingError(f"storey '{asked.storey}' has no zone '{asked.name}'")
    return replace(draft, zones={**draft.zones, asked.storey: kept})


def patch(draft: Draft, asked: Patch) -> Draft:
    """Return the draft with texts, places and zones replaced."""
    graph = {name: text for name, text in asked.texts.items() if is_graph_file(name)}
    hgraph = graph_with_texts(draft.hgraph, graph) if graph else draft.hgraph
    others = {**draft.texts, **{name: text for name, text in asked.texts.items() if name not in graph}}
    texts = {name: text for name, text in others.items() if text is not None}
    known = {*draft.places, *asked.places}
    storeys = [storey.id for storey in hgraph.storeys if storey.id in known]
    places = {storey: draft.places_of(storey) for storey in storeys}
    zones = {storey: draft.zones_of(storey) for storey in storeys}
    for storey, rows in asked.places.items():
        made = [Place(name, Pose2(x, y, theta), near, turn) for name, x, y, theta, near, turn in rows]
        places[storey] = {place.name: checked_place(place) for place in made}
    for storey, drawn in asked.zones.items():
        zones[storey] = tuple(
            checked_zone(Zone(name, Rule(rule), np.array(corners, np.float64), value))
            for name, rule, corners, value in drawn
        )
    return Draft(hgraph, places, zones, texts)


def patch_between(what: str, before: Draft, after: Draft) -> Patch:
    """Return the operation that makes the draft before the draft after."""
    old, new = ({**graph_texts(draft.hgraph), **draft.texts} for draft in (before, after))
    texts: dict[str, str | None] = {name: text for name, text in new.items() if old.get(name) != text}
    texts |= {name: None for name in old if name not in new}
    places = {
        storey: tuple(
            (name, place.pose.x, place.pose.y, place.pose.theta, place.tolerance_m, place.tolerance_rad)
            for name, place in held.items()
        )
        for storey, held in after.places.items()
        if storey not in before.places or dict(held) != dict(before.places[storey])
    }
    zones = {
        storey: tuple((zone.name, zone.rule.value, _corners(zone), float(zone.value)) for zone in held)
        for storey, held in after.zones.items()
        if storey not in before.zones or held is not before.zones[storey]
    }
    return Patch(what, texts, places, zones)


def _corners(zone: Zone) -> tuple[tuple[float, float], ...]:
    return tuple((x, y) for x, y in zone.polygon.tolist())
