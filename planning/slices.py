"""Work that takes longer than a control step: a generator that yields between bounded parts, and returns the result."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

Result = TypeVar("Result")
Slices: TypeAlias = Generator[None, None, Result]
"""Yields wherever a control step may end."""

Parts: TypeAlias = Generator[int, None, Result]
"""Yields after each of many small parts how many cells of a grid that part has visited."""


def finished(work: Generator[object, None, Result]) -> Result:
    """The result, all parts done in one go."""
    while True:
        try:
            next(work)
        except StopIteration as done:
            result: Result = done.value
            return result


def chunks(first: int, stop: int, most: int) -> list[tuple[int, int]]:
    """The numbers from `first` to before `stop`, cut into runs of at most so many: where each begins and ends."""
    return [(begin, min(begin + most, stop)) for begin in range(first, stop, most)]


def sliced(work: Parts[Result], most: int) -> Slices[Result]:
    """Small parts put together to slices, each of which ends once it has visited `most` cells."""
    visited = 0
    while True:
        try:
            visited += next(work)
        except StopIteration as done:
            result: Result = done.value
            return result
        if visited >= most:
            visited = 0
            yield
