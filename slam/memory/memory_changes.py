"""Results of steps of the memory: the nodes that came and went, and the outcome of adding one."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.slam.memory.nodes import MemoryNode
from waychair.slam.memory.rehearsal import RehearsalResult


@dataclass(frozen=True, slots=True)
class MemoryChange:
    """Nodes that came and went: the vocabulary holds words of nodes in RAM (STM and WM), the Bayes filter the WM."""

    woken: tuple[MemoryNode, ...] = ()
    """Nodes that have come into RAM; their words must be recalled."""
    slept: tuple[MemoryNode, ...] = ()
    """Nodes that have left RAM; their words must be forgotten."""
    entered_wm: tuple[int, ...] = ()
    left_wm: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class AddedNode:
    """The outcome of adding a node.

    `id` is the new node's, or the older node's if the new one was merged into it.
    """

    id: int
    verdict: RehearsalResult
    change: MemoryChange
