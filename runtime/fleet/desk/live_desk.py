"""The staff's desk of a live fleet, on the computer of a voter: it hears all chairs, shows them, and repeats given priorities."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from waychair.planning.fleet.peers.messages import Order, State
from waychair.planning.fleet.peers.peer import Fleet
from waychair.planning.fleet.rules import Priority, aged
from waychair.planning.fleet.waits import Audit, Reason, Wait
from waychair.runtime.fleet.desk.desk_messages import GIVEN, GIVEN_NS, Given, Told, note_bytes, note_from
from waychair.runtime.fleet.desk.staff_desk import StaffDesk, desk_view
from waychair.runtime.fleet.fleet_watch import FleetWatch
from waychair.types import Json

SILENT_NS = 3_000_000_000
"""A chair that was not heard for so long is shown as gone."""

_KEPT_WAITS = 2_000

_RULES = {each.value: each for each in Reason}


class LiveDesk:
    """The desk's news of all chairs of a fleet; `note` receives a record of each ended wait, for the audit."""

    def __init__(self, fleet: Fleet, desk: StaffDesk, note: Callable[[Json], None] = lambda record: None) -> None:
        self._fleet, self._desk, self._note = fleet, desk, note
        self._watch = FleetWatch(fleet.building, fleet.ways)
        self._told: dict[int, tuple[int, Told]] = {}
        self._audit = Audit()
        self._given_ns = 0
        self._given: dict[int, Priority] = {}

    def hear(self, heard: Sequence[tuple[int, bytes]], aside: Sequence[tuple[int, bytes]], now_ns: int) -> None:
        """Take the peers' messages, and those beside them, with the numbers of their senders."""
        self._watch.hear(heard, now_ns)
        for sender, data in aside:
            told = note_from(Told, data) if sender in self._fleet.chairs else None
            if told is not None:
                self._told[sender] = (now_ns, told)
        before = len(self._audit.ended)
        self._audit.note(self._waits(now_ns), now_ns // 1_000_000)
        for record in self._audit.ended[before:]:
            self._note({"event": "waited", "t_ms": now_ns // 1_000_000, **record})
        del self._audit.ended[:-_KEPT_WAITS]

    def due(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Return the messages to all chairs that are due: given priorities, at once where they change."""
        given = {chair: each.priority for chair, each in self._desk.given(now_ns // 1_000_000).items()}
        if given == self._given and now_ns - self._given_ns < GIVEN_NS:
            return []
        self._given, self._given_ns = given, now_ns
        return [(GIVEN, note_bytes(Given(chair, int(priority)))) for chair, priority in given.items()]

    def view(self, now_ns: int) -> Json:
        """Return the staff's page."""
        states = {number: state for number, (_, state) in self._watch.states.items()}
        chairs = [
            self._row(number, states.get(number), now_ns) for number in sorted(self._fleet.chairs) if number in states
        ]
        order = self._watch.order
        names: dict[int, str] = {}
        for spot, name in enumerate(self._fleet.ways.names):
            names.setdefault(int(self._fleet.ways.resource[spot]), name)
        queues = {} if order is None else _queues(order, names)
        closed = () if order is None else tuple(names[each] for each in order.closed if each in names)
        return desk_view(chairs, queues, closed, self._audit.ended, now_ns // 1_000_000)

    def _row(self, number: int, state: State | None, now_ns: int) -> Json:
        assert state is not None
        names = self._fleet.ways.names
        told_ns, told = self._told.get(number, (0, Told()))
        heard_ns = self._watch.states[number][0]
        at = names[state.entered[-1]] if state.entered and state.entered[-1] < len(names) else ""
        now_ms = now_ns // 1_000_000
        given = self._desk.given(now_ms).get(number)
        goal = "" if state.wish is None else state.wish.goal
        priority = "" if state.wish is None else aged(Priority(state.wish.priority), state.wish.age_ms).name.lower()
        said = told.told or (f"On the way to {goal}." if goal else "Stands by.")
        if now_ns - heard_ns > SILENT_NS:
            said = f"Has not been heard for {(now_ns - heard_ns) // 1_000_000_000} s."
        elif now_ns - told_ns > SILENT_NS:
            said = f"On the way to {goal}." if goal else "Stands by."
        return {
            "chair": number,
            "at": at,
            "goal": goal,
            "priority": priority,
            "minutes_left": None if given is None else round((given.until_ms - now_ms) / 60_000, 1),
            "told": said,
        }

    def _waits(self, now_ns: int) -> list[Wait]:
        """Return the waits of all chairs that are heard."""
        return [
            Wait(
                number,
                told.other,
                told.place,
                _RULES.get(told.rule, Reason.FIRST),
                (Priority(told.priority), None),
                told.waited_ms,
                None if told.foreseen_ms < 0 else told.foreseen_ms,
            )
            for number, (at_ns, told) in self._told.items()
            if told.waits and now_ns - at_ns <= SILENT_NS
        ]


def _queues(order: Order, names: dict[int, str]) -> dict[str, list[int]]:
    """Return the chairs at each place at which there is more than one, in their order."""
    found = {}
    for queue in order.queues:
        chairs = list(dict.fromkeys(chair for chair, _ in queue.turns))
        if len(chairs) > 1 and queue.resource in names:
            found[names[queue.resource]] = chairs
    return found
