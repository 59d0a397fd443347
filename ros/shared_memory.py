"""What processes that were killed leave behind in shared memory.

Fast DDS keeps a segment (35 MB by our profile) and ports for each process, in files that only a process which ends by
itself takes away. A file beside a segment is locked for as long as its owner lives; by that Fast DDS's own `fastdds shm
clean` tells the dead, too.
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FOLDER = Path("/dev/shm")

_LOCK_OF_SEGMENT = re.compile(r"(fastrtps_[0-9a-f]{16})_el")
_OF_PORT = re.compile(r"(sem\.)?fastrtps_port\d+(_el|_sl|_mutex)?")


def clear_dead(folder: Path = FOLDER) -> int:
    """Remove what the dead have left, and tell of how many segments that was; what belongs to other users stays.

    Fast DDS takes the dead's ports up by itself, but for one whose owner was killed while it made it: everybody who comes
    after waits for it for ever. Somebody who lives may hold a port open, so they are removed only when nobody does.
    """
    cleared = 0
    for lock, segment in _locks(folder):
        with suppress(OSError), _held(lock):
            segment.unlink(missing_ok=True)
            lock.unlink()
            cleared += 1
    if not any(_locks(folder)):
        for path in _files(folder):
            if _OF_PORT.fullmatch(path.name):
                with suppress(OSError):
                    path.unlink()
    return cleared


def _locks(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Each segment's lock, and the segment."""
    for path in _files(folder):
        if (found := _LOCK_OF_SEGMENT.fullmatch(path.name)) is not None:
            yield path, folder / found[1]


def _files(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if folder.is_dir() else []


@contextmanager
def _held(lock: Path) -> Iterator[None]:
    """
    Raises:
        OSError: its owner lives, or is another user's.
    """
    file = os.open(lock, os.O_RDWR)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(file)
