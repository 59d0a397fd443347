"""Kind 5: folders of pictures with other stamps, scales and sizes, lists that are broken, pictures that are missing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.corruptions.fault import faults_of, file_fault
from waychair.recordings.rgbd_folders import TUM_DEPTH_SCALE

Rng = np.random.Generator
PAIRS, FIRST = 12, 60
"""Number of pairs of the recording that are taken, from which on."""
_LISTS = "associations.txt"
_LINE = "lines?|list|stamps?|associations|later|sorted|depth within"
_PICTURES = "decoded|read|damage|missing|has colours|sizes?"
_SCALE = "scale|millimet|--depth-scale|unlikely"


def write_pictures(source: Path, folder: Path) -> None:
    """Copy some pairs of a folder of TUM RGB-D's layout, with the lists and the truth."""
    lines = [line for line in (source / _LISTS).read_text().splitlines() if not line.startswith("#")]
    lines = lines[FIRST : FIRST + PAIRS]
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    for line in lines:
        _, colour, _, depth = line.split()
        for name in (colour, depth):
            shutil.copyfile(source / name, folder / name)
    (folder / _LISTS).write_text("\n".join(lines) + "\n")
    shutil.copyfile(source / "groundtruth.txt", folder / "groundtruth.txt")


def _lines(path: Path, by: Callable[[list[list[str]]], list[list[str]]]) -> Path:
    rows = [line.split() for line in (path / _LISTS).read_text().splitlines()]
    (path / _LISTS).write_text("\n".join(" ".join(row) for row in by(rows)) + "\n")
    return path


def _chosen(path: Path, kind: str, rng: Rng) -> list[Path]:
    files = sorted((path / kind).iterdir())
    share = float(rng.choice([0.0, 0.1, 0.6, 1.0]))
    return [file for file in files if rng.random() < share] or [files[int(rng.integers(1, len(files)))]]


def _pixels(files: list[Path], by: Callable[[Any], Any]) -> None:
    import cv2

    for file in files:
        cv2.imwrite(str(file), by(cv2.imread(str(file), cv2.IMREAD_UNCHANGED)))


@file_fault(5, "pictures", _LINE, "pictures")
def stamps_are_written_otherwise(path: Path, rng: Rng) -> Path:
    forms: list[Callable[[str], str]] = [
        lambda text: f"{float(text):.18e}",
        lambda text: f"{float(text):.5e}",
        lambda text: f"{float(text) * 1e9:.0f}",
        lambda text: f"{float(text) * 1e3:.0f}",
        lambda text: "nan",
        lambda text: text.replace(".", ","),
    ]
    form = forms[int(rng.integers(len(forms)))]
    return _lines(path, lambda rows: [[form(row[0]), row[1], form(row[2]), row[3]] for row in rows])


@file_fault(5, "pictures", _LINE, "pictures")
def one_stamp_is_wrong(path: Path, rng: Rng) -> Path:
    text = str(rng.choice(["nan", "0", "abc", "1.305031240", "9305031240.5", "-5"]))

    def broken(rows: list[list[str]]) -> list[list[str]]:
        row = rows[int(rng.integers(2, len(rows)))]
        row[0] = row[2] = text
        return rows

    return _lines(path, broken)


@file_fault(5, "pictures", _LINE, "pictures")
def list_is_broken(path: Path, rng: Rng) -> Path:
    which = int(rng.integers(6))

    def broken(rows: list[list[str]]) -> list[list[str]]:
        at = int(rng.integers(5, len(rows)))
        changed: list[list[list[str]]] = [
            rows[:at],
            [*rows[:at], rows[at][:2], *rows[at + 1 :]],
            [],
            rows[::-1],
            [*rows, *rows[-3:]],
            [[*row[:1], row[3], *row[2:3], row[1]] for row in rows],
        ]
        return changed[which]

    return _lines(path, broken)


@file_fault(5, "pictures", _LINE + "|zero|read|text", "pictures")
def list_holds_other_bytes(path: Path, rng: Rng) -> Path:
    data = bytearray((path / _LISTS).read_bytes())
    at = int(rng.integers(len(data) - 200))
    data[at : at + 60] = bytes(60) if rng.random() < 0.5 else rng.bytes(60)
    (path / _LISTS).write_bytes(data)
    return path


@file_fault(5, "pictures", _PICTURES + "|" + _LINE, "pictures")
def pictures_are_missing(path: Path, rng: Rng) -> Path:
    for file in _chosen(path, str(rng.choice(["rgb", "depth"])), rng):
        file.unlink()
    return path


@file_fault(5, "pictures", _PICTURES, "pictures")
def pictures_are_damaged(path: Path, rng: Rng) -> Path:
    which = int(rng.integers(3))
    for file in _chosen(path, str(rng.choice(["rgb", "depth"])), rng):
        data = file.read_bytes()
        file.write_bytes([b"", data[: len(data) // 3], data[: len(data) // 2] + bytes(len(data) // 2)][which])
    return path


@file_fault(5, "pictures", _SCALE, "pictures")
def depth_has_another_scale(path: Path, rng: Rng) -> Path:
    scale = float(rng.choice([1000.0, 256.0, 100.0, 1.0])) / TUM_DEPTH_SCALE
    _pixels(sorted((path / "depth").iterdir()), lambda pixels: (pixels * scale).astype(np.uint16))
    return path


@file_fault(5, "pictures", _SCALE + "|bits?\\b|sizes?|channel|decoded|colours|no depth", "pictures")
def depth_is_no_depth(path: Path, rng: Rng) -> Path:
    which = int(rng.integers(4))
    changes: list[Callable[[Any], Any]] = [
        lambda pixels: np.zeros_like(pixels),
        lambda pixels: (pixels >> 8).astype(np.uint8),
        lambda pixels: np.full_like(pixels, 65535),
        lambda pixels: np.dstack([pixels >> 8] * 3).astype(np.uint8),
    ]
    _pixels(_chosen(path, "depth", rng), changes[which])
    return path


@file_fault(5, "pictures", "sizes?|camera|centre|half|pixels|" + _PICTURES, "pictures")
def pictures_have_another_size(path: Path, rng: Rng) -> Path:
    both, step = rng.random() < 0.6, int(rng.choice([2, 4]))
    for kind in ("rgb", "depth") if both else ("depth",):
        _pixels(sorted((path / kind).iterdir()), lambda pixels: pixels[::step, ::step])
    return path


@file_fault(5, "pictures", "exchanged|has colours|made for the eye", "pictures")
def pictures_are_exchanged(path: Path, rng: Rng) -> Path:
    (path / "rgb").rename(path / "swapped")
    (path / "depth").rename(path / "rgb")
    (path / "swapped").rename(path / "depth")
    return path


@file_fault(5, "pictures", "camera|centre|lens|matrix|intrinsic", "pictures")
def camera_is_another(path: Path, rng: Rng) -> Path:
    other = path.with_name(str(rng.choice(["fr2", "fr3", "room"])))
    path.rename(other)
    return other


@file_fault(5, "pictures", "same|repeat|again|stamps?|later", "pictures")
def pictures_repeat(path: Path, rng: Rng) -> Path:
    files = sorted((path / "rgb").iterdir())
    first = int(rng.integers(1, len(files) - 5))
    for k in range(first + 1, first + int(rng.integers(2, 5))):
        shutil.copyfile(files[first], files[k])
    return path


PICTURE_FAULTS = faults_of(globals())
