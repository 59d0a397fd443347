"""The part of a `ChairPort` with which the rider chooses a level of help and overrides the guard: for a chair in this
program, or for one without levels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from waychair.runtime.chair import Chair
from waychair.runtime.pages.chair_port import PortAnswer
from waychair.runtime.rider.kept_level import KeptLevel
from waychair.types import HelpLevel

NO_LEVELS = "this chair has no levels of help"


class WithoutLevels:
    """A chair that has no levels of help."""

    def choose_level(self, level: HelpLevel) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(False, NO_LEVELS)

    def override_guard(self) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(False, NO_LEVELS)


class GuardPort(ABC):
    """A chair in this program; requests run in its own thread."""

    _kept_level = KeptLevel()
    """The rider's file, in which the chosen level is kept."""

    @abstractmethod
    def _request(self, what: Callable[[], PortAnswer], first: bool = False) -> PortAnswer:
        """Run a request in the chair's thread and return its answer."""

    @abstractmethod
    def _guarded(self) -> tuple[Chair, int]:
        """Return the chair and its time [ns]."""

    def choose_level(self, level: HelpLevel) -> PortAnswer:
        """See `ChairPort`."""

        def chosen() -> PortAnswer:
            chair, _ = self._guarded()
            told = chair.choose_level(level)
            return PortAnswer(chair.level is level, told)

        answer = self._request(chosen)
        if not answer.done:
            return answer
        trouble = self._kept_level.keep(level)  # outside the chair's thread, which waits for no disk
        return PortAnswer(True, f"{answer.sentence} {trouble}".strip())

    def override_guard(self) -> PortAnswer:
        """See `ChairPort`."""

        def pressed() -> PortAnswer:
            chair, now_ns = self._guarded()
            return PortAnswer(*chair.override_guard(now_ns))

        return self._request(pressed)
