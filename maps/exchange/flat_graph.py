"""A building's graph without its tree, as other programs write it: nodes by storey and arcs between them."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from waychair.errors import BuildingError, OutputError, PlaceError
from waychair.files import is_file, os_error_text, path_exists, read_bytes, write_bytes
from waychair.maps.building.building import MAPS, Building, save_building
from waychair.maps.building.hgraph import PLAIN, HGraph, Lift, Node, NodeKind, NodeRef, Way, inner_end
from waychair.maps.building.hgraph_files import GENERAL
from waychair.maps.drawn.places import checked_place, save_places
from waychair.maps.folders.map_files import save_map
from waychair.types import OccupancyGrid, Place, Pose2
from waychair.yaml_files import quoted

KEPT = "imported"
"""Folder, in that of the building, of the files that it was imported from; an export changes only what was edited."""

FARTHEST = 100_000.0
"""Largest coordinate [m] of an imported node: no building is 100 km long."""


@dataclass(frozen=True, slots=True)
class Imported:
    """A building read from another program's files.

    Attributes:
        hgraph: the building.
        kept: the files as they were, by name.
        notes: sentences on parts that are kept, but not used.
        grids: maps of storeys, by the storey's id.
    """

    hgraph: HGraph
    kept: Mapping[str, bytes]
    notes: tuple[str, ...] = ()
    grids: Mapping[str, OccupancyGrid] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FlatNode:
    """A node with its storey and its place [m] in the building's frame."""

    storey: str
    node: Node
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class FlatGraph:
    """Nodes by address; ways by their two ends, `start` to `end` where one-way; lifts by id."""

    nodes: Mapping[NodeRef, FlatNode]
    ways: Mapping[tuple[NodeRef, NodeRef], Way]
    lifts: Mapping[str, Lift]

    def directed(self) -> dict[tuple[NodeRef, NodeRef], Way]:
        """Return each way in each direction in which it can be driven."""
        both = dict(self.ways)
        both |= {(end, start): way for (start, end), way in self.ways.items() if not way.one_way}
        return both

    def rides(self) -> dict[tuple[NodeRef, NodeRef], str]:
        """Return the lift by each pair of neighbouring stops, in both directions."""
        found = {}
        for key, lift in self.lifts.items():
            for lower, upper in zip(lift.stops, lift.stops[1:], strict=False):
                found[lower.at, upper.at] = found[upper.at, lower.at] = key
        return found


NOTHING = FlatGraph({}, {}, {})


def flat_graph(hgraph: HGraph) -> FlatGraph:
    """Return a building's graph without its tree: doorways become ways."""
    nodes = {}
    frames = {path: hgraph.frame_of(path) for path in hgraph.submaps}
    storeys = {path: hgraph.storey_of(path) for path in hgraph.submaps}
    for ref, node in hgraph.nodes():
        x, y = frames[ref.submap].point(node.x, node.y)
        nodes[ref] = FlatNode(storeys[ref.submap], node, x, y)
    ways: dict[tuple[NodeRef, NodeRef], Way] = {}
    for path, submap in hgraph.submaps.items():
        for arc in submap.arcs:
            ways[NodeRef(path, arc.start), NodeRef(path, arc.end)] = arc.way
        for doorway in submap.doorways:
            ends = NodeRef(path, doorway.start), inner_end(submap, doorway)
            ways[ends[::-1] if doorway.way.one_way and doorway.outwards else ends] = doorway.way
    return FlatGraph(nodes, ways, hgraph.lifts)


def checked_coordinates(where: str, x: object, y: object) -> tuple[float, float]:
    """Return two coordinates [m].

    Raises:
        BuildingError: one is no number, not finite, or farther than `FARTHEST`; `where` begins the sentence.
    """
    numbers = []
    for value in (x, y):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BuildingError(f"{where} lies at {quoted(value)}, which is no number: give metres")
        if not abs(value) <= FARTHEST:  # True for nan, and for whole numbers that no float holds
            raise BuildingError(f"{where} lies at {quoted(value)} m, which is in no building: correct it, or the unit")
        numbers.append(float(value))
    return numbers[0], numbers[1]


def speed_way(speed: object) -> Way:
    """Return the way with a limit of speed [m/s]; none for a value that is none."""
    good = isinstance(speed, int | float) and not isinstance(speed, bool) and 0 < speed <= FARTHEST
    return Way(speed=float(speed)) if good else PLAIN  # type: ignore[arg-type]


def write_imported(folder: Path, imported: Imported) -> Building:
    """Make a building of imported files in a folder.

    It is made aside and then moved there, the general file last: a full disk leaves nothing.

    Raises:
        BuildingError: there is a building already, or something else with the name of one of its parts.
        OutputError: the folder cannot be written to.
    """
    if path_exists(folder / GENERAL, BuildingError):
        raise BuildingError(f"there is a building in {folder} already: choose another folder")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as name:
            aside = Path(name)
            for file, data in imported.kept.items():
                write_bytes(aside / KEPT / file, data)
            for storey, grid in imported.grids.items():
                save_map(aside / MAPS / storey, grid)
                save_places(aside / MAPS / storey, goal_places(imported.hgraph, storey))
            save_building(Building(aside, imported.hgraph))
            _move_into(aside, folder)
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {os_error_text(error)}") from error
    return Building(folder, imported.hgraph)


def goal_places(hgraph: HGraph, storey: str) -> dict[str, Place]:
    """Return the goals of a storey as places of its map; those whose names no place can have are left out."""
    found = {}
    for ref, node in hgraph.nodes():
        if node.kind is NodeKind.END and hgraph.storey_of(ref.submap) == storey and node.name not in found:
            place = Place(node.name, Pose2(*hgraph.map_frame_of(ref.submap).point(node.x, node.y)))
            with suppress(PlaceError):
                found[node.name] = checked_place(place)
    return found


def _move_into(aside: Path, folder: Path) -> None:
    """Move all that is in one folder into another, the general file of a building last."""
    parts = sorted(aside.iterdir(), key=lambda each: each.name == GENERAL)
    for each in parts:
        if path_exists(folder / each.name, BuildingError):
            raise BuildingError(f"{folder / each.name} is there already: choose another folder")
    folder.mkdir(exist_ok=True)
    for each in parts:
        each.rename(folder / each.name)


def kept_file(folder: Path, name: str) -> bytes | None:
    """Return a kept file of a building's folder; None if there is none."""
    path = folder / KEPT / name
    return read_bytes(path, BuildingError) if is_file(path, BuildingError) else None
