"""Writing text files again: lines that still hold stay as they were, and all files of a building change together."""

from __future__ import annotations

import errno
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from waychair.errors import OutputError
from waychair.files import os_error_text, remove, sync_folder
from waychair.maps.building.records import END

_MANY = 50
"""Files from which on one flush of all disks is faster than one of each."""


@dataclass(frozen=True, slots=True)
class _Old:
    """An old line, its kind of record ("" for a comment), and its object's name if the record is not wanted any more."""

    line: str
    kind: str
    gone: str


Form = Callable[[int, str], tuple[str, str] | None]
"""A line's kind of record and its line in the usual form, given its number and text; None for a comment."""


def rewritten(old: str, lines: list[str], form: Form) -> str:
    """Return the text with exactly these records.

    Lines of the old text whose record is still wanted stay as they are, and so do comments. A new record takes the place
    of an old one with the same name (its kind and id, or its ends); other new ones follow the last of their kind.
    """
    unseen = Counter(lines)
    olds: list[_Old] = []
    for number, line in enumerate(old.split("\n"), start=1):
        found = form(number, line)
        kind, normal = found or ("", "")
        still = unseen[normal] > 0
        unseen[normal] -= still
        olds.append(_Old(line, kind, "" if found is None or still else _name(normal)))
    fresh: dict[str, list[str]] = {}
    for line in lines:
        if unseen[line] > 0:
            unseen[line] -= 1
            fresh.setdefault(_name(line), []).append(line)
    kept: list[tuple[str, str]] = []
    for each in olds:
        if not each.gone:
            kept.append((each.line, each.kind))
        elif fresh.get(each.gone):
            kept.append((fresh[each.gone].pop(0), each.kind))
    return "\n".join(_with_additions(kept, [line for new in fresh.values() for line in new]))


def write_all(texts: Mapping[Path, str], swept: Path | None = None) -> None:
    """Write files so that either all change or none does; text files below `swept` that are not named are removed.

    Every file whose text differs is written aside and flushed first, then all are renamed in order, the last one last.

    Raises:
        OutputError: a file cannot be written; all files are as before.
    """
    aside: list[tuple[Path, Path]] = []
    made: list[Path] = []
    done = False
    try:
        for path, text in texts.items():
            data = text.encode()
            if not _holds(path, data):
                _make_folders(path.parent, made)
                aside.append((_written_aside(path, data), path))
        _flush([temporary for temporary, _ in aside])
        for temporary, path in aside:
            temporary.replace(path)
        done = True
        for parent in {path.parent for _, path in aside}:
            with suppress(OSError):  # not every file system supports it
                sync_folder(parent)
    except OSError as error:
        raise OutputError(f"cannot write {error.filename or next(iter(texts))}: {os_error_text(error)}") from error
    finally:
        for temporary, _ in aside:
            temporary.unlink(missing_ok=True)
        for parent in () if done else reversed(made):
            with suppress(OSError):  # somebody else has put a file there meanwhile
                parent.rmdir()
    if swept is not None and swept.is_dir():
        for path in sorted(swept.rglob("*.txt")):
            if path not in texts:
                remove(path)


def _make_folders(folder: Path, made: list[Path]) -> None:
    """Make a folder with its parents, and add those that were not there to `made`, outer ones first."""
    new = []
    while not folder.exists():
        new.append(folder)
        folder = folder.parent
    for each in reversed(new):
        each.mkdir(exist_ok=True)
        made.append(each)


def _written_aside(path: Path, data: bytes) -> Path:
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=".aside", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        Path(name).chmod(0o644)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        error.filename = str(path)
        raise
    return Path(name)


def _flush(paths: list[Path]) -> None:
    """Flush files to the disk; many of them by one call for all disks, which is faster."""
    if len(paths) > _MANY:
        os.sync()
        return
    for path in paths:
        with path.open("rb") as file:
            os.fsync(file.fileno())


def _holds(path: Path, data: bytes) -> bool:
    try:
        return path.stat().st_size == len(data) and path.read_bytes() == data
    except (FileNotFoundError, NotADirectoryError):
        return False


def _name(line: str) -> str:
    """Return the part of a record's line that names its object: its kind, and its id or its two ends."""
    values = 2 if line.startswith(("arc ", "door ", "stop ")) else 1
    return " ".join(line.split(" ", values + 1)[: values + 1])


def _with_additions(kept: list[tuple[str, str]], additions: list[str]) -> list[str]:
    """Return the lines of `kept`, (line, kind), with new records after the last of their kind, else before `end`."""
    lines, kinds = [line for line, _ in kept], [kind for _, kind in kept]
    by_kind: dict[str, list[str]] = {}
    for line in additions:
        by_kind.setdefault(line.partition(" ")[0], []).append(line)
    for kind, new in by_kind.items():
        if kind in kinds:
            at = len(kinds) - kinds[::-1].index(kind)
        else:
            at = max(at for at, line in enumerate(lines) if line.partition("#")[0].strip() == END)
        lines[at:at], kinds[at:at] = new, [kind] * len(new)
    return lines
