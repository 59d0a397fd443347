"""The storeys of a building's beacons: a tag on a wall, or any sender of an id, says where the chair is."""

from __future__ import annotations

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import HGraph


def storey_of_beacon(hgraph: HGraph, beacon: str) -> str:
    """Return the id of the storey on which a beacon is.

    Raises:
        BuildingError: the building has no such beacon, or several on different storeys, which tell nothing.
    """
    wanted = beacon.strip()
    found = {
        hgraph.storey_of(path)
        for path, submap in hgraph.submaps.items()
        if any(each.id == wanted for each in submap.beacons)
    }
    if not found:
        raise BuildingError(f"the building has no beacon '{wanted}': add it in the editor, or take it away")
    if len(found) > 1:
        storeys = ", ".join(sorted(found))
        raise BuildingError(f"beacon '{wanted}' is on several storeys ({storeys}): give each its own id")
    return found.pop()
