"""The changes of the memory since it last wrote to its store."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable

import numpy as np

from waychair.slam.memory.long_term_file import Batch, NodeState
from waychair.slam.memory.nodes import Link, MemoryNode
from waychair.slam.memory.skeleton import Skeleton
from waychair.types import Bytes, FloatArray, IntArray

_ANCHORS = 256  # most anchors written in one transaction; a loop may move all of them


class Journal:
    """Collects changes; `batch` makes one transaction of them, `following` begins the next journal."""

    def __init__(self) -> None:
        self.states: set[int] = set()
        self._links: dict[tuple[int, int], Link | None] = {}
        self._rewritten: dict[int, MemoryNode] = {}
        self._gone: list[int] = []
        self._moved: set[int] = set()
        self._written: list[int] = []  # anchors in the batch

    @property
    def has_moved(self) -> bool:
        """Whether there are anchors still to be written."""
        return bool(self._moved)

    def linked(self, link: Link) -> None:
        """Record a new or changed link."""
        self._links[min(link.i, link.j), max(link.i, link.j)] = link

    def unlinked(self, i: int, j: int) -> None:
        """Record a removed link."""
        self._links[min(i, j), max(i, j)] = None

    def rewritten(self, node: MemoryNode) -> None:
        """Record a node whose words have new ids."""
        self._rewritten[node.id] = node

    def gone(self, node: int) -> None:
        """Record a node to be removed from the store."""
        self.states.discard(node)
        self._rewritten.pop(node, None)
        self._gone.append(node)

    def moved(self, anchors: IntArray) -> None:
        """Record anchors (K,) with new poses."""
        self._moved.update(anchors.tolist())

    def following(self) -> Journal:
        """Return the next journal, with the anchors that did not fit into the batch."""
        following = Journal()
        following._moved = self._moved
        following._moved.difference_update(self._written)
        return following

    def batch(
        self,
        added: Iterable[MemoryNode],
        words: tuple[IntArray, Bytes] | None,
        skeleton: Skeleton,
        awake: Collection[int],
        anchors: FloatArray,
    ) -> Batch:
        """Return all changes as one transaction, with the new nodes and words.

        It holds a limited number of moved anchors, the newest ones, to which new nodes are attached; the others follow
        in the next batches. A program killed meanwhile finds those at their poses before the loop closure.
        """
        self._written = heapq.nlargest(_ANCHORS, self._moved)
        moved = np.array(sorted(self._written), np.int64)
        moved = moved[np.isfinite(anchors[moved]).all(axis=1)]
        states = (_state(skeleton, node, node in awake) for node in sorted(self.states))
        return Batch(
            nodes=tuple(added),
            rewritten=tuple(self._rewritten.values()),
            states=tuple(states),
            links=tuple(link for link in self._links.values() if link is not None),
            unlinked=tuple(ends for ends, link in self._links.items() if link is None),
            gone=tuple(self._gone),
            words=words,
            anchors=(moved, anchors[moved]) if len(moved) else None,
        )


def _state(skeleton: Skeleton, node: int, awake: bool) -> NodeState:
    weight, anchor = int(skeleton.rows["weight"][node]), int(skeleton.rows["anchor"][node])
    return NodeState(node, weight, awake, anchor, skeleton.anchor_from_node(node))
