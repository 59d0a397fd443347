"""A chair that was carried while it mapped: the doubt, the tear, and the scans after it that confirm or undo the tear.

A scan that matches poorly and contradicts the scans before it (`scan_agreement`) tears the map: a new part begins, placed
by the odometry. One scan may err, so the tear stays open. The next key scans of the new part are matched with each
other only. Together they are laid on the surfaces before the tear, near where the odometry says. If both parts then see
the same surfaces, the chair drove: the tear is undone. If they contradict each other, it was carried: only a loop can
join the parts.

A scan that fits well where the odometry says that the chair is not claims a slip of the odometry. A room that looks alike
claims the same. So the next key scans are compared with those before: if they contradict each other, the chair was
carried, and the map is torn at the slip. They judge a match in the same way where its scan contradicts those before less
than a tear needs: together they show a carry that no scan shows by itself.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.information import (
    ODOMETRY_DISTANCE_SIGMA,
    match_information,
    odometry_information,
    rotated_information,
)
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.scan.reference_surfaces import ScanReference
from waychair.slam.scan.scan_agreement import Agreement, View, agreement, view_of
from waychair.slam.scan.scan_matching import Match, MatchSettings, Window, match
from waychair.slam.scan.scan_points import ScanPoints
from waychair.types import FloatArray, Pose2

_BEFORE = 10  # latest key scans that a doubted scan is compared with
_POOR_RESPONSE, _CONTRADICTED = 0.62, 0.15  # a match as poor as this is a tear if it contradicts more
_SURELY_CONTRADICTED = 0.25  # the same for a better match
_SLIP_WINDOW = Window(2.0, 0.6)  # m, rad; where the odometry may have slipped, or the chair was carried a step
_BETTER = 1.1  # times the response of the match near the odometry's pose, from which a slip is likely
_AT_GUESS, _HELD = Window(0.05, 0.05), 100.0  # a match that must not leave the guess, of so many times the information
_USUAL_OF, _USUAL, _FREE = 5, 2.0, 0.05
# Among trees, poles and cars the scans of a drive contradict each other anyway. So many times what the latest key scans show against those
# before them, beyond a share that buildings show too, is no sign of a carry. Indoors they show 0.002 to 0.04, on Freiburg's campus up to 0.5.
_SLIP, _SLIP_CONTRADICTED = 0.5, 0.1  # m; a slip of the odometry by more must be contradicted as little as this
# The same for a slip that a poor match claims: two carries showed 0.06 and 0.08, a true slip 0.00.
_POOR_SLIP_CONTRADICTED = 0.03
_SLIP_SHARE = 0.5  # of the contradiction at the odometry's pose is left where it slipped
_AGAIN = 0.7  # times these limits for the scan after a doubted one, which shows nearly the same
_LEAST_SHARED = 60  # surface points that must be shared with all scans before; fewer prove nothing
_LEAST_SHARED_EACH = 40  # the same in the mean of all pairs of a key scan before a slip and one after it
_AGREED, _CARRIED = 0.12, 0.2  # contradicted share up to which the chair drove, and from which it was carried
# Of 50 carries the least share near the odometry's pose was 0.29; where real drives were doubted, it was 0.12 to 0.24.
_ODOMETRY_AGREED, _ODOMETRY_CARRIED = 0.2, 0.25  # the same where the parts lie as the odometry says
_NEAR_ODOMETRY, _TURNED_ODOMETRY = 0.15, 0.06  # m, rad; a match this near to the odometry's pose lies as it says
_SLIP_CARRIED = (
    0.15  # share of contradiction over a slip from which the chair was carried; real slips show 0.07 or less
)
_FIRST_DOUBTED, _LAST_DOUBTED = 6, 10  # key scans since a match in doubt that judge it
SLIP_CLAIMED = 0.25  # m; a match farther than this from the odometry's pose claims a slip
_SOON = 3  # key scans after a tear within which the chair may be back on known ground
_SURE_RESPONSE = 0.75  # response and share of inliers of a scan that is
_LEAST_RESPONSE = 0.5  # of the match of both parts, for an edge by the scans and not by the odometry
_WINDOW = Window(0.5, 0.35)  # m, rad; where the odometry may have slipped over a tear
_QUERY_CELL = 0.1  # m
# A tear that a loop has bridged is undone if the odometry over it differs by no more than this, plus so much per metre of
# the way through the loop.
_NEAR_AWAY, _NEAR_TURNED = 0.3, 0.1  # m, rad
_DRIFT, _TURN_DRIFT = 0.01, 0.001  # m/m, rad/m
_MOST_AWAY, _MOST_TURNED, _LONGEST_WAY = 1.5, 0.35, 500.0  # m, rad, m
SUSPICIOUS = 0.5
"""Doubt from which the next key scans judge a match. At one place 11 of 21 carries showed 0.5 to 0.95 only."""

JUDGED_AT = (3, 6, 10, 15, 20)
"""Numbers of key scans since a tear at which it is judged."""

EMBEDDED = 0.12
"""Greatest contradicted share at which a part of the map fits a place where another part was seen."""


class Verdict(enum.Enum):
    """What the scans after a tear say."""

    OPEN = "more scans are needed"
    DROVE = "the chair drove over the tear"
    CARRIED = "the chair was carried"


@dataclass(frozen=True, slots=True)
class OpenTear:
    """A tear that is not yet judged: its edge, the key scans before it, and the information (3, 3) of the odometry.

    Over a slip of the odometry, the edge is that of the match, and `odometry` is the motion that it contradicts; `beyond`
    holds the poses of the frames before the edge's key scan, relative to it, that lie beyond the slip. `earlier` is the tear
    before it, if the few key scans between the two have confirmed that one only: they may be the faulty ones.
    """

    edge: Edge
    before: tuple[int, ...]
    by_odometry: FloatArray
    odometry: Pose2 | None = None
    earlier: OpenTear | None = None
    beyond: tuple[Pose2, ...] = ()

    @property
    def chain(self) -> tuple[OpenTear, ...]:
        """The tear and those before it that only the key scans between have confirmed, latest first."""
        return (self, *(() if self.earlier is None else self.earlier.chain))

    @property
    def claims_slip(self) -> bool:
        """Whether the odometry and the match over a slip differ."""
        gap = Pose2() if self.odometry is None else self.odometry.inverse() @ self.edge.i_from_j
        return math.hypot(gap.x, gap.y) > SLIP_CLAIMED

    @property
    def over_odometry(self) -> Edge:
        """The edge by odometry over the tear."""
        return Edge(self.edge.i, self.edge.j, self.edge.i_from_j, self.by_odometry, EdgeKind.ODOMETRY)


class CarryJudge:
    """Compares the scans on both sides of a step."""

    def __init__(self, matching: MatchSettings, reach: float, base_from_laser: Pose2) -> None:
        """`reach` [m]: half side of the reference round the tear."""
        self._matching, self._reach, self._mount = matching, reach, base_from_laser

    def doubt(
        self, keys: KeyGraph, recent: Sequence[int], scan: ScanPoints, found: Match, guess: Pose2, again: bool
    ) -> float:
        """Return how far a scan contradicts the latest key scans, both at its match and at the odometry's guess.

        Above 1, as a share of the contradiction that is allowed, the scan is doubted. The better the match, the more is
        allowed; less where the odometry would have to have slipped, and `again`, after another doubted scan.
        """
        earlier = self.views(keys, recent[-_BEFORE:])
        view = view_of(scan, self._mount)
        at = [agreement(earlier, [(view, pose @ self._mount)]) for pose in (found.pose, guess)]
        least = min(at, key=lambda each: each.contradiction)
        if least.shared < _LEAST_SHARED:
            return 0.0
        fits = found.response >= _POOR_RESPONSE
        limit = _SURELY_CONTRADICTED if fits else _CONTRADICTED
        slip, slip_limit = (_SLIP, _SLIP_CONTRADICTED) if fits else (SLIP_CLAIMED, _POOR_SLIP_CONTRADICTED)
        if at[1].contradiction > limit and math.hypot(found.pose.x - guess.x, found.pose.y - guess.y) > slip:
            limit = slip_limit
        limit *= _AGAIN if again else 1.0
        if least.contradiction <= SUSPICIOUS * limit:
            return least.contradiction / limit
        return (least.contradiction - self._usual(keys, recent)) / limit

    def _usual(self, keys: KeyGraph, nodes: Sequence[int]) -> float:
        """Return the contradiction that is usual here beyond that of buildings, by the latest of some key scans."""
        views, seen = self.views(keys, nodes[-_BEFORE - _USUAL_OF :]), Agreement()
        for k in range(max(len(views) - _USUAL_OF, 1), len(views)):
            seen += agreement(views[max(0, k - _BEFORE) : k], [views[k]])
        return max(0.0, _USUAL * seen.contradiction - _FREE) if seen.shared >= _LEAST_SHARED else 0.0

    def less_contradicted(
        self,
        keys: KeyGraph,
        recent: Sequence[int],
        scan: ScanPoints,
        reference: ScanReference,
        found: Match,
        guess: Pose2,
        prior: FloatArray,
        is_measured: bool,
    ) -> tuple[Match, bool]:
        """Return the match of a scan that fits poorly near the guess, and whether the odometry slipped.

        `found` is its match near the guess, whose information is `prior` (3, 3), and `is_measured` unless the guess only
        continues the last motion. A better fit elsewhere is no proof of a slip. A chair that drives backwards or turns sees
        new walls beside the known ones; its scan fits best where it lies on known walls as a whole, which may be a metre
        away. So the latest key scans must contradict the scan at the guess, and hardly where it fits.
        """
        wide = match(scan, reference, guess, prior / 100, _SLIP_WINDOW, self._matching)
        earlier, view = self.views(keys, recent[-_BEFORE:]), view_of(scan, self._mount)

        def is_proved(pose: Pose2, against: Pose2) -> bool:
            there, here = (agreement(earlier, [(view, at @ self._mount)]) for at in (against, pose))
            if there.shared < _LEAST_SHARED or not is_measured:
                return True
            limit = min(_SLIP_CONTRADICTED, _SLIP_SHARE * there.contradiction)
            return there.contradiction > _SLIP_CONTRADICTED and here.contradiction < limit

        gap = guess.inverse() @ found.pose
        if math.hypot(gap.x, gap.y) > _NEAR_ODOMETRY and not is_proved(found.pose, guess):
            found = match(scan, reference, guess, _HELD * prior, _AT_GUESS, self._matching)
        slipped = wide.response > _BETTER * found.response and is_proved(wide.pose, found.pose)
        return (wide if slipped else found), slipped

    def returned(self, keys: KeyGraph, tear: OpenTear, scan: ScanPoints, key_from_base: Pose2) -> Edge | None:
        """Return the edge from the last key scan before a tear to a new key scan.

        It exists if a scan soon after the tear, at `key_from_base` from the last key scan, fits the key scans before the
        tear again: those between were hidden or faulty, and lie as the odometry says.
        """
        node, last = tear.edge.j, tear.edge.i
        if len(keys) - node > _SOON:
            return None
        guess = keys.pose(len(keys) - 1) @ key_from_base
        reference = keys.reference(tear.before, keys.poses[last], self._reach, self._matching.resolution)
        prior = rotated_information(tear.by_odometry, guess.theta)
        found = match(scan, reference, guess, prior, _WINDOW, self._matching)
        if found.response < _SURE_RESPONSE or found.inliers < _SURE_RESPONSE:
            return None
        seen = agreement(
            self.views(keys, tear.before[-_BEFORE:]), [(view_of(scan, self._mount), found.pose @ self._mount)]
        )
        if seen.contradiction > _AGREED:
            return None
        known = rotated_information(match_information(found.information) + prior, -found.pose.theta)
        return Edge(last, len(keys), keys.pose(last).inverse() @ found.pose, known, EdgeKind.MATCH)

    def judged(
        self, keys: KeyGraph, tear: OpenTear, since: Sequence[int], is_final: bool = False, least_shared: int = 0
    ) -> tuple[Verdict, Edge | None]:
        """Return what the key scans `since` a tear say about it, and the edge that takes its place if the chair drove.

        `is_final`: no more key scans will follow, so that the verdict is not `OPEN`. The chair drove only if both parts see
        `least_shared` surface points.
        """
        if len(since) not in JUDGED_AT and not is_final:
            return Verdict.OPEN, None
        last = is_final or len(since) >= JUDGED_AT[-1]
        if tear.odometry is not None:
            return self._slip_judged(keys, tear, since, is_final), None
        node, base = tear.edge.j, keys.pose(tear.edge.j)
        query = keys.joined_points(since, base, _QUERY_CELL)
        reference = keys.reference(
            tear.before, keys.poses[tear.edge.i], self._reach + _WINDOW.distance, self._matching.resolution
        )
        prior = rotated_information(tear.by_odometry, base.theta)
        found = match(query, reference, base, prior, _WINDOW, self._matching)
        earlier = self.views(keys, tear.before[-_BEFORE:])
        tried = [self._laid(keys, earlier, since, pose @ base.inverse()) for pose in (found.pose, base)]
        best = min(tried, key=lambda each: each.contradiction)
        usual = max(self._usual(keys, tear.before), self._usual(keys, since))
        gap = base.inverse() @ found.pose
        near = math.hypot(gap.x, gap.y) < _NEAR_ODOMETRY and abs(gap.theta) < _TURNED_ODOMETRY
        by_odometry = (best.contradiction if near else tried[1].contradiction) - usual
        contradiction = best.contradiction - usual
        if best.shared < least_shared:
            return (Verdict.CARRIED if last else Verdict.OPEN), None
        if last and contradiction > 0.5 * (_AGREED + _CARRIED):
            if by_odometry > _ODOMETRY_AGREED:
                return Verdict.CARRIED, None
            best = tried[1]
        elif not last and contradiction > _CARRIED and by_odometry > _ODOMETRY_CARRIED:
            return (Verdict.CARRIED if len(since) > JUDGED_AT[0] else Verdict.OPEN), None
        elif not last and contradiction > _AGREED:
            return Verdict.OPEN, None
        before_from_base = keys.pose(tear.edge.i).inverse()
        if best is tried[0] and found.response >= _LEAST_RESPONSE:
            known = rotated_information(match_information(found.information) + prior, -found.pose.theta)
            return Verdict.DROVE, Edge(tear.edge.i, node, before_from_base @ found.pose, known, EdgeKind.MATCH)
        return Verdict.DROVE, tear.over_odometry

    def judged_over(
        self, keys: KeyGraph, tear: OpenTear, earlier: OpenTear, since: Sequence[int], is_final: bool
    ) -> tuple[Verdict, Edge | None]:
        """Return what the key scans `since` a tear say about the way from the key scans before an earlier one.

        They say that the chair drove if they see the same surfaces: then the key scans between the two tears were faulty.
        """
        i, j = earlier.edge.i, tear.edge.j
        way = Edge(i, j, keys.pose(i).inverse() @ keys.pose(j), earlier.by_odometry, EdgeKind.UNKNOWN)
        return self.judged(keys, OpenTear(way, earlier.before, earlier.by_odometry), since, is_final, _LEAST_SHARED)

    def _slip_judged(self, keys: KeyGraph, slip: OpenTear, since: Sequence[int], is_final: bool) -> Verdict:
        """Return whether the key scans since a slip, or since a match in doubt, contradict those before it.

        Where the odometry agrees with the match in doubt, more of them are needed, and a carry shows within `_LAST_DOUBTED`.
        """
        first, last = (1, JUDGED_AT[-1]) if slip.claims_slip else (_FIRST_DOUBTED, _LAST_DOUBTED)
        if len(since) >= first and self._contradict(keys, slip.before, since):
            return Verdict.CARRIED
        return Verdict.DROVE if is_final or len(since) >= last else Verdict.OPEN

    def _contradict(self, keys: KeyGraph, before: Sequence[int], since: Sequence[int]) -> bool:
        """Return whether key scans contradict those before them by more than a drive does, and more than is usual here."""
        latest = before[-_BEFORE:]
        seen = self._laid(keys, self.views(keys, latest), since, Pose2())
        if seen.shared < _LEAST_SHARED_EACH * len(latest) * len(since) or seen.contradiction <= _SLIP_CARRIED:
            return False
        return seen.contradiction - (self._usual(keys, before) + self._usual(keys, since)) > _SLIP_CARRIED

    def _laid(
        self, keys: KeyGraph, earlier: Sequence[tuple[View, Pose2]], nodes: Sequence[int], moved: Pose2
    ) -> Agreement:
        """Return the agreement of key scans, moved rigidly in the map, with views."""
        return agreement(earlier, [(view, moved @ pose) for view, pose in self.views(keys, nodes)])

    def embedded(self, keys: KeyGraph, part: Sequence[int], place: Sequence[int], moved: Pose2) -> Agreement:
        """Return how far the key scans of a part, moved rigidly in the map, agree with those of a place."""
        return self._laid(keys, self.views(keys, place), part, moved)

    def views(self, keys: KeyGraph, nodes: Sequence[int]) -> list[tuple[View, Pose2]]:
        """Return key scans as views with the poses of their lidars."""
        return [(view_of(keys.store[node], self._mount), keys.pose(node) @ self._mount) for node in nodes]


def agrees_with_odometry(keys: KeyGraph, tear: Edge) -> Edge | None:
    """Return the odometry's edge over a tear that loops have bridged, if the poses since then agree with it.

    The longer the way through the loops from one side of the tear to the other, the more they may differ.
    """
    shown = keys.pose(tear.i).inverse() @ keys.pose(tear.j)
    gap = tear.i_from_j.inverse() @ shown
    away, turned = math.hypot(gap.x, gap.y), abs(gap.theta)
    if away > _MOST_AWAY or turned > _MOST_TURNED:
        return None
    way = keys.path_lengths(tear.i, _LONGEST_WAY).get(tear.j)
    if way is None or away > _NEAR_AWAY + _DRIFT * way or turned > _NEAR_TURNED + _TURN_DRIFT * way:
        return None
    step = math.hypot(tear.i_from_j.x, tear.i_from_j.y)
    known = odometry_information(Pose2(step + away / ODOMETRY_DISTANCE_SIGMA, 0.0, tear.i_from_j.theta))
    return Edge(tear.i, tear.j, tear.i_from_j, known, EdgeKind.ODOMETRY)
