"""How a drive ended, as a client tells it."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class TaskResult(enum.Enum):
    """How a drive ended."""

    UNKNOWN = 0
    SUCCEEDED = 1
    CANCELED = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class DriveOutcome:
    """How a drive ended: the result, the reason, and Nav2's error code."""

    result: TaskResult
    reason: str = ""
    code: int = 0
