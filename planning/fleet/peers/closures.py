"""Sections that chairs have seen shut, as every peer knows them, so that each one can be the warden with the same closures.

A chair that reports a section repeats it until its time is over, or until it takes it back with a time of 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from waychair.planning.fleet.peers.messages import Blocked

REPEATED_NS = 1_000_000_000
"""A report is repeated so often: one may be lost, and a peer that has started hears it soon."""

MOST_OF_ONE = 16
"""Sections that one chair closes at most: one that sees everything shut has a broken sensor."""

_MS = 1_000_000


@dataclass(slots=True)
class Closures:
    """What one peer has heard, and reports itself.

    Attributes:
        sections: the names of the building's sections and lifts; others are not heard.
        own: the times [ns] until which its own reports hold, with their causes, by section.
        told: when each of them was told, by section.
        heard: the times [ns] until which others' reports hold, by sender and section.
    """

    sections: frozenset[str]
    own: dict[str, tuple[str, int]] = field(default_factory=dict)
    told: dict[str, int] = field(default_factory=dict)
    heard: dict[int, dict[str, int]] = field(default_factory=dict)

    def report(self, sections: Mapping[str, int], cause: str, now_ns: int) -> bool:
        """Take in the own chair's reports, section by ms, 0 to take one back; return whether one is new."""
        new = False
        for section, for_ms in sections.items():
            if section not in self.sections:
                continue
            is_shut = section in self.own and self.own[section][1] > now_ns
            new |= for_ms > 0 and not is_shut
            self.own[section] = (cause, now_ns + for_ms * _MS)
            self.told.pop(section, None)
        return new

    def hear(self, sender: int, blocked: Blocked, now_ns: int) -> None:
        """Take in another chair's report."""
        if blocked.section not in self.sections:
            return
        reports = self.heard.setdefault(sender, {})
        if blocked.for_ms == 0:
            reports.pop(blocked.section, None)
        elif blocked.section in reports or len(reports) < MOST_OF_ONE:
            reports[blocked.section] = now_ns + blocked.for_ms * _MS

    def due(self, now_ns: int) -> list[Blocked]:
        """Return the own reports that are to be told now; one that is taken back is told for a few seconds more."""
        found = []
        for section, (cause, until_ns) in list(self.own.items()):
            if now_ns - until_ns > 3 * REPEATED_NS:
                del self.own[section]
                self.told.pop(section, None)
            elif now_ns - self.told.get(section, now_ns - REPEATED_NS) >= REPEATED_NS:
                self.told[section] = now_ns
                found.append(Blocked(section, cause, max((until_ns - now_ns) // _MS, 0)))
        return found

    def left_ms(self, now_ns: int) -> dict[str, int]:
        """Return for how long [ms] each section is shut by all reports that hold."""
        found: dict[str, int] = {}
        ends = [(section, until_ns) for section, (_, until_ns) in self.own.items()]
        for reports in self.heard.values():
            for section, until_ns in list(reports.items()):
                if until_ns <= now_ns:
                    del reports[section]
                ends.append((section, until_ns))
        for section, until_ns in ends:
            if until_ns > now_ns:
                found[section] = max(found.get(section, 0), (until_ns - now_ns) // _MS)
        return found

    def forget(self) -> None:
        """Drop all that was heard: the clock jumped."""
        self.heard.clear()
        self.own.clear()
        self.told.clear()
