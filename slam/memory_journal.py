"""What the memory has changed since it last wrote to its store."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from waychair.slam.long_term_file import Batch, State
from waychair.slam.nodes import Link, Node
from waychair.slam.skeleton import Skeleton
from waychair.types import Bytes, FloatArray, IntArray

_MOVED = 1e-6  # [m], [rad] by which an anchor stands elsewhere


class Journal:
    """Collects changes, of which `batch` makes one transaction; begin another then."""

    def __init__(self) -> None:
        self.states: set[int] = set()
        self._links: dict[tuple[int, int], Link | None] = {}
        self._rewritten: dict[int, Node] = {}
        self._children: list[tuple[Node | None, State]] = []
        self._gone: list[int] = []
        self._moved: set[int] = set()

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

    def bent(self, before: FloatArray, after: FloatArray) -> None:
        """Anchors that stood at (A, 3) stand at (B, 3)."""
        known = min(len(before), len(after))
        with np.errstate(invalid="ignore"):
            still = (np.abs(after[:known] - before[:known]) <= _MOVED).all(axis=1)
        self._moved.update(np.flatnonzero(~still).tolist(), range(known, len(after)))

    def batch(
        self,
        added: Iterable[Node],
        words: tuple[IntArray, Bytes] | None,
        skeleton: Skeleton,
        awake: Collection[int],
        anchors: FloatArray,
    ) -> Batch:
        """All that has changed, with the nodes and words that are new."""
        moved = np.array(sorted(k for k in self._moved if np.isfinite(anchors[k]).all()), np.int64)
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
