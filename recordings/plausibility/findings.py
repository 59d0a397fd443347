"""Findings about a recording: one for each kind of defect, with its count, its first time and the remedy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from waychair.types import Json


@dataclass(frozen=True, slots=True)
class Finding:
    """One kind of defect of one part of a recording.

    - `kind`: short name for programs, such as "code for nothing".
    - `topic`: the topic or other part that is concerned.
    - `text`: the defect, and the reaction to it; a clause without topic, full stop or count.
    - `remedy`: what the user can do; empty where nothing needs to be done.
    - `count`: messages concerned; 0 if the defect is one of the whole recording.
    - `first_s`: time of the first of them since the first scan [s]; None if unknown.
    """

    kind: str
    topic: str
    text: str
    remedy: str = ""
    count: int = 0
    first_s: float | None = None

    def sentence(self) -> str:
        """Return the finding as one sentence: topic, text, count and first time, remedy."""
        told = []
        if self.count:
            told.append("once" if self.count == 1 else f"{self.count} times")
        if self.first_s is not None:
            told.append(f"at {self.first_s:.1f} s" if self.count == 1 else f"first at {self.first_s:.1f} s")
        counted = f" ({', '.join(told)})" if told else ""
        return f"{self.topic}: {self.text}{counted}" + (f"; {self.remedy}" if self.remedy else "")

    def as_json(self) -> Json:
        """Return the finding for report.json."""
        return {
            "kind": self.kind,
            "topic": self.topic,
            "text": self.text,
            "remedy": self.remedy,
            "count": self.count,
            "first_s": None if self.first_s is None else round(self.first_s, 3),
        }


def seconds_after(stamps_ns: Sequence[int], index: int) -> float:
    """Return the time [s] of message `index` after the first one."""
    return (stamps_ns[index] - stamps_ns[0]) * 1e-9
