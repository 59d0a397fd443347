"""A chair's port that records its calls, and can be made to wait."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from waychair.runtime.pages.chair_port import ChairPort


@dataclass(frozen=True, slots=True)
class Call:
    """A call of the port with its start and end by the steady clock."""

    name: str
    asked: tuple[Any, ...]
    began_ns: int
    ended_ns: int


class Noted:
    """Passes all calls on to a real port and records them, except those that only read."""

    def __init__(self, port: ChairPort) -> None:
        self.port = port
        self.calls: list[Call] = []
        self.watchers: list[tuple[str, ...]] = []
        self.gates: dict[str, threading.Event] = {}
        """Calls of these names wait until the event is set."""

    @property
    def outline(self) -> Any:
        return self.port.outline

    def watched(self, pages: Sequence[str]) -> None:
        self.watchers.append(tuple(pages))
        self.port.watched(pages)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        call = getattr(self.port, name)
        if name in ("view", "grid", "layout", "goals", "picture", "perception", "network", "haptics"):
            return call  # type: ignore[no-any-return]

        def noted(*asked: Any) -> Any:
            began_ns = time.monotonic_ns()
            if name in self.gates:
                self.gates[name].wait()
            answer = call(*asked)
            self.calls.append(Call(name, asked, began_ns, time.monotonic_ns()))
            return answer

        return noted

    def named(self, name: str) -> list[Call]:
        """The calls of one name."""
        return [call for call in self.calls if call.name == name]
