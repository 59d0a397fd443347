"""The staff's view of one district's chairs, and the priorities that staff give them with their key.

A priority changes the order in which chairs go, never a chair's speed, distance or braking. TOP holds for one chair of the
district at a time and ten minutes at most; an APPOINTMENT holds until it is due. Every change is noted.
"""

from __future__ import annotations

import hmac
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from waychair.errors import TaskError
from waychair.planning.fleet.audit import TOP_LONGEST_MS
from waychair.planning.fleet.order import Order, with_priorities
from waychair.planning.fleet.rules import Priority, aged
from waychair.planning.fleet.waits import Wait
from waychair.types import Json

APPOINTMENT_LONGEST_MS = 12 * 3_600_000
"""ms; an appointment that is due later is one of another day."""

LEAST_KEY = 8
"""Characters of the staff's key."""

_WRONG_KEYS, _WRONG_KEYS_WAIT_MS = 5, 30_000  # so many wrong keys in a row, and then this pause for all
_WAITS_SHOWN = 200
GIVEN = {"top": Priority.TOP, "appointment": Priority.APPOINTMENT, "routine": Priority.ROUTINE}
"""The priorities that staff give, by their names; routine takes one back."""


@dataclass(frozen=True, slots=True)
class GivenPriority:
    """A chair's priority until a time."""

    priority: Priority
    until_ms: int


class StaffDesk:
    """The priorities given by staff; any thread may give them, the warden's loop applies them."""

    def __init__(self, key: str, note: Callable[[Json], None] = lambda record: None) -> None:
        """`key` is the staff's; `note` receives a record of each change, for the audit.

        Raises:
            TaskError: the key is too short.
        """
        if len(key) < LEAST_KEY:
            raise TaskError(f"the staff's key has {len(key)} characters: give one of at least {LEAST_KEY}")
        self._key, self._note = key, note
        self._lock = threading.Lock()
        self._given: dict[int, GivenPriority] = {}
        self._own: dict[int, Priority] = {}  # what requests had before, by their numbers
        self._wrong = 0
        self._closed_until_ms = 0

    def give(self, chair: int, name: str, key: str, now_ms: int, minutes: float = 10.0) -> str:
        """Give a chair a priority by name for some minutes, for an appointment until it is due; return a sentence about it.

        Raises:
            TaskError: the key is wrong, the priority or time impossible, or another chair has TOP.
        """
        with self._lock:
            self._check_key(key, now_ms)
            priority = GIVEN.get(name)
            if priority is None:
                raise TaskError(f"there is no priority '{name[:20]}': give {', '.join(GIVEN)}")
            self._given = {who: each for who, each in self._given.items() if each.until_ms > now_ms}
            if priority is Priority.ROUTINE:
                self._given.pop(chair, None)
                self._note({"event": "priority", "t_ms": now_ms, "chair": chair, "priority": name})
                return f"Chair {chair} has its own priority again."
            longest = TOP_LONGEST_MS if priority is Priority.TOP else APPOINTMENT_LONGEST_MS
            if not 0.0 < minutes * 60_000 <= longest:
                raise TaskError(f"{name} for {minutes:g} min is impossible: give up to {longest // 60_000} min")
            holder = next(
                (who for who, each in self._given.items() if each.priority is Priority.TOP and who != chair), None
            )
            if priority is Priority.TOP and holder is not None:
                left = round((self._given[holder].until_ms - now_ms) / 60_000)
                raise TaskError(f"chair {holder} has TOP for {left} min more: take it back first")
            until_ms = now_ms + round(minutes * 60_000)
            self._given[chair] = GivenPriority(priority, until_ms)
            self._note({"event": "priority", "t_ms": now_ms, "chair": chair, "priority": name, "until_ms": until_ms})
            return f"Chair {chair} has {name.upper()} for {minutes:g} min."

    def _check_key(self, key: str, now_ms: int) -> None:
        if now_ms < self._closed_until_ms:
            left = -(-(self._closed_until_ms - now_ms) // 1000)
            raise TaskError(f"too many wrong keys: wait {left} s")
        if hmac.compare_digest(key.encode(), self._key.encode()):
            self._wrong = 0
            return
        self._wrong += 1
        if self._wrong >= _WRONG_KEYS:
            self._wrong, self._closed_until_ms = 0, now_ms + _WRONG_KEYS_WAIT_MS
        raise TaskError("the staff's key is wrong")

    def given(self, now_ms: int) -> dict[int, GivenPriority]:
        """Return the priorities that hold now, by chair."""
        with self._lock:
            return {who: each for who, each in self._given.items() if each.until_ms > now_ms}

    def applied(self, order: Order, now_ms: int) -> Order:
        """Return the order with the given priorities in its requests; one that has lapsed gives way to the request's own."""
        given = self.given(now_ms)
        requests = [chain.request for chain in order.chains.values() if chain.request is not None]
        requests += order.waiting
        self._own = {each.number: self._own.get(each.number, each.priority) for each in requests}
        wanted = {
            each.number: given[each.chair].priority if each.chair in given else self._own[each.number]
            for each in requests
        }
        return with_priorities(order, wanted)


def staff_view(
    order: Order,
    present: Iterable[Wait],
    ended: Iterable[Json],
    given: Mapping[int, GivenPriority],
    now_ms: int,
) -> Json:
    """Return the staff's page, as plain values: chairs, queues, closures, and the waits that have ended.

    `ended`: records of `waits.Audit`, the earliest first; the page shows the latest ones. Chairs are numbers.
    """
    ways = order.ways
    why = {wait.chair: wait.sentence for wait in present}
    asking = {request.chair: request for request in order.waiting}
    chairs: list[Json] = []
    for chair, chain in sorted(order.chains.items()):
        request = chain.request or asking.get(chair)
        until = given[chair].until_ms if chair in given else None
        priority = None if request is None else aged(request.priority, now_ms - request.asked_ms).name.lower()
        goal = "" if request is None else request.goal
        chairs.append(
            {
                "chair": chair,
                "at": ways.names[chain.spots[0]],
                "goal": goal,
                "priority": priority or "",
                "minutes_left": None if until is None else round((until - now_ms) / 60_000, 1),
                "told": why.get(chair, f"On the way to {goal}." if goal else "Stands by."),
            }
        )
    names: dict[int, str] = {}
    for spot in range(len(ways.names)):
        names.setdefault(int(ways.resource[spot]), ways.names[spot])
    queues = {
        names[resource]: list(dict.fromkeys(turn.chair for turn in queue))
        for resource, queue in sorted(order.queues.items())
        if len({turn.chair for turn in queue}) > 1
    }
    return desk_view(chairs, queues, (names[resource] for resource in order.closed), ended, now_ms)


def desk_view(
    chairs: Sequence[Json],
    queues: Mapping[str, Sequence[int]],
    closed: Iterable[str],
    ended: Iterable[Json],
    now_ms: int,
) -> Json:
    """Return the staff's page, from its rows of chairs, the chairs before each place, and the waits that have ended."""
    waits = list(ended)[-_WAITS_SHOWN:]
    return {
        "chairs": list(chairs),
        "queues": [{"place": place, "chairs": list(each)} for place, each in queues.items()],
        "closed": sorted(set(closed)),
        "waited": [
            {
                "minutes_ago": round(max(now_ms - each["begun_ms"], 0) / 60_000),
                **{name: each[name] for name in ("waits", "first", "place", "rule", "real_s", "foreseen_s")},
            }
            for each in reversed(waits)
        ],
    }
