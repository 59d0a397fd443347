"""Loop closure: searches for the place that a chair has returned to, and the scan matches that verify it.

A nearby candidate is a run of earlier key scans that is close in the map, while its path through the graph is long. Its
uncertainty, and so the search window, grows with that path. Where whole views do not match, because the chair returned
with another heading, the small common part has to match (`partial_overlap`), twice, some distance apart. Where the
window would be too large to search, after long drift or when the chair was kidnapped, whole submaps are searched: those
where the chair can be, nearest first, one with each key scan, so that the work per scan is bounded. A place found there
counts only if all latest key scans, laid there, see the surfaces of the place and the place sees theirs, if that holds
at no other place of its part of the map, and when a second find, some distance on, agrees, or the map has the chair
near that place already. A loop is accepted by geometry (enough of the query lies on the reference's surfaces, no second
place fits nearly as well), never by the likelihood alone.
"""

from __future__ import annotations

import enum
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from waychair.geometry import wrap_angle
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.information import match_information, rotated_information
from waychair.slam.mapping.carried import EMBEDDED, CarryJudge
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.mapping.loop_candidates import (
    CHAIN_REACH,
    MAX_ANGLE,
    MAX_WINDOW,
    MIN_WINDOW,
    TURN_DRIFT,
    LoopSettings,
    candidates,
    graph_distances,
    uncertain_submaps,
)
from waychair.slam.mapping.loop_searches import CandidatesSearch, Find, LoopCandidate, SubmapsSearch
from waychair.slam.scan import partial_overlap as overlap
from waychair.slam.scan.partial_overlap import known_ground
from waychair.slam.scan.reference_surfaces import ScanReference
from waychair.slam.scan.scan_matching import MatchSettings, Window, correlative_search, refine
from waychair.slam.scan.submap_search import SubmapPyramids, SubmapRound
from waychair.types import FloatArray, Pose2

_QUERY_CELL = 0.1
_QUERY_SCANS = 6  # latest key scans that are matched together
_MIN_RESPONSE = 0.5  # least mean likelihood
_MIN_INLIERS = 0.7  # least share of points on the reference's surfaces
_SUBMAP_QUERY = 15  # latest key scans that are searched for in submaps
_AGREE_DISTANCE, _AGREE_ANGLE = 0.5, 0.15  # m, rad; two finds this near agree
_PLACE_REACH, _PLACE_PATH = 12.0, 15.0  # m; key scans this near to a part laid at a place, and so connected, see it
_PLACE_VIEWS, _PART_VIEWS = 30, 20  # key scans of the place and of the part that are compared
_LEAST_SHARED = 300  # surface points that both must know about
_LONGEST_REST = 3  # times the length of a round of submaps: where the chair is on new ground, a round finds nothing
_LOOKUPS = 5_000_000  # points that one piece of a search by partial overlap looks up in a grid, 10 ms
_SUBMAP_LOOKUPS = 6_000_000  # points that one piece of a search of a submap looks up, 12 ms
_TORN_PIECES = 3  # are done with each key scan while parts of the map are apart
_FARTHEST_EXPECTED = 2 * MAX_WINDOW  # m; a find that moves the chair farther needs a second one
_MAX_AMBIGUITY = 0.9  # largest ratio of the runner-up's response over the winner's


@dataclass(slots=True)
class Driven:
    """Distances driven [m] since the last search near the chair, of submaps, by partial overlap, and since the last loop.

    Then the number of latest rounds of submaps without a find, and the distance [m] from the begin of the last to the next.
    """

    search: float = math.inf
    submaps: float = math.inf
    overlap: float = math.inf
    loop: float = math.inf
    fruitless: int = 0
    next_round: float = 0.0

    def end_round(self, is_fruitless: bool) -> None:
        """Rest after a fruitless round of submaps for so many times its length as rounds before it were fruitless, too."""
        self.next_round = self.submaps * (1 + min(self.fruitless, _LONGEST_REST)) if is_fruitless else 0.0
        self.fruitless = self.fruitless + 1 if is_fruitless else 0


class LoopRejection(enum.Enum):
    """Why a loop is not accepted."""

    CONTRADICTED = "it contradicts the driven path"
    POOR_FIT = "the scans do not fit there"
    AMBIGUOUS = "the scans fit at two places nearly as well"
    BETTER_ELSEWHERE = "the scans fit better at another place within the drift"
    FEW_INLIERS = "too few points of the scans lie on the surfaces there"
    SEEN_THROUGH = "the scans look through walls there, or the walls stand where the chair once saw free ground"
    UNCONFIRMED = "the position is too uncertain, and no second find agrees"
    FEW_KEY_SCANS = "too few key scans since the start or a kidnapping"


class LoopCloser:
    """Searches for loops while the chair drives; `counts` holds the number of searches, finds and rejections."""

    _submap_finds: tuple[Edge, ...] = ()  # of the class, since older checkpoints were saved without it

    def __init__(
        self,
        settings: LoopSettings,
        matching: MatchSettings,
        reach: float,
        base_from_laser: Pose2,
        judge: CarryJudge,
    ) -> None:
        """`reach` [m]: half side of a reference beyond the window and the chain's size."""
        self.counts: Counter[str] = Counter()
        self._settings, self._matching, self._reach = settings, matching, reach
        self._pyramids = SubmapPyramids()
        self._base_from_laser, self._judge = base_from_laser, judge
        self._since = Driven()
        self._submaps: dict[
            int, bool
        ] = {}  # by first key scan: whether a submap where the chair can have been was searched
        self._overlap_search: CandidatesSearch | None = None
        self._submap_search: SubmapsSearch | None = None
        self._overlap_finds: list[Find] = []
        self._recognised: Find | None = None

    @property
    def never_searched(self) -> int:
        """Number of submaps where the chair could have been, and that no search has reached."""
        return list(self._submaps.values()).count(False)

    def add_distance(self, distance: float) -> None:
        """Add the distance driven [m] since the last call."""
        since = self._since
        since.search, since.submaps = since.search + distance, since.submaps + distance
        since.overlap, since.loop = since.overlap + distance, since.loop + distance

    def begin_part(self) -> None:
        """Forget what was found before, since the chair may have been carried."""
        self._overlap_search = self._submap_search = self._recognised = None
        self._overlap_finds, self._submap_finds = [], ()
        self._since.end_round(is_fruitless=False)

    def loops(self, keys: KeyGraph, recent: Sequence[int]) -> list[Edge]:
        """Return edges that close loops at the last key scan, or at the view of a longer search.

        `recent` are the latest key scans in driving order. Of the longer searches, one piece is done with each key scan, or
        three while parts of the map are apart: a candidate by partial overlap, the pyramid of a submap, its search, or the
        verification of one place.
        """
        edges = self._loops_here(keys, recent)
        for _ in range(_TORN_PIECES if keys.is_torn else 1):
            edges = edges or self._next_piece(keys)
        return self._closed(edges)

    def last_loops(self, keys: KeyGraph, recent: Sequence[int]) -> list[Edge]:
        """Return what `loops` might have found with further key scans: the longer searches are done to their end, and if they
        find nothing, another one from the last key scan, too, if that is some way on."""
        edges = self._rest(keys)
        if not edges:
            self._since.search, self._since.next_round = math.inf, 0.0
            edges = self._loops_here(keys, recent) or self._rest(keys)
        return self._closed(edges)

    def _rest(self, keys: KeyGraph) -> list[Edge]:
        """Do the longer searches up to their end or to the first edges; return these."""
        edges: list[Edge] = []
        while not edges and (self._overlap_search is not None or self._submap_search is not None):
            edges = self._next_piece(keys)
        return edges

    def _next_piece(self, keys: KeyGraph) -> list[Edge]:
        """Do the next piece of a longer search; return the edges that it leads to."""
        return self._submap_edges(keys) if self._overlap_search is None else self._partial_overlap_edges(keys)

    def _closed(self, edges: list[Edge]) -> list[Edge]:
        """Count accepted edges, after which all searches begin anew; return them."""
        self.counts["loops_closed"] += len(edges)
        if edges:
            self._since.loop, self._overlap_search, self._submap_search = 0.0, None, None
            self._since.end_round(is_fruitless=False)
        return edges

    def _loops_here(self, keys: KeyGraph, recent: Sequence[int]) -> list[Edge]:
        """Return edges to candidates near the last key scan, and begin a search of submaps where one is due."""
        settings = self._settings
        known = len(keys) - len(recent)
        if self._since.search < settings.spacing or known < 1 or len(recent) < _QUERY_SCANS:
            return []
        self._since.search = 0.0
        path_lengths = graph_distances(keys.poses, keys.edge_arrays, len(keys) - 1)[:known]
        near = candidates(keys.poses, path_lengths, settings)
        found = [self._verified(keys, recent, candidate) for candidate in near]
        edges = [edge for edge in found if isinstance(edge, Edge)]
        if not edges and near and self._is_overlap_search_due():
            self._since.overlap, self._overlap_search = 0.0, CandidatesSearch(list(recent), list(near))
        if not edges and len(recent) >= _SUBMAP_QUERY:
            self._search_submaps(keys, recent, path_lengths)
        return edges

    def verify_recognised(
        self, keys: KeyGraph, recent: Sequence[int], old: int, map_from_base: Pose2
    ) -> Edge | LoopRejection:
        """Return the edge to an old key scan for a place that another sensor, such as the camera, has recognised.

        `map_from_base` is the pose, by that sensor, at the last of the key scans `recent`. It must lie within the drift
        of the path through the graph or, where that drift exceeds the largest window, agree with the find before it.
        The scans must also fit the surfaces round the old key scan there, as for any loop, and fit no better anywhere
        else within the drift. Where they fit equally well all along a corridor, the other sensor decides.
        """
        settings, here = self._settings, recent[-1]
        if len(recent) < _QUERY_SCANS:
            return LoopRejection.FEW_KEY_SCANS
        path_length = float(graph_distances(keys.poses, keys.edge_arrays, here)[old])
        gap = keys.pose(here).inverse() @ map_from_base
        drift, before, find = settings.drift * path_length, self._recognised, Find(here, map_from_base)
        angle = min(MAX_ANGLE, 0.15 + TURN_DRIFT * path_length)
        if drift > MAX_WINDOW:
            self._recognised = find
            apart = before is not None and math.dist(*(keys.poses[k, :2] for k in (before.node, here)))
            if before is None or apart < settings.spacing or not self._agree(keys, before, find):
                return LoopRejection.UNCONFIRMED
        elif math.hypot(gap.x, gap.y) > MIN_WINDOW + drift or abs(gap.theta) > angle:
            return LoopRejection.CONTRADICTED
        latest = set(recent[-_SUBMAP_QUERY:])
        near = [node for node in sorted(keys.path_lengths(old, CHAIN_REACH)) if node not in latest]
        candidate = LoopCandidate(old, np.array(near, np.int64), MIN_WINDOW, _AGREE_ANGLE)
        if drift <= MAX_WINDOW:
            return self._verified(keys, recent, candidate, map_from_base, Window(MIN_WINDOW + drift, angle))
        edge = self._verified(keys, recent, candidate, map_from_base)
        if isinstance(edge, Edge) and not self._belongs(keys, recent, edge):
            return LoopRejection.SEEN_THROUGH
        return edge

    def _verified(
        self,
        keys: KeyGraph,
        recent: Sequence[int],
        candidate: LoopCandidate,
        guess: Pose2 | None = None,
        rivals: Window | None = None,
    ) -> Edge | LoopRejection:
        """Return the edge if the latest key scans together fit the candidate's surfaces at one pose only.

        The search is centred on the guess, by default the present pose. With `rivals`, a window round the present pose,
        no pose in that window may fit better.
        """
        self.counts["loops_proposed"] += 1
        matching, base = self._matching, keys.pose(recent[-1])
        query = keys.joined_points(recent[-_QUERY_SCANS:], base, _QUERY_CELL)
        reference = self._reference_of(keys, candidate, candidate.window if rivals is None else rivals.distance)
        window, guess = Window(candidate.window, candidate.angle), guess or base
        coarse, response = correlative_search(query.points, reference, guess, window, floor=_MIN_RESPONSE)
        if response < _MIN_RESPONSE:
            return LoopRejection.POOR_FIT
        floor = _MAX_AMBIGUITY * response
        if correlative_search(query.points, reference, guess, window, floor=floor, excluded=coarse)[1] > 0:
            self.counts["loops_ambiguous"] += 1
            return LoopRejection.AMBIGUOUS
        if rivals is not None:
            floor = response / _MAX_AMBIGUITY
            if correlative_search(query.points, reference, base, rivals, floor=floor, excluded=coarse)[1] > 0:
                return LoopRejection.BETTER_ELSEWHERE
        pose, information, inliers, _ = refine(
            query, reference, start=coarse, guess=coarse, guess_information=np.zeros((3, 3)), settings=matching
        )
        if inliers < _MIN_INLIERS:
            self.counts["loops_rejected"] += 1
            return LoopRejection.FEW_INLIERS
        return self._edge(keys, recent[-1], candidate, pose, information)

    def _reference_of(self, keys: KeyGraph, candidate: LoopCandidate, window: float) -> ScanReference:
        """Return a candidate's surfaces, as far as they are visible from anywhere in a window [m]."""
        reach = window + CHAIN_REACH + self._reach
        return keys.reference(candidate.members, keys.poses[candidate.nearest], reach, self._matching.resolution)

    def _edge(self, keys: KeyGraph, node: int, candidate: LoopCandidate, pose: Pose2, information: FloatArray) -> Edge:
        """Return the edge from the candidate to a key scan at `pose`, by a match with this information (3, 3)."""
        nearest_from_node = keys.pose(candidate.nearest).inverse() @ pose
        known = rotated_information(match_information(information), -pose.theta)
        return Edge(candidate.nearest, node, nearest_from_node, known, EdgeKind.LOOP)

    def _is_overlap_search_due(self) -> bool:
        """Return whether the costly search for partial overlap is due: whole views have closed no loop for a while."""
        waited = self._since.loop >= overlap.PATIENCE and self._since.overlap >= overlap.SPACING
        return waited and self._overlap_search is None

    def _partial_overlap_edges(self, keys: KeyGraph) -> list[Edge]:
        """Do the next piece of the search by partial overlap; when it is over, return the edges where two finds agree.

        The first piece of a candidate draws its surfaces and the ground that is known there.
        """
        search = self._overlap_search
        assert search is not None
        candidate, node = search.waiting[0], search.recent[-1]
        if search.present is None:
            self.counts["glimpses_tried"] += 1
            search.drawn_at = keys.pose(candidate.nearest)
            search.present = self._begin_overlap(keys, search.recent, candidate)
        if not search.present.go_on(self._matching, _LOOKUPS):
            return []
        found, search.present = search.present.found, None
        del search.waiting[0]
        if found is not None:
            self.counts["glimpses"] += 1
            pose = keys.pose(candidate.nearest) @ (search.drawn_at.inverse() @ found.pose)  # the graph may have moved
            find = Find(node, pose)
            search.finds.append(find)
            agreed = any(self._agree(keys, earlier, find) for earlier in self._overlap_finds)
            if found.inliers >= overlap.MIN_INLIERS and agreed:
                search.edges.append(self._edge(keys, node, candidate, pose, found.information))
        if search.waiting:
            return []
        self._overlap_finds, self._overlap_search = search.finds, None
        return search.edges

    def _begin_overlap(self, keys: KeyGraph, recent: Sequence[int], candidate: LoopCandidate) -> overlap.OverlapSearch:
        """Return the search of a candidate for the view of the latest key scans, with nothing searched yet."""
        base = keys.pose(recent[-1])
        query = keys.joined_points(recent[-overlap.QUERY_SCANS :], base, _QUERY_CELL)
        window = Window(min(overlap.WIDENING * candidate.window, overlap.MAX_WINDOW), candidate.angle)
        reference = self._reference_of(keys, candidate, window.distance)
        every = -(-len(candidate.members) // overlap.DRAWN_SCANS)
        known = known_ground(keys.store, keys.poses, candidate.members[::every], self._base_from_laser, reference)
        return overlap.OverlapSearch(query, reference, known, base, window)

    def _search_submaps(self, keys: KeyGraph, recent: Sequence[int], path_lengths: FloatArray) -> None:
        """Note the submaps that are too uncertain for a window, and begin to search them where a search is due."""
        part_starts = keys.edge_arrays.j[keys.edge_arrays.torn].tolist() if keys.is_torn else []
        submaps = uncertain_submaps(keys.poses, path_lengths, self._settings, part_starts)
        self._submaps = dict.fromkeys(submaps, False) | self._submaps
        rested = keys.is_torn or self._since.submaps >= self._since.next_round  # parts that are apart have no rest
        is_due = rested and self._since.submaps >= self._settings.submap_spacing
        if not submaps or not is_due or self._submap_search is not None:
            return
        self._since.submaps = 0.0
        self.counts["submap_searches"] += 1
        query = keys.joined_points(recent[-_SUBMAP_QUERY:], keys.pose(recent[-1]), _QUERY_CELL)
        self._submap_search = SubmapsSearch(list(recent), submaps, SubmapRound(query.points, list(submaps.items())))

    def _submap_edges(self, keys: KeyGraph) -> list[Edge]:
        """Do the next piece of the search of submaps; return the edge to one of them, when all is done and two finds agree."""
        search = self._submap_search
        if search is None:
            return []
        if search.round.waiting:
            if not search.is_due():
                return []
            submap = search.round.waiting[0][0]
            if search.round.search(keys.store, keys.poses, self._pyramids, _SUBMAP_LOOKUPS):
                self.counts["submaps_searched"] += 1
                self._submaps[submap] = True
            return []
        if self._try_next_place(keys, search):
            return []
        self._submap_search = None
        self._since.end_round(is_fruitless=not search.edges)
        earlier, finds = self._submap_finds, search.edges
        if not self._is_one_place(keys, finds):
            self.counts["places_ambiguous"] += 1
            self._submap_finds = ()
            return []
        if finds:  # a round that finds nothing says nothing of the one before
            self._submap_finds = tuple(finds)
        before = [_find_of(keys, find) for find in earlier]
        return [
            find
            for find in finds
            if any(self._agree(keys, other, _find_of(keys, find)) for other in before) or self._is_expected(keys, find)
        ]

    def _is_expected(self, keys: KeyGraph, find: Edge) -> bool:
        """Return whether a find in the chair's own part of the map moves it no farther than the odometry may have drifted."""
        gap = keys.pose(find.j).inverse() @ _find_of(keys, find).pose
        path_length = graph_distances(keys.poses, keys.edge_arrays, find.j)[find.i]
        window = np.clip(self._settings.drift * path_length, MAX_WINDOW, _FARTHEST_EXPECTED)
        near = math.hypot(gap.x, gap.y) <= window and abs(gap.theta) <= MAX_ANGLE
        part = keys.parts()
        return bool(near and part[find.i] == part[find.j])

    def _is_one_place(self, keys: KeyGraph, finds: Sequence[Edge]) -> bool:
        """Return whether the chair can be at all places that the finds of one view lead to.

        It can be at one place of each part of the map, if the surroundings of that place in one part are those in the other.
        """
        part = keys.parts()
        for a, b in combinations(finds, 2):
            if part[a.i] == part[b.i]:
                return False
            a_from_b = _find_of(keys, a).pose @ _find_of(keys, b).pose.inverse()
            if not self._is_embedded(keys, sorted(keys.path_lengths(b.i, _PLACE_PATH)), a.i, a_from_b):
                return False
        return True

    def _try_next_place(self, keys: KeyGraph, search: SubmapsSearch) -> bool:
        """Verify the places where the view of a search fits up to the next one that the scans match; return False if there is
        none.

        Places that fit much worse than the best one, and those that a verified edge leads to, count for nothing.
        """
        found = search.round.hypotheses(keys.poses)
        while search.tried < len(found):
            rival = found[search.tried]
            search.tried += 1
            if rival.response < _MAX_AMBIGUITY * found[0].response:
                return False
            pose, members = rival.map_from_base, search.submaps[rival.submap]
            if any(_near(_find_of(keys, edge).pose, pose) for edge in search.edges):
                continue
            nearest = int(members[np.argmin(np.hypot(*(keys.poses[members, :2] - (pose.x, pose.y)).T))])
            near = LoopCandidate(nearest, members, MIN_WINDOW, _AGREE_ANGLE)
            edge = self._verified(keys, search.recent, near, pose)
            if isinstance(edge, Edge):  # the dear half of a verification follows
                if self._belongs(keys, search.recent, edge):
                    search.edges.append(edge)
                return True
        return False

    def _belongs(self, keys: KeyGraph, recent: Sequence[int], edge: Edge) -> bool:
        """Return whether the latest key scans, laid where an edge says, and the place there see the same surfaces."""
        moved = _find_of(keys, edge).pose @ keys.pose(edge.j).inverse()
        fits = self._is_embedded(keys, recent, edge.i, moved)
        self.counts["places_contradicted"] += not fits
        return fits

    def _is_embedded(self, keys: KeyGraph, part: Sequence[int], place: int, moved: Pose2) -> bool:
        """Return whether key scans, moved rigidly in the map, and those round a key scan of another place see the same
        surfaces."""
        few = part[:: -(-len(part) // _PART_VIEWS)]
        laid = np.array([(moved @ keys.pose(node)).array() for node in few])
        own = set(part)
        connected = [node for node in sorted(keys.path_lengths(place, _PLACE_PATH)) if node not in own]
        apart = np.hypot(*(keys.poses[connected, None, :2] - laid[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
        near = [node for node, away in zip(connected, apart, strict=True) if away < _PLACE_REACH]
        if not near:
            return False
        seen = self._judge.embedded(keys, few, near[:: -(-len(near) // _PLACE_VIEWS)], moved)
        return seen.shared >= _LEAST_SHARED and seen.contradiction <= EMBEDDED

    def _agree(self, keys: KeyGraph, before: Find, now: Find) -> bool:
        """Return whether the motion between two finds equals the motion that was driven."""
        return _near(before.pose @ (keys.pose(before.node).inverse() @ keys.pose(now.node)), now.pose)


def _find_of(keys: KeyGraph, edge: Edge) -> Find:
    """Return the find that an edge from a key scan of the present map stands for."""
    return Find(edge.j, keys.pose(edge.i) @ edge.i_from_j)


def _near(a: Pose2, b: Pose2) -> bool:
    """Return whether two finds of one pose agree."""
    gap = a.inverse() @ b
    return math.hypot(gap.x, gap.y) < _AGREE_DISTANCE and abs(wrap_angle(gap.theta)) < _AGREE_ANGLE
