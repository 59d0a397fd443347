"""A chair's peer: one step from the chair's own state and the messages heard to messages, authority and notices.

It touches no clock, network or file: the same steps give the same bytes. Every peer hears all States, and can become the
warden of its district. A peer without a warden keeps its chair where it is, and after a while lets it drive by its own eyes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import msgspec

from waychair.planning.fleet.peers import messages
from waychair.planning.fleet.peers.closures import Closures
from waychair.planning.fleet.peers.decision import WardenDecision
from waychair.planning.fleet.peers.election import Allegiance, Known, Voter, followed, followers, is_majority, standing
from waychair.planning.fleet.peers.electorate import adopted
from waychair.planning.fleet.peers.memory import BOOT_NS, HELLO_NS, REQUEST_NS, STATE_NS, HeardOthers, Times
from waychair.planning.fleet.peers.messages import (
    Answer,
    Blocked,
    Body,
    Electorate,
    Hello,
    Letter,
    Reader,
    Request,
    State,
    Wish,
    packed,
)
from waychair.planning.fleet.ways import Ways
from waychair.types import Json

if TYPE_CHECKING:
    from waychair.planning.fleet.peers.networked_warden import Office

START_NS = 3_000_000_000
"""A peer listens so long before it votes, as it has forgotten whom it followed."""

ALONE_NS = 4_500_000_000
"""A chair that wants to go and has no warden for so long says that it will drive by its own eyes: a take-over needs 4 s."""

ANNOUNCED_NS = 4_000_000_000
"""It does so then only: within this time the others have heard it, or miss it, and look before they enter."""

GAP_NS = 1_000_000_000
"""A step that is so late, or a clock that ran backwards: the computer slept, and its leases are nothing."""

DOUBLED_NS = 2_000_000_000
"""Two boots of one number that are both heard for so long are two chairs, not one that was started again."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """What all peers of a building know beforehand.

    `chairs` and `voters` are numbers; a chair votes as well. `ways` are of the whole district.
    """

    building: str
    ways: Ways
    chairs: frozenset[int]
    voters: frozenset[int] = frozenset()
    district: str = "all"
    clearing_ms: int = 3_000
    version: str = ""

    @property
    def numbers(self) -> frozenset[int]:
        """The numbers of all peers."""
        return self.chairs | self.voters


@dataclass(frozen=True, slots=True)
class OwnWish:
    """The chair's wish: its number, the refuge, the priority, and when it was made by the own clock [ns]."""

    number: int
    goal: str
    priority: int
    asked_ns: int


@dataclass(frozen=True, slots=True)
class Own:
    """The own chair now: see `messages.State`. A voter without a chair has entered nothing.

    `blocked`: sections that it has just seen shut, and for how long [ms] this is believed; 0: one is free again.
    """

    entered: tuple[int, ...] = ()
    visit: int = 0
    ready_ms: int = 0
    leaves_ms: tuple[int, ...] = ()
    wants: int = 0
    wish: OwnWish | None = None
    manual: bool = False
    parked: bool = False
    place: messages.Place | None = None
    blocked: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SpotAuthority:
    """What the chair may do.

    Attributes:
        spots: the spots after the front one that it may enter now, in their order.
        chain: all spots after the front one that it was granted.
        look: it has to see a spot free before it enters it.
        alone: it drives by its own eyes alone, slowly.
        others: the chair for which it waits.
        sentence: why it waits, for the rider.
        foreseen_ms: how long; -1: unknown.
        refused: the number of its wish, if that was refused.
        rule: by which rule the other one goes first, see `waits.Reason`.
    """

    spots: tuple[int, ...] = ()
    chain: tuple[int, ...] = ()
    look: bool = True
    alone: bool = False
    others: tuple[int, ...] = ()
    sentence: str = ""
    foreseen_ms: int = -1
    refused: int = 0
    rule: str = ""


@dataclass(frozen=True, slots=True)
class PeerStep:
    """The messages to send, to all peers or one, with their kinds; the authority; and sentences for people, once each.

    `electorate`: a new one, which the owner has to keep for the next start of this peer before it sends the messages. `records` are
    lines of the audit's log, of a warden only: each a wait that has ended, with its reason.
    """

    send: tuple[tuple[int | None, str, bytes], ...]
    authority: SpotAuthority
    notices: tuple[str, ...] = ()
    electorate: Electorate | None = None
    records: tuple[Json, ...] = ()


class Peer:
    """The peer of one chair, or of a voter without a chair."""

    def __init__(
        self, fleet: Fleet, number: int, boot: int, hello: Hello | None = None, electorate: Electorate | None = None
    ) -> None:
        """`boot` is a random number of this start of the program, above 0.

        `electorate`: the last one that an earlier start of this peer told its owner to remember; by default, everybody.
        """
        self.fleet, self.number, self.boot = fleet, number, boot
        everybody = Electorate(0, 0, tuple(sorted(fleet.numbers)))
        self.voter = Voter(number, boot, fleet.district, electorate or everybody)
        self.reader = Reader(fleet.building)
        self.allegiance = Allegiance()
        self.office: Office | None = None
        self.refused = ""
        self._hello = hello or Hello(version=fleet.version)
        self._heard = HeardOthers(Closures(frozenset(section.resource for section in fleet.ways.graph.sections)))
        self._times = Times()
        self._stance = 0
        self._mode = messages.IN_ORDER
        self._seq = 0
        self._last: State | None = None

    @property
    def grants(self) -> bool:
        """Whether this peer is the warden and may grant."""
        return self.office is not None and self._last is not None and self._last.grants

    @property
    def answered(self) -> int:
        """The number of the own wish that the last answer was about; 0: none."""
        return 0 if self._heard.answer is None else self._heard.answer.number

    @property
    def known(self) -> Mapping[int, Known]:
        """The other peers by their last States."""
        return self._heard.known

    def step(self, now_ns: int, own: Own, heard: Sequence[tuple[int, bytes]]) -> PeerStep:
        """Return what follows from the own chair and the messages since the last step, each with the number of its sender.

        `now_ns` is a monotonic clock that runs while the computer sleeps.
        """
        times = self._times
        if times.now == 0:
            times.start = times.warden = now_ns
        elif not 0 <= now_ns - times.now <= GAP_NS:
            self._slept(now_ns)
        times.now = now_ns
        electorate = self.voter.electorate
        notices = [
            said for who, data in self._heard.bearable(heard, self.reader) if (said := self._read(who, data, now_ns))
        ]
        notices += self._check_number(now_ns)
        if self.refused:
            return PeerStep((), SpotAuthority(alone=True, sentence=self.refused), tuple(notices))
        if self._heard.closures.report(own.blocked, "seen shut", now_ns):
            self._give_back()  # its way leads through there
        decision = self._vote(now_ns, own)
        self._choose_mode(now_ns, own)
        authority = self._authority(now_ns, own)
        send = self._messages(now_ns, own, authority, decision)
        new = None if self.voter.electorate is electorate else self.voter.electorate
        return PeerStep(send, authority, tuple(notices), new, decision.records)

    def _slept(self, now_ns: int) -> None:
        """Forget all leases and the warden: the computer was suspended, or its clock jumped."""
        self._heard.known.clear()
        self._heard.closures.forget()
        self._give_back()
        left = (
            self.allegiance.left
            if self.allegiance.term is None
            else max(self.allegiance.left, self.allegiance.term.epoch)
        )
        self.allegiance = Allegiance(left=left)
        self.office = None
        self._times = Times(now_ns, now_ns, warden=now_ns)

    def _give_back(self) -> None:
        """Give back all spots that the chair has not entered."""
        self._heard.answer = None
        self._stance += 1

    def _read(self, who: int, data: bytes, now_ns: int) -> str:
        """Take in a message; return advice about one that was refused."""
        letter, said = self.reader.read(data, who)
        if letter is None or letter.sender not in self.fleet.numbers or letter.boot in self._heard.dead:
            return said
        heard = self._heard
        if letter.boot == self.boot:
            return ""
        if letter.sender == self.number:
            if isinstance(letter.body, Hello):
                heard.uptimes[letter.boot] = letter.body.up_ms
            heard.doubled.setdefault(letter.boot, now_ns)
            return self._meets_double(letter, now_ns)
        if isinstance(letter.body, State):
            heard.take_state(letter, letter.body, now_ns)
        elif isinstance(letter.body, messages.Order):
            if self._is_of_warden(letter, letter.body.epoch):
                self.voter = adopted(self.voter, letter.body.electorate, self.fleet.numbers)
        elif isinstance(letter.body, Answer):
            self._take_answer(letter, letter.body)
        elif isinstance(letter.body, Blocked):
            heard.closures.hear(letter.sender, letter.body, now_ns)
        elif isinstance(letter.body, Request):
            known = heard.known.get(letter.sender)
            if known is not None and known.boot == letter.boot and known.state.stance == letter.body.stance:
                state = msgspec.structs.replace(known.state, wish=letter.body.wish)
                heard.known[letter.sender] = Known(known.number, known.boot, known.sent_ns, known.heard_ns, state)
        return ""

    def _meets_double(self, letter: Letter, now_ns: int) -> str:
        """Refuse to go on if another chair had this number before."""
        heard = self._heard
        if now_ns - self._times.start < START_NS or letter.boot not in heard.uptimes:
            return ""
        if now_ns - heard.doubled[letter.boot] < DOUBLED_NS or self.refused:
            return ""
        own = ((now_ns - self._times.start) // 1_000_000, self.boot)
        if (heard.uptimes[letter.boot], letter.boot) < own:
            return ""
        self.refused = f"Another chair has the number {self.number} already: give this one a number of its own."
        return self.refused

    def _check_number(self, now_ns: int) -> list[str]:
        """Return a sentence for each number that two chairs have."""
        said = []
        for number, since_ns in list(self._heard.doubled.items()):
            if number in self._heard.known and now_ns - since_ns > DOUBLED_NS + BOOT_NS:
                del self._heard.doubled[number]
                said.append(f"Two chairs have the number {number}: the second is not heard.")
        return said

    def _take_answer(self, letter: Letter, answer: Answer) -> None:
        """Keep an answer of the warden that this peer follows, if it is for this boot and stance and newer than the last."""
        if answer.chair != self.number or answer.boot != self.boot or answer.stance != self._stance:
            return
        if not self._is_of_warden(letter, answer.epoch):
            return
        if answer.word == messages.REVOKED:
            self._give_back()
            return
        last = self._heard.answer
        if last is None or (answer.serial, answer.echo_ns, answer.upto) >= (last.serial, last.echo_ns, last.upto):
            self._heard.answer = answer

    def _is_of_warden(self, letter: Letter, epoch: int) -> bool:
        """Return whether a word of some epoch comes from the warden that this peer follows, in that term."""
        term = self.allegiance.term
        return term is not None and (letter.sender, letter.boot, epoch) == (term.warden, term.boot, term.epoch)

    def _vote(self, now_ns: int, own: Own) -> WardenDecision:
        """Follow a warden, or be one; return what the own office decides."""
        alone = self.voter.electorate.members == (self.number,)
        if self.number not in self.fleet.numbers or (now_ns - self._times.start < START_NS and not alone):
            return WardenDecision()
        before = self.allegiance
        known = self._heard.known
        self.allegiance = followed(self.voter, before, known, now_ns)
        term = self.allegiance.term
        if term is not None and term.warden == self.number and self._is_passed(now_ns):
            self.allegiance = standing(self.voter, self.allegiance, known)
            term = self.allegiance.term
        if term != before.term:
            self._give_back()
            self.office = None
        if term is None or term.warden != self.number:
            return WardenDecision()
        if self.office is None and not is_majority(self.voter.electorate, followers(self.voter, term, known, now_ns)):
            return WardenDecision()
        # late: it takes 60 MB, which only a warden has to pay
        from waychair.planning.fleet.peers.networked_warden import Office, ordered

        self.office = self.office or Office(term)
        state = self._state(now_ns, own, SpotAuthority(), grants=False)
        mine = Known(self.number, self.boot, now_ns, now_ns, state)
        decision = ordered(
            self.office,
            self.voter,
            self.fleet.ways,
            self.fleet.clearing_ms,
            self.fleet.chairs,
            {**known, self.number: mine},
            self._heard.closures.left_ms(now_ns),
            now_ns,
        )
        for answer in decision.answers:
            if answer.chair == self.number and answer.word == messages.REVOKED:
                self._give_back()
            elif answer.chair == self.number:
                self._heard.answer = answer
        if decision.begins_again:
            self.allegiance, self.office = standing(self.voter, self.allegiance, known), None
            self._give_back()
        if decision.electorate is not None:
            self.voter = replace(self.voter, electorate=decision.electorate)
        return decision

    def _is_passed(self, now_ns: int) -> bool:
        """Return whether a peer that this warden hears can no longer follow its epoch."""
        term = self.allegiance.term
        assert term is not None
        return any(
            now_ns - each.heard_ns <= GAP_NS
            and each.state.follows != term
            and (each.state.left >= term.epoch or each.state.term > term.epoch)
            for each in self._heard.known.values()
        )

    def has_warden(self) -> bool:
        """Return whether this peer follows a warden that grants, or is one."""
        term = self.allegiance.term
        if term is None:
            return False
        if term.warden == self.number:
            return self.grants
        warden = self._heard.known.get(term.warden)
        return warden is not None and warden.state.grants

    def _choose_mode(self, now_ns: int, own: Own) -> None:
        """Keep the order, drive by eye, or let the rider steer."""
        times = self._times
        if self.has_warden():
            times.warden, times.alone = now_ns, None
        elif times.alone is None and own.wish is not None and now_ns - times.warden >= ALONE_NS:
            times.alone = now_ns
        mode = messages.MANUAL if own.manual else messages.IN_ORDER if times.alone is None else messages.ALONE
        if mode != self._mode:
            self._mode = mode
            self._give_back()

    def _authority(self, now_ns: int, own: Own) -> SpotAuthority:
        """Return what the chair may enter by the last answer, as long as its lease lasts."""
        times, answer = self._times, self._heard.answer
        if self._mode == messages.ALONE:
            may_move = times.alone is not None and now_ns - times.alone >= ANNOUNCED_NS
            return SpotAuthority(
                alone=may_move, sentence="No other chair can be heard: drives slowly and looks before it goes."
            )
        if answer is None or self._mode != messages.IN_ORDER:
            return SpotAuthority()
        look = answer.look or self._heard.misses_somebody(self.fleet.chairs - {self.number}, now_ns)
        first = own.visit - answer.visit
        if not own.entered or not 0 <= first < len(answer.spots) or answer.spots[first] != own.entered[-1]:
            return SpotAuthority(look=look)
        chain = answer.spots[first + 1 :]
        free = max(answer.upto - own.visit, 0)
        if not 0 <= now_ns - answer.echo_ns <= answer.lease_ms * 1_000_000:
            free = 0
        return SpotAuthority(
            chain[:free],
            chain,
            look,
            False,
            answer.why.others,
            answer.why.sentence,
            answer.why.foreseen_ms,
            answer.number if answer.word == messages.REJECTED else 0,
            answer.why.rule,
        )

    def _state(self, now_ns: int, own: Own, authority: SpotAuthority, grants: bool) -> State:
        term, wish = self.allegiance.term, own.wish
        return State(
            entered=own.entered,
            visit=own.visit,
            released=authority.spots,
            ready_ms=own.ready_ms,
            leaves_ms=own.leaves_ms,
            wants=own.wants,
            mode=self._mode,
            stance=self._stance,
            follows=term,
            echo_ns=self.allegiance.echo_ns,
            left=self.allegiance.left,
            term=term.epoch if term is not None and term.warden == self.number else 0,
            grants=grants,
            parked=own.parked,
            electors=self.voter.electorate.version,
            wish=None
            if wish is None or self._mode != messages.IN_ORDER
            else Wish(wish.number, wish.goal, wish.priority, max(now_ns - wish.asked_ns, 0) // 1_000_000),
            place=own.place,
        )

    def _messages(
        self, now_ns: int, own: Own, authority: SpotAuthority, decision: WardenDecision
    ) -> tuple[tuple[int | None, str, bytes], ...]:
        """Return the messages that are due: a State at once where it differs from the last."""
        times = self._times
        bodies: list[tuple[int | None, Body]] = [(answer.chair, answer) for answer in decision.answers]
        bodies += [(None, blocked) for blocked in self._heard.closures.due(now_ns)]
        if decision.order is not None:
            bodies.append((None, decision.order))
        state = self._state(now_ns, own, authority, decision.grants)
        if now_ns - times.state >= STATE_NS or self._differs(state):
            times.state = now_ns
            bodies.append((None, state))
        term = self.allegiance.term
        answered = (
            self._heard.answer is not None
            and state.wish is not None
            and (self._heard.answer.number == state.wish.number)
        )
        if state.wish is not None and not answered and term is not None and now_ns - times.request >= REQUEST_NS:
            times.request = now_ns
            if term.warden != self.number:
                bodies.append((term.warden, Request(self._stance, state.wish)))
        if now_ns - times.hello >= HELLO_NS:
            times.hello = now_ns
            up_ms = (now_ns - times.start) // 1_000_000
            bodies.append((None, msgspec.structs.replace(self._hello, up_ms=up_ms)))
        self._last = state
        return tuple(
            (to, type(body).__name__.lower(), self._packed(now_ns, body)) for to, body in bodies if to != self.number
        )

    def _differs(self, new: State) -> bool:
        """Return whether the others have to know at once."""
        old = self._last
        return old is None or (
            (old.entered, old.visit, old.wants, old.mode, old.stance, old.follows, old.term, old.grants)
            != (new.entered, new.visit, new.wants, new.mode, new.stance, new.follows, new.term, new.grants)
            or (old.parked, old.electors) != (new.parked, new.electors)
        )

    def _packed(self, now_ns: int, body: Body) -> bytes:
        self._seq += 1
        return packed(self.fleet.building, self.number, self.boot, self._seq, now_ns, body)
