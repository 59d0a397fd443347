"""Findings about one rider, kept in a file on the chair only: bounded, exported by copying it, reset by removing it.

It is data about health, readable by its owner alone; nothing of it goes to a black box, a topic or a log.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from waychair.control.haptics.learning import KEPT, RiderLearner
from waychair.control.haptics.rider import LIMITS
from waychair.errors import LearntError
from waychair.files import is_file, read_bytes, remove, replacing
from waychair.types import Json

VERSION = 1

_BETWEEN = " answered by "


def default_learnt() -> Path:
    """Return the file of this chair's rider (`XDG_DATA_HOME`, else ~/.local/share)."""
    data = os.environ.get("XDG_DATA_HOME")
    return (Path(data) if data else Path.home() / ".local" / "share") / "waychair" / "learnt.json"


def load_learner(path: Path | None) -> RiderLearner:
    """Return the findings about a rider: the file's figures, or those of an unknown rider without a file.

    Raises:
        LearntError: the file is damaged, or of another version.
    """
    learner = RiderLearner()
    if path is None or not is_file(path, LearntError):
        return learner
    try:
        found = json.loads(read_bytes(path, LearntError))
    except ValueError as error:
        raise _damaged(path, "it is no JSON") from error
    if not isinstance(found, dict) or found.get("version") != VERSION:
        raise _damaged(path, f"it is not of version {VERSION}")
    learner.restore(_values(path, found.get("values")), _answers(path, found.get("answers")))
    return learner


def save_learner(path: Path | None, learner: RiderLearner) -> None:
    """Write the findings, readable by its owner alone; None: nothing is kept.

    Raises:
        OutputError: the file cannot be written.
    """
    if path is None:
        return
    kept: Json = {"version": VERSION, **learner.exported()}
    with replacing(path, mode=0o600) as aside:
        aside.write_text(json.dumps(kept, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def forget_learnt(path: Path) -> None:
    """Forget the rider.

    Raises:
        OutputError: the file cannot be removed.
    """
    remove(path)


def _values(path: Path, found: object) -> Mapping[str, Sequence[float]]:
    if not isinstance(found, dict) or not all(isinstance(each, list) and len(each) <= KEPT for each in found.values()):
        raise _damaged(path, f"'values' must hold lists of up to {KEPT} numbers")
    for name, values in found.items():
        if name not in LIMITS:
            raise _damaged(path, f"'{name}' is no figure of a rider")
        if not all(isinstance(each, int | float) and math.isfinite(each) for each in values):
            raise _damaged(path, f"'{name}' holds something that is no number")
    return found


def _answers(path: Path, found: object) -> Mapping[tuple[str, str], int]:
    if not isinstance(found, dict):
        raise _damaged(path, "it has no 'answers'")
    answers = {}
    for words, count in found.items():
        said, between, done = str(words).partition(_BETWEEN)
        if not between or not isinstance(count, int) or count < 0:
            raise _damaged(path, f"the answer '{words}' cannot be read")
        answers[said, done] = count
    return answers


def _damaged(path: Path, why: str) -> LearntError:
    return LearntError(f"{path} is no file of what was learnt of a rider: {why}; remove it to begin anew")
