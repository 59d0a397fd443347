"""Removing the shared-memory files that killed processes leave behind.

Fast DDS keeps a segment (35 MB by our profile) and ports for each process, in files that only a process that ends
normally removes. A lock file beside a segment is locked as long as its owner lives. Fast DDS's own `fastdds shm clean`
identifies dead owners in the same way.
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
_OF_PORT = re.compile(r"(?:sem\.)?fastrtps_port(\d+)(?:_el|_sl|_mutex)?")
_LOCK_OF_PORT = re.compile(r"fastrtps_port(\d+)_[es]l")

_FIRST_PORT, _PORTS_OF_DOMAIN = 7400, 250
"""Numbers of ports by domain (RTPS 2.5, 9.6.2.3): the first of domain 0, and the step from one domain to the next."""


def remove_dead_segments(folder: Path = FOLDER) -> int:
    """Remove segments and ports of dead processes, and return the number of segments; files of other users stay.

    Fast DDS reuses ports of dead processes itself, except a port whose owner was killed while creating it: every later
    process waits for that port forever. A living process may hold any port of its ROS domain open, so a domain's ports
    are removed only if nobody listens on any of them: other chairs may live in other domains.
    """
    cleared = 0
    for lock, segment in _locks(folder):
        with suppress(OSError), _held(lock):
            segment.unlink(missing_ok=True)
            lock.unlink()
            cleared += 1
    nobody_lives = not any(_locks(folder))
    locks = [path for path in _files(folder) if _LOCK_OF_PORT.fullmatch(path.name)]
    living = {_domain(lock, _LOCK_OF_PORT) for lock in locks if _is_held(lock)}
    for path in _files(folder):
        if not _OF_PORT.fullmatch(path.name):
            continue
        domain = _domain(path, _OF_PORT)
        if nobody_lives or (domain >= 0 and domain not in living):  # ports below those of the domains are everybody's
            with suppress(OSError):
                path.unlink()
    return cleared


def _domain(path: Path, shape: re.Pattern[str]) -> int:
    """Return the ROS domain of a port's file."""
    found = shape.fullmatch(path.name)
    assert found is not None
    return (int(found[1]) - _FIRST_PORT) // _PORTS_OF_DOMAIN


def _is_held(lock: Path) -> bool:
    """Return whether a process holds a lock file, exclusively or shared; also if it cannot be told."""
    try:
        with _held(lock):
            return False
    except OSError:
        return True


def _locks(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Yield each segment's lock file, and the segment."""
    for path in _files(folder):
        if (found := _LOCK_OF_SEGMENT.fullmatch(path.name)) is not None:
            yield path, folder / found[1]


def _files(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if folder.is_dir() else []


@contextmanager
def _held(lock: Path) -> Iterator[None]:
    """Hold a lock file.

    Raises:
        OSError: the owner lives, or the file belongs to another user.
    """
    file = os.open(lock, os.O_RDWR)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(file)
