"""A chair as a member of a live fleet: its driver and peer, its network, its wish, and the words for its rider.

The owner steps it ten times a second; between two steps another thread may let it answer the messages so far, see `prompt_answers.py`.
It gives the chair's authority and goals; everything that stops the chair stays in the chair.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from waychair.control.drive.navigation import Navigation
from waychair.planning.fleet.peers.peer import Fleet, OwnWish, Peer
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Reason, Wait
from waychair.runtime.fleet.audit_file import AuditFile
from waychair.runtime.fleet.chain_driving import ChainDriver, Steps
from waychair.runtime.fleet.desk.desk_messages import GIVEN_LAPSES_NS, TOLD, TOLD_NS, Given, Told, note_bytes, note_from
from waychair.runtime.fleet.electorate_file import kept_electorate
from waychair.runtime.fleet.peer_driving import PeerDriver
from waychair.runtime.fleet.peer_post import FleetTransport, Measures, PeerPost
from waychair.runtime.fleet.shut_ways import ShutWays
from waychair.runtime.fleet.spot_sight import SpotSight
from waychair.runtime.pages.chair_port import OthersView
from waychair.types import Pose2

SILENT_NS = 3_000_000_000
"""A chair that was not heard for so long is told to the rider as such."""

AGAIN_NS = 5_000_000_000
"""A wish that was refused is made again after so long: the building may have changed."""

_RULES = {each.value: each for each in Reason}

_GOES_FIRST = {
    Priority.TOP: "Goes before all others: staff said so.",
    Priority.APPOINTMENT: "Goes first: you have an appointment.",
}


@dataclass(frozen=True, slots=True)
class MemberStep:
    """The results of a step: authority and goals, the present wait, the rider's sentence, and sentences for people.

    `tone`: see `PeerSteps`.
    """

    driven: Steps
    wait: Wait | None
    told: str
    notices: tuple[str, ...]
    tone: bool = False


class FleetMember:
    """The part of one chair in its fleet."""

    def __init__(
        self,
        fleet: Fleet,
        number: int,
        boot: int,
        driver: ChainDriver,
        start: str | Sequence[int],
        transport: FleetTransport,
        log: AuditFile | None = None,
        memory: Path | None = None,
    ) -> None:
        """`start`: the refuge in which the chair stands, or the spots in which it is, from its rear to its front.

        `log` takes down what this chair decides while it is the warden; `memory` keeps the peers that are counted, see `electorate_file.py`.
        """
        peer = Peer(fleet, number, boot, electorate=kept_electorate(memory, fleet.numbers))
        self.driver = PeerDriver(fleet.ways, peer, driver, start)
        self.has_news = False
        """Whether an answer since the last step has changed what the chair may enter."""
        self._shut = ShutWays(driver)
        self._post = PeerPost(transport, log, memory)
        self._lock = threading.RLock()  # for all below, and the driver
        self._said: list[str] = []  # sentences for people since the last step
        self._fleet = fleet
        self._wish: OwnWish | None = None
        self._wishes = 0
        self._given: tuple[Priority, int] | None = None  # by staff, and when it was heard last
        self._refused: tuple[str, int] | None = None
        self._waits_since_ns: int | None = None
        self._present: Wait | None = None
        self._others: dict[int, Told] = {}  # the others' last words
        self._told = Told(), 0  # the last word to all, and when

    @property
    def entered(self) -> tuple[int, ...]:
        """The spots in which the chair is, from its rear to its front."""
        return self.driver.entered

    def want(self, goal: str | None, now_ns: int, priority: Priority = Priority.ROUTINE) -> None:
        """Wish for a refuge, or for none any more."""
        with self._lock:
            self._wish = self._refused = None
            self._post.forget_request()
            if goal is not None:
                self._wishes += 1
                self._wish = OwnWish(self._wishes, goal, priority, now_ns)

    def step(
        self,
        now_ns: int,
        pose: Pose2,
        goals_left: int,
        manual: bool = False,
        sight: SpotSight | None = None,
        navigation: Navigation | None = None,
    ) -> MemberStep:
        """Return the results of `map_from_base`, the goals of the last chain that are left, and what has come.

        `now_ns` is a monotonic clock that runs while the computer sleeps; `sight`: see `PeerDriver.step`. By its `navigation` the
        chair finds sections shut, which it tells the others.
        """
        with self._lock:
            return self._step(self._post.begin(now_ns), pose, goals_left, manual, sight, navigation)

    def answer(self, now_ns: int) -> None:
        """Take the messages so far, and answer them, between two steps: from any thread."""
        with self._lock:
            if not self.driver.can_answer:
                return
            now_ns, before = self._post.begin(now_ns), self.driver.authority
            step = self.driver.answer(now_ns, self._post.transport.received())
            self._said += self._post.pass_on(step)
            self._measure()
            self.has_news = self.has_news or step.authority != before

    def _step(
        self,
        now_ns: int,
        pose: Pose2,
        goals_left: int,
        manual: bool,
        sight: SpotSight | None,
        navigation: Navigation | None,
    ) -> MemberStep:
        self._hear_aside(now_ns)
        heard = self._post.transport.received()
        wish = None if self._wish is None else replace(self._wish, priority=int(self._priority(now_ns)))
        found = self.driver.step(now_ns, pose, goals_left, heard, wish, manual, sight)
        self.has_news = False
        said = (*self._said, *self._post.pass_on(found.peer))
        self._said.clear()
        self._measure()
        self._retry(now_ns)
        wait = self._present = self._wait(now_ns)
        told = self.driver.authority.sentence if self._refused is None else self._refused[0]
        self._tell(now_ns, wait, told)
        if navigation is not None and not manual:
            self._note_shut(now_ns, navigation, pose)
        return MemberStep(found.driven, wait, told, said, found.tone)

    def measured(self) -> Measures:
        """Return the measures since the last call."""
        with self._lock:
            return self._post.taken_measures()

    def stand_in(self, spots: Sequence[int]) -> None:
        """Go on from other spots, see `PeerDriver.stand_in`."""
        with self._lock:
            self.driver.stand_in(spots)

    def park(self) -> None:
        """Say from now on that the chair is about to be switched off, if it stands in a refuge: the others count it no more."""
        self.driver.parked = True

    def others(self, now_ns: int) -> OthersView:
        """Return the other chairs, and the present wait, for the rider's page."""
        with self._lock:
            return self._others_view(now_ns)

    def _others_view(self, now_ns: int) -> OthersView:
        wait = self._present
        seconds = None if wait is None or wait.foreseen_ms is None else wait.foreseen_ms / 1e3
        known = self.driver.peer.known
        found = []
        for number in sorted(self._fleet.chairs - {self.driver.peer.number}):
            if number not in known:
                continue
            told = self._others.get(number, Told())
            is_heard = now_ns - known[number].heard_ns <= SILENT_NS
            goal = f"On the way to {told.goal}." if told.goal else "Stands by."
            found.append((number, (told.told or goal) if is_heard else "Cannot be heard."))
        priority = Priority.ROUTINE if self._wish is None else self._priority(now_ns)
        first = _GOES_FIRST.get(priority, "") if wait is None or priority is Priority.TOP else ""
        why = "" if wait is None else wait.why
        return OthersView(why, seconds, tuple(found), first=first, lit=priority is Priority.TOP)

    def _priority(self, now_ns: int) -> Priority:
        """Return the wish's priority: that of staff while they repeat it."""
        assert self._wish is not None
        if self._given is not None and now_ns - self._given[1] <= GIVEN_LAPSES_NS:
            return self._given[0]
        return Priority(self._wish.priority)

    def _hear_aside(self, now_ns: int) -> None:
        for sender, data in self._post.transport.received_aside():
            told = note_from(Told, data) if sender in self._fleet.chairs else None
            if told is not None:
                self._others[sender] = told
            given = note_from(Given, data) if sender in self._fleet.voters else None
            if given is not None and given.chair == self.driver.peer.number:
                self._given = Priority(given.priority), now_ns

    def _note_shut(self, now_ns: int, navigation: Navigation, pose: Pose2) -> None:
        """Tell the others of a section that the chair finds shut; one that drives by its own eyes looks for itself."""
        others = [
            Pose2(1e-3 * place.x_mm, 1e-3 * place.y_mm, 1e-3 * place.heading_mrad)
            for each in self.driver.peer.known.values()
            if (place := each.state.place) is not None
        ]
        held = self._present is not None
        found = self._shut.step(now_ns // 1_000_000, navigation, pose, held, others)
        if found and not self.driver.authority.alone:
            self.driver.note_shut(found)

    def _measure(self) -> None:
        self._post.measure(self.driver.peer, 0 if self._wish is None else self._wish.number)

    def _retry(self, now_ns: int) -> None:
        """Wish again, after a while, for a goal that was refused."""
        authority = self.driver.authority
        if self._wish is None or authority.refused != self._wish.number:
            return
        if self._refused is None:
            self._refused = authority.sentence, now_ns
        elif now_ns - self._refused[1] > AGAIN_NS:
            self.want(self._wish.goal, now_ns, Priority(self._wish.priority))

    def _wait(self, now_ns: int) -> Wait | None:
        """Return the wait that the chair's peer tells; none while the chair may go on."""
        authority, wish = self.driver.authority, self._wish
        if wish is None or not self.driver.waits or not authority.sentence or authority.alone:
            self._waits_since_ns = None
            return None
        self._waits_since_ns = now_ns if self._waits_since_ns is None else self._waits_since_ns
        return Wait(
            self.driver.peer.number,
            authority.others[0] if authority.others else None,
            self._fleet.ways.names[authority.chain[0]] if authority.chain else wish.goal,
            _RULES.get(authority.rule, Reason.FIRST),
            (self._priority(now_ns), None),
            (now_ns - self._waits_since_ns) // 1_000_000,
            authority.foreseen_ms if authority.foreseen_ms >= 0 else None,
        )

    def _tell(self, now_ns: int, wait: Wait | None, told: str) -> None:
        """Tell all the words of this chair: at once where it differs, but for the seconds that pass."""
        wish = self._wish
        word = Told(
            "" if wish is None else wish.goal,
            0 if wish is None else int(self._priority(now_ns)),
            told[:300],
            wait is not None,
            None if wait is None else wait.other,
            "" if wait is None else wait.place,
            "" if wait is None else wait.reason.value,
            -1 if wait is None or wait.foreseen_ms is None else wait.foreseen_ms,
            0 if wait is None else wait.waited_ms,
        )
        last, told_ns = self._told
        same = (word.goal, word.priority, word.waits, word.other, word.place) == (
            *(last.goal, last.priority, last.waits, last.other, last.place),
        )
        if same and now_ns - told_ns < TOLD_NS:
            return
        self._told = word, now_ns
        self._post.transport.send(None, TOLD, note_bytes(word))
