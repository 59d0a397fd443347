"""The tears and slips that the next key scans have not judged yet.

A chair may be carried again, or its odometry may slip again, before enough key scans have judged the time before. So every
claim is kept and judged by itself. Where a new part of the map begins, it is decided at once by the key scans so far: those
of the new part say nothing about it. The few key scans between two tears may be faulty, as in a crowd. Then those after the
second tear agree with those before the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.mapping.carried import JUDGED_AT, CarryJudge, OpenTear, Verdict
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.scan.scan_points import ScanPoints
from waychair.types import FloatArray, Pose2

RECENT_KEYS = 40
"""Greatest number of latest key scans that a new scan is matched against."""


@dataclass(slots=True)
class Ruling:
    """What judgements have changed: the latest key scans in driving order, the number of tears that are undone, and the slips
    at which new parts of the map have begun.

    `took_long`: whether a tear was judged, for which scans are matched.
    """

    recent: list[int]
    undone: int = 0
    parted: list[OpenTear] = field(default_factory=list)
    took_long: bool = False


class OpenTears:
    """Tears and slips in the order of driving, until they are judged."""

    def __init__(self, judge: CarryJudge) -> None:
        self._judge = judge
        self._open: list[OpenTear] = []

    def add(self, tear: OpenTear) -> None:
        """Add a tear, or a slip that a match claims."""
        self._open.append(tear)

    def forget(self, edge: Edge) -> None:
        """Forget the tear with this edge, also in chains, since loops have undone it."""
        self._open = [_unchained(tear, edge) for tear in self._open if tear.edge is not edge]

    def can_be_doubted(self, recent: Sequence[int]) -> bool:
        """Return whether enough key scans follow the latest tear to contradict the next one."""
        torn = [tear.edge.j for tear in self._open if tear.odometry is None]
        return not torn or sum(node >= torn[-1] for node in recent) >= JUDGED_AT[0]

    def returned(
        self, keys: KeyGraph, recent: Sequence[int], scan: ScanPoints, key_from_base: Pose2
    ) -> tuple[Ruling, Edge] | None:
        """Undo the latest tear if a scan soon after it fits the key scans before it; return the edge to the new key scan.

        See `CarryJudge.returned`. The last key scan before the tear is then the latest one.
        """
        torn = next((tear for tear in self._open if tear.odometry is None), None)
        for tear in () if torn is None else torn.chain:
            if (edge := self._judge.returned(keys, tear, scan, key_from_base)) is not None:
                assert torn is not None
                ruling = Ruling(list(recent))
                self._undo(keys, torn, tear, ruling)
                since, before = recent, [node for node in tear.before if node not in recent]
                ruling.recent = [*since, *before][-RECENT_KEYS:]
                return ruling, edge
        return None

    def judged(self, keys: KeyGraph, recent: Sequence[int]) -> Ruling:
        """Judge all that is open by the latest key scans; return what has changed."""
        ruling = Ruling(list(recent))
        self._judge_all(keys, ruling, is_final=False)
        return ruling

    def begin_part(self, keys: KeyGraph, recent: Sequence[int], torn: Edge, by_odometry: FloatArray) -> Ruling:
        """Decide all that is open by the latest key scans, and open a tear; return what has changed.

        `by_odometry` (3, 3) is the information of the odometry over the tear.
        """
        ruling, node = Ruling(list(recent)), torn.j
        earlier = next((tear for tear in self._open if tear.odometry is None), None)
        self._judge_all(keys, ruling, is_final=True)
        if earlier is not None and (
            node - earlier.edge.j > JUDGED_AT[-1] or not any(edge is earlier.edge for edge in keys.edges)
        ):
            earlier = None
        self.add(OpenTear(torn, tuple(ruling.recent), by_odometry, earlier=earlier))
        return ruling

    def _judge_all(self, keys: KeyGraph, ruling: Ruling, is_final: bool) -> None:
        for edge in [tear.edge for tear in self._open]:
            tear = next((other for other in self._open if other.edge is edge), None)
            if tear is not None:  # judging another may have decided it
                self._judge_one(keys, tear, ruling, is_final)

    def _judge_one(self, keys: KeyGraph, tear: OpenTear, ruling: Ruling, is_final: bool) -> None:
        since = [node for node in ruling.recent if node >= tear.edge.j]
        ruling.took_long |= tear.odometry is None and len(since) in JUDGED_AT
        verdict, edge = self._judge.judged(keys, tear, since, is_final)
        first, others = tear, iter(tear.chain[1:])
        while edge is None and (other := next(others, None)) is not None:
            first = other
            verdict, edge = self._judge.judged_over(keys, tear, first, since, is_final)
        if verdict is Verdict.OPEN:
            return
        self._open = [other for other in self._open if other is not tear]
        if edge is not None:
            self._undo(keys, tear, first, ruling, edge)
            known = [node for each in reversed(_back_to(tear, first)) for node in each.before]
            before = [node for node in dict.fromkeys(known) if node not in ruling.recent]
            ruling.recent = [*before, *ruling.recent][-RECENT_KEYS:]
        elif tear.odometry is not None and verdict is Verdict.CARRIED and keys.tear(tear.edge, tear.odometry):
            earlier = Ruling([node for node in ruling.recent if node < tear.edge.j])
            for other in [other for other in self._open if other.edge.j < tear.edge.j]:
                self._judge_one(keys, other, earlier, is_final=True)
            self._open = [_begun_at(other, tear.edge.j) for other in self._open]
            ruling.recent, ruling.undone = since, ruling.undone + earlier.undone
            ruling.parted.append(tear)

    def _undo(self, keys: KeyGraph, tear: OpenTear, first: OpenTear, ruling: Ruling, edge: Edge | None = None) -> None:
        """Undo the tears of a chain back to the `first`: by an edge of known motion from there to the key scan after the
        latest, else by odometry."""
        self._open = [other for other in self._open if other is not tear]
        if edge is not None and first is tear:
            keys.undo_tear(tear.edge, edge)
            ruling.undone += 1
            return
        for each in _back_to(tear, first):
            keys.undo_tear(each.edge, each.over_odometry)
            ruling.undone += 1
        if edge is not None and edge.kind is not EdgeKind.ODOMETRY:
            keys.link(edge)
            keys.optimise()


def _back_to(tear: OpenTear, first: OpenTear) -> list[OpenTear]:
    """Return the tears of a chain from the latest back to the first."""
    chain = tear.chain
    return list(chain[: 1 + next(k for k, each in enumerate(chain) if each is first)])


def _begun_at(tear: OpenTear, node: int) -> OpenTear:
    """Return a tear, of which the key scans before it are those of its part of the map, which begins at a key scan."""
    return replace(tear, before=tuple(k for k in tear.before if k >= node)) if tear.edge.j > node else tear


def _unchained(tear: OpenTear, edge: Edge) -> OpenTear:
    """Return a tear whose chain ends before the one with this edge."""
    if tear.earlier is None:
        return tear
    return replace(tear, earlier=None if tear.earlier.edge is edge else _unchained(tear.earlier, edge))
