"""The recordings of `waychair map-all`: lists of them, a folder's name for each, and a fingerprint of its files."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from waychair import __version__
from waychair.errors import RecordingError
from waychair.files import is_file, read_text
from waychair.offline.checkpoints import files_of

LIST_SUFFIX = ".txt"
"""Suffix of a file that lists recordings, one path a line."""

_PACKED = {".gz", ".bz2", ".xz", ".zst"}
_RECORDED = {".clf", ".log", ".dat", ".bag", ".mcap", ".db3", ".active", ".rawlog"}
_NOT_IN_NAMES = re.compile(r"[^\w.+-]+")


@dataclass(frozen=True, slots=True)
class Bag:
    """A recording by its absolute path, and the name of its map's folder."""

    name: str
    path: Path


def listed(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Return the recordings, with each list (.txt) replaced by the paths in it, as seen from the list's folder.

    A line that is empty or begins with # is left out.

    Raises:
        RecordingError: a list cannot be read, or names no recording.
    """
    found: list[Path] = []
    for path in paths:
        if path.suffix.lower() != LIST_SUFFIX or not is_file(path, RecordingError):
            found.append(path)
            continue
        text = read_text(path, RecordingError, "give a list of paths, one a line")
        lines = [line.strip() for line in text.splitlines()]
        own = [path.parent / line for line in lines if line and not line.startswith("#")]
        if not own:
            raise RecordingError(f"{path} lists no recording: write one path a line into it")
        found += own
    return tuple(found)


def named_bags(paths: Sequence[Path]) -> tuple[tuple[Bag, ...], tuple[str, ...]]:
    """Return the recordings with a folder's name each, and sentences about those given twice or alike in name.

    A name is the file's without its suffixes. Recordings alike in name get their whole file names, or else the folders
    they are in, before it, so that a name does not depend on the order in which they are given.
    """
    told: list[str] = []
    once: dict[Path, Path] = {}
    for path in paths:
        whole = path.absolute()
        try:
            key = path.resolve()
        except (OSError, RuntimeError):  # a loop of links; mapping it names the fault
            key = whole
        if key in once:
            told.append(f"{path} is given twice: it is mapped once")
        once.setdefault(key, whole)
    names = {key: _stem(key) for key in once}
    taken: set[str] = set()
    bags = {}
    for key in sorted(once):
        alike = [other for other in once if other != key and names[other] == names[key]]
        name = _distinct(key, alike) if alike else names[key]
        number, free = 2, name
        while free.lower() in taken:
            number, free = number + 1, f"{name}-{number}"
        taken.add(free.lower())
        bags[key] = Bag(free, once[key])
        if alike:
            told.append(f"{len(alike) + 1} recordings are called {names[key]}: the map of {once[key]} goes to {free}")
    return tuple(bags[key] for key in once), tuple(told)


def _stem(path: Path) -> str:
    name = path.name
    for suffixes in (_PACKED, _RECORDED):
        dot = name.rfind(".")
        if dot > 0 and name[dot:].lower() in suffixes:
            name = name[:dot]
    return _plain(name)


def _distinct(path: Path, alike: Sequence[Path]) -> str:
    """Return a name that none of the others gets: of as few parts of the path as tell it from them."""
    for count in range(1, len(path.parts)):
        if all(other.parts[-count:] != path.parts[-count:] for other in alike):
            return _plain("-".join((*path.parts[-count:-1], path.name if count == 1 else _stem(path))))
    return _plain("-".join(path.parts))


def _plain(name: str) -> str:
    """Return a name without characters that trouble shells and addresses, and not a hidden one."""
    plain = _NOT_IN_NAMES.sub("_", name).lstrip(".")
    return plain or "recording"


def size_of(path: Path) -> int:
    """Return the bytes of a recording's files; 0 where there is none."""
    try:
        return sum(file.stat().st_size for file in files_of((path,)))
    except OSError:
        return 0


def fingerprint(path: Path, told: Sequence[str]) -> str | None:
    """Return a hash over a recording's files, by name, size and time, the program's version, and the texts `told`.

    None where there is no such recording.
    """
    try:
        stats = [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files_of((path,))]
    except (OSError, ValueError):
        return None
    return hashlib.sha256(repr((__version__, stats, tuple(told))).encode()).hexdigest()
