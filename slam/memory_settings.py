"""Settings and counts of the memory: RTAB-Map's parameters under their own names, and two presets."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting


@dataclass(frozen=True, slots=True)
class MemorySettings(Settings):
    """Limits and rules of the memory; defaults of RTAB-Map 0.23.8 (Parameters.h), whose names begin the texts.

    Two differ on purpose. `not_linked_nodes_kept` is off: no code reads a merged node again, and with it the file of a
    standing chair grows without end. `wake_by_place` is new: RTAB-Map finds a sleeping node only through an awake one,
    so a chair that returns to a place whose nodes are all asleep recognises nothing.
    """

    stm_size: int = setting(10, "nodes", "Mem/STMSize, those with pictures", low=1, high=10_000)
    rehearsal_similarity: float = setting(0.6, "", "Mem/RehearsalSimilarity", low=0.0, high=1.0)
    rehearsal_id_updated_to_new_one: bool = setting(False, "", "Mem/RehearsalIdUpdatedToNewOne")
    rehearsal_weight_ignored_while_moving: bool = setting(False, "", "Mem/RehearsalWeightIgnoredWhileMoving")
    linear_update: float = setting(0.1, "m", "RGBD/LinearUpdate, by axis", low=0.0, high=10.0)
    angular_update: float = setting(0.1, "rad", "RGBD/AngularUpdate", low=0.0, high=3.2)
    reduce_graph: bool = setting(False, "", "Mem/ReduceGraph: nodes that closed a loop go when they leave the STM")
    not_linked_nodes_kept: bool = setting(False, "", "Mem/NotLinkedNodesKept (there true): merged nodes stay on disk")
    time_thr: float = setting(0.0, "ms", "Rtabmap/TimeThr, of one frame; 0: no limit", low=0.0, high=1e6)
    memory_thr: int = setting(0, "nodes", "Rtabmap/MemoryThr, of the WM; 0: no limit", low=0, high=10**7)
    transfer_sorting_by_weight_id: bool = setting(False, "", "Mem/TransferSortingByWeightId: the age does not count")
    recent_wm_ratio: float = setting(0.2, "", "Mem/RecentWmRatio", low=0.0, high=1.0)
    max_retrieved: int = setting(2, "nodes", "Rtabmap/MaxRetrieved", low=0, high=1000)
    max_local_retrieved: int = setting(2, "nodes", "RGBD/MaxLocalRetrieved", low=0, high=1000)
    local_radius: float = setting(10.0, "m", "RGBD/LocalRadius", low=0.0, high=1000.0)
    local_immunization_ratio: float = setting(0.25, "", "RGBD/LocalImmunizationRatio", low=0.0, high=1.0)
    prediction_levels: int = setting(17, "links", "entries of Bayes/PredictionLC less one", low=0, high=1000)
    wake_by_place: bool = setting(True, "", "also wake nodes near the chair where no node at all is awake")
    cached_nodes: int = setting(200, "nodes", "put to sleep last and kept decoded, so that waking costs no disk")

    @property
    def bounded(self) -> bool:
        """Whether there is a limit beyond which nodes are put to sleep."""
        return self.time_thr > 0 or self.memory_thr > 0


PRESETS: dict[str, MemorySettings] = {
    "rtabmap": MemorySettings(),
    "paper": MemorySettings(time_thr=1000.0, transfer_sorting_by_weight_id=True),
}
"""`paper` follows Pai et al. 2026, sections 3.2.2 and 3.2.3: an STM of 10 nodes; when a frame takes more than 1 s, the
node of lowest weight goes, among equals the oldest, which has the lowest id."""


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
