"""The part of a `ChairPort` for a rider who is told and led by touch and voice: for a chair in this program, or without it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

from waychair.control.haptics.next_door import DoorSide
from waychair.runtime.chair import NOBODY_LEADS, Chair
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.pages.chair_port import PortAnswer
from waychair.types import Place

NOT_LED = "nobody is led now: choose a place first"


class WithoutHaptics:
    """A chair that has neither glove nor voice."""

    def haptics(self) -> HapticState | None:
        """See `ChairPort`."""
        return None

    def lead(self, goal: str) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(False, NOBODY_LEADS)

    def lead_through(self, side: DoorSide) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(False, NOBODY_LEADS)

    def end_lead(self) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(False, NOBODY_LEADS)

    def say_again(self) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(False, NOBODY_LEADS)

    def say_where(self) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(False, NOBODY_LEADS)


class HapticPort(ABC):
    """The same of a chair in this program; requests run in the chair's own thread."""

    @abstractmethod
    def _request(self, what: Callable[[], PortAnswer], first: bool = False) -> PortAnswer:
        """Run a request in the chair's thread and return its answer."""

    @abstractmethod
    def _led(self) -> tuple[Chair, Mapping[str, Place]]:
        """Return the chair, and the places of its map."""

    _haptics: HapticState | None = None
    """The state after the latest tick."""

    def haptics(self) -> HapticState | None:
        """See `ChairPort`."""
        return self._haptics

    def lead(self, goal: str) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            chair, places = self._led()
            if chair.haptics is None:
                return PortAnswer(False, NOBODY_LEADS)
            if goal not in places:
                return PortAnswer(False, f"there is no place '{goal}' on this map: choose one of its places")
            return PortAnswer(True, chair.lead(places[goal]))

        return self._request(done)

    def lead_through(self, side: DoorSide) -> PortAnswer:
        """See `ChairPort`."""
        return self._request(lambda: PortAnswer(*self._led()[0].lead_through(side)))

    def end_lead(self) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            haptics = self._led()[0].haptics
            if haptics is None or haptics.leader.goal is None:
                return PortAnswer(False, NOBODY_LEADS if haptics is None else NOT_LED)
            haptics.end()
            return PortAnswer(True, "you are no longer led")

        return self._request(done)

    def say_again(self) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            haptics = self._led()[0].haptics
            if haptics is None:
                return PortAnswer(False, NOBODY_LEADS)
            haptics.say_again()
            return PortAnswer(True, "")

        return self._request(done)

    def say_where(self) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            haptics = self._led()[0].haptics
            if haptics is None:
                return PortAnswer(False, NOBODY_LEADS)
            haptics.say_where()
            return PortAnswer(True, "")

        return self._request(done)
