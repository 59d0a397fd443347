"""Settings and counts of the memory."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting


@dataclass(frozen=True, slots=True)
class MemorySettings(Settings):
    """Limits of the memory; RTAB-Map's names in brackets."""

    frame_time_limit: float = setting(
        0.0,
        "ms",
        "time of a frame above which nodes are put to sleep; larger: fewer sleep; 0: no limit [Rtabmap/TimeThr]",
        low=0.0,
        high=1e6,
    )
    working_memory_limit: int = setting(
        0, "nodes",
        "most awake nodes in the working memory; more: more time per picture; 0: no limit [Rtabmap/MemoryThr]",
        low=0, high=10**7,
    )  # fmt: skip
    reduce_graph: bool = setting(
        False, "", "true: nodes that closed a loop are removed once they leave the short-term memory [Mem/ReduceGraph]"
    )

    @property
    def bounded(self) -> bool:
        """Whether there is a limit beyond which nodes are put to sleep."""
        return self.frame_time_limit > 0 or self.working_memory_limit > 0


@dataclass(frozen=True, slots=True)
class MemoryCounts:
    """The counts of Tables 1 and 2 of Pai et al. 2026, in two readings.

    As states at this moment: `stm` + `wm` + `ltm`, each node once, are at most `frames` (merged, reduced and dropped
    nodes are missing). As events since the start: `entered_wm` and `transferred` count every move of a node. The
    paper's numbers fit neither reading. As states: 1498 + 427 WM and LTM nodes exceed 1050 frames, as do 870 + 132 of
    550. As events: with 10 nodes in the STM, 1040 + retrieved equals 1498 only if 458 were retrieved, more than the 427
    ever transferred (330 of 132 in the basement).
    """

    frames: int = 0
    """Nodes ever added, without intermediate ones."""
    stm: int = 0
    wm: int = 0
    ltm: int = 0
    """Nodes in each memory now, with intermediate ones."""
    entered_wm: int = 0
    """Moves of a node into the WM, from the STM or the LTM."""
    transferred: int = 0
    """Moves of a node from the WM to the LTM."""
    retrieved: int = 0
    """Moves of a node from the LTM to the WM."""
    merged: int = 0
    """Nodes merged into another by rehearsal."""
    reduced: int = 0
    """Nodes removed by graph reduction when they left the STM."""
    dropped: int = 0
    """Nodes removed by the caller, such as those of a chair that has not moved."""
    closures: int = 0
    """Loop closures by appearance, without removed ones."""
    unreadable: int = 0
    """Nodes with a damaged record on disk."""
    words: int = 0
    """Words in the vocabulary now; only the vocabulary knows."""
