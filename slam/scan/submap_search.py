"""Search of whole submaps, for loop closures where drift makes the position useless.

A submap is a run of key scans. It is searched in the frame of its first key scan, so its pyramid stays valid while the
graph moves the submap, until the submap's own shape changes. Searches without a find are cheap: each starts from the
least response that still counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from waychair.geometry import compose, invert, pose_from_array, transform_points
from waychair.slam.scan.relocaliser import HYPOTHESES, MIN_RESPONSE, SPREAD, Pyramid, global_search, pyramid_from_points
from waychair.slam.scan.scan_points import ScanStore
from waychair.types import FloatArray, IntArray, Pose2

REACH = 2.0  # m; the chair stands within this distance of a pose of the submap
MAX_BEND = 0.1  # m; the pyramid of a submap whose poses moved further in its own frame is stale
MAX_SPAN = 100.0  # m; key scans farther from most of their submap were put there by a jump of the odometry


@dataclass(frozen=True, slots=True)
class SubmapHypothesis:
    """A fit in submap `submap`: `map_from_base` by the submap's present pose, and the mean likelihood in [0, 1]."""

    submap: int
    map_from_base: Pose2
    response: float


class SubmapPyramids:
    """Cache of the pyramids of finished submaps."""

    def __init__(self) -> None:
        self._kept: dict[int, tuple[IntArray, FloatArray, Pyramid]] = {}

    def pyramid(self, submap: int, store: ScanStore, poses: FloatArray, members: IntArray) -> Pyramid:
        """Return the pyramid of the key scans `members` (M,), in the frame of the first of them.

        Its size is limited: key scans that a jump has put beyond `MAX_SPAN` of most others are left out.
        """
        shape = compose(invert(poses[members[0]]), poses[members])
        if submap in self._kept:
            known, then, pyramid = self._kept[submap]
            if np.array_equal(known, members) and np.hypot(*(shape - then)[:, :2].T).max() <= MAX_BEND:
                return pyramid
        near = np.hypot(*(shape[:, None, :2] - shape[None, :, :2]).transpose(2, 0, 1)) <= MAX_SPAN
        together = near[int(np.argmax(near.sum(axis=0)))]
        every = np.concatenate(
            [
                transform_points(pose_from_array(pose), store[int(member)].points)
                for pose, member in zip(shape[together], members[together], strict=True)
            ]
        )
        pyramid = pyramid_from_points(every, shape[together, :2], REACH)
        self._kept[submap] = (members.copy(), shape, pyramid)
        return pyramid


def global_candidates(
    store: ScanStore,
    poses: FloatArray,
    members_by_submap: Mapping[int, IntArray],
    points: FloatArray,
    pyramids: SubmapPyramids,
) -> tuple[SubmapHypothesis, ...]:
    """Return the fits of points (N, 2) [m, base] in the submaps, best first, up to the number of hypotheses.

    `poses` (K, 3) [m, m, rad] are those of all key scans in the map, `members_by_submap` the key scans of each submap.
    Positions are exact to one cell of the search; a match against the submap's key scans has to follow.
    """
    found, floor = list[SubmapHypothesis](), MIN_RESPONSE
    for submap, members in members_by_submap.items():
        if len(members) == 0:
            continue
        pyramid = pyramids.pyramid(submap, store, poses, np.asarray(members, np.int64))
        map_from_submap = pose_from_array(poses[members[0]])
        for place in global_search(points, pyramid, floor=floor):
            found.append(SubmapHypothesis(submap, map_from_submap @ place.pose, place.response))
            floor = max(floor, place.response - SPREAD)
    found.sort(key=lambda hypothesis: -hypothesis.response)
    return tuple(hypothesis for hypothesis in found if hypothesis.response >= floor)[:HYPOTHESES]
