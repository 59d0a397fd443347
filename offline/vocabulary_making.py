"""Training of a visual vocabulary from a folder of pictures or a recording with pictures."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from waychair.config import Settings
from waychair.errors import VocabularyError
from waychair.recordings.recording import InputSettings, read_recording
from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.slam.camera.features import Descriptors, features_of_image, gray_image
from waychair.slam.words.vocabulary_training import TrainingSettings, save, train
from waychair.types import Bytes

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"})
"""Suffixes of pictures in a plain folder."""


@dataclass(frozen=True, slots=True)
class VocabularyMakingSettings(Settings):
    """Settings of the training: features, clustering, and the recording's input."""

    features: FeatureSettings = field(default_factory=lambda: FeatureSettings(detector="orb"))
    training: TrainingSettings = field(default_factory=TrainingSettings)
    input: InputSettings = field(default_factory=InputSettings)


@dataclass(frozen=True, slots=True)
class TrainingCounts:
    """Counts of a training: pictures read, pictures without features, unreadable files, descriptors and words."""

    pictures: int
    blank: int
    unreadable: int
    descriptors: int
    words: int
    warnings: tuple[str, ...] = ()


def make_vocabulary(
    source: Path, out: Path, settings: VocabularyMakingSettings, progress: Callable[[str], Callable[[float], None]]
) -> TrainingCounts:
    """Read the pictures of `source`, cluster their descriptors, and write the vocabulary to `out`.

    Raises:
        VocabularyError: there is no picture, or no picture has features.
        RecordingError: the recording cannot be read.
        OutputError: `out` cannot be written.
    """
    files = picture_files(source)
    warnings: tuple[str, ...] = ()
    if files:
        pictures = _opened(files, progress("pictures"))
    else:
        recording = read_recording(source, settings.input)
        warnings = recording.warnings
        pictures = (frame.image for frame in recording.pictures())
    found: list[Descriptors] = []
    read = unreadable = blank = 0
    for picture in pictures:
        if picture is None:
            unreadable += 1
            continue
        descriptors = features_of_image(gray_image(picture), settings.features).descriptors
        read, blank = read + 1, blank + (len(descriptors) == 0)
        found.append(descriptors)
    if read == 0:
        raise VocabularyError(f"{source} holds no picture that can be read: give a folder of .jpg or .png files")
    if blank == read:
        raise VocabularyError(f"the {read} pictures of {source} have no features: a vocabulary needs textured pictures")
    together = np.concatenate(found)
    words = train(together, settings.training, progress("clusters"))
    save(out, words, settings.features)
    return TrainingCounts(
        pictures=read,
        blank=blank,
        unreadable=unreadable,
        descriptors=len(together),
        words=len(words),
        warnings=warnings,
    )


def picture_files(folder: Path) -> list[Path]:
    """Return the pictures directly in a folder, ordered by the numbers in their names; none if it is no folder."""
    if not folder.is_dir() or (folder / "associations.txt").exists():
        return []
    files = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and ".depth." not in path.name)
    return sorted(
        files, key=lambda path: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]
    )


def _opened(files: list[Path], progress: Callable[[float], None]) -> Iterator[Bytes | None]:
    for done, path in enumerate(files, start=1):
        yield _opened_file(path)
        progress(done / len(files))


def _opened_file(path: Path) -> Bytes | None:
    try:
        data = np.fromfile(path, np.uint8)
    except OSError:
        return None
    picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    return None if picture is None else picture.astype(np.uint8, copy=False)
