"""What differs between two versions of a building's texts, in plain sentences."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping

SHOWN = 20
"""Most differences that are told one by one."""


def differences(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return a sentence for each line that was added or taken away, and for each file."""
    found = list(_differences(before, after))
    more = [f"and {len(found) - SHOWN} more"] if len(found) > SHOWN else []
    return [*found[:SHOWN], *more]


def _differences(before: Mapping[str, str], after: Mapping[str, str]) -> Iterator[str]:
    for name in sorted({*before, *after}):
        if name not in after:
            yield f"{name} was taken away"
        elif name not in before:
            yield f"{name} is new"
        elif before[name] != after[name]:
            for line in difflib.unified_diff(before[name].splitlines(), after[name].splitlines(), lineterm="", n=0):
                if line[:1] in "+-" and line[:3] not in ("+++", "---"):
                    yield f"{name}: {'now' if line[0] == '+' else 'no more'} '{line[1:].strip()}'"
