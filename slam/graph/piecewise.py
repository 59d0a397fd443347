"""Work that can be put by after each piece, so that nothing else waits for the whole of it."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

_Result = TypeVar("_Result")

Piecewise = Generator[int, None, _Result]
"""It yields, after each piece, how many nodes of a graph the piece has solved, and returns its result."""


def finished(work: Piecewise[_Result]) -> _Result:
    """Return the result of work that is done without a break."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            result: _Result = end.value
            return result
