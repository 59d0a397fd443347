"""The audit of several chairs: a log of grants, movements and waits, and the rules that it must keep.

A log is a sequence of JSON records, one a line, in the order of time; chairs are numbers, and there are no names of people:

    {"event": "order", "t_ms": 0, "chains": {"1": [4, [7, 9, 2], 0]}, "queues": {"9": [[1, 5], [2, 3]]}}
    {"event": "asked", "t_ms": 0, "chair": 1, "request": 3, "goal": "room 4"}
    {"event": "entered", "t_ms": 3000, "chair": 1, "visit": 5, "resource": 9}
    {"event": "left", "t_ms": 3001, "chair": 1, "resource": 7}
    {"event": "priority", "t_ms": 5000, "chair": 1, "priority": "top", "until_ms": 605000}
    {"event": "waited", "t_ms": 9000, "waits": 1, "first": 2, "place": "a-b", "rule": ..., "foreseen_s": 5.0, "real_s": 6.0, ...}

A chain is the number of its first visit, the resources from the one that the chair is in, and the number of requests that
overtook it. `audited` shares no code with the coordinator.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from waychair.errors import TaskError
from waychair.planning.fleet.order import Order
from waychair.types import Json

STANDS_MS = 600_000
"""ms for which a chair may stand while the way that it was granted is free."""

TOP_LONGEST_MS = 600_000
"""ms for which a chair has TOP at most."""

MOST_FAULTS = 1_000
"""Faults that are kept; a log with more is broken throughout."""


def order_record(order: Order, now_ms: int) -> Json:
    """Return the record of an order that has changed."""
    resource = order.ways.resource
    return {
        "event": "order",
        "t_ms": now_ms,
        "chains": {
            str(chair): [chain.visit, [int(resource[spot]) for spot in chain.spots], len(chain.overtaken_by)]
            for chair, chain in order.chains.items()
        },
        "queues": {str(each): [list(turn) for turn in queue] for each, queue in order.queues.items() if len(queue) > 1},
    }


@dataclass(slots=True)
class Audited:
    """The result of an audit.

    Attributes:
        faults: a sentence for each rule that was broken.
        records: the number of records.
        arrivals: chairs' arrivals in the places that they asked for.
        hours: simulated or real time [h].
        waits: the records of waits.
    """

    faults: list[str] = field(default_factory=list)
    records: int = 0
    arrivals: Counter[int] = field(default_factory=Counter)
    hours: float = 0.0
    waits: list[Json] = field(default_factory=list)

    def waits_of(self, chair: int | None) -> list[Json]:
        """Return the waits of a chair; of all for None."""
        return [each for each in self.waits if chair is None or each["waits"] == chair]

    def seconds_by_place(self) -> dict[str, float]:
        """Return how long chairs waited before each place [s], the most first."""
        found: Counter[str] = Counter()
        for each in self.waits:
            found[each["place"]] += each["real_s"]
        return dict(found.most_common())

    def foreseen_right(self) -> float | None:
        """Return the share of waits that were foreseen within 5 s or a quarter; None if none was foreseen."""
        told = [each for each in self.waits if each["foreseen_s"] is not None]
        right = [abs(each["foreseen_s"] - each["real_s"]) <= max(5.0, each["real_s"] / 4) for each in told]
        return sum(right) / len(right) if right else None


@dataclass(slots=True)
class _Chair:
    """A chair by its log: its visit, the resources granted from there on, and when it last moved or was free to."""

    visit: int
    ahead: list[int]
    since_ms: int
    asks: bool = False


def audited(records: Iterable[Json]) -> Audited:
    """Return what a log tells, and where it breaks a rule.

    The rules: one chair in a resource at a time; a chair enters only the resource granted next, first in its queue; the
    ends of the chains differ; the waits have no cycle; nobody is overtaken thrice; nobody stands 10 min with a free way; one
    chair has TOP at a time, and for ten minutes at most.

    Raises:
        TaskError: a record is not of this form; the message gives its number.
    """
    found = Audited()
    chairs: dict[int, _Chair] = {}
    users: dict[int, set[int]] = {}
    queues: dict[int, list[tuple[int, int]]] = {}
    tops: dict[int, int] = {}
    first_ms: int | None = None
    now_ms = 0
    for number, record in enumerate(records, start=1):
        found.records = number
        try:
            before_ms, now_ms = now_ms, int(record["t_ms"])
            first_ms = now_ms if first_ms is None else first_ms
            event = record["event"]
            said: list[str] = []
            if now_ms < before_ms:
                said.append("time runs backwards")
            if event == "order":
                said += _renewed(record, now_ms, chairs, users, queues)
            elif event == "asked":
                chairs[int(record["chair"])].asks = True
            elif event == "entered":
                said += _entered(record, now_ms, chairs, users, queues)
                chair = chairs[int(record["chair"])]
                if len(chair.ahead) == 1 and chair.asks:
                    found.arrivals[int(record["chair"])] += 1
                    chair.asks = False
            elif event == "left":
                who, resource = int(record["chair"]), int(record["resource"])
                users.get(resource, set()).discard(who)
                _freed(resource, who, chairs, queues, now_ms)
            elif event == "waited":
                float(record["real_s"]), str(record["place"]), int(record["waits"])
                found.waits.append(record)
            elif event == "priority":
                said += _prioritised(record, now_ms, tops)
            else:
                said.append(f"the event '{event}' is unknown")
        except (AttributeError, KeyError, TypeError, ValueError, IndexError) as problem:
            raise TaskError(
                f"record {number} of the log is damaged ({type(problem).__name__} {problem}): make the log again"
            ) from None
        found.faults += [f"record {number}, at {now_ms / 1e3:.1f} s: {each}" for each in said]
        if len(found.faults) > MOST_FAULTS:
            break
    found.hours = 0.0 if first_ms is None else (now_ms - first_ms) / 3.6e6
    return found


def _prioritised(record: Json, now_ms: int, tops: dict[int, int]) -> list[str]:
    """Take over a priority that staff gave; `tops` are the chairs with TOP, and until when [ms]."""
    who, name = int(record["chair"]), str(record["priority"])
    tops.pop(who, None)
    if name != "top":
        return []
    until_ms = int(record["until_ms"])
    said = [f"chair {who} has TOP for more than 10 min"] if until_ms - now_ms > TOP_LONGEST_MS else []
    said += [f"chairs {other} and {who} have TOP at once" for other, until in tops.items() if until > now_ms]
    tops[who] = until_ms
    return said


def _renewed(
    record: Json,
    now_ms: int,
    chairs: dict[int, _Chair],
    users: dict[int, set[int]],
    queues: dict[int, list[tuple[int, int]]],
) -> list[str]:
    """Take over an order; return the rules that it breaks."""
    said: list[str] = []
    ends: dict[int, int] = {}
    for name, (visit, resources, overtaken) in record["chains"].items():
        who = int(name)
        old = chairs.get(who)
        if old is None:
            users.setdefault(int(resources[0]), set()).add(who)
        elif old.visit != visit or old.ahead[0] != resources[0]:
            said.append(f"chair {who} is granted a chain from where it is not")
        since_ms = now_ms if old is None or old.ahead[1:2] != resources[1:2] else old.since_ms
        chairs[who] = _Chair(int(visit), [int(each) for each in resources], since_ms, old is not None and old.asks)
        if resources[-1] in ends:
            said.append(f"chairs {ends[resources[-1]]} and {who} are sent to one slot")
        ends[resources[-1]] = who
        if overtaken > 2:
            said.append(f"chair {who} has been overtaken {overtaken} times")
    queues.clear()
    queues.update({int(each): [(int(a), int(b)) for a, b in queue] for each, queue in record["queues"].items()})
    if _has_cycle(chairs, queues):
        said.append("the order has a cycle: chairs wait for each other for ever")
    return said


def _has_cycle(chairs: Mapping[int, _Chair], queues: Mapping[int, list[tuple[int, int]]]) -> bool:
    """Return whether the turns wait for each other in a ring; a turn ends when its chair has begun the next one."""
    after: dict[tuple[int, int], list[tuple[int, int]]] = {}
    missing: Counter[tuple[int, int]] = Counter()
    for who, chair in chairs.items():
        for k in range(1, len(chair.ahead)):
            after.setdefault((who, chair.visit + k - 1), []).append((who, chair.visit + k))
            missing[who, chair.visit + k] += 1
    for queue in queues.values():
        for (who, visit), later in pairwise(queue):
            if visit >= chairs[who].visit:  # else it is only a rear that leaves
                after.setdefault((who, visit + 1), []).append(later)
                missing[later] += 1
    turns = {(who, chair.visit + k) for who, chair in chairs.items() for k in range(len(chair.ahead))}
    ready = [turn for turn in turns if missing[turn] == 0]
    done = 0
    while ready:
        turn = ready.pop()
        done += 1
        for later in after.get(turn, ()):
            missing[later] -= 1
            if missing[later] == 0:
                ready.append(later)
    return done < len(turns)


def _entered(
    record: Json,
    now_ms: int,
    chairs: dict[int, _Chair],
    users: dict[int, set[int]],
    queues: dict[int, list[tuple[int, int]]],
) -> list[str]:
    """Take over that a chair has entered a resource; return the rules that this breaks."""
    who, visit, resource = (int(record[key]) for key in ("chair", "visit", "resource"))
    chair = chairs[who]
    said: list[str] = []
    if chair.ahead[1:2] != [resource] or visit != chair.visit + 1:
        said.append(f"chair {who} entered resource {resource}, which it was not granted next")
    queue = queues.get(resource, [])
    if queue and queue[0] != (who, visit):
        said.append(f"chair {who} entered resource {resource} before chair {queue[0][0]}, which was first")
    others = users.setdefault(resource, set()) - {who}
    if others:
        said.append(f"chair {who} entered resource {resource}, in which chair {min(others)} is")
    if now_ms - chair.since_ms > STANDS_MS and not others:
        said.append(f"chair {who} stood {(now_ms - chair.since_ms) / 6e4:.0f} min with a free way")
    users[resource].add(who)
    chair.visit, chair.ahead, chair.since_ms = visit, chair.ahead[1:] or [resource], now_ms
    return said


def _freed(
    resource: int, who: int, chairs: dict[int, _Chair], queues: dict[int, list[tuple[int, int]]], now_ms: int
) -> None:
    """Take the chair that has left off its queue; the next one's way is free from now on."""
    queue = queues.get(resource, [])
    for k, (chair, visit) in enumerate(queue):
        if chair == who and visit < chairs[who].visit:
            del queue[k]
            break
    if queue and queue[0][0] in chairs:
        chairs[queue[0][0]].since_ms = max(chairs[queue[0][0]].since_ms, now_ms)
