"""A draft: a building with the places and zones of its storeys' maps, as one value that edits replace by another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from waychair.errors import BuildingError
from waychair.files import is_file
from waychair.maps.building.building import ANCHORED, Building, node_poses, save_building
from waychair.maps.building.hgraph import HGraph, NodeRef
from waychair.maps.building.hgraph_files import (
    GENERAL,
    SUBMAPS,
    general_from_text,
    general_text,
    submap_file,
    submap_from_text,
    submap_text,
)
from waychair.maps.building.zone_rules import with_zones_of
from waychair.maps.drawn.anchors import ANCHORS_YAML, anchors_text
from waychair.maps.drawn.places import PLACES, PLACES_YAML, load_places, place_points, places_path, places_text
from waychair.maps.drawn.zones import ZONES, ZONES_YAML, Zone, load_zones, zone_points, zones_text
from waychair.types import Place, Pose2


@dataclass(frozen=True, slots=True)
class Draft:
    """A building's graph, the places and zones of its storeys' maps by storey, and further texts by relative path.

    The texts are those that a generation leaves (`generated/STOREY.json`).
    """

    hgraph: HGraph
    places: Mapping[str, Mapping[str, Place]] = field(default_factory=dict)
    zones: Mapping[str, tuple[Zone, ...]] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)

    def places_of(self, storey: str) -> Mapping[str, Place]:
        """Return the places of a storey's map by name."""
        return self.places.get(storey, {})

    def zones_of(self, storey: str) -> tuple[Zone, ...]:
        """Return the zones of a storey's map."""
        return self.zones.get(storey, ())

    def map_point(self, ref: NodeRef) -> tuple[float, float]:
        """Return where a node is in its storey's map [m].

        Raises:
            BuildingError: there is no such node.
        """
        node = self.hgraph.node(ref)
        if node is None:
            raise BuildingError(f"there is no node {ref}: somebody has deleted it")
        return self.hgraph.map_frame_of(ref.submap).point(node.x, node.y)


def draft_of(building: Building) -> Draft:
    """Return a building as a draft without changes.

    Raises:
        MapError, PlaceError, ZoneError: a storey's map folder is damaged.
    """
    places, zones = {}, {}
    for storey in building.hgraph.storeys:
        folder = building.map_folder(storey.id)
        if folder is not None and folder.is_dir():
            places[storey.id], zones[storey.id] = load_places(folder), load_zones(folder)
    return Draft(building.hgraph, places, zones)


def zoned(draft: Draft) -> HGraph:
    """Return a draft's graph with the rules of its zones, for checks and routes."""
    hgraph = draft.hgraph
    for storey, zones in draft.zones.items():
        hgraph = with_zones_of(hgraph, storey, zones)
    return hgraph


def save_draft(folder: Path, draft: Draft, before: Draft) -> None:
    """Write a draft as the building in a folder, with the places and zones that differ from those before; all or nothing.

    Raises:
        BuildingError, PlaceError: a name cannot be written.
        MapError: the anchors of a storey's map are damaged.
        OutputError: a file cannot be written.
    """
    building = Building(folder, draft.hgraph)
    others = {folder / name: text for name, text in draft.texts.items()}
    for storey in draft.hgraph.storeys:
        map_folder = building.map_folder(storey.id)
        if map_folder is not None and map_folder.is_dir():
            others |= _drawn_texts(building, storey.id, map_folder, draft, before)
    save_building(building, others)


def _drawn_texts(building: Building, storey: str, folder: Path, draft: Draft, before: Draft) -> dict[Path, str]:
    """Return the texts of a storey's places, zones and anchors where they differ from those before."""
    texts, points = {}, {}
    places, zones = draft.places_of(storey), draft.zones_of(storey)
    if dict(places) != dict(before.places_of(storey)):
        texts[places_path(folder)] = places_text(places)
        points[PLACES] = place_points(places)
    if zones is not before.zones_of(storey) and (zones or is_file(folder / ZONES_YAML, BuildingError)):
        texts[folder / ZONES_YAML] = zones_text(zones)
        points[ZONES] = {zone.name: zone_points(zone) for zone in zones}
    if points:
        anchors = anchors_text(folder, {**points, ANCHORED: node_poses(building.hgraph, storey)})
        if anchors is not None:
            texts[folder / ANCHORS_YAML] = anchors
    return texts


def graph_texts(hgraph: HGraph) -> dict[str, str]:
    """Return the texts of a graph's files by relative path."""
    texts = {submap_file(Path(), path).as_posix(): submap_text(each) for path, each in hgraph.submaps.items()}
    return {**texts, GENERAL: general_text(hgraph)}


def texts_of_draft(draft: Draft) -> dict[str, str]:
    """Return a draft's texts by relative path: the graph's files, and the places and zones of each storey."""
    texts = graph_texts(draft.hgraph)
    for storey, places in draft.places.items():
        texts[f"{storey}/{PLACES_YAML}"] = places_text(places)
    for storey, zones in draft.zones.items():
        texts[f"{storey}/{ZONES_YAML}"] = zones_text(zones)
    return {**texts, **draft.texts}


def graph_with_texts(hgraph: HGraph, texts: Mapping[str, str | None]) -> HGraph:
    """Return a graph with the texts of some of its files replaced; sub-maps whose text stays are the same objects.

    Raises:
        BuildingError: a text is damaged.
    """
    general = general_from_text(Path(GENERAL), texts.get(GENERAL) or general_text(hgraph))
    submaps = {}
    for path, bare in general.submaps.items():
        name = submap_file(Path(), path).as_posix()
        known, text = hgraph.submaps.get(path), texts.get(name)
        if text is not None:
            read = submap_from_text(Path(name), text, bare)
            submaps[path] = replace(read, source=None if known is None else known.source)
        elif known is None:
            raise BuildingError(f"{name} is missing, though {GENERAL} names it: restore it")
        elif (known.name, known.frame, known.storey) == (bare.name, bare.frame, bare.storey):
            submaps[path] = known
        else:
            submaps[path] = replace(known, name=bare.name, frame=bare.frame, storey=bare.storey)
    return replace(general, submaps=submaps, source=hgraph.source)


def is_graph_file(name: str) -> bool:
    """Return whether a relative path is that of one of the graph's text files."""
    return name == GENERAL or name.startswith(f"{SUBMAPS}/")


def moved_place(place: Place, x: float, y: float) -> Place:
    """Return a place at another point [m] of its map, with the same heading."""
    return replace(place, pose=Pose2(x, y, place.pose.theta))
