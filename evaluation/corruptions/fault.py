"""A fault: what it does to a recording, and the words by which a user would know it again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from evaluation.corruptions.messages import Messages

Part = Literal["odometry", "imu", "lidar", "mount", "clock", "file", "log", "pictures"]
Where = Literal["messages", "clouds", "file", "log", "pictures"]
ChangeMessages = Callable[[Messages, np.random.Generator], None]
ChangeFile = Callable[[Path, np.random.Generator], Path]


@dataclass(frozen=True, slots=True)
class RecordingFault:
    """A fault of one of the kinds 1 to 5.

    `parts` are the parts of a recording that may rightly be named, `words` the pattern of its kind in a sentence;
    `where` says on what `change` works: messages (as LaserScans or `clouds`), or a path (a bag, a log, a folder of
    pictures), for which it returns the path to be mapped.
    """

    name: str
    kind: int
    parts: tuple[Part, ...]
    words: str
    where: Where
    messages: ChangeMessages | None = None
    file: ChangeFile | None = None


def messages_fault(
    kind: int, parts: Part | tuple[Part, ...], words: str, *, clouds: bool = False
) -> Callable[[ChangeMessages], RecordingFault]:
    """Return a decorator that makes a fault of a function on messages; the function's name is the fault's."""

    def made(change: ChangeMessages) -> RecordingFault:
        own: tuple[Part, ...] = (parts,) if isinstance(parts, str) else parts
        return RecordingFault(change.__name__, kind, own, words, "clouds" if clouds else "messages", messages=change)

    return made


def file_fault(
    kind: int, parts: Part | tuple[Part, ...], words: str, where: Where = "file"
) -> Callable[[ChangeFile], RecordingFault]:
    """Return a decorator that makes a fault of a function on a path; the function's name is the fault's."""

    def made(change: ChangeFile) -> RecordingFault:
        own: tuple[Part, ...] = (parts,) if isinstance(parts, str) else parts
        return RecordingFault(change.__name__, kind, own, words, where, file=change)

    return made


def faults_of(namespace: dict[str, object]) -> tuple[RecordingFault, ...]:
    """Return the faults of a module, in the order of its text."""
    return tuple(value for value in namespace.values() if isinstance(value, RecordingFault))
