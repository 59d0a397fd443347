"""The storeys of a building's beacons: a tag on a wall, or any sender of an id, says where the chair is."""

from __future__ import annotations

from waychair.errors import BuildingError
from waychair.geometry import wrap_angle
from waychair.maps.building.hgraph import HGraph
from waychair.types import Pose2


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


def pose_of_beacon(hgraph: HGraph, beacon: str) -> Pose2 | None:
    """Return a beacon's pose in its storey's map, theta the direction in which a tag faces; None if it has several places.

    Raises:
        BuildingError: as `storey_of_beacon`.
    """
    storey_of_beacon(hgraph, beacon)
    wanted = beacon.strip()
    found = []
    for path, submap in hgraph.submaps.items():
        frame = hgraph.map_frame_of(path)
        for each in submap.beacons:
            if each.id == wanted:
                x, y = frame.point(each.pose.x, each.pose.y)
                found.append(Pose2(x, y, wrap_angle(frame.theta + each.pose.theta)))
    return found[0] if len(found) == 1 else None
