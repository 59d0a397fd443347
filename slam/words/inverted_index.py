"""The inverted index of a bag of words, from words to the nodes that show them (Sivic and Zisserman 2003).

Words are identified by slot (a small integer, used again once its word is removed), nodes by id. The postings of a word
form a chain in one pool of arrays, so that the cost of adding, removing and scoring depends only on shared words.
"""

from __future__ import annotations

from collections.abc import KeysView

import numpy as np
from numba import njit

from waychair.slam.camera.hamming_index import Int32Array
from waychair.types import FloatArray, IntArray


class InvertedIndex:
    """References from words to the nodes in short-term and working memory."""

    def __init__(self) -> None:
        self._slots_of: dict[int, Int32Array] = {}
        self._row_of: dict[int, int] = {}
        self._free_rows: list[int] = []
        self._size = np.zeros(16, np.int32)  # words of the node of each row, with repetitions
        self._head = np.full(1024, -1, np.int32)  # first posting of each word
        self._nodes = np.zeros(1024, np.int32)  # number of nodes that show each word
        self._next = np.arange(1, 1025, dtype=np.int32)  # the next posting of the same word, or the next free one
        self._next[-1] = -1
        self._row = np.zeros(1024, np.int32)
        self._count = np.zeros(1024, np.int32)
        self._free, self._spare = 0, 1024  # the first free posting, and the number of free ones

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self._row_of)

    def __contains__(self, node: int) -> bool:
        return node in self._row_of

    @property
    def nodes(self) -> KeysView[int]:
        """The ids of the nodes in the order of their addition."""
        return self._row_of.keys()

    def slots_of(self, node: int) -> Int32Array:
        """Return the words (N,) of a node, in the order of its features."""
        return self._slots_of[node]

    def postings(self, slot: int) -> dict[int, int]:
        """Return the nodes that show a word, and how often."""
        node_of = {row: node for node, row in self._row_of.items()}
        found, at = {}, int(self._head[slot]) if slot < len(self._head) else -1
        while at >= 0:
            found[node_of[int(self._row[at])]] = int(self._count[at])
            at = int(self._next[at])
        return found

    def add(self, node: int, slots: Int32Array) -> None:
        """Add a new node with its words (N,)."""
        row = self._free_rows.pop() if self._free_rows else len(self._row_of)
        if row >= len(self._size):
            self._size = np.concatenate([self._size, np.zeros_like(self._size)])
        self._row_of[node], self._slots_of[node], self._size[row] = row, slots, len(slots)
        distinct, counts = np.unique(slots, return_counts=True)
        self._reserve(int(distinct[-1]) + 1 if len(distinct) else 0, len(distinct))
        self._free = _link(
            slots=distinct,
            counts=counts,
            row=row,
            head=self._head,
            nodes=self._nodes,
            following=self._next,
            rows=self._row,
            count=self._count,
            free=self._free,
        )
        self._spare -= len(distinct)

    def remove(self, node: int) -> Int32Array:
        """Remove a node; return its words (K,) that no other node shows."""
        row, slots = self._row_of.pop(node), np.unique(self._slots_of.pop(node))
        self._free_rows.append(row)
        self._free = _unlink(
            slots=slots,
            row=row,
            head=self._head,
            nodes=self._nodes,
            following=self._next,
            rows=self._row,
            free=self._free,
        )
        self._spare += len(slots)
        return self.unused(slots)

    def unused(self, slots: Int32Array) -> Int32Array:
        """Return the words among (N,) that no node shows."""
        gone: Int32Array = slots[self._nodes[slots] == 0]
        return gone

    def scores(self, slots: Int32Array, nodes: IntArray) -> FloatArray:
        """Return tf-idf scores (M,) of nodes (M,) for the words (N,) of another node."""
        totals = _scores(
            slots=np.unique(slots),
            memory=len(self._row_of),
            head=self._head,
            nodes=self._nodes,
            following=self._next,
            rows=self._row,
            count=self._count,
            size=self._size,
        )
        rows = np.fromiter((self._row_of[int(node)] for node in nodes), np.int64, len(nodes))
        return totals[rows]

    def _reserve(self, slots: int, postings: int) -> None:
        if slots > len(self._head):
            more = max(slots, 2 * len(self._head)) - len(self._head)
            self._head = np.concatenate([self._head, np.full(more, -1, np.int32)])
            self._nodes = np.concatenate([self._nodes, np.zeros(more, np.int32)])
        if postings > self._spare:
            old = len(self._next)
            more = max(old, postings)
            chain = np.arange(old + 1, old + more + 1, dtype=np.int32)
            chain[-1] = self._free  # the old free ones follow the new ones
            self._next = np.concatenate([self._next, chain])
            self._row = np.concatenate([self._row, np.zeros(more, np.int32)])
            self._count = np.concatenate([self._count, np.zeros(more, np.int32)])
            self._free, self._spare = old, self._spare + more


@njit(cache=True)
def _link(
    slots: Int32Array,
    counts: IntArray,
    row: int,
    head: Int32Array,
    nodes: Int32Array,
    following: Int32Array,
    rows: Int32Array,
    count: Int32Array,
    free: int,
) -> int:
    """Add a posting of `row` at the head of each word's chain; return the first free posting."""
    for i in range(len(slots)):
        at, slot = free, slots[i]
        free = following[at]
        rows[at], count[at] = row, counts[i]
        following[at] = head[slot]
        head[slot] = at
        nodes[slot] += 1
    return free


@njit(cache=True)
def _unlink(
    slots: Int32Array,
    row: int,
    head: Int32Array,
    nodes: Int32Array,
    following: Int32Array,
    rows: Int32Array,
    free: int,
) -> int:
    """Free the postings of `row` in the words' chains; return the first free posting."""
    for slot in slots:
        before, at = -1, head[slot]
        while rows[at] != row:
            before, at = at, following[at]
        if before < 0:
            head[slot] = following[at]
        else:
            following[before] = following[at]
        following[at] = free
        free = at
        nodes[slot] -= 1
    return free


@njit(cache=True, nogil=True)
def _scores(
    slots: Int32Array,
    memory: int,
    head: Int32Array,
    nodes: Int32Array,
    following: Int32Array,
    rows: Int32Array,
    count: Int32Array,
    size: Int32Array,
) -> FloatArray:
    totals = np.zeros(len(size))
    for slot in slots:
        if nodes[slot] == 0:
            continue
        weight = np.log10(memory / nodes[slot])
        at = head[slot]
        while at >= 0:
            totals[rows[at]] += count[at] * weight / size[rows[at]]
            at = following[at]
    return totals
