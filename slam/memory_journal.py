"""What the memory has changed since it last wrote to its store."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable

import numpy as np

from waychair.slam.long_term_file import Batch, State
from waychair.slam.nodes import Link, Node
from waychair.slam.skeleton import Skeleton
from waychair.types import Bytes, FloatArray, IntArray

_ANCHORS = 256  # written in one transaction at most; a loop may bend all there are


class Journal:
    """Collects changes, of which `batch` makes one transaction; go on with what is `following` then."""

    def __init__(self) -> None:
        self.states: set[int] = set()
        self._links: dict[tuple[int, int], Link | None] = {}
        self._rewritten: dict[int, Node] = {}
        self._children: list[tuple[Node | None, State]] = []
        self._gone: list[int] = []
        self._moved: set[int] = set()
        self._written: list[int] = []  # anchors of the batch

    @property
    def has_moved(self) -> bool:
        """Whether there are anchors that are yet to be written."""
        return bool(self._moved)

    def linked(self, link: Link) -> None:
        """A link is new, or is another one than before."""
        self._links[min(link.i, link.j), max(link.i, link.j)] = link

    def unlinked(self, i: int, j: int) -> None:
        """A link is gone."""
        self._links[min(i, j), max(i, j)] = None

    def rewritten(self, node: Node) -> None:
        """A node's words have other numbers."""
        self._rewritten[node.id] = node

    def gone(self, node: int) -> None:
        """A node is not to be in the store."""
        self._forget(node)
        self._gone.append(node)

    def child(self, node: Node, stored: bool, state: State) -> None:
        """A node stays in the store, though only there, under its parent."""
        self._forget(node.id)
        self._children.append((None if stored else node, state))

    def moved(self, anchors: IntArray) -> None:
        """Anchors (K,) stand elsewhere, or are new."""
        self._moved.update(anchors.tolist())

    def following(self) -> Journal:
        """A new one, with the anchors that the batch had no room for."""
        following = Journal()
        following._moved = self._moved
        following._moved.difference_update(self._written)
        return following

    def batch(
        self,
        added: Iterable[Node],
        words: tuple[IntArray, Bytes] | None,
        skeleton: Skeleton,
        awake: Collection[int],
        anchors: FloatArray,
    ) -> Batch:
        """All that has changed, with the nodes and words that are new.

        Of the anchors that have moved only so many: the newest, on which new nodes hang, and the others with the next
        batches. A program that is killed meanwhile finds those where they stood before the loop, as a loop later.
        """
        self._written = heapq.nlargest(_ANCHORS, self._moved)
        moved = np.array(sorted(self._written), np.int64)
        moved = moved[np.isfinite(anchors[moved]).all(axis=1)]
        states = (_state(skeleton, node, node in awake) for node in sorted(self.states))
        return Batch(
            nodes=(*added, *(node for node, _ in self._children if node is not None)),
            rewritten=tuple(self._rewritten.values()),
            states=(*states, *(state for _, state in self._children)),
            links=tuple(link for link in self._links.values() if link is not None),
            unlinked=tuple(ends for ends, link in self._links.items() if link is None),
            gone=tuple(self._gone),
            words=words,
            anchors=(moved, anchors[moved]) if len(moved) else None,
        )

    def _forget(self, node: int) -> None:
        self.states.discard(node)
        self._rewritten.pop(node, None)


def _state(skeleton: Skeleton, node: int, awake: bool) -> State:
    weight, anchor = int(skeleton.rows["weight"][node]), int(skeleton.rows["anchor"][node])
    return State(node, weight, awake, anchor, skeleton.anchor_from_node(node))
