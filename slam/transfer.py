"""Which nodes of the WM are put to sleep, as RTAB-Map 0.23.8 chooses them (Memory::getRemovableSignatures)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from waychair.slam.memory_settings import MemorySettings
from waychair.slam.skeleton import Skeleton

_SECOND = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Awake:
    """What is in RAM: STM in the order of joining, WM; and the newer node of the latest loop closure (0: none yet)."""

    stm: Sequence[int]
    wm: Collection[int]
    last_closure: int = 0
    immunised: Collection[int] = field(default=frozenset())


def is_due(spent_ms: float, wm_nodes: int, settings: MemorySettings) -> bool:
    """Whether a limit is exceeded: by the time that the frame took, or by the WM's nodes, intermediate ones apart."""
    late = settings.time_thr > 0 and spent_ms > settings.time_thr
    return late or (settings.memory_thr > 0 and wm_nodes > settings.memory_thr)


def removable(skeleton: Skeleton, awake: Awake, most: int, settings: MemorySettings) -> list[int]:
    """The nodes to put to sleep, at most so many: lowest weight, then oldest age in whole seconds, then lowest id.

    Not those that weigh -1 or are immunised, nor the STM's neighbours, nor the latest closure. Nodes newer than that
    closure are spared where they are fewer than a part (`recent_wm_ratio`) of the WM; where they are more, until the
    pick has made them so.
    """
    candidates = _candidates(skeleton, awake)
    ids = np.array(candidates, np.int64)
    weights, ages = skeleton.rows["weight"][ids], skeleton.rows["entered_ns"][ids] // _SECOND
    if settings.transfer_sorting_by_weight_id:
        ages = np.zeros_like(ages)
    order = ids[np.lexsort((ids, ages, weights))].tolist()
    last, few = awake.last_closure, settings.recent_wm_ratio * len(awake.wm)
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
    """The nodes and, each after its own, the intermediate ones of the WM on either side; those are not counted."""
    going: dict[int, None] = {}
    for node in picked:
        going[node] = None
        reached = [node]
        while reached:
            for beside in skeleton.ways_in_time(reached.pop()):
                if beside in wm and beside not in going and skeleton.rows["weight"][beside] < 0:
                    going[beside] = None
                    reached.append(beside)
    return list(going)


def _candidates(skeleton: Skeleton, awake: Awake) -> list[int]:
    """Nodes of the WM that may go at all, but for what is recent."""
    held = {there for node in awake.stm for there in skeleton.neighbours(node)}
    held.update(awake.immunised)
    held.add(awake.last_closure)
    weight = skeleton.rows["weight"]
    return sorted(node for node in awake.wm if node not in held and weight[node] >= 0)
