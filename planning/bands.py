"""A large grid's rows shared out between two threads: numba's kernels that let go of the interpreter run side by side.

Results do not hang on how many threads there are: rows are computed alike whichever band they are in, and a sum is put
together from the same bands by one thread as by two.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Result = TypeVar("Result")

_WORTH = 1 << 17
"""Cells from which on a second thread saves more than it costs to wake it, some 0.05 ms: their rows are cut in two."""


def in_bands(kernel: Callable[..., None], first: int, stop: int, cells: int, *given: object) -> None:
    """`kernel(*given, first, stop)` over all rows from `first` to before `stop`, a band in each thread.

    Of a grid of so many cells; no row may need what another one writes.
    """
    _shared(kernel, first, stop, cells, given)


def summed(kernel: Callable[..., float], first: int, stop: int, cells: int, *given: object) -> float:
    """As `in_bands`, for the sum of what the kernel gives for each band."""
    return sum(_shared(kernel, first, stop, cells, given))


def bands(first: int, stop: int, cells: int) -> list[tuple[int, int]]:
    """Into which the rows from `first` to before `stop` are cut."""
    half = (first + stop) // 2
    return [(first, half), (half, stop)] if cells >= _WORTH else [(first, stop)]


def _shared(
    kernel: Callable[..., Result], first: int, stop: int, cells: int, given: tuple[object, ...]
) -> list[Result]:
    """What is made of each band, in their order; that of the last in the helper, where there is one."""
    *here, last = bands(first, stop, cells)
    helper = _helper() if here else None
    if helper is None:
        return [kernel(*given, *band) for band in (*here, last)]
    there = helper.submit(kernel, *given, *last)
    return [kernel(*given, *band) for band in here] + [there.result()]


@cache
def _helper() -> ThreadPoolExecutor | None:
    """One thread beside that which asks; None on a computer of one core."""
    return ThreadPoolExecutor(1, "bands") if len(os.sched_getaffinity(0)) > 1 else None


os.register_at_fork(after_in_child=_helper.cache_clear)  # threads are not forked
