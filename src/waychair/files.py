"""Files: reading with clear errors, and atomic writing, so that a reader never sees a half-written file."""

from __future__ import annotations

import errno
import json
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from waychair.errors import OutputError, WaychairError
from waychair.types import Json

_TOGETHER = ".together."
"""Beginning of the name of a folder whose files are to take their places together."""


def cache_folder() -> Path:
    """Return the folder for this user's cached build products (`XDG_CACHE_HOME`, else ~/.cache)."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "waychair"


def path_exists(path: Path, failure: type[WaychairError]) -> bool:
    """Return whether a path exists.

    Raises:
        WaychairError: of the type `failure`; the path cannot be examined, e.g. for lack of permission.
    """
    return _mode(path, failure) is not None


def is_file(path: Path, failure: type[WaychairError]) -> bool:
    """Return whether the path is a file; raises as `path_exists`."""
    return stat.S_ISREG(_mode(path, failure) or 0)


def is_folder(path: Path, failure: type[WaychairError]) -> bool:
    """Return whether the path is a folder; raises as `path_exists`."""
    return stat.S_ISDIR(_mode(path, failure) or 0)


def read_bytes(path: Path, failure: type[WaychairError]) -> bytes:
    """Return a file's bytes.

    Raises:
        WaychairError: of the type `failure`; the file cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise failure(f"cannot read {path}: {os_error_text(error)}") from error


def read_text(path: Path, failure: type[WaychairError], advice: str = "") -> str:
    """Return a file's text; `advice` is the advice given when the file is not text.

    Raises:
        WaychairError: of the type `failure`; the file cannot be read, or is not UTF-8 text.
    """
    try:
        return read_bytes(path, failure).decode("utf-8")
    except UnicodeDecodeError as error:
        raise failure(f"cannot read {path}: it is not UTF-8 text; {advice or 'write it again'}") from error


def os_error_text(error: OSError) -> str:
    """Return the operating system's error text, and advice."""
    return f"{error.strerror or error}; {_ADVICE.get(error.errno or 0, 'check the path and the disk')}"


def refuse_empty_file(path: Path, failure: type[WaychairError], none: str) -> None:
    """Refuse an empty file, which waychair never writes; `none` is the content of a file without entries.

    Raises:
        WaychairError: of the type `failure`; the file is empty.
    """
    if not read_bytes(path, failure):
        raise failure(
            f"{path} is empty, as after a power cut: restore a copy, or write {none} to it if there are no entries"
        )


@contextmanager
def replacing(path: Path, *, lasting: bool = True, mode: int = 0o644) -> Iterator[Path]:
    """Yield a temporary path beside `path`. It replaces `path` when the block succeeds, and is removed otherwise.

    After a power cut the file is either the old one or the new one. With `lasting=False` nothing waits for the disk,
    and after a power cut the file may be empty. `mode`: the file's permissions.

    A symbolic link is followed: its target is written. An existing folder, device or pipe is left alone.

    Raises:
        OutputError: the folder cannot be made or written to, or `path` exists and is not a file.
    """
    path = _written(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except FileExistsError as error:  # `mkdir` raises this where the folder is a file
        raise OutputError(f"cannot write {path}: Not a directory; choose another folder or name") from error
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder or name") from error
    aside = Path(name)
    try:
        yield aside
        aside.chmod(mode)
        if lasting:
            with aside.open("rb") as file:
                os.fsync(file.fileno())
        aside.replace(path)
        if lasting:
            with suppress(OSError):  # not every file system supports it
                sync_folder(path.parent)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {os_error_text(error)}") from error
    finally:
        aside.unlink(missing_ok=True)


@contextmanager
def replacing_together(folder: Path) -> Iterator[Path]:
    """Yield an empty folder inside `folder`. Its files take their places in `folder` when the block succeeds, and are removed
    otherwise: a disk that is full leaves the files of before, not some of each.

    Raises:
        OutputError: the folder cannot be made or written to, or a file would replace one that is none.
    """
    aside = folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for stale in folder.glob(f"{_TOGETHER}*"):  # of a run that was killed
            shutil.rmtree(stale, ignore_errors=True)
        with tempfile.TemporaryDirectory(prefix=_TOGETHER, dir=folder) as work:
            aside = Path(work)
            yield aside
            places = [(path, folder / path.name, _written(folder / path.name)) for path in sorted(aside.iterdir())]
            for path, place, target in places:
                if place.is_symlink():
                    write_bytes(place, path.read_bytes())
                else:
                    path.replace(target)
    except OutputError as error:
        raise OutputError(str(error).replace(str(aside), str(folder))) from error
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {os_error_text(error)}") from error


def sync_folder(folder: Path) -> None:
    """Flush a folder's directory entries to the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: Path, text: str, *, lasting: bool = True) -> None:
    """Write a text file atomically; `lasting`: see `replacing`."""
    with replacing(path, lasting=lasting) as aside:
        aside.write_text(text, encoding="utf-8")


def write_bytes(path: Path, data: bytes) -> None:
    """Write a binary file atomically."""
    with replacing(path) as aside:
        aside.write_bytes(data)


def remove(path: Path) -> None:
    """Remove a file if it exists.

    Raises:
        OutputError: the file cannot be removed.
    """
    try:
        path.unlink()
    except (FileNotFoundError, NotADirectoryError):  # the latter where a parent folder is a file
        return
    except OSError as error:
        raise OutputError(f"cannot remove {path}: {os_error_text(error)}") from error


def write_json(path: Path, values: Json, *, lasting: bool = True) -> None:
    """Write a JSON file atomically; NaN and infinities are refused. `lasting`: see `replacing`."""
    write_text(path, json.dumps(values, indent=2, allow_nan=False) + "\n", lasting=lasting)


def _mode(path: Path, failure: type[WaychairError]) -> int | None:
    """Return the `st_mode` of a path; None where nothing can exist there."""
    try:
        return path.stat().st_mode
    except ValueError:  # a null byte in the path
        return None
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP):
            return None
        raise failure(f"cannot read {path}: {os_error_text(error)}") from error


def _written(path: Path) -> Path:
    """Return the file behind symbolic links, which is the one to write."""
    try:
        target = path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links
        raise OutputError(f"cannot write {path}: its symbolic links form a loop; choose another name") from error
    mode = _mode(target, OutputError)
    if mode is not None and not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a device, pipe or socket"
        raise OutputError(f"cannot write {path}: it is {kind}, not a file; choose a file name")
    return target


_ADVICE = {
    errno.EACCES: "give this user permission for it and its folders",
    errno.EPERM: "give this user permission for it and its folders",
    errno.EISDIR: "give a file",
    errno.ENOENT: "check its name",
    errno.ENAMETOOLONG: "use a shorter name",
    errno.ENOSPC: "make room on the disk",
}
