"""The memory of places of a map: built from a recording's pictures, saved as `memory.db`, with its report."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from waychair.errors import RecordingError, SessionError
from waychair.offline.memory_file import MEMORY, remove_memory
from waychair.recordings.recording import Recording
from waychair.slam.mapping.appearance_loops import NEAR_DISTANCE, AppearanceLoopClosure
from waychair.slam.mapping.appearance_settings import AppearanceSettings
from waychair.slam.mapping.mapper import Mapper
from waychair.slam.memory.memory_manager import STM_SIZE, NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import LinkKind
from waychair.slam.memory.place_memory import PictureCost, PlaceMemory
from waychair.slam.memory.revisit_count import revisits
from waychair.types import Json, Pose3, RgbdFrame, SensorFrame


class MemoryBuilder:
    """Builds a memory of places from the pictures between a recording's scans; `seconds`: CPU time with decoding."""

    def __init__(self, appearance: AppearanceLoopClosure, pictures: Iterator[RgbdFrame]) -> None:
        self.appearance = appearance
        self.seconds = 0.0
        self.warnings: tuple[str, ...] = ()
        self._pictures = self._readable(pictures)
        self._next = next(self._pictures, None)

    def follow(self, mapper: Mapper, frame: SensorFrame) -> None:
        """Add the pictures up to a frame; call it after `mapper.process`."""
        started = time.process_time()
        while self._next is not None and self._next.stamp_ns <= frame.stamp_ns:
            self.appearance.see(self._next)
            self._next = next(self._pictures, None)
        self.appearance.follow(mapper, frame)
        self.seconds += time.process_time() - started

    def finish(self, mapper: Mapper) -> Json:
        """Close the memory after the mapper's last optimisation; return its report.

        `warnings` then holds problems of the pictures and the file.
        """
        late = sum(1 for _ in self._pictures) + (self._next is not None)
        self.appearance.counts["pictures after the last scan"] = late
        self.appearance.finish(mapper)
        store = self.appearance.memory.store
        report = memory_report(self.appearance.places, NEAR_DISTANCE)
        self.appearance.memory.close()
        self.warnings += (*store.notes, *([] if store.fault is None else [str(store.fault)]))
        return report

    def _readable(self, pictures: Iterator[RgbdFrame]) -> Iterator[RgbdFrame]:
        """Yield the pictures up to the first unreadable one; the lidar goes on alone."""
        try:
            yield from pictures
        except RecordingError as error:
            self.warnings += (f"no place is recognised by pictures from here on: {error}",)


def begin_memory(
    recording: Recording, settings: AppearanceSettings, base_from_camera: Pose3, folder: Path | None
) -> MemoryBuilder | None:
    """Begin a new memory, in a folder or in RAM; None for a recording without pictures.

    A memory that is already in the folder belongs to another map and is removed.

    Raises:
        OutputError: the folder cannot be written to.
    """
    if not _has_pictures(recording):
        return None
    if folder is None:
        return MemoryBuilder(AppearanceLoopClosure(settings, base_from_camera), recording.pictures())
    memory = new_memory(folder, settings.memory)
    return MemoryBuilder(AppearanceLoopClosure(settings, base_from_camera, memory), recording.pictures())


def new_memory(folder: Path, settings: MemorySettings) -> NodeMemory:
    """Return an empty memory in a folder, in place of an existing one.

    Raises:
        OutputError: the folder cannot be written to.
    """
    remove_memory(folder)
    return NodeMemory.opened(folder / MEMORY, settings)


def continue_memory(
    recording: Recording, settings: AppearanceSettings, base_from_camera: Pose3, folder: Path, known: int
) -> MemoryBuilder | None:
    """Continue the memory of a map with `known` key scans; None for a recording without pictures.

    A damaged memory is moved aside and a new one begun, with a warning at the end.

    Raises:
        SessionError: the memory belongs to another map.
    """
    if not _has_pictures(recording):
        return None
    memory = NodeMemory.opened(folder / MEMORY, settings.memory)
    if len(memory.anchors) > known:
        anchors = len(memory.anchors)
        memory.close()
        raise SessionError(
            f"{MEMORY} refers to {anchors} key scans and the map has {known}, so it belongs to another map: remove it, or "
            "map the recordings again"
        )
    return MemoryBuilder(AppearanceLoopClosure(settings, base_from_camera, memory), recording.pictures())


def move_memory(folder: Path, mapper: Mapper) -> None:
    """Move the memory of a folder, if there is one, with the graph of a drive without pictures."""
    if (folder / MEMORY).exists():
        memory = NodeMemory.opened(folder / MEMORY)
        memory.move_anchors(mapper.keys.poses)
        memory.close()


def _has_pictures(recording: Recording) -> bool:
    try:
        return next(recording.pictures(), None) is not None
    except RecordingError:
        return False  # `depth_recording.see_pictures` warns of it


def memory_report(places: PlaceMemory, near: float) -> Json:
    """Return counts of pictures, memory, words and loops, and the time per picture; `paper_tables` explains each.

    `near` [m]: greatest length of a link that counts as a return to a known place.
    """
    memory, costs = places.memory, places.costs
    counts = memory.counts(len(places.recognition.vocabulary))
    kinds = Counter(link.kind for link in memory.skeleton.every_link())
    left_out = {name: count for name, count in places.counts.items() if name != "pictures" and count}
    return {
        "pictures": places.counts["pictures"],
        "left_out": left_out,
        "memory": asdict(counts),
        "references": _total(costs, lambda cost: cost.words),
        "words_made": _total(costs, lambda cost: cost.new_words),
        "links": {"by appearance": kinds[LinkKind.GLOBAL], "on known ground": kinds[LinkKind.SPACE]},
        "revisits": revisits(memory, near, STM_SIZE),
        "refused": dict(Counter(refused.reason for refused in places.refused)),
        "per_picture": {
            "words": _mean(costs, lambda cost: cost.words),
            "extraction_ms": _mean(costs, lambda cost: cost.extraction_ms),
            "words_ms": _mean(costs, lambda cost: cost.words_ms),
            "total_ms": _mean(costs, lambda cost: cost.total_ms),
            "total_p99_ms": round(float(np.quantile([c.total_ms for c in costs], 0.99)), 2) if costs else 0.0,
        },
    }


def _total(costs: list[PictureCost], value: Callable[[PictureCost], float]) -> int:
    return int(sum(value(cost) for cost in costs))


def _mean(costs: list[PictureCost], value: Callable[[PictureCost], float]) -> float:
    """Return the mean without the first value, which includes the loading of kernels."""
    counted = costs[1:] or costs
    return round(float(np.mean([value(cost) for cost in counted])), 2) if counted else 0.0
