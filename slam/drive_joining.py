"""Joining a drive to the map of earlier drives by scans: where it begins on the map, and when the two graphs connect."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from waychair.errors import SessionError
from waychair.slam.graph.edges import EdgeKind
from waychair.slam.localising.localiser import LocalisationState, Localiser, LocaliserSettings
from waychair.slam.mapping.mapper import CERTAIN_PATH, Mapper
from waychair.slam.mapping.tracking import twist_of
from waychair.types import OccupancyGrid, Pose2, SensorFrame


class DriveJoiner:
    """Joins a drive to the map of earlier ones by scans alone, and notes whether the two graphs are connected.

    The localiser searches for the chair on the saved grid (`slam.localising`), as after switching on. Its poses become
    candidates for loop closures, which have to pass the usual tests at two places some distance apart.
    """

    def __init__(self, grid: OccupancyGrid, mapper: Mapper) -> None:
        """`grid` is the grid of the earlier map, whose key scans the mapper holds."""
        self.joined = False
        self._known = len(mapper.keys)
        self._localiser = Localiser(grid, mapper.base_from_laser, None, LocaliserSettings())
        self._loops = -1

    def follow(self, mapper: Mapper, frame: SensorFrame) -> None:
        """Look for a loop closure; call it after `mapper.process` and after the loops by pictures."""
        if self.joined or frame.scan is None:
            return
        # the mapper's pose, from scan matching, is better odometry than the wheels'
        found = self._localiser.process(frame.scan, mapper.pose(), twist_of(frame))
        if found.state is LocalisationState.OK:
            here = found.map_from_base @ found.remaining
            mapper.close_loop(nearest_key(mapper, here, self._known)[0], here)
        self._check(mapper)

    def _check(self, mapper: Mapper) -> None:
        """Check after each loop closure whether the graph connects the chair to a key scan of earlier drives."""
        closed = mapper.keys.kinds[EdgeKind.LOOP]
        if not self.joined and closed != self._loops:
            self.joined = mapper.keys.reaches(mapper.frames[-1].key, self._known)
            self._loops = closed


def nearest_key(mapper: Mapper, pose: Pose2, known: int) -> tuple[int, float]:
    """Return the index of the key scan nearest to a pose among the first `known`, and its distance [m]."""
    away = np.hypot(*(mapper.keys.poses[:known, :2] - (pose.x, pose.y)).T)
    nearest = int(np.argmin(away))
    return nearest, float(away[nearest])


def beginning(
    mapper: Mapper, grid: OccupancyGrid, frames: Sequence[SensorFrame], follow: Callable[[Mapper, SensorFrame], None]
) -> tuple[int, Pose2] | None:
    """Return where a drive begins on a map: the key scan nearest to its first frame, and that frame's pose from there.

    None where it begins outside the map. The mapper continues the map of the grid and has seen nothing else; `follow`
    is called after each frame, for loop closures by pictures.

    Raises:
        SessionError: the drive is nowhere recognised on the map.
    """
    known, joiner = len(mapper.keys), DriveJoiner(grid, mapper)
    for frame in frames:
        mapper.process(frame)
        follow(mapper, frame)
        joiner.follow(mapper, frame)
        if joiner.joined:
            break
    else:
        raise SessionError(
            "the drive was recognised nowhere on the map: record one that passes over mapped ground, or map it by itself"
        )
    first = mapper.frames[mapper.earlier_frames]
    pose = mapper.keys.pose(first.key) @ first.key_from_base
    nearest, away = nearest_key(mapper, pose, known)
    if away > CERTAIN_PATH:
        return None
    return nearest, mapper.keys.pose(nearest).inverse() @ pose
