"""Large arrays of a solve, cut from one piece of memory that the next solve works in again.

The system clears new memory, which for a field of a million cells takes as long as two or three cycles of multigrid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_MOST_KEPT = 128_000_000
"""Bytes that are kept between two solves."""

LINE = 64
"""Bytes at whole multiples of which each part begins."""

_kept: list[NDArray[np.uint8]] = []


class Memory:
    """Hands out parts of one array, each once."""

    def __init__(self, within: NDArray[np.uint8]) -> None:
        self._left = within

    def take(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """An array that is still to be written."""
        size = math.prod(shape) * np.dtype(dtype).itemsize
        taken = self._left[:size].view(dtype).reshape(shape)
        self._left = self._left[-(-size // LINE) * LINE :]
        return taken

    def framed(self, shape: tuple[int, int], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """The same, with a border of zeros."""
        framed = self.take(shape, dtype)
        framed[0] = framed[-1] = 0.0
        framed[:, 0] = framed[:, -1] = 0.0
        return framed


def new_memory(size: int) -> Memory:
    """So many bytes for one solve."""
    return Memory(np.empty(size, np.uint8))


@contextmanager
def borrowed(size: int) -> Iterator[Memory]:
    """So many bytes for as long as a solve takes; what is cut from them is not to be used after that."""
    try:
        within = _kept.pop()
    except IndexError:  # nothing is kept, or another thread has it
        within = np.empty(size, np.uint8)
    if within.size < size:
        within = np.empty(size, np.uint8)
    try:
        yield Memory(within)
    finally:
        if not _kept and within.size <= _MOST_KEPT:
            _kept.append(within)
