"""Which key frames look like a picture: each of its features votes for the key frames with one like it."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from waychair.slam.features import Features
from waychair.slam.hamming_index import Words64, hamming_table, packed
from waychair.types import Float32Array

_KEPT = 100  # strongest features of each picture that take part
_ALIKE = 50  # bits in which two descriptors of the same corner differ at most, of 256
_APART = 3  # key frames this near to a chosen one are the same place


class KeyFrameVote:
    """Binary descriptors of key frames, numbered in their order."""

    def __init__(self) -> None:
        self._descriptors: list[Words64] = []

    def add(self, features: Features) -> None:
        """The next key frame."""
        self._descriptors.append(_strongest(features))

    def candidates(self, features: Features, excluded: Collection[int] = (), most: int = 3) -> list[int]:
        """Key frames that look most like the picture, best first, at most one of each place."""
        out = set(excluded)
        asked = [key for key, own in enumerate(self._descriptors) if key not in out and len(own)]
        query = _strongest(features)
        if not asked or len(query) == 0:
            return []
        stored = np.concatenate([self._descriptors[key] for key in asked])
        starts = np.cumsum([0, *(len(self._descriptors[key]) for key in asked[:-1])])
        nearest: Float32Array = np.minimum.reduceat(hamming_table(query, stored), starts, axis=1)
        votes = (nearest <= _ALIKE).sum(axis=0)
        chosen: list[int] = []
        for place in np.argsort(-votes, kind="stable").tolist():
            if votes[place] == 0 or len(chosen) == most:
                break
            if all(abs(asked[place] - key) > _APART for key in chosen):
                chosen.append(asked[place])
        return chosen


def _strongest(features: Features) -> Words64:
    """(K, 4) the strongest features as packed words."""
    return packed(np.asarray(features.descriptors[:_KEPT], np.uint8).reshape(-1, 32))
