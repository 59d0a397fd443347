"""Files, read with a sentence for whatever is in the way, and written so that a reader never sees half of one."""

from __future__ import annotations

import errno
import json
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from waychair.errors import OutputError, WaychairError
from waychair.types import Json


def cache_folder() -> Path:
    """Where this user's computer keeps what was built on it (`XDG_CACHE_HOME`, else ~/.cache)."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "waychair"


def is_there(path: Path, failure: type[WaychairError]) -> bool:
    """Whether there is anything at a path.

    Raises:
        WaychairError: of the type `failure`; that cannot be known, as for a folder that may not be entered.
    """
    return _mode(path, failure) is not None


def is_file(path: Path, failure: type[WaychairError]) -> bool:
    """Whether there is a file at a path; raises as `is_there`."""
    return stat.S_ISREG(_mode(path, failure) or 0)


def is_folder(path: Path, failure: type[WaychairError]) -> bool:
    """Whether there is a folder at a path; raises as `is_there`."""
    return stat.S_ISDIR(_mode(path, failure) or 0)


def read_bytes(path: Path, failure: type[WaychairError]) -> bytes:
    """A file's bytes.

    Raises:
        WaychairError: of the type `failure`; the file cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise failure(f"cannot read {path}: {refusal(error)}") from error


def read_text(path: Path, failure: type[WaychairError], instead: str = "") -> str:
    """A file's text; `instead` is advice for a file that is none.

    Raises:
        WaychairError: of the type `failure`; the file cannot be read, or is no text.
    """
    try:
        return read_bytes(path, failure).decode("utf-8")
    except UnicodeDecodeError as error:
        raise failure(f"cannot read {path}: it is no text in UTF-8; {instead or 'write it anew'}") from error


def refusal(error: OSError) -> str:
    """What the operating system says, and what to do about it."""
    return f"{error.strerror or error}; {_ADVICE.get(error.errno or 0, 'check the path and the disk')}"


def refuse_emptied(path: Path, failure: type[WaychairError], none: str) -> None:
    """Refuse a file of no byte, which nobody has written so; `none` is what it would hold where there is nothing to say.

    Raises:
        WaychairError: of the type `failure`; it is one.
    """
    if not read_bytes(path, failure):
        raise failure(f"{path} is empty, as after a power cut: put a copy of it back, or write {none} into it for none")


@contextmanager
def replacing(path: Path, *, lasting: bool = True) -> Iterator[Path]:
    """A temporary path beside `path`, moved onto it when the block ends well and removed when it does not.

    After a power cut the file is the old one or the new one, unless it is not to be `lasting`: then nobody waits for the
    disk, and it may be empty.

    Where `path` is a symbolic link, what it points to is written. What is there already and is no file (a folder, a
    device, a pipe) is left as it is.

    Raises:
        OutputError: the folder cannot be made or written to, or something other than a file is there.
    """
    path = _written(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except FileExistsError as error:  # what `mkdir` calls a folder that is a file
        raise OutputError(f"cannot write {path}: Not a directory; choose another folder or name") from error
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder or name") from error
    aside = Path(name)
    try:
        yield aside
        aside.chmod(0o644)
        if lasting:
            with aside.open("rb") as file:
                os.fsync(file.fileno())
        aside.replace(path)
        if lasting:
            with suppress(OSError):  # not every file system can
                sync_folder(path.parent)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {refusal(error)}") from error
    finally:
        aside.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Have the disk keep the folder's list of files."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: Path, text: str, *, lasting: bool = True) -> None:
    """Write a text file whole or not at all; `lasting`: see `replacing`."""
    with replacing(path, lasting=lasting) as aside:
        aside.write_text(text, encoding="utf-8")


def write_bytes(path: Path, data: bytes) -> None:
    """Write a binary file whole or not at all."""
    with replacing(path) as aside:
        aside.write_bytes(data)


def remove(path: Path) -> None:
    """See that there is no file at a path.

    Raises:
        OutputError: it cannot be removed.
    """
    try:
        path.unlink()
    except (FileNotFoundError, NotADirectoryError):  # such as in a folder that is a file
        return
    except OSError as error:
        raise OutputError(f"cannot remove {path}: {refusal(error)}") from error


def write_json(path: Path, values: Json, *, lasting: bool = True) -> None:
    """Write a JSON file whole or not at all; NaN and infinities are refused. `lasting`: see `replacing`."""
    write_text(path, json.dumps(values, indent=2, allow_nan=False) + "\n", lasting=lasting)


def _mode(path: Path, failure: type[WaychairError]) -> int | None:
    """What kind of thing there is at a path; None where there can be nothing."""
    try:
        return path.stat().st_mode
    except ValueError:  # a null in it
        return None
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP):
            return None
        raise failure(f"cannot read {path}: {refusal(error)}") from error


def _written(path: Path) -> Path:
    """The file that is written in the end, through symbolic links."""
    try:
        target = path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # links in a circle
        raise OutputError(f"cannot write {path}: it leads nowhere; choose another name") from error
    mode = _mode(target, OutputError)
    if mode is not None and not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a device, pipe or socket"
        raise OutputError(f"cannot write {path}: it is {kind}, no file; choose the name of a file")
    return target


_ADVICE = {
    errno.EACCES: "give this user the right to it and to its folders",
    errno.EPERM: "give this user the right to it and to its folders",
    errno.EISDIR: "give a file",
    errno.ENOENT: "check its name",
    errno.ENAMETOOLONG: "take a shorter name",
    errno.ENOSPC: "make room on the disk",
}
