"""Scratch memory: the large arrays of a solve, cut from one block that the next solve reuses.

The operating system clears new memory; for a field of a million cells that takes as long as two or three multigrid
cycles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_MOST_KEPT = 128_000_000
"""Largest block [bytes] that is kept between two solves."""

LINE = 64
"""Alignment [bytes] of each part."""

_kept: list[NDArray[np.uint8]] = []


class ScratchMemory:
    """A block of memory that hands out its parts, each once."""

    def __init__(self, within: NDArray[np.uint8]) -> None:
        self._left = within

    def take(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """Return an uninitialised array."""
        size = math.prod(shape) * np.dtype(dtype).itemsize
        taken = self._left[:size].view(dtype).reshape(shape)
        self._left = self._left[-(-size // LINE) * LINE :]
        return taken

    def framed(self, shape: tuple[int, int], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """Return an uninitialised array with a border of zeros."""
        framed = self.take(shape, dtype)
        framed[0] = framed[-1] = 0.0
        framed[:, 0] = framed[:, -1] = 0.0
        return framed


def new_scratch_memory(size: int) -> ScratchMemory:
    """Return a new block of so many bytes."""
    return ScratchMemory(np.empty(size, np.uint8))


@contextmanager
def borrowed_scratch_memory(size: int) -> Iterator[ScratchMemory]:
    """Lend a block of so many bytes for one solve; its arrays must not be used afterwards."""
    try:
        within = _kept.pop()
    except IndexError:  # no block is kept, or another thread has it
        within = np.empty(size, np.uint8)
    if within.size < size:
        within = np.empty(size, np.uint8)
    try:
        yield ScratchMemory(within)
    finally:
        if not _kept and within.size <= _MOST_KEPT:
            _kept.append(within)
