"""Resumable generators, for work longer than a control period or a scan: they yield between bounded parts."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

Result = TypeVar("Result")

CELLS_PER_STEP = 2_000_000
"""Grid cells visited in one control period, about 6 ms of its 50."""

Resumable: TypeAlias = Generator[None, None, Result]
"""A generator that yields wherever the control loop may interrupt the work."""

CountedSteps: TypeAlias = Generator[int, None, Result]
"""A generator that yields, after each small part, how much that part has done: grid cells visited, or graph nodes solved."""


def finished(work: Generator[object, None, Result]) -> Result:
    """Return the result, without interruption."""
    while True:
        try:
            next(work)
        except StopIteration as done:
            result: Result = done.value
            return result


def ranges_of(first: int, stop: int, most: int) -> list[tuple[int, int]]:
    """Return the range from `first` to before `stop` cut into ranges of at most so many numbers."""
    return [(begin, min(begin + most, stop)) for begin in range(first, stop, most)]


def in_time_slices(work: CountedSteps[Result], most: int) -> Resumable[Result]:
    """Return the work with a yield only once `most` cells have been visited since the last one."""
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


def counted(work: Resumable[Result], cells: int) -> CountedSteps[Result]:
    """Return the work as counted steps, each of which counts as so many cells."""
    while True:
        try:
            next(work)
        except StopIteration as done:
            result: Result = done.value
            return result
        yield cells
