"""Compressed files, recognised by their first bytes: gzip, bzip2, xz and zstd."""

from __future__ import annotations

import bz2
import gzip
import lzma
import shutil
import sys
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

from waychair.errors import RecordingDamaged, RecordingError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


class Packing(NamedTuple):
    """A compression: its name, the command that undoes it, and the class that opens a file for reading."""

    name: str
    command: str
    open: Callable[[Path], Any]


PACKINGS: Mapping[bytes, Packing] = {
    b"\x1f\x8b": Packing("gzip", "gunzip", gzip.GzipFile),
    b"BZh": Packing("bzip2", "bunzip2", bz2.BZ2File),
    b"\xfd7zXZ\x00": Packing("xz", "unxz", lzma.LZMAFile),
    b"\x28\xb5\x2f\xfd": Packing("zstd", "unzstd", zstd.ZstdFile),
}
"""The compressions that can be read, by their magic bytes."""

PACKED_ENDINGS = (".gz", ".bz2", ".xz", ".zst", ".zstd")
"""Usual endings of compressed files; only their content decides."""

_CHUNK = 1 << 20  # bytes
_BROKEN = (EOFError, zlib.error, lzma.LZMAError, zstd.ZstdError, gzip.BadGzipFile, ValueError)


def packing_of(head: bytes) -> Packing | None:
    """Return the compression of a file by its first bytes; None for a file that is not compressed."""
    return next((packing for magic, packing in PACKINGS.items() if head.startswith(magic)), None)


def unpacked_head(path: Path, packing: Packing, count: int) -> bytes:
    """Return up to `count` bytes from the beginning of the content; fewer where the file is damaged."""
    head = b""
    try:
        with packing.open(path) as file:
            while len(head) < count and (part := file.read1(count - len(head))):
                head += part
    except (*_BROKEN, OSError):
        pass
    return head


def unpack(path: Path, packing: Packing, target: Path) -> str:
    """Write the content of a compressed file; return why its end is missing, an empty text for a whole file.

    Raises:
        RecordingDamaged: nothing can be decompressed.
        RecordingError: the disk has no room for the content, or cannot be written.
    """
    try:
        with packing.open(path) as source, target.open("wb") as file:
            try:
                _copy(source, file)
            except (*_BROKEN, OSError) as error:
                if isinstance(error, OSError) and error.errno is not None:
                    raise
                reason = str(error).rstrip(".") or "the file ends early"
                if not file.tell():
                    raise RecordingDamaged(
                        f"{path} is a damaged {packing.name} file ({reason}): nothing can be read; copy it again from its source"
                    ) from error
                return reason
    except OSError as error:
        free = shutil.disk_usage(target.parent).free
        raise RecordingError(
            f"cannot unpack {path} into {target.parent}, where {free / 1e9:.1f} GB are free: {error.strerror or error}; "
            f"unpack it elsewhere ({packing.command}) and give the unpacked file"
        ) from error
    return ""


def _copy(source: Any, target: IO[bytes]) -> None:
    """Copy all that can be decompressed; a damaged end raises after the data before it were written."""
    while part := source.read1(_CHUNK):
        target.write(part)
