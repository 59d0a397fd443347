"""Searches for a revisited place that go on over several scans, as the values that a checkpoint keeps."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.slam.graph.edges import Edge
from waychair.slam.scan import partial_overlap as overlap
from waychair.slam.scan.submap_search import SubmapRound
from waychair.types import IntArray, Pose2

_LARGE_ROUND = 60  # submaps; of more, not one is searched with each key scan


@dataclass(frozen=True, slots=True)
class LoopCandidate:
    """A run of earlier key scans: its nearest node, its members, and the half sizes of the search window [m], [rad]."""

    nearest: int
    members: IntArray
    window: float
    angle: float


@dataclass(frozen=True, slots=True)
class Find:
    """A find of a search: at key scan `node` the chair was at `pose` in the present map."""

    node: int
    pose: Pose2


@dataclass(slots=True)
class CandidatesSearch:
    """A search by partial overlap for the view of the key scans `recent`, the last of which is at the chair's place: the
    candidates that wait, the search of the first of them once it is begun and the pose then of its nearest key scan, the finds so far, and the edges to those that agree with a find of the search before."""

    recent: list[int]
    waiting: list[LoopCandidate]
    present: overlap.OverlapSearch | None = None
    drawn_at: Pose2 = field(default_factory=Pose2)
    finds: list[Find] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)


@dataclass(slots=True)
class SubmapsSearch:
    """A search of submaps for the view of the key scans `recent`, the last of which is at the chair's place; the members
    of the searched submaps by number, and the edges to the places that hold, of those `tried` when all are searched.

    `waited` counts the key scans since the last piece."""

    recent: list[int]
    submaps: dict[int, IntArray]
    round: SubmapRound
    tried: int = 0
    edges: list[Edge] = field(default_factory=list)
    waited: int = 0

    def is_due(self) -> bool:
        """Count a key scan; return whether the next submap is due: in a very large building it is with every second key scan or
        so, so that the work with each does not grow with the building."""
        self.waited += 1
        if self.waited * _LARGE_ROUND < len(self.submaps):
            return False
        self.waited = 0
        return True
