"""What became of a recording: mapped, failed and why, or interrupted; kept on disk beside its map."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from pathlib import Path

from waychair.files import write_json
from waychair.types import Json

RECORD = "map_all.json"
"""Name of a finished recording's outcome in its map folder; it arrives there together with the map."""


class OutcomeState(StrEnum):
    """What became of a recording."""

    DONE = "done"
    FAILED = "failed"
    """It cannot be mapped; not tried again unless its files, the settings or the limit change."""
    STOPPED = "stopped"
    """Its mapping was killed or interrupted; the next run of the command goes on with it."""
    UNREACHED = "unreached"
    """The worker has no path to the recording or to the maps' folder, and has to be sent it."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a recording, and its cost, over all tries.

    `cpu_s` and `peak_memory_mb` are of the mapping process. `kept` says that it is the outcome of an earlier run.
    """

    name: str
    state: OutcomeState
    fingerprint: str
    why: str = ""
    seconds: float = 0.0
    cpu_s: float = 0.0
    peak_memory_mb: float = 0.0
    host: str = ""
    memory_limit: int = 0
    kept: bool = False

    def as_json(self) -> Json:
        """Return the outcome as plain values."""
        return asdict(self)


def read_outcome(path: Path) -> Outcome | None:
    """Return the outcome in a file; None where there is none, or none that can be read."""
    try:
        values = json.loads(path.read_bytes())
        names = {each.name for each in fields(Outcome)}
        found = Outcome(**{name: value for name, value in values.items() if name in names})
        return Outcome(**{**asdict(found), "state": OutcomeState(found.state)})
    except (OSError, ValueError, TypeError, AttributeError):
        return None


def write_outcome(path: Path, outcome: Outcome) -> None:
    """Write an outcome.

    Raises:
        OutputError: the folder cannot be written.
    """
    write_json(path, outcome.as_json())
