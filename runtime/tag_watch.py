"""AprilTags of a building in the picture of a chair's camera: they tell its storey, and its place on the storey's map.

A tag sets the place of a chair that is lost, and confirms that of one that is not. A tag that contradicts a place makes it
uncertain: the chair is localised anew where the tag says, and its lidar has to agree before it drives.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from waychair.errors import BuildingError
from waychair.geometry import wrap_angle
from waychair.maps.building.hgraph import HGraph
from waychair.planning.building.beacon_places import pose_of_beacon, storey_of_beacon
from waychair.slam.camera.seen_tags import SeenTag
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.types import Pose2

LOOK_S = 0.5
"""s; time between two pictures that are searched for tags."""

ALIKE_M, ALIKE_RAD = 0.3, math.radians(10.0)
"""m, rad; two looks at a tag agree within these."""

AGREES_M, AGREES_RAD = 0.7, math.radians(20.0)
"""m, rad; a place and a tag's word agree within these: tags are hung, and their poses typed, by hand."""


SETTLES_S = 3.0
"""s; a localiser that has been given a place has this long to find out whether its scans agree."""


@dataclass(frozen=True, slots=True)
class TagWord:
    """A tag's word: its number as a beacon's id, its storey, and the chair's pose in that storey's map, None if unknown."""

    beacon: str
    storey: str
    map_from_base: Pose2 | None = None


def words_of_tags(hgraph: HGraph, seen: Iterable[SeenTag]) -> tuple[TagWord, ...]:
    """Return the words of those tags that are beacons of a building; others hang there for somebody else."""
    words = []
    for tag in seen:
        beacon = str(tag.number)
        try:
            storey, map_from_tag = storey_of_beacon(hgraph, beacon), pose_of_beacon(hgraph, beacon)
        except BuildingError:  # unknown, or on several storeys
            continue
        pose = None
        if map_from_tag is not None and tag.base_from_tag is not None:
            pose = map_from_tag @ tag.base_from_tag.inverse()
        words.append(TagWord(beacon, storey, pose))
    return tuple(words)


class TagWatch:
    """Compares the words of tags with the chair's place; two looks at a tag must agree before it counts."""

    def __init__(self) -> None:
        self._map_from_odom: Mapping[str, Pose2] = {}
        self._given_ns = -(10**12)

    def forget(self) -> None:
        """Forget all sightings, as after a change of the map."""
        self._map_from_odom = {}

    def place(
        self, words: Iterable[TagWord], odom_from_base: Pose2, located: Localisation | None, now_ns: int
    ) -> Pose2 | None:
        """Return the pose in map near which the chair is to be localised anew by these words; None: it is not.

        Args:
            words: of the tags in one picture, all on the storey of the map in use.
            odom_from_base: the chair by odometry as the picture was taken.
            located: its place on the map, None while it has none.
            now_ns: the time; a place is not given again before the localiser could use it.
        """
        before, now = self._map_from_odom, dict[str, Pose2]()
        for word in words:
            if word.map_from_base is not None:
                now[word.beacon] = word.map_from_base @ odom_from_base.inverse()
        self._map_from_odom = now
        if 0 <= now_ns - self._given_ns < SETTLES_S * 1e9:
            return None
        known = located.map_from_base if located is not None and located.state is not LocalisationState.LOST else None
        for beacon, map_from_odom in now.items():
            pose = map_from_odom @ odom_from_base
            if beacon not in before or not _near(before[beacon] @ odom_from_base, pose, ALIKE_M, ALIKE_RAD):
                continue
            if known is None or not _near(known, pose, AGREES_M, AGREES_RAD):
                self._given_ns = now_ns
                return pose
        return None


def _near(one: Pose2, other: Pose2, metres: float, radians: float) -> bool:
    turned = abs(wrap_angle(one.theta - other.theta))
    return math.dist((one.x, one.y), (other.x, other.y)) <= metres and turned <= radians
