"""Results, warnings and questions to the user, and the option --quiet."""

from __future__ import annotations

import sys
from collections.abc import Callable


def warn(sentence: str) -> None:
    """Print a warning on a line of its own."""
    print(f"warning: {sentence}", file=sys.stderr)


def warnings_unless(quiet: bool) -> Callable[[str], None]:
    """Return `warn`, or with `quiet` a function that does nothing."""
    return (lambda sentence: None) if quiet else warn


def sayer(quiet: bool) -> Callable[[str], None]:
    """Return `print`, or with `quiet` a function that does nothing."""
    return (lambda text: None) if quiet else print


def is_agreed(question: str) -> bool:
    """Return whether the user answers a question with yes; False where nobody can be asked, without a terminal."""
    if not sys.stdin.isatty():
        return False
    print(f"{question} [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")
