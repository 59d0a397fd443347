"""Pairs of colour and depth pictures of a folder: from lists, from the files' names, or from their numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from waychair.errors import RecordingDamaged
from waychair.recordings.stamps import UNIT_NAMES, Row, read_rows, stamp_from_text, unit_of_stamps

MAX_SPREAD = 0.02  # s; a colour picture and its depth are this far apart at most
FRAME_RATE = 30.0  # Hz; of numbered frames, which have no stamps

LEAST_KEPT = 0.5
"""Share of the listed pairs that must be usable; with fewer, the lists or pictures are wrong, and a map misleads."""

_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".exr")
_LISTS = ("associations.txt", "associate.txt", "association.txt", "associated.txt")
_NUMBERED = re.compile(r"frame-(\d+)\.color\.(?:png|jpe?g)$")
_LOOKED_AT = 5  # pairs of a list by which its folder is known
_SLACK_NS = 1000  # tolerance for rounding of decimal stamps


@dataclass(frozen=True, slots=True)
class Pair:
    """A colour picture with its stamp, and its depth picture."""

    stamp_ns: int
    colour: Path
    depth: Path


@dataclass(frozen=True, slots=True)
class Pairs:
    """The usable pairs by ascending stamp, the number of pairs or colour pictures listed, and warnings."""

    usable: tuple[Pair, ...]
    listed: int
    warnings: tuple[str, ...]


def is_tum(path: Path) -> bool:
    """Return whether a folder has the layout of the TUM RGB-D benchmark, or a list of pairs in folders of other names."""
    return ((path / "rgb").is_dir() and (path / "depth").is_dir()) or _names_pairs(path)


def _names_pairs(path: Path) -> bool:
    """Return whether a folder has a list of pairs, one of the first of which is there."""
    listed = _list_of_pairs(path)
    if listed is None:
        return False
    with suppress(RecordingDamaged):
        pairs = [row.fields for row in read_rows(listed)[:_LOOKED_AT] if len(row.fields) >= 4]
        return any(_file(path, "", pair[1]).is_file() and _file(path, "", pair[3]).is_file() for pair in pairs)
    return False


def _list_of_pairs(path: Path) -> Path | None:
    return next((path / name for name in _LISTS if (path / name).is_file()), None)


def is_numbered(path: Path) -> bool:
    """Return whether a folder holds numbered frames."""
    return any(_NUMBERED.match(file.name) for file in path.iterdir())


def read_pairs(path: Path) -> Pairs:
    """Return the pairs of a folder, without opening a picture.

    Raises:
        RecordingDamaged: a list has a wrong form, no colour picture has a depth picture, or most are lost.
    """
    found, listed, told = _tum_pairs(path) if is_tum(path) else _numbered_pairs(path)
    if not found:
        why = "; ".join(told) or "there are none"
        raise RecordingDamaged(
            f"no colour picture in {path} has a depth picture within {MAX_SPREAD:g} s ({why}): copy both folders again, or "
            "list the pairs in associations.txt"
        )
    _refuse_missing(path, found)
    late = sum(b.stamp_ns <= a.stamp_ns for a, b in pairwise(found))
    usable = tuple(sorted({pair.stamp_ns: pair for pair in found}.values(), key=lambda pair: pair.stamp_ns))
    twice = len(found) - len(usable)
    if len(usable) < LEAST_KEPT * listed:
        raise RecordingDamaged(_most_lost(path, found, listed, len(usable), twice))
    warnings = list(told)
    if late:
        warnings.append(
            f"{late} pairs are not later than the one before them: they were sorted"
            + (f", {twice} with a duplicate stamp left out" if twice else "")
        )
    if len(usable) < listed:
        warnings.append(f"{listed - len(usable)} of {listed} pictures are lost: {len(usable)} pairs are used")
    return Pairs(usable, listed, tuple(warnings))


def numbered_files(path: Path) -> list[tuple[int, Path]]:
    """Return the colour pictures of numbered frames by number."""
    found = [(match, file) for file in path.iterdir() if (match := _NUMBERED.match(file.name))]
    return sorted((int(match[1]), file) for match, file in found)


def _refuse_missing(path: Path, pairs: Sequence[Pair]) -> None:
    """Refuse a folder most of whose listed pictures are not there.

    Raises:
        RecordingDamaged: with the first of them, and its true place where a picture of that name lies elsewhere.
    """
    for kind, files in (("colour", [pair.colour for pair in pairs]), ("depth", [pair.depth for pair in pairs])):
        gone = [file for file in files if not file.is_file()]
        if len(gone) <= (1.0 - LEAST_KEPT) * len(files):
            continue
        first = gone[0].relative_to(path) if gone[0].is_relative_to(path) else gone[0]
        other = next((place for place in sorted(path.glob(f"*/{gone[0].name}")) if place.is_file()), None)
        advice = "copy the folder again from its source"
        if other is not None:
            advice = f"a picture of that name lies in {other.parent.name}: are the folders rgb and depth exchanged?"
        raise RecordingDamaged(
            f"{len(gone)} of {len(files)} {kind} pictures in the list of {path} are missing, the first of them {first}; {advice}"
        )


def _most_lost(path: Path, found: Sequence[Pair], listed: int, usable: int, twice: int) -> str:
    """Return the sentence for a folder most of whose pairs are lost, with the cause."""
    start = f"only {usable} of {listed} pictures in {path} can be used"
    if twice > listed - len(found):
        first = found[0].stamp_ns * 1e-9
        return (
            f"{start}: {twice} have the stamp of another picture (such as {first:.9g} s); their list was written with too "
            "few digits, write stamps with six decimals"
        )
    return (
        f"{start}: the others have no depth picture within {MAX_SPREAD:g} s; copy both folders again, or list the pairs in "
        "associations.txt"
    )


def _tum_pairs(path: Path) -> tuple[list[Pair], int, list[str]]:
    """Return the pairs from the list of pairs if there is one, else each colour picture with its nearest depth in time."""
    listed = _list_of_pairs(path)
    if listed is not None:
        pairs, told = _listed_pairs(path, listed)
        return pairs, len(pairs), told
    colours, told = _listed_pictures(path, "rgb")
    depths, also_told = _listed_pictures(path, "depth")
    told += [each for each in also_told if each not in told]
    if not colours or not depths:
        return [], len(colours), told
    stamps = np.array([stamp for stamp, _ in depths], np.int64)
    order = np.argsort(stamps, kind="stable")
    pairs, gaps = [], []
    for stamp, colour in colours:
        at = int(np.clip(np.searchsorted(stamps[order], stamp), 1, max(1, len(stamps) - 1)))
        near = min(order[max(0, at - 1) : at + 1].tolist(), key=lambda k: abs(depths[k][0] - stamp))
        if abs(depths[near][0] - stamp) <= MAX_SPREAD * 1e9 + _SLACK_NS:
            pairs.append(Pair(stamp, colour, depths[near][1]))
        else:
            gaps.append(abs(depths[near][0] - stamp))
    if gaps:
        middle = sorted(gaps)[len(gaps) // 2] * 1e-9
        told.append(
            f"{len(gaps)} colour pictures have no depth within {MAX_SPREAD:g} s: the nearest is {middle:.3g} s away"
        )
    return pairs, len(colours), told


def _listed_pairs(path: Path, listed: Path) -> tuple[list[Pair], list[str]]:
    """Return the pairs of lines `stamp file stamp file`, with the colour picture first or second.

    The depth picture is the one whose path says so, or, in folders of other names, the one that is a depth picture.
    """
    rows = read_rows(listed)
    swapped = _depth_is_first(path, rows)
    unit, told = _unit(listed, [row.fields[0] for row in rows])
    pairs = []
    for row in rows:
        if len(row.fields) < 4:
            raise RecordingDamaged(
                f"{listed} line {row.number} is not `stamp file stamp file`: {len(row.fields)} fields"
            )
        first, second = ((row.fields[k], row.fields[k + 1]) for k in (0, 2))
        if (swapped and not _is_depth(second[1])) or _is_depth(first[1]):
            first, second = second, first
        stamp = _stamp(listed, row, first[0], unit)
        _stamp(listed, row, second[0], unit)
        _refuse_no_name(listed, row)
        pairs.append(Pair(stamp, _file(path, "rgb", first[1]), _file(path, "depth", second[1])))
    return pairs, told


def _listed_pictures(path: Path, kind: str) -> tuple[list[tuple[int, Path]], list[str]]:
    """Return stamps [ns] and files of `rgb` or `depth`, from their list if there is one, else from the file names."""
    listed = path / f"{kind}.txt"
    if not listed.is_file():
        listed = path / f"{kind}.csv"
    if listed.is_file():
        rows = read_rows(listed)
        unit, told = _unit(listed, [row.fields[0] for row in rows])
        pictures = []
        for row in rows:
            if len(row.fields) < 2:
                raise RecordingDamaged(f"{listed} line {row.number} is not `stamp file`: {len(row.fields)} field")
            stamp = _stamp(listed, row, row.fields[0], unit)
            _refuse_no_name(listed, row)
            pictures.append((stamp, _file(path, kind, row.fields[1])))
        return pictures, told
    files = sorted(file for file in (path / kind).iterdir() if file.suffix.lower() in _PICTURES)
    unit, told = _unit(path / kind, [file.stem for file in files])
    named = [(at, file) for file in files if (at := _stamp_of(file, unit)) is not None]
    if len(named) < len(files):
        told.append(f"{len(files) - len(named)} files in {path / kind} have no stamp as their name and are left out")
    return named, told


def _unit(where: Path, texts: Sequence[str]) -> tuple[str, list[str]]:
    """Return the unit of stamps, and a note where it is not the second."""
    unit = unit_of_stamps(texts)
    return unit, [f"the stamps of {where.name} are read as {UNIT_NAMES[unit]}"] if unit != "s" else []


def _stamp(listed: Path, row: Row, text: str, unit: str) -> int:
    try:
        return stamp_from_text(text, unit)
    except ValueError as error:
        raise RecordingDamaged(f"{listed} line {row.number} holds no stamp where one belongs: {error}") from error


def _refuse_no_name(listed: Path, row: Row) -> None:
    """Refuse a line with bytes that no text has, as where a file was damaged."""
    if any("\0" in field or "\ufffd" in field for field in row.fields):
        raise RecordingDamaged(f"{listed} line {row.number} holds bytes that are no text; copy the list again")


def _stamp_of(file: Path, unit: str) -> int | None:
    try:
        return stamp_from_text(file.stem, unit)
    except ValueError:
        return None


def _is_depth(name: str) -> bool:
    return name.replace("\\", "/").lstrip("./").startswith("depth")


def _depth_is_first(path: Path, rows: Sequence[Row]) -> bool:
    """Return whether the first pair of a list has its depth picture first."""
    fields = next((row.fields for row in rows if len(row.fields) >= 4), None)
    if fields is None:
        return False
    first, second = fields[1].lower(), fields[3].lower()
    if ("depth" in first) != ("depth" in second):
        return "depth" in first
    return not _holds_depth(_file(path, "", fields[3])) and _holds_depth(_file(path, "", fields[1]))


def _holds_depth(file: Path) -> bool:
    """Return whether a picture has one channel of more than 8 bits, by the head of a PNG, or by its suffix."""
    if file.suffix.lower() != ".png":
        return file.suffix.lower() in (".exr", ".tif", ".tiff", ".pgm")
    try:
        with file.open("rb") as data:
            head = data.read(26)
    except OSError:
        return False
    return head[24:26] == b"\x10\x00"  # 16 bits, grey


def _file(path: Path, kind: str, name: str) -> Path:
    """Return the file of a list's entry: in the folder of the list, or in that of its kind."""
    name = name.replace("\\", "/")
    inside = path / kind / name
    return inside if "/" not in name and inside.is_file() else path / name


def _numbered_pairs(path: Path) -> tuple[list[Pair], int, list[str]]:
    pairs = []
    for number, colour in numbered_files(path):
        depth = path / f"{colour.name.split('.')[0]}.depth.png"
        pairs.append(Pair(round(number / FRAME_RATE * 1e9), colour, depth))
    return pairs, len(pairs), []
