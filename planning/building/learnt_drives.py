"""Driving times learnt from finished drives: each drive tells how long the chair took along the arcs that it drove.

`drives.json` in the building's folder keeps the last times of each arc. From five drives on their median replaces the
estimate of the arc's cost (`with_drives`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from waychair.errors import BuildingError
from waychair.files import is_file, read_bytes
from waychair.maps.building.building import Building, load_building, save_building
from waychair.maps.building.hgraph import ArcRef, HGraph, NodeRef, inner_end
from waychair.maps.building.hgraph_edits import arc_ref, with_drives
from waychair.types import FloatArray, IntArray

DRIVES = "drives.json"

PASSES_M = 0.75
"""The chair passes a node if its middle comes so near [m]: it cuts corners, and doors are at least as far apart."""

LONGER, SHORTER, APART_M = 1.25, 0.8, 0.5
"""Between two nodes the chair drove along their arc if it drove between these multiples of its length, and this much [m]
less or more. Ends that are nearer to each other than this, as the two sides of a doorway, tell no time."""

MOVES_M = 0.05
"""A drive begins once the chair is so far [m] from where it stood, and ends so far before it stands."""

KEPT = 50
"""Times of an arc that are kept: older ones are forgotten, so that a chair or floor that changes is learnt anew."""


def learn_drive(building: Building, storey: str, stamps_ns: IntArray, poses: FloatArray) -> dict[ArcRef, list[float]]:
    """Add the times of a finished drive on a storey to the building, write it, and return them [s] by arc.

    Args:
        building: as loaded; it is written with the new costs of its arcs.
        storey: id of the storey.
        stamps_ns: (N,) ascending.
        poses: (N, 2) or (N, 3), x, y [m] in the storey's map.

    Raises:
        BuildingError: there is no such storey, `drives.json` is damaged, or the trajectory is impossible.
        OutputError: a file cannot be written; then nothing is learnt.
    """
    if not any(each.id == storey for each in building.hgraph.storeys):
        raise BuildingError(f"there is no storey '{storey}': add it with waychair building add")
    driven = arcs_driven(building.hgraph, storey, stamps_ns, poses)
    if not driven:
        return {}
    path = building.folder / DRIVES
    kept = _kept(path)
    for ref, seconds in driven.items():
        kept[str(ref)] = [*kept.get(str(ref), []), *seconds][-KEPT:]
    known = {str(ref): ref for ref, *_ in _ways(building.hgraph, storey)}
    times = {known[text]: seconds for text, seconds in kept.items() if text in known}
    text = json.dumps(kept, indent=1, allow_nan=False) + "\n"
    save_building(Building(building.folder, with_drives(building.hgraph, times)), {path: text})
    return driven


def building_of_map(map_folder: Path) -> tuple[Building, str] | None:
    """Return the building that a map folder is a storey of, and the storey's id; None where it is none.

    Raises:
        BuildingError, MapError, PlaceError: the building is damaged.
    """
    folder = map_folder.resolve()
    for parent in folder.parents[1:3]:
        if is_file(parent / "hgraph.txt", BuildingError):
            building = load_building(parent)
            for storey in building.hgraph.storeys:
                if storey.map and (parent / storey.map).resolve() == folder:
                    return building, storey.id
    return None


def arcs_driven(hgraph: HGraph, storey: str, stamps_ns: IntArray, poses: FloatArray) -> dict[ArcRef, list[float]]:
    """Return the times [s] that a drive took along the arcs and doorways of a storey that it drove from end to end.

    Raises:
        BuildingError: the stamps do not ascend, or a pose is not finite.
    """
    points = np.asarray(poses, np.float64)[:, :2]
    if len(points) != len(stamps_ns) or not np.isfinite(points).all() or (np.diff(stamps_ns) <= 0).any():
        raise BuildingError("the drive's stamps must ascend, and its poses must be numbers: record it again")
    moving = _moving(points)
    points, seconds = points[moving], (stamps_ns[moving] - stamps_ns[0]) * 1e-9
    if len(points) < 2:
        return {}
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    places = _points(hgraph, storey)
    visits = {ref: _visits(points, place) for ref, place in places.items()}
    found: dict[ArcRef, list[float]] = {}
    for ref, one, other, length in _ways(hgraph, storey):
        both = sorted([(k, 0) for k in visits.get(one, ())] + [(k, 1) for k in visits.get(other, ())])
        straight = math.dist(places[one], places[other]) if one in places and other in places else math.inf
        metres = straight if length is None else length
        for (begin, side), (end, far) in pairwise(both):
            driven = float(along[end] - along[begin])
            fits = SHORTER * metres - APART_M <= driven <= LONGER * metres + APART_M
            if side != far and fits and seconds[end] > seconds[begin] and straight > APART_M:
                found.setdefault(ref, []).append(round(float(seconds[end] - seconds[begin]), 3))
    return found


def _moving(points: FloatArray) -> slice:
    """Return the part of a drive between its first and its last motion."""
    from_start = np.flatnonzero(np.hypot(*(points - points[0]).T) > MOVES_M) if len(points) else np.empty(0)
    from_end = np.flatnonzero(np.hypot(*(points - points[-1]).T) > MOVES_M) if len(points) else np.empty(0)
    if not len(from_start):
        return slice(0, 0)
    return slice(max(int(from_start[0]) - 1, 0), int(from_end[-1]) + 2)


def _visits(points: FloatArray, place: tuple[float, float]) -> list[int]:
    """Return the moments of a drive at which it is nearest to a node, one for each time that it passes."""
    away = np.hypot(*(points - place).T)
    near = np.flatnonzero(away <= PASSES_M)
    groups = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if len(near) else []
    return [int(group[np.argmin(away[group])]) for group in groups]


def _points(hgraph: HGraph, storey: str) -> dict[NodeRef, tuple[float, float]]:
    found: dict[NodeRef, tuple[float, float]] = {}
    for path, submap in hgraph.submaps.items():
        if hgraph.storey_of(path) == storey:
            frame = hgraph.map_frame_of(path)
            found |= {NodeRef(path, node.id): frame.point(node.x, node.y) for node in submap.nodes.values()}
    return found


def _ways(hgraph: HGraph, storey: str) -> Iterator[tuple[ArcRef, NodeRef, NodeRef, float | None]]:
    """Yield the arcs and doorways of a storey: address, ends, and length [m] where it is known."""
    for path, submap in hgraph.submaps.items():
        if hgraph.storey_of(path) != storey:
            continue
        for arc in submap.arcs:
            yield arc_ref(submap, arc), NodeRef(path, arc.start), NodeRef(path, arc.end), arc.way.length
        for doorway in submap.doorways:
            start, end = NodeRef(path, doorway.start), inner_end(submap, doorway)
            yield arc_ref(submap, doorway), start, end, doorway.way.length


def _kept(path: Path) -> dict[str, list[float]]:
    if not is_file(path, BuildingError):
        return {}
    try:
        values = json.loads(read_bytes(path, BuildingError))
        return {str(key): _checked(seconds) for key, seconds in values.items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise BuildingError(f"{path} is damaged: remove it; driving times are then learnt anew") from error


def _checked(seconds: Sequence[float]) -> list[float]:
    numbers = [float(each) for each in seconds]
    if not all(0.0 < each < math.inf for each in numbers):
        raise ValueError("an impossible time")
    return numbers
