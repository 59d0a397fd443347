"""Search of whole submaps, for loop closures where drift makes the position useless.

A submap is a run of key scans. It is searched in the frame of its first key scan, so its pyramid stays valid while the
graph moves the submap, until the submap's own shape changes. Searches without a find are cheap: each starts from the
least response that still counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from waychair.geometry import compose, invert, pose_from_array, transform_points
from waychair.slam.scan.relocaliser import (
    ENDLESS,
    HYPOTHESES,
    MIN_RESPONSE,
    SPREAD,
    GlobalSearch,
    Pyramid,
    begin_global_search,
    pyramid_from_points,
)
from waychair.slam.scan.scan_points import ScanStore
from waychair.types import FloatArray, IntArray, Pose2

REACH = 2.0  # m; the chair stands within this distance of a pose of the submap
MAX_BEND = 0.1  # m; the pyramid of a submap whose poses moved further in its own frame is stale
MAX_SPAN = (
    40.0  # m; key scans farther from most of their submap lie beyond a jump or a yard, and a pyramid of all is slow
)
MOST_KEPT = 20_000_000  # bytes of pyramids; building one again takes a third of the time of searching it
LARGE = 500_000  # cells; a larger pyramid takes as long to build as to search


@dataclass(frozen=True, slots=True)
class SubmapHypothesis:
    """A fit in submap `submap`: `map_from_base` by the submap's present pose, and the mean likelihood in [0, 1]."""

    submap: int
    map_from_base: Pose2
    response: float


class SubmapPyramids:
    """Cache of the pyramids of finished submaps: those used last, as far as they fit into `MOST_KEPT`."""

    def __init__(self) -> None:
        self._kept: dict[int, tuple[IntArray, FloatArray, Pyramid]] = {}

    def pyramid(self, submap: int, store: ScanStore, poses: FloatArray, members: IntArray) -> Pyramid:
        """Return the pyramid of the key scans `members` (M,), in the frame of the first of them.

        Its size is limited: key scans that a jump has put beyond `MAX_SPAN` of most others are left out.
        """
        shape = compose(invert(poses[members[0]]), poses[members])
        if (kept := self._valid(submap, members, shape)) is not None:
            return kept
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
        size = sum(_size(kept) for _, _, kept in self._kept.values())
        while size > MOST_KEPT and len(self._kept) > 1:
            size -= _size(self._kept.pop(next(iter(self._kept)))[2])
        return pyramid

    def has(self, submap: int, poses: FloatArray, members: IntArray) -> bool:
        """Return whether a submap's pyramid is there and still valid at the present poses."""
        return self._valid(submap, members, compose(invert(poses[members[0]]), poses[members])) is not None

    def _valid(self, submap: int, members: IntArray, shape: FloatArray) -> Pyramid | None:
        if submap not in self._kept:
            return None
        known, then, pyramid = self._kept[submap] = self._kept.pop(submap)  # the last one is that used last
        same = np.array_equal(known, members) and np.hypot(*(shape - then)[:, :2].T).max() <= MAX_BEND
        return pyramid if same else None


def _size(pyramid: Pyramid) -> int:
    return pyramid.likelihood.nbytes + pyramid.standing.nbytes


@dataclass(slots=True)
class SubmapRound:
    """A search of many submaps for one view, piece by piece.

    `points` (N, 2) [m, base] are the view, `waiting` the key scans of each submap that is still to be searched, in order.
    `found` holds the fits so far, relative to the first key scan of their submaps, so that the graph may move meanwhile.
    """

    points: FloatArray
    waiting: list[tuple[int, IntArray]]
    found: list[tuple[int, int, Pose2, float]] = field(default_factory=list)
    """Submap, its first key scan, the pose in its frame, and the response."""
    floor: float = MIN_RESPONSE
    _present: GlobalSearch | None = None
    """The search of the submap that waits first, once it has begun."""

    def search(self, store: ScanStore, poses: FloatArray, pyramids: SubmapPyramids, most: int = ENDLESS) -> bool:
        """Do the next piece: build the pyramid of the next submap, and, unless it is new and large, look up at least `most`
        points in it, or all that are left to look up; return whether the submap is searched.

        A search whose submap has changed its shape since the piece before begins again.
        """
        submap, members = self.waiting[0]
        is_built = pyramids.has(submap, poses, members)
        pyramid = pyramids.pyramid(submap, store, poses, members)
        if not is_built:
            self._present = None
            if pyramid.standing.size > LARGE:
                return False
        if self._present is None:
            self._present = begin_global_search(self.points, pyramid, self.floor)
        if not self._present.go_on(pyramid, most):
            return False
        del self.waiting[0]
        for place in self._present.hypotheses(pyramid):
            self.found.append((submap, int(members[0]), place.pose, place.response))
            self.floor = max(self.floor, place.response - SPREAD)
        self._present = None
        return True

    def hypotheses(self, poses: FloatArray) -> tuple[SubmapHypothesis, ...]:
        """Return the fits so far by the present poses, best first, up to the number of hypotheses.

        Positions are exact to one cell of the search; a match against the submap's key scans has to follow.
        """
        best = sorted((each for each in self.found if each[3] >= self.floor), key=lambda each: -each[3])
        return tuple(
            SubmapHypothesis(submap, pose_from_array(poses[first]) @ pose, response)
            for submap, first, pose, response in best[:HYPOTHESES]
        )


def global_candidates(
    store: ScanStore,
    poses: FloatArray,
    members_by_submap: Mapping[int, IntArray],
    points: FloatArray,
    pyramids: SubmapPyramids,
) -> tuple[SubmapHypothesis, ...]:
    """Return the fits of points (N, 2) [m, base] in all submaps at once, as a complete `SubmapRound`.

    `poses` (K, 3) [m, m, rad] are those of all key scans in the map, `members_by_submap` the key scans of each submap.
    """
    waiting = [(submap, np.asarray(members, np.int64)) for submap, members in members_by_submap.items() if len(members)]
    whole = SubmapRound(points, waiting)
    while whole.waiting:
        whole.search(store, poses, pyramids)
    return whole.hypotheses(poses)
