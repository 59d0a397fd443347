"""Writing text files again: lines that still hold stay as they were, and all files of a building change together."""

from __future__ import annotations

import errno
import json
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from waychair.errors import OutputError
from waychair.files import os_error_text, remove, sync_folder, write_text
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


def write_all(texts: Mapping[Path, str], swept: Path | None = None, journal: Path | None = None) -> None:
    """Write files so that either all change or none does; text files below `swept` that are not named are removed.

    Every file whose text differs is written aside and flushed first, then all are renamed in order, the last one last.
    With a `journal`, the list of the renames is written before the first one, and removed after the last: a program that
    is killed between two renames has finished them once `finish_writing` was called.

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
        gone = [] if swept is None else [path for path in sorted(swept.rglob("*.txt")) if path not in texts]
        if journal is not None and len(aside) + len(gone) > 1:
            _write_journal(journal, aside, gone)
            done = True
            finish_writing(journal)
            return
        for temporary, path in aside:
            temporary.replace(path)
        done = True
        _sync_parents(aside)
        for path in gone:
            remove(path)
    except OSError as error:
        raise OutputError(f"cannot write {error.filename or next(iter(texts))}: {os_error_text(error)}") from error
    finally:
        for temporary, _ in () if done else aside:
            temporary.unlink(missing_ok=True)
        for parent in () if done else reversed(made):
            with suppress(OSError):  # somebody else has put a file there meanwhile
                parent.rmdir()


def finish_writing(journal: Path) -> bool:
    """Finish the renames of a journal that was left behind, and remove it. Return whether there was one.

    Raises:
        OutputError: the folder cannot be written to; the journal stays.
    """
    try:
        values = json.loads(journal.read_bytes())
        renames = [(journal.parent / one, journal.parent / other) for one, other in values["renames"]]
        gone = [journal.parent / each for each in values["gone"]]
    except FileNotFoundError:
        return False
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(f"cannot read {journal}, the list of a save that was cut off: {error}") from error
    try:
        for temporary, path in renames:
            with suppress(FileNotFoundError):  # renamed before
                temporary.replace(path)
        _sync_parents(renames)
    except OSError as error:
        raise OutputError(
            f"cannot finish a save that was cut off, {error.filename}: {os_error_text(error)}; then open it again"
        ) from error
    for path in gone:
        remove(path)
    remove(journal)
    return True


def _write_journal(journal: Path, aside: list[tuple[Path, Path]], gone: list[Path]) -> None:
    renames = [[os.path.relpath(each, journal.parent) for each in pair] for pair in aside]
    values = {"renames": renames, "gone": [os.path.relpath(each, journal.parent) for each in gone]}
    write_text(journal, json.dumps(values))


def _sync_parents(renamed: list[tuple[Path, Path]]) -> None:
    for parent in {path.parent for _, path in renamed}:
        with suppress(OSError):  # not every file system supports it
            sync_folder(parent)


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
