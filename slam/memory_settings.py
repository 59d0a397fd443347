"""How the memory is managed: RTAB-Map's parameters under their own names, two presets, and what is counted."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting


@dataclass(frozen=True, slots=True)
class MemorySettings(Settings):
    """Defaults are those of RTAB-Map 0.23.8 (Parameters.h); each text begins with the parameter's name there.

    Two differ on purpose. `not_linked_nodes_kept`: nothing reads a merged node again, and with it the file of a chair
    that stands still grows without end. `wake_by_place` is new: RTAB-Map finds a sleeping node only through one that is
    awake, so a chair that comes back to a place of which all nodes sleep recognises nothing.
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
        """Whether there is a limit, so that nodes are ever put to sleep."""
        return self.time_thr > 0 or self.memory_thr > 0


PRESETS: dict[str, MemorySettings] = {
    "rtabmap": MemorySettings(),
    "paper": MemorySettings(time_thr=1000.0, transfer_sorting_by_weight_id=True),
}
"""`paper` is section 3.2.2 and 3.2.3 of Pai et al. 2026: STM of 10 nodes; when a frame takes more than 1 s the node of
lowest weight goes, among equals the one that joined first, which is the lowest id."""


@dataclass(frozen=True, slots=True)
class MemoryCounts:
    """What Tables 1 and 2 of Pai et al. 2026 count, each in two readings.

    As a state, at this moment: `stm` + `wm` + `ltm` nodes, each in one place only, are at most the `frames` (those that
    were merged, reduced or dropped are missing). As events, since the start: `entered_wm` and `transferred` count a node
    each time it goes. The paper's do not add up as states: 1498 + 427 WM and LTM nodes of 1050 frames, 870 + 132 of
    550. Nor do they as events: with 10 nodes in the STM, 1040 + retrieved can be 1498 only if 458 were retrieved, more
    than the 427 that were ever transferred (330 of 132 in the basement).
    """

    frames: int = 0
    """Nodes that were ever added, intermediate ones apart."""
    stm: int = 0
    wm: int = 0
    ltm: int = 0
    """Nodes there now, intermediate ones included."""
    entered_wm: int = 0
    """Times that a node came into the WM, from the STM or the LTM."""
    transferred: int = 0
    """Times that a node went from the WM to the LTM."""
    retrieved: int = 0
    """Times that a node came back from there."""
    merged: int = 0
    """Nodes that rehearsal has merged into another."""
    reduced: int = 0
    """Nodes that were led past when they left the STM."""
    dropped: int = 0
    """Nodes taken back by the caller, such as those of a chair that has not moved."""
    closures: int = 0
    """Loops by appearance that were accepted and not taken back."""
    unreadable: int = 0
    """Nodes whose record on disk is damaged."""
    words: int = 0
    """Words in the dictionary now; known to the dictionary only."""
