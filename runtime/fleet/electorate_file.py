"""The electorate that a peer keeps over its restarts, in a small file beside its fleet's file.

A peer that forgot it would count chairs that are switched off, and two could order at once.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import msgspec

from waychair.errors import OutputError
from waychair.files import write_text
from waychair.planning.fleet.peers.messages import Electorate


def kept_electorate(path: Path | None, numbers: Collection[int]) -> Electorate | None:
    """Return the electorate that an earlier start kept; None without one, with a damaged one, or one with other peers."""
    try:
        found = None if path is None else msgspec.json.decode(path.read_bytes(), type=Electorate)
    except (OSError, msgspec.MsgspecError):
        return None
    return found if found is not None and set(found.members) <= set(numbers) else None


def keep_electorate(path: Path | None, electorate: Electorate | None) -> str:
    """Keep a new electorate, if there is one; return a sentence for people where it cannot be written."""
    if path is None or electorate is None:
        return ""
    try:
        write_text(path, msgspec.json.encode(electorate).decode())
    except OutputError as problem:
        return f"Who is counted cannot be kept: {problem}."
    return ""
