"""The warden of a district over a network: it hears States, and answers with the spots that each chair may enter now.

It keeps an order as `warden.py` does, with one difference: a spot counts as entered from the moment in which the warden allows it,
not from the moment in which the chair is there. So no later plan takes back what a chair may be doing just then. A chair that
gives up all that it has not entered says so by a new stance; then the order is made again from what the chairs say.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from waychair.planning.fleet.order import Order, Request, Turn, with_priorities
from waychair.planning.fleet.peers import messages
from waychair.planning.fleet.peers.claims import Claim, claim_of, is_known, kept, order_of
from waychair.planning.fleet.peers.decision import SILENT_NS, WardenDecision
from waychair.planning.fleet.peers.election import Known, Voter, followers, is_majority
from waychair.planning.fleet.peers.electorate import next_electorate
from waychair.planning.fleet.peers.messages import Answer, Queue, Term, Version, Why
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Audit, Wait
from waychair.planning.fleet.warden import ChairReport, Heard, Reply, WardenState, decided
from waychair.planning.fleet.warden import RequestWord as Word
from waychair.planning.fleet.ways import NEVER, Ways
from waychair.types import Json

LEASE_MS = 500
"""ms for which a chair may enter what it was allowed, from when it sent the State that the answer answers: two States, and the way
to the warden and back."""

LISTEN_NS = 2_200_000_000
"""A new warden listens longer than any lease of an earlier one, unless all chairs have told before.

The last lease of an earlier warden runs from a State that came before its majority ended.
"""

AGAIN_NS = 400_000_000
"""An answer is repeated so often; one that lets a chair in is renewed with each State until the chair has entered."""

ORDER_NS = 1_000_000_000
"""The order is told so often."""

STANDS_MS = 2_000
"""ms from the end of its spot within which a chair stands that may not enter all that it wants: its refuge is longer than it."""

_NUMBERS = 1 << 32


@dataclass(slots=True)
class Office:
    """What a warden knows in one term.

    Attributes:
        term: the term.
        boots: the boots of followers that are counted in this term.
        since_ns: when the majority was first counted.
        district: the order, once the chairs were heard.
        stances: boot and stance of each chair that keeps the order.
        absent: the claims of chairs that do not, or are silent.
        heard: the time of the last State of each chair that went into the order.
        refused: numbers of wishes that were refused, with the sentence, by chair.
        answers: the last answer to each chair, and when it was sent.
        told_ns: when the order was told.
        told_electors: the version of the electorate that was told with it.
        waits: the present waits.
        audit: the waits as they begin and end.
    """

    term: Term
    boots: dict[int, int] = field(default_factory=dict)
    since_ns: int | None = None
    district: WardenState | None = None
    stances: dict[int, tuple[int, int]] = field(default_factory=dict)
    absent: dict[int, Claim] = field(default_factory=dict)
    heard: dict[int, int] = field(default_factory=dict)
    refused: dict[int, tuple[int, str]] = field(default_factory=dict)
    answers: dict[int, tuple[Answer, int]] = field(default_factory=dict)
    told_ns: int = 0
    told_electors: Version = (0, 0)
    waits: tuple[Wait, ...] = ()
    audit: Audit = field(default_factory=Audit)


def counted(office: Office, own: Voter, known: Mapping[int, Known], found: Collection[int]) -> bool:
    """Return whether those `found` to follow are a majority; one that has booted again is counted where the others are one.

    It may have followed somebody else since, and forgotten it.
    """
    boots = {each.number: each.boot for each in known.values()} | {own.number: own.boot}
    office.boots.setdefault(own.number, own.boot)
    if office.since_ns is None:
        office.boots.update({number: boots[number] for number in found})
    old = {number for number in found if office.boots.get(number) == boots[number]}
    if not is_majority(own.electorate, old):
        return False
    office.boots.update({number: boots[number] for number in found})
    return True


def ordered(
    office: Office,
    own: Voter,
    ways: Ways,
    clearing_ms: int,
    chairs: frozenset[int],
    known: Mapping[int, Known],
    blocked_ms: Mapping[str, int],
    now_ns: int,
) -> WardenDecision:
    """Return the warden's decision from the last States of all peers, its own among them, and take it down in the office.

    `blocked_ms` are the sections that chairs see shut, and for how long that is believed.
    """
    following = followers(own, office.term, known, now_ns)
    if not counted(office, own, known, following):
        return WardenDecision(begins_again=is_majority(own.electorate, following))
    if office.since_ns is None:
        office.since_ns = now_ns
    now_ms = now_ns // 1_000_000
    loyal = {
        number: each
        for number, each in known.items()
        if number in chairs and _keeps_order(office, each) and now_ns - each.heard_ns <= SILENT_NS
    }
    if office.district is None:
        if any(number not in loyal for number in chairs) and now_ns - office.since_ns < LISTEN_NS:
            return WardenDecision()
        office.district = WardenState(order_of(ways, {}, now_ms), clearing_ms, own.number)
    afresh = _is_changed(office, loyal, known, chairs, now_ms)
    if afresh:
        order = _taken_over(office, ways, loyal, known, chairs, now_ms)
        office.district = _with_closed(office, replace(office.district, order=order), now_ms)
    _decide(office, loyal, blocked_ms, now_ns, afresh)
    look = any(number not in loyal and not (number in known and known[number].state.parked) for number in chairs)
    twice = _claimed_twice(office, loyal)
    answers = _answers(office, loyal, look or bool(twice), {chair for chairs in twice for chair in chairs}, now_ns)
    told = None
    if afresh or office.told_electors != own.electorate.version or now_ns - office.told_ns >= ORDER_NS:
        office.told_ns, office.told_electors = now_ns, own.electorate.version
        told = _told(own, office)
    electorate = next_electorate(own, office.term, known, following)
    return WardenDecision(True, False, answers, told, electorate, _ended_waits(office, now_ms))


def _taken_over(
    office: Office,
    ways: Ways,
    loyal: Mapping[int, Known],
    known: Mapping[int, Known],
    chairs: frozenset[int],
    now_ms: int,
) -> Order:
    """Return the order from all claims; a chair that kept its stance claims all that it was allowed.

    A chair that does not keep the order is no part of it: what it claims is closed.
    """
    before = None if office.district is None else office.district.order
    claims: dict[int, Claim] = {}
    absent: dict[int, Claim] = {}
    stances: dict[int, tuple[int, int]] = {}
    for number in sorted(chairs & set(known)):
        each = known[number]
        stance = (each.boot, each.state.stance)
        claim = _claim(office, before, number, each, now_ms)
        if claim is None or not is_known(ways, claim):
            continue
        if _keeps_order(office, each):
            stances[number] = stance
        if number in loyal:
            claims[number] = claim
        else:
            absent[number] = claim
    office.stances, office.absent = stances, absent
    office.answers.clear()
    return order_of(ways, claims, now_ms)


def _claim(office: Office, before: Order | None, number: int, each: Known, now_ms: int) -> Claim | None:
    """Return what a chair is in or may enter: by the order as long as it keeps its stance, else by its own word."""
    if not _keeps_order(office, each):
        return claim_of(each.state, with_released=True)
    if office.stances.get(number) != (each.boot, each.state.stance):
        return claim_of(each.state, with_released=False)
    is_in = before is not None and number in before.chains
    claim = kept(before, number, now_ms) if before is not None and is_in else office.absent.get(number)
    if claim is None or not set(each.state.entered) <= set(claim.spots):  # somebody pushed it
        return claim_of(each.state, with_released=True)
    return claim


def _keeps_order(office: Office, each: Known) -> bool:
    return each.state.follows == office.term and each.state.mode == messages.IN_ORDER


def _is_changed(
    office: Office, loyal: Mapping[int, Known], known: Mapping[int, Known], chairs: frozenset[int], now_ms: int
) -> bool:
    """Return whether a chair has given something back, has come or gone, or drives by its own eyes."""
    assert office.district is not None
    order = office.district.order
    for number in chairs & set(known):
        each = known[number]
        if not each.state.entered:
            continue
        if (number in loyal) != (number in order.chains):
            return True
        if number in loyal:
            stance = (each.boot, each.state.stance)
            if office.stances.get(number) != stance or not _is_there(order, number, each):
                return True
        elif _claim(office, order, number, each, now_ms) != office.absent.get(number):
            return True
    return False


def _is_there(order: Order, number: int, each: Known) -> bool:
    """Return whether a chair is in no spot but those that it was allowed to enter."""
    chain = order.chains[number]
    return set(each.state.entered) <= {chain.spots[0], *(spot for _, spot in chain.behind)}


def _with_closed(office: Office, district: WardenState, now_ms: int) -> WardenState:
    """Return the district with all resources closed in which a chair is that does not keep the order."""
    ways = district.order.ways
    blocked = {resource: until for resource, until in district.blocked_until_ms.items() if now_ms < until < NEVER}
    for claim in office.absent.values():
        blocked.update({int(ways.resource[spot]): NEVER for spot in claim.spots})
    return replace(district, blocked_until_ms=blocked)


def _decide(
    office: Office, loyal: Mapping[int, Known], blocked_ms: Mapping[str, int], now_ns: int, afresh: bool
) -> None:
    """Take the States since the last time into the order, with the sections that are shut now."""
    assert office.district is not None
    order = _reprioritised(office.district.order, loyal)
    now_ms = now_ns // 1_000_000
    reports: list[ChairReport] = []
    requests: list[Request] = []
    for number, each in loyal.items():
        if number not in order.chains or (office.heard.get(number) == each.sent_ns and not afresh):
            continue
        office.heard[number] = each.sent_ns
        reports.append(_report(order, number, each))
        request = _request(office, order, number, each, now_ms)
        if request is not None:
            requests.append(request)
    if not (reports or requests or afresh):
        return
    closed = {resource: until for resource, until in office.district.blocked_until_ms.items() if until >= NEVER}
    before = replace(office.district, order=order, blocked_until_ms=closed)
    state, replies, office.waits = decided(before, Heard(tuple(reports), tuple(requests), blocked_ms), now_ms)
    office.district = state
    _note_refusals(office, replies, requests)


def _reprioritised(order: Order, loyal: Mapping[int, Known]) -> Order:
    """Return the order with the priorities that the chairs' present wishes have."""
    wanted = {
        number * _NUMBERS + each.state.wish.number: Priority(each.state.wish.priority)
        for number, each in loyal.items()
        if each.state.wish is not None
    }
    return with_priorities(order, wanted)


def _report(order: Order, number: int, each: Known) -> ChairReport:
    """Return the report in which all that the chair wants and may enter now counts as entered."""
    chain, state = order.chains[number], each.state
    more = max(min(state.visit + state.wants - chain.visit, len(chain.spots) - 1), 0)
    free = 0
    for k in range(1, more + 1):
        resource = int(order.ways.resource[chain.spots[k]])
        if order.queues[resource][0] != Turn(number, chain.visit + k) or resource in order.closed:
            break
        free = k
    visits = chain.visit + free
    behind = max(visits - (state.visit - len(state.entered) + 1), 0)
    if state.wants > visits - state.visit and state.ready_ms <= STANDS_MS:  # it stands, and would go on at once
        return ChairReport(number, visits, behind, 0, state.leaves_ms)
    passing = sum(int(order.ways.passing_ms[spot]) for spot in chain.spots[1 : free + 1])
    ahead = sum(int(order.ways.passing_ms[spot]) for visit, spot in chain.behind if visit > state.visit)
    if chain.visit > state.visit:
        ahead += int(order.ways.passing_ms[chain.spots[0]])
    return ChairReport(number, visits, behind, state.ready_ms + passing + ahead, state.leaves_ms)


def _request(office: Office, order: Order, number: int, each: Known, now_ms: int) -> Request | None:
    """Return a chair's wish as a request, if the order does not have it yet."""
    wish, chain = each.state.wish, order.chains[number]
    if wish is None:
        return None
    key = number * _NUMBERS + wish.number
    asked = {request.number for request in order.waiting}
    is_asked = key in asked or (chain.request is not None and chain.request.number == key)
    is_there = len(chain.spots) == 1 and order.ways.names[chain.spots[0]] == wish.goal
    if is_asked or is_there or office.refused.get(number, (0, ""))[0] == wish.number:
        return None
    return Request(key, number, wish.goal, now_ms - wish.age_ms, Priority(wish.priority))


def _note_refusals(office: Office, replies: tuple[Reply, ...], requests: list[Request]) -> None:
    numbers = {request.chair: request.number % _NUMBERS for request in requests}
    for reply in replies:
        if reply.answer is Word.REJECTED and reply.chair in numbers:
            office.refused[reply.chair] = (numbers[reply.chair], reply.sentence)


def _claimed_twice(office: Office, loyal: Mapping[int, Known]) -> list[set[int]]:
    """Return for each resource that two chairs claim those of them that have not entered it, and have to give it back.

    A chair that drove by its own eyes may have entered what another one was allowed to enter, and did not yet.
    """
    assert office.district is not None
    order = office.district.order
    users: dict[int, dict[int, bool]] = {}
    for number, chain in order.chains.items():
        entered = set(loyal[number].state.entered) if number in loyal else set()
        for spot in (*(spot for _, spot in chain.behind), chain.spots[0]):
            users.setdefault(int(order.ways.resource[spot]), {})[number] = number in loyal and spot not in entered
    for number, claim in office.absent.items():
        for spot in claim.spots:
            users.setdefault(int(order.ways.resource[spot]), {})[number] = False
    return [{number for number, gives in each.items() if gives} for each in users.values() if len(each) > 1]


def _answers(
    office: Office, loyal: Mapping[int, Known], look: bool, revoked: set[int], now_ns: int
) -> tuple[Answer, ...]:
    """Return the answers that have changed or are due again."""
    assert office.district is not None
    order = office.district.order
    why = {wait.chair: wait for wait in office.waits}
    found = []
    for number, each in loyal.items():
        if number not in order.chains:
            continue
        state = each.state
        chain = order.chains[number]
        ahead = tuple(spot for visit, spot in chain.behind if visit >= state.visit) + chain.spots
        first = chain.last - len(ahead) + 1
        refused = office.refused.get(number)
        wish = 0 if state.wish is None else state.wish.number
        if len(ahead) < 2 and not wish:
            continue
        if number in revoked:
            ahead, first = state.entered[-1:], state.visit
        word, sentence = messages.GRANTED if len(ahead) > 1 else messages.QUEUED, ""
        if number in revoked:
            word = messages.REVOKED
        elif refused is not None and refused[0] == wish:
            word, sentence = messages.REJECTED, refused[1]
        wait = why.get(number)
        if wait is not None and not sentence:
            sentence = wait.sentence
        other = () if wait is None or wait.other is None else (wait.other,)
        foreseen = -1 if wait is None or wait.foreseen_ms is None else min(max(wait.foreseen_ms, 0), NEVER)
        answer = Answer(
            chair=number,
            boot=each.boot,
            stance=state.stance,
            epoch=office.term.epoch,
            serial=office.district.serial,
            word=word,
            echo_ns=each.sent_ns,
            lease_ms=LEASE_MS,
            visit=max(first, 0),
            spots=ahead,
            upto=state.visit if number in revoked else chain.visit,
            look=look,
            why=Why(other, sentence[:240], foreseen, "" if wait is None else wait.reason.value),
            number=wish,
        )
        before = office.answers.get(number)
        renews = before is not None and answer.upto > state.visit and before[0].echo_ns != answer.echo_ns
        if before is not None and now_ns - before[1] < AGAIN_NS and _same(before[0], answer) and not renews:
            continue
        office.answers[number] = (answer, now_ns)
        found.append(answer)
    return tuple(found)


def _ended_waits(office: Office, now_ms: int) -> tuple[Json, ...]:
    """Return the records of the waits that have ended since the last time, as an audit's log has them."""
    office.audit.note(office.waits, now_ms)
    records = tuple({"event": "waited", "t_ms": now_ms, **record} for record in office.audit.ended)
    office.audit.ended.clear()
    return records


def _same(old: Answer, new: Answer) -> bool:
    """Return whether two answers allow the same for the same reason."""
    ends = (old.visit + len(old.spots), new.visit + len(new.spots))
    return (
        ends[0] == ends[1]
        and (old.upto, old.look, old.word, old.why.others, old.number)
        == (new.upto, new.look, new.word, new.why.others, new.number)
        and old.spots[-1:] == new.spots[-1:]
    )


def _told(own: Voter, office: Office) -> messages.Order:
    assert office.district is not None
    order = office.district.order
    queues = tuple(
        Queue(resource, tuple((turn.chair, turn.visit) for turn in turns)) for resource, turns in order.queues.items()
    )
    return messages.Order(
        own.district,
        office.term.epoch,
        office.district.serial,
        own.electorate,
        queues,
        tuple(sorted(order.closed)),
    )
