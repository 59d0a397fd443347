"""Exact nearest neighbours among float words (SIFT) by a matrix product, for some ten thousand words."""

from __future__ import annotations

import numpy as np

from waychair.slam.camera.hamming_index import Int32Array
from waychair.types import Float32Array


class FloatIndex:
    """Float words by slot, a small integer chosen by the caller; it is free again after `remove`."""

    def __init__(self, width: int = 128) -> None:
        self._words = np.zeros((256, width), np.float32)
        self._norms = np.full(256, np.inf, np.float32)  # squared; infinite where a slot holds no word

    def __len__(self) -> int:
        return int(np.isfinite(self._norms).sum())

    def insert(self, words: Float32Array, slots: Int32Array) -> None:
        """Insert words (N, width) under unused slots (N,)."""
        if len(slots) == 0:
            return
        if slots.max() >= len(self._norms):
            more = max(int(slots.max()) + 1, 2 * len(self._norms)) - len(self._norms)
            self._words = np.concatenate([self._words, np.zeros((more, self._words.shape[1]), np.float32)])
            self._norms = np.concatenate([self._norms, np.full(more, np.inf, np.float32)])
        self._words[slots] = words
        self._norms[slots] = np.einsum("ij,ij->i", words, words)

    def remove(self, slots: Int32Array) -> None:
        """Remove the words of these slots."""
        self._norms[slots] = np.inf

    def words(self, slots: Int32Array) -> Float32Array:
        """Return the words (N, width) of slots (N,)."""
        return self._words[slots]

    def nearest(self, queries: Float32Array) -> tuple[Int32Array, Float32Array]:
        """Return slots and squared distances (N, 2) of each query's two nearest words; -1 and inf where missing."""
        slots = np.full((len(queries), 2), -1, np.int32)
        distances = np.full((len(queries), 2), np.inf, np.float32)
        if len(queries) == 0:
            return slots, distances
        squared = self._norms - 2.0 * (queries @ self._words.T)
        two = np.argpartition(squared, 1, axis=1)[:, :2]
        values = np.take_along_axis(squared, two, axis=1)
        order = np.argsort(values, axis=1, kind="stable")
        two, values = np.take_along_axis(two, order, axis=1), np.take_along_axis(values, order, axis=1)
        found = np.isfinite(values)
        slots[found] = two[found]
        own = np.einsum("ij,ij->i", queries, queries)[:, None]
        distances[found] = np.maximum(values + own, 0.0)[found]
        return slots, distances
