"""A whole chair among peers: it drives along its chain as its peer's authority lets it, and tells the peer where it is.

The chair enters the next spots only once its peer may let it in; it asks for them a little before it has to brake. Between two
steps of the chair its peer may answer others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from waychair.planning.fleet.order import Chain, Order, Turn
from waychair.planning.fleet.peers.messages import Place
from waychair.planning.fleet.peers.peer import Own, OwnWish, Peer, PeerStep, SpotAuthority
from waychair.planning.fleet.ways import Ways
from waychair.runtime.fleet.alone_driving import AloneDriver, AloneWay, Seen, speed_by_eye
from waychair.runtime.fleet.chain_driving import ChainDriver, Steps
from waychair.runtime.fleet.spot_sight import SpotSight
from waychair.types import Pose2

ASKED_BEFORE_MS = 4_000
"""ms before the end of its spot at which a chair asks for the next ones: it brakes from 1.6 m before, at 0.45 m/s."""

_OTHERS = 0xFFFF
"""Stands for the other chair in a queue; who it is does not matter to the driver."""


@dataclass(frozen=True, slots=True)
class PeerSteps:
    """The results of a step: the driver's authority and goals, the peer's messages and words, and the tone before a run.

    The tone is to be sounded where a chair that drives by its own eyes comes out of a place aside.
    """

    driven: Steps
    peer: PeerStep
    tone: bool = False


class PeerDriver:
    """The driver of one chair and its peer, stepped together ten times a second."""

    def __init__(self, ways: Ways, peer: Peer, driver: ChainDriver, start: str | Sequence[int]) -> None:
        """`start`: the refuge in which the chair stands, or the spots in which it is, from its rear to its front."""
        self.peer, self.driver = peer, driver
        self.authority = SpotAuthority()
        self.waits = False
        """Whether it may not go on to the next place where it disturbs nobody by waiting."""
        self.parked = False
        """Whether its owner is about to switch it off."""
        self.alone = AloneDriver(ways)
        self._ways = ways
        spots = (ways.slots[start][0],) if isinstance(start, str) else tuple(start)
        driver.stand_in(spots)
        self._spots: dict[int, int] = dict(enumerate(spots))  # by the number of the visit
        self._visit = self._behind = len(spots) - 1
        self._shut: dict[str, int] = {}
        self._own: Own | None = None

    def stand_in(self, spots: Sequence[int]) -> None:
        """Go on from other spots, from the rear to the front of a chair that was pushed or driven by its rider."""
        first = self._visit + 1
        self._spots = dict(enumerate(spots, start=first))
        self._visit, self._behind = first + len(spots) - 1, len(spots) - 1
        self.driver.stand_in(spots, self._visit)
        self.authority, self._own = SpotAuthority(), None

    @property
    def entered(self) -> tuple[int, ...]:
        """The spots in which the chair is, from its rear to its front."""
        return tuple(self._spots[visit] for visit in range(self._visit - self._behind, self._visit + 1))

    def step(
        self,
        now_ns: int,
        pose: Pose2,
        goals_left: int,
        heard: Sequence[tuple[int, bytes]],
        wish: OwnWish | None,
        manual: bool = False,
        sight: SpotSight | None = None,
    ) -> PeerSteps:
        """Return the results of `map_from_base`, the goals left and the messages since the last step.

        `sight`: the chair's eyes, for spots that it has to see free before it enters them, and by which it drives alone; without
        them it takes its order's word, and stands where there is none.
        """
        authority = self.authority
        tone = False
        if authority.alone and sight is not None:
            way = self._by_eye(now_ns // 1_000_000, wish, sight.seen(pose))
            chain, free, tone = way.chain, way.free, way.tone
        else:
            chain, free = authority.chain, len(authority.spots)
            if authority.look and sight is not None:
                free = next((k for k, spot in enumerate(authority.spots) if not sight.is_free(spot)), free)
        order = seen_order(self._ways, self.peer.number, self.entered, self._visit, chain, free)
        self._spots |= {self._visit + k: spot for k, spot in enumerate(chain, start=1)}
        driven = self.driver.step(order, pose, now_ns // 1_000_000, goals_left, authority.sentence)
        if authority.alone:
            speed = speed_by_eye(self._ways, (*self.entered, *chain[:free]))
            driven = replace(driven, authority=replace(driven.authority, speed=speed))
        self._visit, self._behind = driven.report.visits, driven.report.behind
        self._spots = {visit: spot for visit, spot in self._spots.items() if visit >= self._visit - self._behind}
        wants = 0
        if wish is not None and driven.report.ready_in_ms <= ASKED_BEFORE_MS:
            wants = max(self.driver.wanted, 1)
        own = Own(
            self.entered,
            self._visit,
            driven.report.ready_in_ms,
            driven.report.leaves_in_ms,
            wants,
            wish,
            manual,
            self.parked and len(self.entered) == 1 and bool(self._ways.at_home[self.entered[0]]),
            Place(x_mm=round(1e3 * pose.x), y_mm=round(1e3 * pose.y), heading_mrad=round(1e3 * pose.theta)),
            blocked=self._shut,
        )
        self._shut = {}
        self._own = replace(own, blocked={})
        step = self.peer.step(now_ns, own, heard)
        self.authority = step.authority
        self.waits = wants > len(step.authority.spots)
        return PeerSteps(driven, step, tone)

    @property
    def can_answer(self) -> bool:
        """Whether the chair is where it was at its last step, so that its peer can answer without another one."""
        return self._own is not None

    def answer(self, now_ns: int, heard: Sequence[tuple[int, bytes]]) -> PeerStep:
        """Step the peer alone, by what the chair was at its last step; only where it `can_answer`."""
        assert self._own is not None
        step = self.peer.step(now_ns, self._own, heard)
        self.authority = step.authority
        return step

    def note_shut(self, sections: Mapping[str, int]) -> None:
        """Tell the others that the chair stands before sections that are shut, for some ms each, and give back its way there."""
        self._shut = dict(sections)
        self._withdraw()
        self.authority, self._own = SpotAuthority(sentence=self.authority.sentence), None

    def _withdraw(self) -> bool:
        """Give back a section that the chair is not wholly in; return whether there was one."""
        if not self._behind:
            return False
        order = seen_order(self._ways, self.peer.number, self.entered, self._visit, (), 0)
        if self.driver.withdraw(order) is order:
            return False
        self._note_given_back(1)
        return True

    def _note_given_back(self, spots: int) -> None:
        self._visit, self._behind = self._visit - spots, self._behind - spots

    def _by_eye(self, now_ms: int, wish: OwnWish | None, seen: Seen) -> AloneWay:
        """Return the way of a chair that hears no warden; it first gives back the spots before it in which it sees something.

        Where it backs out, it gives back a section that it is not wholly in.
        """
        entered = self.entered
        lost = self.alone.lost(entered, len(entered) - self.driver.unreached, seen)
        self.driver.give_back(lost)
        self._note_given_back(lost)
        goal = None if wish is None else wish.goal
        before = self.alone.retreats
        way = self.alone.step(now_ms, self.entered[-1], goal, seen)
        goes_back = self._behind > 0 and way.chain[:1] == self.entered[-2:-1]
        if self.alone.retreats > before and goes_back and self._withdraw():
            way = self.alone.step(now_ms, self.entered[-1], goal, seen)
        return way


def seen_order(ways: Ways, number: int, entered: Sequence[int], visit: int, chain: Sequence[int], free: int) -> Order:
    """Return the order as one chair knows it: its own chain, of which it may enter the first `free` spots."""
    first = visit - len(entered) + 1
    behind = tuple((first + k, spot) for k, spot in enumerate(entered[:-1]))
    queues: dict[int, tuple[Turn, ...]] = {}
    for k, spot in enumerate((*entered, *chain)):
        resource = int(ways.resource[spot])
        turn = Turn(number, first + k)
        before = () if k < len(entered) + free else (Turn(_OTHERS, 0),)
        queues[resource] = (*queues.get(resource, before), turn)
    return Order(ways, {number: Chain((entered[-1], *chain), visit, behind=behind)}, queues)
