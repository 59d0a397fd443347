"""The vocabulary of visual words, with the inverted index of the nodes that show them.

Two kinds with one interface. `IncrementalVocabulary` is RTAB-Map's (Labbe and Michaud 2013): it starts empty; a
descriptor that is clearly nearest to one word is that word, any other becomes a new word. `FixedVocabulary` is the
wheelchair paper's (Pai et al. 2026, section 3.2; Sivic and Zisserman 2003): words by k-means, trained offline from
pictures (`vocabulary_training.py`). Binary words are compared by Hamming distance, float words by squared Euclidean
distance.

Words have ids from 1 on, never used twice; 0 means "no word". Only nodes in short-term and working memory refer to
words: call `forget` when a node goes to sleep, store the result of `drop_unused` in the long-term memory, and call
`recall` with the missing words when the node wakes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.errors import VocabularyError
from waychair.slam.camera.feature_matching import distances_between
from waychair.slam.camera.features import Descriptors
from waychair.slam.camera.hamming_index import HammingIndex, Int32Array, assign, packed, unpacked
from waychair.slam.words.float_index import FloatIndex
from waychair.slam.words.inverted_index import InvertedIndex
from waychair.types import Float32Array, IntArray

NO_WORD = 0
"""Word id of a keypoint without a word."""

BINARY_WIDTH, FLOAT_WIDTH = 32, 128
"""Columns of ORB's descriptors (bytes) and of SIFT's (floats)."""


NEAREST_RATIO = 0.8
"""A descriptor is its nearest word if nearer than this share of the second one's distance (RTAB-Map's Kp/NndrRatio)."""


@dataclass(frozen=True, slots=True)
class SleepingWords:
    """Words removed from the vocabulary: ids (K,), descriptors (K, W), and `since` (K,), the next id at that time."""

    ids: Int32Array
    descriptors: Descriptors
    since: Int32Array

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, ids: Int32Array) -> SleepingWords:
        """Return the words that are among `ids`."""
        chosen = np.isin(self.ids, ids)
        return SleepingWords(self.ids[chosen], self.descriptors[chosen], self.since[chosen])


class Vocabulary(ABC):
    """A vocabulary with the inverted index of the awake nodes."""

    def __init__(self, binary: bool) -> None:
        self.binary = binary
        self.index = InvertedIndex()

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of words."""

    @abstractmethod
    def words_of(self, node: int, descriptors: Descriptors) -> Int32Array:
        """Return word ids (N,) of a new node's descriptors (N, W), and add the node with them.

        Raises:
            VocabularyError: the descriptors are of the other kind.
        """

    @abstractmethod
    def known(self, descriptors: Descriptors) -> Int32Array:
        """Return slots (K,) of the known words among descriptors (N, W), without adding node or words.

        Raises:
            VocabularyError: the descriptors are of the other kind.
        """

    @abstractmethod
    def forget(self, node: int) -> None:
        """Remove a node that goes to sleep from the index."""

    @abstractmethod
    def drop_unused(self) -> SleepingWords:
        """Remove and return the words that no node refers to."""

    @abstractmethod
    def missing(self, words: Int32Array) -> Int32Array:
        """Return the words (K,) among (N,) that `recall` needs."""

    @abstractmethod
    def recall(self, node: int, words: Int32Array, asleep: SleepingWords) -> Int32Array:
        """Add a waking node with its former words (N,); return its words (N,) now, which may differ."""

    def no_words(self) -> SleepingWords:
        """Return an empty set of words of this vocabulary's kind."""
        none = np.empty(0, np.int32)
        return SleepingWords(none, _empty(self.binary), none)

    def _checked(self, descriptors: Descriptors) -> None:
        kind, width = (np.uint8, BINARY_WIDTH) if self.binary else (np.float32, FLOAT_WIDTH)
        if descriptors.ndim != 2 or descriptors.shape[1] != width or descriptors.dtype != kind:
            raise VocabularyError(
                f"descriptors of {descriptors.dtype} {descriptors.shape} do not fit a vocabulary of"
                f" {np.dtype(kind)} (N, {width}): use the detector that it was made with"
            )


class IncrementalVocabulary(Vocabulary):
    """A vocabulary that grows with new views and shrinks with forgotten ones; words are never averaged."""

    def __init__(self, *, binary: bool = True) -> None:
        super().__init__(binary)
        self._search: HammingIndex | FloatIndex = HammingIndex() if binary else FloatIndex(FLOAT_WIDTH)
        self._next_id = 1
        self._slot_of: dict[int, int] = {}
        self._id_of = np.zeros(1024, np.int32)
        self._slots = 0  # slots used so far; free ones are used first
        self._free_slots: list[int] = []
        self._unused: set[int] = set()

    def __len__(self) -> int:
        return len(self._slot_of)

    def words_of(self, node: int, descriptors: Descriptors) -> Int32Array:
        """Return word ids (N,): the nearest word if clearly nearer than the second, also among this image's new words.

        Raises:
            VocabularyError: the descriptors are of the other kind.
        """
        self._checked(descriptors)
        found, distances = self._nearest(descriptors)
        chosen = choose_words(found, distances, distances_between(descriptors, descriptors), NEAREST_RATIO)
        founders = np.flatnonzero(chosen == -1 - np.arange(len(chosen)))
        ids = np.arange(self._next_id, self._next_id + len(founders), dtype=np.int32)
        self._next_id += len(founders)
        new = self._insert(ids, descriptors[founders])
        slot_of_founder = np.zeros(len(chosen), np.int32)
        slot_of_founder[founders] = new
        slots = np.where(chosen >= 0, chosen, slot_of_founder[-1 - np.minimum(chosen, -1)]).astype(np.int32)
        self.index.add(node, slots)
        return self._id_of[slots]

    def known(self, descriptors: Descriptors) -> Int32Array:
        """Return slots (K,) of the words that some of the descriptors (N, W) clearly match.

        Raises:
            VocabularyError: the descriptors are of the other kind.
        """
        self._checked(descriptors)
        found, distances = self._nearest(descriptors)
        clear = (found[:, 1] >= 0) & (distances[:, 0] <= NEAREST_RATIO * distances[:, 1])
        slots: Int32Array = found[clear, 0].astype(np.int32)
        return slots

    @property
    def next_id(self) -> int:
        """The id of the next new word, greater than all earlier ones."""
        return self._next_id

    def begin_at(self, next_id: int) -> None:
        """Give new words ids from `next_id` on, since earlier sessions have used those below."""
        self._next_id = max(self._next_id, next_id)

    def forget(self, node: int) -> None:
        """Remove a node that goes to sleep from the index."""
        self._unused.update(self.index.remove(node).tolist())

    def drop_unused(self) -> SleepingWords:
        """Remove and return the words that no node refers to, in the order of their ids."""
        slots = self.index.unused(np.array(sorted(self._unused), np.int32))
        self._unused.clear()
        if len(slots) == 0:
            return self.no_words()
        slots = slots[np.argsort(self._id_of[slots])]
        ids = self._id_of[slots]
        dropped = SleepingWords(ids, self._descriptors(slots), np.full(len(ids), self._next_id, np.int32))
        self._search.remove(slots)
        for word in ids.tolist():
            self._free_slots.append(self._slot_of.pop(word))
        return dropped

    def missing(self, words: Int32Array) -> Int32Array:
        """Return the words (K,) among (N,) that are asleep, each once."""
        asleep = [word for word in np.unique(words).tolist() if word != NO_WORD and word not in self._slot_of]
        return np.array(asleep, np.int32)

    def recall(self, node: int, words: Int32Array, asleep: SleepingWords) -> Int32Array:
        """Add a waking node; return its words (N,): old ids, or newer words that clearly match.

        A word is compared only with words made since it fell asleep: it differs from those that it was awake with. A
        replacement is not recorded, since the same comparison finds it for the next node. A word that is neither awake
        nor among `asleep` (its record was lost) becomes `NO_WORD`.
        """
        needed = asleep.take(self.missing(words))
        names = {NO_WORD: NO_WORD} | {word: word for word in np.unique(words).tolist() if word in self._slot_of}
        if len(needed):
            self._checked(needed.descriptors)
            found, distances = self._nearest(needed.descriptors)
            born = np.where(found[:, 0] >= 0, self._id_of[found[:, 0]], 0)
            clear = (found[:, 1] >= 0) & (distances[:, 0] <= NEAREST_RATIO * distances[:, 1])
            same = clear & (born >= needed.since)
            self._insert(needed.ids[~same], needed.descriptors[~same])
            names |= dict(zip(needed.ids.tolist(), np.where(same, born, needed.ids).tolist(), strict=True))
        result = np.array([names.get(word, NO_WORD) for word in words.tolist()], np.int32)
        known = [self._slot_of[word] for word in result.tolist() if word != NO_WORD]
        self.index.add(node, np.array(known, np.int32))
        return result

    def descriptors_of(self, words: Int32Array) -> Descriptors:
        """Return the descriptors (N, W) of awake words (N,)."""
        return self._descriptors(np.array([self._slot_of[word] for word in words.tolist()], np.int32))

    def _insert(self, ids: Int32Array, descriptors: Descriptors) -> Int32Array:
        reused = [self._free_slots.pop() for _ in range(min(len(ids), len(self._free_slots)))]
        fresh = range(self._slots, self._slots + len(ids) - len(reused))
        self._slots += len(fresh)
        slots = np.array([*reused, *fresh], np.int32)
        if len(slots) and slots.max() >= len(self._id_of):
            self._id_of = np.concatenate([self._id_of, np.zeros(max(int(slots.max()), len(self._id_of)), np.int32)])
        self._id_of[slots] = ids
        self._slot_of.update(zip(ids.tolist(), slots.tolist(), strict=True))
        if isinstance(self._search, HammingIndex):
            self._search.insert(packed(descriptors), slots)
        else:
            self._search.insert(descriptors, slots)
        return slots

    def _nearest(self, descriptors: Descriptors) -> tuple[Int32Array, Float32Array]:
        if isinstance(self._search, HammingIndex):
            found, distances = self._search.nearest(packed(descriptors))
            return found, distances.astype(np.float32)
        return self._search.nearest(descriptors)

    def _descriptors(self, slots: Int32Array) -> Descriptors:
        if isinstance(self._search, HammingIndex):
            return unpacked(self._search.words(slots))
        return self._search.words(slots)


class FixedVocabulary(Vocabulary):
    """A vocabulary trained offline: every descriptor is its nearest word, and words neither come nor go."""

    def __init__(self, words: Descriptors) -> None:
        super().__init__(words.dtype == np.uint8)
        self._checked(words)
        if len(words) == 0:
            raise VocabularyError("the vocabulary has no words: make it from pictures with features")
        self.words = words

    def __len__(self) -> int:
        return len(self.words)

    def words_of(self, node: int, descriptors: Descriptors) -> Int32Array:
        """Return word ids (N,): those of the nearest words.

        Raises:
            VocabularyError: the descriptors are of the other kind.
        """
        slots = self.known(descriptors)
        self.index.add(node, slots)
        return slots + np.int32(1)

    def known(self, descriptors: Descriptors) -> Int32Array:
        """Return slots (N,) of the words nearest to the descriptors (N, W).

        Raises:
            VocabularyError: the descriptors are of the other kind.
        """
        self._checked(descriptors)
        return nearest_words(descriptors, self.words).astype(np.int32)

    def forget(self, node: int) -> None:
        """Remove a node that goes to sleep from the index."""
        self.index.remove(node)

    def drop_unused(self) -> SleepingWords:
        """Return no words: the vocabulary is fixed."""
        return self.no_words()

    def missing(self, words: Int32Array) -> Int32Array:
        """Return no words: the vocabulary is fixed."""
        return np.empty(0, np.int32)

    def recall(self, node: int, words: Int32Array, asleep: SleepingWords) -> Int32Array:
        """Add a waking node with its words (N,); return them unchanged."""
        self.index.add(node, words[words != NO_WORD] - np.int32(1))
        return words


def nearest_words(descriptors: Descriptors, words: Descriptors) -> IntArray:
    """Return rows (N,) of the nearest words (K, W) to descriptors (N, W)."""
    nearest: IntArray
    if descriptors.dtype == np.uint8:
        nearest, _ = assign(packed(descriptors), packed(words))
    else:
        nearest = np.argmin(distances_between(descriptors, words), axis=1)
    return nearest


@njit(cache=True)
def choose_words(found: Int32Array, distances: Float32Array, within: Float32Array, ratio: float) -> Int32Array:
    """Return the slot (N,) of each descriptor's word, or -1 - k for the new word of descriptor k (k = i: its own).

    found, distances (N, 2): the two nearest words of the vocabulary; within (N, N): distances between the descriptors.
    """
    chosen = np.empty(len(found), np.int32)
    founders = np.empty(len(found), np.int64)
    made = 0
    for i in range(len(found)):
        best, d1, d2 = found[i, 0], distances[i, 0], distances[i, 1]
        candidates = (found[i, 0] >= 0) + (found[i, 1] >= 0)
        for k in founders[:made]:
            d = within[i, k]
            candidates += 1
            if d < d1 or candidates == 1:
                best, d1, d2 = -1 - k, d, d1
            elif d < d2 or candidates == 2:
                d2 = d
        if candidates < 2 or d1 > ratio * d2:
            founders[made] = i
            made += 1
            best = -1 - i
        chosen[i] = best
    return chosen


def _empty(binary: bool) -> Descriptors:
    return np.empty((0, BINARY_WIDTH), np.uint8) if binary else np.empty((0, FLOAT_WIDTH), np.float32)
