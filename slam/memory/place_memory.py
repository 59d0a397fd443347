"""The memory together with place recognition: vocabulary and Bayes filter follow the memory's nodes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from waychair.errors import LongTermError
from waychair.slam.camera.features import ImageFeatures
from waychair.slam.memory.memory_changes import MemoryChange
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.nodes import Link, LinkKind, MemoryNode, WordIds
from waychair.slam.words.place_recognition import PlaceRecognition, Recognition
from waychair.slam.words.recognition_settings import RecognitionSettings
from waychair.slam.words.vocabulary import IncrementalVocabulary, SleepingWords, Vocabulary
from waychair.types import Bytes, IntArray


@dataclass(frozen=True, slots=True)
class RefusedPlace:
    """A refused match of a node with a place, and the reason."""

    node: int
    place: int
    reason: str


@dataclass(frozen=True, slots=True)
class PictureCost:
    """The cost of one picture: CPU time [ms] of features, words and everything; the numbers of words and new words."""

    extraction_ms: float
    words_ms: float
    total_ms: float
    words: int
    new_words: int


class PlaceMemory:
    """The memory with place recognition. `counts` holds outcomes of pictures, `costs` their CPU time."""

    def __init__(self, settings: RecognitionSettings, memory: NodeMemory, vocabulary: Vocabulary | None = None) -> None:
        """Begin with the nodes that the memory holds of earlier sessions."""
        self.memory = memory
        self.recognition = PlaceRecognition(settings, vocabulary)
        self.counts: Counter[str] = Counter()
        self.refused: list[RefusedPlace] = []
        self.costs: list[PictureCost] = []
        if isinstance(self.recognition.vocabulary, IncrementalVocabulary):
            self.recognition.vocabulary.begin_at(memory.store.newest_word() + 1)
        for node in memory.awake:
            self._recall(node, np.iinfo(np.int32).max)

    @property
    def next_id(self) -> int:
        """The id of the node that is added next."""
        return self.memory.skeleton.count

    @property
    def loops(self) -> tuple[Link, ...]:
        """The loops found by appearance that the memory holds now."""
        return tuple(link for link in self.memory.skeleton.every_link() if link.kind is LinkKind.GLOBAL)

    def words(self, features: ImageFeatures) -> tuple[WordIds, tuple[IntArray, Bytes] | None]:
        """Return the words (N,) of the node to be added next, and its new words as the store keeps them."""
        vocabulary = self.recognition.vocabulary
        if not isinstance(vocabulary, IncrementalVocabulary):
            return self.recognition.see(self.next_id, features), None
        first = vocabulary.next_id
        words = self.recognition.see(self.next_id, features)
        made = np.unique(words[words >= first])
        if len(made) == 0:
            return words, None
        return words, (made.astype(np.int64), vocabulary.descriptors_of(made).view(np.uint8))

    def recognise(self, node: int) -> Recognition:
        """Return the recognition of a node's view, with the links of the memory."""
        skeleton = self.memory.skeleton
        awake = {other.id for other in self.memory.awake}
        beside = {other: skeleton.cached_neighbours(other) for other in awake}
        neighbours = {other: [way for way in ways if way in awake] for other, (ways, _) in beside.items()}
        twins = {other: [loop for loop in loops if loop in awake] for other, (_, loops) in beside.items()}
        return self.recognition.recognise(node, neighbours, twins)

    def apply_change(self, change: MemoryChange) -> None:
        """Update vocabulary and filter after a change of the memory."""
        for node in change.slept:
            self.recognition.leave(node.id)  # its words have been in the store since they were made
        for node in change.woken:
            self._recall(node, None)
        for place in change.entered_wm:
            self.recognition.enter(place)

    def refuse(self, node: int, place: int, reason: str) -> bool:
        """Record why the place is not that of the node; return False."""
        self.refused.append(RefusedPlace(node, place, reason))
        return False

    def _recall(self, node: MemoryNode, since: int | None) -> None:
        """Recall the words of a waking node; sleeping words are compared with words made after them.

        Args:
            node: the node as it was put to sleep.
            since: the first word that may replace a sleeping one; None: the word after it.
        """
        vocabulary = self.recognition.vocabulary
        try:
            ids, rows = self.memory.store.words(vocabulary.missing(node.words).astype(np.int64))
        except LongTermError:  # see the store's fault; without its words the node is not recognised
            ids, rows = np.empty(0, np.int64), np.empty((0, 0), np.uint8)
        asleep = vocabulary.no_words()
        if len(ids):
            descriptors = rows if vocabulary.binary else rows.view(np.float32)
            later = ids + 1 if since is None else np.full(len(ids), since)
            asleep = SleepingWords(ids.astype(np.int32), descriptors, later.astype(np.int32))
        words = self.recognition.wake(node.id, node.words, asleep)
        if not np.array_equal(words, node.words):
            self.memory.rewrite(node.id, words)
