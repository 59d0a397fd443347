"""Training of a vocabulary offline by clustering, as in the wheelchair paper (Pai et al. 2026, section 3.2).

Float descriptors are clustered by k-means, binary ones by k-majority (Grana et al. 2013): the same two steps with the
Hamming distance, where each bit of a centre is the majority of its members.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numba import njit

from waychair.config import Settings, dump, from_mapping, setting
from waychair.errors import ConfigError, VocabularyError
from waychair.files import replacing
from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.slam.camera.features import Descriptors
from waychair.slam.camera.hamming_index import Words64, assign, majority, packed, unpacked
from waychair.slam.words.vocabulary import FixedVocabulary
from waychair.types import Float32Array, IntArray
from waychair.yaml_files import yaml_from_text

_FORMAT = 1

ROUNDS = 10
"""Rounds of assigning descriptors and averaging, at most."""

_MOST_DESCRIPTORS = 100_000  # drawn evenly if there are more

_FORMER_SETTINGS = {
    "quality": 0.001, "min_distance": 7.0, "block_size": 3, "min_strength": 2e-4, "fast_threshold": 10,
    "scale_factor": 1.2, "levels": 8, "depth_as_mask": True,
}  # fmt: skip
"""Settings in the files of earlier versions that are constants of `features.py` now."""


@dataclass(frozen=True, slots=True)
class TrainingSettings(Settings):
    """Settings of the training."""

    words: int = setting(
        16_000, "", "number of words of a trained vocabulary; more: they tell places apart better and take longer",
        low=2, high=200_000,
    )  # fmt: skip
    seed: int = setting(
        1, "", "seed of the clustering; the same pictures and seed give the same words", low=0, high=2**31 - 1
    )


def train(
    descriptors: Descriptors,
    settings: TrainingSettings | None = None,
    progress: Callable[[float], None] = lambda _: None,
    *,
    rounds: int = ROUNDS,
) -> Descriptors:
    """Return words (K, W) trained from descriptors (N, W); fewer if there are fewer distinct descriptors.

    Raises:
        VocabularyError: fewer than two distinct descriptors.
    """
    settings = settings or TrainingSettings()
    rng = np.random.default_rng(settings.seed)
    if len(descriptors) > _MOST_DESCRIPTORS:
        descriptors = descriptors[np.sort(rng.choice(len(descriptors), _MOST_DESCRIPTORS, replace=False))]
    different = np.unique(descriptors, axis=0)
    if len(different) < 2:
        raise VocabularyError(
            f"{len(different)} different descriptors are too few for a vocabulary: give pictures with more features"
        )
    count = min(settings.words, len(different))
    first = different[np.sort(rng.choice(len(different), count, replace=False))]
    if descriptors.dtype == np.uint8:
        return unpacked(_k_majority(packed(descriptors), packed(first), rounds, progress))
    return _k_means(descriptors, first, rounds, progress)


def save(path: Path, words: Descriptors, features: FeatureSettings) -> None:
    """Write words (K, W) and the settings of their features, the whole file or none."""
    with replacing(path) as aside, aside.open("wb") as file:
        np.savez_compressed(file, format=np.int64(_FORMAT), words=words, features=np.array(dump(features)))


def load(path: Path) -> tuple[FixedVocabulary, FeatureSettings]:
    """Return the vocabulary of a file and the settings of its features.

    Raises:
        VocabularyError: the file is missing, damaged, or not written by `save`.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            version, words, features = int(arrays["format"]), arrays["words"], str(arrays["features"])
    except FileNotFoundError:
        raise VocabularyError(f"there is no vocabulary {path}: make one with `waychair vocabulary`") from None
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
        raise VocabularyError(f"{path} is damaged, or not a vocabulary ({error}): make it again") from error
    if version != _FORMAT:
        raise VocabularyError(f"{path} is a vocabulary of format {version}, not {_FORMAT}: make it again")
    try:
        values = yaml_from_text(features, str(path), VocabularyError)
        for key, constant in _FORMER_SETTINGS.items():
            if values.pop(key, constant) != constant:
                raise VocabularyError(f"{key} is fixed at {constant}")
        settings = from_mapping(FeatureSettings, values, str(path))
        return FixedVocabulary(words), settings
    except (ConfigError, VocabularyError, msgspec.MsgspecError) as error:
        raise VocabularyError(f"{path} is damaged ({error}): make it again") from error


def _k_majority(words: Words64, centres: Words64, rounds: int, progress: Callable[[float], None]) -> Words64:
    for done in range(rounds):
        nearest, distances = assign(words, centres)
        moved = _majorities(words, nearest, centres)
        _refill(moved, words, np.bincount(nearest, minlength=len(centres)), distances)
        progress((done + 1) / rounds)
        if np.array_equal(moved, centres):
            break
        centres = moved
    return centres


def _k_means(
    descriptors: Float32Array, centres: Float32Array, rounds: int, progress: Callable[[float], None]
) -> Float32Array:
    from scipy.cluster.vq import vq

    for done in range(rounds):
        nearest, distances = vq(descriptors, centres)
        counts = np.bincount(nearest, minlength=len(centres))
        moved = np.zeros_like(centres)
        np.add.at(moved, nearest, descriptors)
        moved /= np.maximum(counts, 1)[:, None].astype(np.float32)
        _refill(moved, descriptors, counts, distances)
        progress((done + 1) / rounds)
        if np.array_equal(moved, centres):
            break
        centres = moved
    return centres


def _refill(
    centres: Words64 | Float32Array, data: Words64 | Float32Array, counts: IntArray, distances: IntArray
) -> None:
    """Restart clusters without members at the descriptors farthest from their centres."""
    empty = np.flatnonzero(counts == 0)
    centres[empty] = data[np.argsort(-distances, kind="stable")[: len(empty)]]


@njit(cache=True)
def _majorities(words: Words64, nearest: IntArray, centres: Words64) -> Words64:
    """Return the majority word (K, 4) of each cluster; an empty cluster keeps its centre."""
    order = np.argsort(nearest, kind="mergesort")
    result = centres.copy()
    start = 0
    while start < len(order):
        cluster, end = nearest[order[start]], start
        while end < len(order) and nearest[order[end]] == cluster:
            end += 1
        result[cluster] = majority(words[order[start:end]])
        start = end
    return result
