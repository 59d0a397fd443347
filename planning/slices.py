"""Work that takes longer than a control step: a generator that yields between bounded parts, and returns the result."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

Result = TypeVar("Result")
Slices: TypeAlias = Generator[None, None, Result]


def finished(work: Slices[Result]) -> Result:
    """The result, all parts done in one go."""
    while True:
        try:
            next(work)
        except StopIteration as done:
            result: Result = done.value
            return result
