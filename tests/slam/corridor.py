"""A memory of a straight corridor: node k stands k metres from the start, and is its own anchor."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.slam.memory import memory_manager as memory_module
from waychair.slam.memory import retrieval
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import Link, LinkKind, MemoryNode, NodeScan
from waychair.slam.memory.skeleton import Skeleton
from waychair.types import Pose2, Scan

SECOND = 1_000_000_000

_MODULES = {"STM_SIZE": memory_module, "CACHED_NODES": memory_module}
SURE = np.diag([100.0, 100.0, 400.0])


def view(k: int, words: list[int] | None = None, x: float | None = None, second: float | None = None) -> MemoryNode:
    """A node k metres down the corridor, seen at second k, with five own words, unless given."""
    own = list(range(10 * k + 1, 10 * k + 6)) if words is None else words
    rng = np.random.default_rng(k)
    scan = Scan(k * SECOND, rng.uniform(1.0, 5.0, 40).astype(np.float32), -math.pi, math.tau / 40, 0.0, 0.1, 10.0)
    return MemoryNode(
        round((k if second is None else second) * SECOND),
        Pose2(float(k) if x is None else x),
        np.array(own, np.int32),
        rng.random((len(own), 2), np.float32),
        rng.random((len(own), 3), np.float32),
        rng.integers(0, 256, (len(own), 32), dtype=np.uint8),
        rng.random((40, 2), np.float32),
        NodeScan(scan, Pose2(0.2), Pose2(0.21)),
    )


def corridor(length: int, settings: MemorySettings, memory: NodeMemory | None = None) -> NodeMemory:
    """A drive over this number of nodes; no node is woken or put to sleep."""
    memory = memory or NodeMemory(settings)
    stand(memory, length)
    for k in range(1, length + 1):
        memory.add(view(k), SURE)
    return memory


def set_limits(patch: pytest.MonkeyPatch, **constants: float) -> None:
    """Set constants of the memory and of retrieval to small values, as a long drive reaches the real ones."""
    for name, value in constants.items():
        patch.setattr(_MODULES.get(name, retrieval), name, value)


def stand(memory: NodeMemory, length: int) -> None:
    """The anchors are at the nodes, each facing down the corridor."""
    anchors = np.zeros((length + 1, 3))
    anchors[:, 0] = np.arange(length + 1)
    memory.move_anchors(anchors)


def loop(i: int, j: int, kind: LinkKind = LinkKind.GLOBAL) -> Link:
    return Link(i, j, kind, Pose2(0.1, 0.2, 0.3), SURE)


def chain(length: int) -> Skeleton:
    """Nodes 1, 2, ... one metre apart, each its own anchor, linked as neighbours; all of them in the STM."""
    skeleton = Skeleton()
    for node in range(1, length + 1):
        skeleton.add(node, node * SECOND, 0, node, Pose2())
        if node > 1:
            skeleton.link(Link(node - 1, node, LinkKind.NEIGHBOUR, Pose2(1.0), SURE))
    return skeleton
