"""Row threads: a large grid's rows are split between two threads running nogil numba kernels in parallel.

Results do not depend on the number of threads: each row is computed the same in either half, and one thread adds up
the same two halves as two threads do.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Result = TypeVar("Result")

_WORTH = 1 << 17
"""Least number of cells for which a second thread saves more time than waking it takes, about 0.05 ms."""


def over_rows(kernel: Callable[..., None], first: int, stop: int, cells: int, *given: object) -> None:
    """Run `kernel(*given, first, stop)` over the rows from `first` to before `stop` of a grid of so many cells.

    Rows must be independent: none may read values that another writes.
    """
    _run_over_rows(kernel, first, stop, cells, given)


def sum_over_rows(kernel: Callable[..., float], first: int, stop: int, cells: int, *given: object) -> float:
    """Return the sum of the kernel's results; otherwise as `over_rows`."""
    return sum(_run_over_rows(kernel, first, stop, cells, given))


def row_ranges(first: int, stop: int, cells: int) -> list[tuple[int, int]]:
    """Return the row ranges into which the rows from `first` to before `stop` are split."""
    half = (first + stop) // 2
    return [(first, half), (half, stop)] if cells >= _WORTH else [(first, stop)]


def _run_over_rows(
    kernel: Callable[..., Result], first: int, stop: int, cells: int, given: tuple[object, ...]
) -> list[Result]:
    """Return the kernel's result for each row range, in order; the last range runs in the helper thread, if any."""
    *here, last = row_ranges(first, stop, cells)
    helper = _helper() if here else None
    if helper is None:
        return [kernel(*given, *band) for band in (*here, last)]
    there = helper.submit(kernel, *given, *last)
    return [kernel(*given, *band) for band in here] + [there.result()]


@cache
def _helper() -> ThreadPoolExecutor | None:
    """Return a pool of one extra thread; None on a computer with one core."""
    return ThreadPoolExecutor(1, "rows") if len(os.sched_getaffinity(0)) > 1 else None


os.register_at_fork(after_in_child=_helper.cache_clear)  # a forked child has no threads
