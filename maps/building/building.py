"""A building's folder: `hgraph.txt`, `submaps/`, and `maps/STOREY/` with one ordinary map folder for each storey."""

from __future__ import annotations

import math
import shutil
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from waychair.errors import BuildingError, OutputError, WaychairError
from waychair.files import is_folder, path_exists
from waychair.maps.building.hgraph import (
    HGraph,
    NodeKind,
    NodeRef,
    Storey,
    SubMap,
    full_name,
)
from waychair.maps.building.hgraph_edits import with_storey, with_submap
from waychair.maps.building.hgraph_files import GENERAL, read_hgraph, write_hgraph
from waychair.maps.building.text_forms import is_id
from waychair.maps.drawn.anchors import ANCHORS_YAML, anchors_text, load_anchors
from waychair.maps.drawn.places import PLACES, load_places, place_points, places_path, places_text
from waychair.maps.folders.map_files import load_info, yaml_path
from waychair.types import Place, Pose2

MAPS = "maps"
"""The folder of the storeys' map folders."""

ANCHORED = "hgraph"
"""The kind of the nodes' anchors in a storey's `anchors.yaml`."""

SAME_M = 1e-6
"""A goal this near to its place [m] is there, and a node this near to its anchor has not moved."""

HIGHEST_M = 10_000.0
"""Largest height of a storey above or below the ground [m]."""


@dataclass(frozen=True, slots=True)
class Building:
    """A building's folder and its graph."""

    folder: Path
    hgraph: HGraph

    def map_folder(self, storey: str) -> Path | None:
        """Return the map folder of a storey; None if it has none, or there is no such storey."""
        for each in self.hgraph.storeys:
            if each.id == storey:
                return self.folder / each.map if each.map else None
        return None


def load_building(folder: Path, progress: Callable[[float], None] | None = None) -> Building:
    """Return the building in a folder: nodes follow their storey's map (`followed`), goals their places (`with_places`).

    Raises:
        BuildingError: as `read_hgraph`.
        MapError: the anchors of a storey's map are damaged.
        PlaceError: the places of a storey's map are.
    """
    building = Building(folder, read_hgraph(folder, progress))
    for storey in building.hgraph.storeys:
        building = replace(building, hgraph=followed(building, storey.id))
        building = replace(building, hgraph=with_places(building, storey.id))
    return building


def save_building(building: Building, others: Mapping[Path, str] = MappingProxyType({})) -> None:
    """Write the text files of a building, and its nodes' anchors beside those of the places of each storey's map.

    `others` are texts of files that change together with them, new places of a storey's map among them. Either all files
    change, or none does.

    Raises:
        BuildingError, OutputError: as `write_hgraph`.
        MapError: the anchors of a storey's map are damaged.
    """
    texts = dict(others)
    for storey in building.hgraph.storeys:
        folder = building.map_folder(storey.id)
        if folder is None or not is_folder(folder, BuildingError):
            continue
        text = anchors_text(folder, {ANCHORED: node_poses(building.hgraph, storey.id)})
        if text is not None:
            texts.setdefault(folder / ANCHORS_YAML, text)
    write_hgraph(building.folder, building.hgraph, texts)


def texts_of_places(building: Building, storey: str, places: Mapping[str, Place]) -> dict[Path, str]:
    """Return the texts of a storey's places and of the anchors of its places and nodes, for `save_building`.

    Raises:
        PlaceError: a name or a number is impossible.
        MapError: the anchors are damaged.
    """
    folder = building.map_folder(storey)
    if folder is None:
        return {}
    points = {PLACES: place_points(places), ANCHORED: node_poses(building.hgraph, storey)}
    anchors = anchors_text(folder, points)
    texts = {places_path(folder): places_text(places)}
    return texts if anchors is None else {**texts, folder / ANCHORS_YAML: anchors}


def new_building(folder: Path, name: str) -> Building:
    """Make a building without storeys in a folder, write it, and return it.

    Raises:
        BuildingError: there is a building already, or the name is empty.
        OutputError: the folder cannot be written to.
    """
    if path_exists(folder / GENERAL, BuildingError):
        raise BuildingError(f"there is a building in {folder} already: choose another folder")
    if not name.strip():
        raise BuildingError("the building's name is empty: give one")
    building = Building(folder, HGraph(name.strip()))
    save_building(building)
    return building


def add_storey(building: Building, storey: Storey) -> Building:
    """Return the building with a storey and a sub-map of its own below the root, not written yet.

    Raises:
        BuildingError: its id is impossible or taken, or its height.
    """
    hgraph = building.hgraph
    if not is_id(storey.id):
        raise BuildingError(f"'{storey.id}' cannot name a storey: use letters, digits, _, - and .")
    if any(each.id == storey.id for each in hgraph.storeys) or storey.id in hgraph.submaps:
        raise BuildingError(f"there is a storey '{storey.id}' already: choose another name")
    if not -HIGHEST_M <= storey.height <= HIGHEST_M:
        raise BuildingError(
            f"a storey {storey.height:g} m above the ground is impossible: give at most {HIGHEST_M:g} m"
        )
    submap = SubMap(storey.id, storey.name, storey=storey.id)
    return replace(building, hgraph=with_submap(with_storey(hgraph, storey), submap))


def save_with_map(building: Building, storey: str, source: Path) -> Building:
    """Copy a map folder into the building's folder as that of a storey, write the building and return it.

    If one of them cannot be written, neither is.

    Raises:
        MapError: `source` is no map folder.
        BuildingError: there is no such storey, or it has a map already.
        OutputError: the folder cannot be written to.
    """
    yaml = yaml_path(source)
    load_info(yaml)  # it must be a map
    target = building.folder / MAPS / storey
    if path_exists(target, BuildingError):
        raise BuildingError(f"storey '{storey}' has a map in {target} already: take it away first")
    storeys = {each.id: each for each in building.hgraph.storeys}
    if storey not in storeys:
        raise BuildingError(f"there is no storey '{storey}': add it first")
    try:
        shutil.copytree(yaml.parent, target)
    except (OSError, shutil.Error) as error:
        _take_away(target)
        raise OutputError(f"cannot copy {yaml.parent} to {target}: make room on the disk, or check it") from error
    hgraph = with_storey(building.hgraph, replace(storeys[storey], map=f"{MAPS}/{storey}"))
    building = replace(building, hgraph=hgraph)
    try:
        save_building(building)
    except WaychairError:
        _take_away(target)
        raise
    return building


def _take_away(folder: Path) -> None:
    """Remove a folder that was just made, and its parent where nothing else is in it."""
    shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError):
        folder.parent.rmdir()


def stats(hgraph: HGraph) -> dict[str, int]:
    """Return how many storeys, sub-maps, nodes of each kind, arcs, doorways and lifts a building has, and its depth."""
    kinds = Counter(node.kind for _, node in hgraph.nodes())
    return {
        "storeys": len(hgraph.storeys),
        "submaps": len(hgraph.submaps),
        "depth": max((path.count("/") + 1 for path in hgraph.submaps if path), default=0),
        "nodes": sum(kinds.values()),
        **{f"{kind.name.lower()}_nodes": kinds[kind] for kind in NodeKind if kind is not NodeKind.SUBMAP},
        "arcs": sum(len(submap.arcs) for submap in hgraph.submaps.values()),
        "doorways": sum(len(submap.doorways) for submap in hgraph.submaps.values()),
        "lifts": len(hgraph.lifts),
        "stops": sum(len(lift.stops) for lift in hgraph.lifts.values()),
        "beacons": sum(len(submap.beacons) for submap in hgraph.submaps.values()),
    }


def goals(hgraph: HGraph) -> dict[str, NodeRef]:
    """Return the goals of a building by their names for people, such as `Ground/West/Waiting room`."""
    return {full_name(hgraph, ref): ref for ref, node in hgraph.nodes() if node.kind is NodeKind.END}


def place_of(building: Building, ref: NodeRef) -> Place | None:
    """Return the place of a goal, in the frame of its storey's map, with its tolerances; None if it has none there.

    Raises:
        PlaceError: the storey's `places.yaml` is broken.
    """
    node, folder = building.hgraph.node(ref), building.map_folder(building.hgraph.storey_of(ref.submap))
    if node is None or folder is None:
        return None
    return load_places(folder).get(node.name)


def followed(building: Building, storey: str) -> HGraph:
    """Return the graph with a storey's nodes moved with the nodes of its map, as places are.

    `anchors.yaml` of the storey's map folder holds them by sub-map. Nodes that were not anchored, or were
    changed by hand since then, stay.

    Raises:
        MapError: the anchors are damaged.
    """
    hgraph, folder = building.hgraph, building.map_folder(storey)
    if folder is None or not is_folder(folder, BuildingError):
        return hgraph
    anchors = load_anchors(folder)
    changed = dict(hgraph.submaps)
    for path, submap in hgraph.submaps.items():
        if hgraph.storey_of(path) != storey or not submap.nodes:
            continue
        frame = hgraph.map_frame_of(path)
        points = [frame.point(node.x, node.y) for node in submap.nodes.values()]
        poses = anchors.follow(ANCHORED, path, [Pose2(x, y) for x, y in points])
        moved = [frame.inside(pose.x, pose.y) for pose in poses]
        pairs = zip(submap.nodes.values(), points, poses, moved, strict=True)
        nodes = {
            node.id: node if math.dist((pose.x, pose.y), point) <= SAME_M else replace(node, x=x, y=y)
            for node, point, pose, (x, y) in pairs
        }
        if nodes != submap.nodes:
            changed[path] = replace(submap, nodes=nodes)
    return replace(hgraph, submaps=changed)


def with_places(building: Building, storey: str) -> HGraph:
    """Return the graph with the goals of a storey where its places of the same names are.

    Goals that share their name with another one of the storey stay: the place may be either's.

    Raises:
        PlaceError: the storey's `places.yaml` is broken.
    """
    hgraph, folder = building.hgraph, building.map_folder(storey)
    places = {} if folder is None or not is_folder(folder, BuildingError) else load_places(folder)
    inside = {path: submap for path, submap in hgraph.submaps.items() if hgraph.storey_of(path) == storey}
    goals_of = Counter(
        node.name for each in inside.values() for node in each.nodes.values() if node.kind is NodeKind.END
    )
    changed = dict(hgraph.submaps)
    for path, submap in inside.items() if places else ():
        frame, moved = hgraph.map_frame_of(path), {}
        for node in submap.nodes.values():
            is_one = node.kind is NodeKind.END and goals_of[node.name] == 1
            place = places.get(node.name) if is_one else None
            if place is not None and math.dist(frame.point(node.x, node.y), (place.pose.x, place.pose.y)) > SAME_M:
                x, y = frame.inside(place.pose.x, place.pose.y)
                moved[node.id] = replace(node, x=x, y=y)
        if moved:
            changed[path] = replace(submap, nodes={**submap.nodes, **moved})
    return replace(hgraph, submaps=changed)


def node_poses(hgraph: HGraph, storey: str) -> dict[str, list[Pose2]]:
    """Return the poses of a storey's nodes in its map, by sub-map."""
    found = {}
    for path, submap in hgraph.submaps.items():
        if submap.nodes and hgraph.storey_of(path) == storey:
            frame = hgraph.map_frame_of(path)
            found[path] = [Pose2(*frame.point(node.x, node.y)) for node in submap.nodes.values()]
    return found
