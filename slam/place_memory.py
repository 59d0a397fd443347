"""The memory and what recognises its places, in step: what comes and goes there, dictionary and Bayes filter follow."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from waychair.errors import LongTermError
from waychair.slam.features import Features
from waychair.slam.memory import Change, Memory
from waychair.slam.nodes import Link, LinkKind, Node, WordIds
from waychair.slam.place_recognition import PlaceRecognition, Recognition, RecognitionSettings
from waychair.slam.vocabulary import IncrementalVocabulary, SleepingWords, Vocabulary
from waychair.types import Bytes, IntArray


@dataclass(frozen=True, slots=True)
class Refused:
    """A place that was taken for that of a node, and why it is not believed."""

    node: int
    place: int
    reason: str


@dataclass(frozen=True, slots=True)
class PictureCost:
    """What one picture cost: CPU [ms] of its features, of its words, and of everything; its words, and the new ones."""

    extraction_ms: float
    words_ms: float
    total_ms: float
    words: int
    new_words: int


class PlaceMemory:
    """`counts` says what became of pictures, `refused` of what was recognised, `costs` what it took."""

    def __init__(self, settings: RecognitionSettings, memory: Memory, vocabulary: Vocabulary | None = None) -> None:
        """What the memory holds of earlier sessions is known from the beginning."""
        self.memory = memory
        self.recognition = PlaceRecognition(settings, vocabulary)
        self.counts: Counter[str] = Counter()
        self.refused: list[Refused] = []
        self.costs: list[PictureCost] = []
        if isinstance(self.recognition.vocabulary, IncrementalVocabulary):
            self.recognition.vocabulary.begin_at(memory.store.newest_word() + 1)
        for node in memory.awake:
            self._recall(node, np.iinfo(np.int32).max)

    @property
    def next_id(self) -> int:
        """What the memory will call the node that is added next."""
        return self.memory.skeleton.count

    @property
    def loops(self) -> tuple[Link, ...]:
        """Those found by appearance that the memory holds now."""
        return tuple(link for link in self.memory.skeleton.every_link() if link.kind is LinkKind.GLOBAL)

    def words(self, features: Features) -> tuple[WordIds, tuple[IntArray, Bytes] | None]:
        """(N,) words of the node that is added next, and those made of it, as the store keeps them."""
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
        """What the view of a node says, by the links that the memory has."""
        skeleton = self.memory.skeleton
        awake = {other.id for other in self.memory.awake}
        beside = {other: skeleton.beside(other) for other in awake}
        neighbours = {other: [way for way in ways if way in awake] for other, (ways, _) in beside.items()}
        twins = {other: [loop for loop in loops if loop in awake] for other, (_, loops) in beside.items()}
        return self.recognition.recognise(node, neighbours, twins)

    def obey(self, change: Change) -> None:
        """Dictionary and filter follow the memory."""
        for node in change.slept:
            self.recognition.leave(node.id)  # its words are in the store since they were made
        for node in change.woken:
            self._recall(node, None)
        for place in change.entered_wm:
            self.recognition.enter(place)

    def refuse(self, node: int, place: int, reason: str) -> bool:
        """Notes why the place is not that of the node; always false."""
        self.refused.append(Refused(node, place, reason))
        return False

    def _recall(self, node: Node, since: int | None) -> None:
        """The words of a node that wakes are known again; those asleep are compared with what was made after them.

        Args:
            node: as it was put to sleep.
            since: the first word that may be another name of one asleep; None: the one after it.
        """
        vocabulary = self.recognition.vocabulary
        try:
            ids, rows = self.memory.store.words(vocabulary.missing(node.words).astype(np.int64))
        except LongTermError:  # the store says so; without its words the node is seen, and not recognised
            ids, rows = np.empty(0, np.int64), np.empty((0, 0), np.uint8)
        asleep = vocabulary.no_words()
        if len(ids):
            descriptors = rows if vocabulary.binary else rows.view(np.float32)
            later = ids + 1 if since is None else np.full(len(ids), since)
            asleep = SleepingWords(ids.astype(np.int32), descriptors, later.astype(np.int32))
        words = self.recognition.wake(node.id, node.words, asleep)
        if not np.array_equal(words, node.words):
            self.memory.rewrite(node.id, words)
