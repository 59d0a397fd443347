"""Choice of the nodes that go from working to long-term memory (RTAB-Map 0.23.8, Memory::getRemovableSignatures)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.skeleton import Skeleton

_SECOND = 1_000_000_000

RECENT_SHARE = 0.2
"""Nodes newer than the latest loop closure stay while they are fewer than this share of the WM (Mem/RecentWmRatio)."""


@dataclass(frozen=True, slots=True)
class NodesInRam:
    """Nodes in RAM: the STM in joining order, and the WM; and the newer node of the latest loop closure (0: none)."""

    stm: Sequence[int]
    wm: Collection[int]
    last_closure: int = 0
    immunised: Collection[int] = field(default=frozenset())


def is_due(spent_ms: float, wm_nodes: int, settings: MemorySettings) -> bool:
    """Return whether a limit is exceeded: the time of a frame, or the WM's nodes without intermediate ones."""
    late = settings.frame_time_limit > 0 and spent_ms > settings.frame_time_limit
    return late or (settings.working_memory_limit > 0 and wm_nodes > settings.working_memory_limit)


def removable(skeleton: Skeleton, awake: NodesInRam, most: int) -> list[int]:
    """Return at most `most` nodes for transfer: lowest weight first, then oldest in whole seconds, then lowest id.

    Exempt are intermediate nodes (weight -1), immunised nodes, neighbours of the STM and the latest closure. Nodes newer
    than that closure are exempt while they are fewer than the share `RECENT_SHARE` of the WM.
    """
    candidates = _candidates(skeleton, awake)
    ids = np.array(candidates, np.int64)
    weights, ages = skeleton.rows["weight"][ids], skeleton.rows["entered_ns"][ids] // _SECOND
    order = ids[np.lexsort((ids, ages, weights))].tolist()
    last, few = awake.last_closure, RECENT_SHARE * len(awake.wm)
    recent = sum(node > last for node in awake.wm) if last else 0
    picked: list[int] = []
    for node in order:
        if len(picked) == most:
            break
        if last and node > last:
            if recent < few:
                continue
            recent -= 1
        picked.append(node)
    return picked


def with_intermediate(skeleton: Skeleton, picked: Sequence[int], wm: Collection[int]) -> list[int]:
    """Return the nodes, each followed by the adjacent intermediate nodes of the WM, which do not count."""
    going: dict[int, None] = {}
    for node in picked:
        going[node] = None
        reached = [node]
        while reached:
            for beside in skeleton.neighbours_in_time(reached.pop()):
                if beside in wm and beside not in going and skeleton.rows["weight"][beside] < 0:
                    going[beside] = None
                    reached.append(beside)
    return list(going)


def _candidates(skeleton: Skeleton, awake: NodesInRam) -> list[int]:
    """Return the nodes of the WM that may be transferred, before the exemption of recent nodes."""
    held = {there for node in awake.stm for there in skeleton.neighbours(node)}
    held.update(awake.immunised)
    held.add(awake.last_closure)
    weight = skeleton.rows["weight"]
    return sorted(node for node in awake.wm if node not in held and weight[node] >= 0)
