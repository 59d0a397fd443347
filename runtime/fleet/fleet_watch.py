"""The States of all chairs of a fleet, for a terminal: the chairs that are there, their modes, the warden, and the waits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from waychair.planning.fleet.peers import messages
from waychair.planning.fleet.peers.messages import Hello, Order, Reader, State
from waychair.planning.fleet.ways import Ways
from waychair.types import Json

_MODES = {messages.IN_ORDER: "in order", messages.ALONE: "alone", messages.MANUAL: "by its rider"}


@dataclass
class FleetWatch:
    """The last words of all peers, and the last order of the latest warden; `ways` gives the names of spots."""

    building: str
    ways: Ways
    states: dict[int, tuple[int, State]] = field(default_factory=dict)
    hellos: dict[int, Hello] = field(default_factory=dict)
    order: Order | None = None

    def __post_init__(self) -> None:
        self.reader = Reader(self.building)

    def hear(self, heard: Sequence[tuple[int, bytes]], now_ns: int) -> list[str]:
        """Take in messages; return advice about those that were refused, once each."""
        said = []
        for who, data in heard:
            letter, advice = self.reader.read(data, who)
            if advice:
                said.append(advice)
            elif letter is not None and isinstance(letter.body, State):
                self.states[letter.sender] = (now_ns, letter.body)
            elif letter is not None and isinstance(letter.body, Hello):
                self.hellos[letter.sender] = letter.body
            elif letter is not None and isinstance(letter.body, Order) and self._is_new(letter.body):
                self.order = letter.body
        return said

    def _is_new(self, order: Order) -> bool:
        return self.order is None or order.epoch >= self.order.epoch

    def rows(self, now_ns: int) -> list[Json]:
        """Return a row for each peer that was heard, by number."""
        return [self._row(number, now_ns - at_ns, state) for number, (at_ns, state) in sorted(self.states.items())]

    def _row(self, number: int, age_ns: int, state: State) -> Json:
        names = self.ways.names
        front = state.entered[-1] if state.entered and state.entered[-1] < len(names) else None
        return {
            "chair": number if state.entered else None,
            "number": number,
            "age_s": round(age_ns / 1e9, 2),
            "mode": _MODES[state.mode] if state.entered else "voter",
            "at": None if front is None else names[front],
            "goal": None if state.wish is None else state.wish.goal,
            "waits_s": None if state.wish is None else round(state.wish.age_ms / 1e3, 1),
            "may_enter": len(state.released),
            "warden": None if state.follows is None else state.follows.warden,
            "grants": state.grants,
        }
