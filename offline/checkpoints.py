"""Checkpoints of a mapping run: the mapper's state is saved in the output folder, and the next run resumes from it."""

from __future__ import annotations

import hashlib
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from waychair import __version__, config
from waychair.config import Settings
from waychair.files import replacing
from waychair.recordings.recording import Recording
from waychair.slam.mapping.checkpoint import mapper_from_state, state_of
from waychair.slam.mapping.mapper import Mapper

CHECKPOINT = "checkpoint.npz"

_MOST_TIME = 0.05  # share of the run time that may go into saving


class Checkpoints:
    """Saves a mapper's state at an interval, or less often where saving would slow the mapping down."""

    def __init__(self, folder: Path, recording: Recording, settings: Settings, interval_s: float) -> None:
        self.path = folder / CHECKPOINT
        self._fingerprint = np.frombuffer(_fingerprint(recording, settings).encode(), np.uint8)
        self._interval_s = interval_s
        self._next = time.monotonic() + interval_s

    def restored(self) -> tuple[Mapper, int] | None:
        """Return the mapper of an earlier run with the same input and settings, and its frame count; None without."""
        try:
            with np.load(self.path, allow_pickle=False) as state:
                if not np.array_equal(state["fingerprint"], self._fingerprint):
                    return None
                return mapper_from_state(state), int(state["frames"])
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None  # there is no checkpoint, or another version's: the mapping begins anew

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Add a note about the checkpoint to an interrupt from the keyboard within the block."""
        try:
            yield
        except KeyboardInterrupt as stop:
            if self.path.exists():
                stop.add_note("run the same command again to resume from its checkpoint")
            raise

    def offer(self, mapper: Mapper, frames: int) -> None:
        """Save the mapper with its number of frames, if it is time.

        Raises:
            OutputError: the folder cannot be written to.
        """
        started = time.monotonic()
        if started < self._next:
            return
        arrays: dict[str, Any] = {"fingerprint": self._fingerprint, "frames": np.array(frames), **state_of(mapper)}
        with replacing(self.path) as aside, aside.open("wb") as file:
            np.savez(file, **arrays)
        now = time.monotonic()
        self._next = now + max(self._interval_s, (now - started) / _MOST_TIME)


def remove_checkpoint(folder: Path) -> None:
    """Remove the checkpoint after a finished run, and the half-written files of killed runs."""
    stem, _, suffix = CHECKPOINT.partition(".")
    for path in (folder / CHECKPOINT, *folder.glob(f".{stem}.*.{suffix}")):
        path.unlink(missing_ok=True)


def _fingerprint(recording: Recording, settings: Settings) -> str:
    """Return a hash over the recording's files and frames, the settings and the program's version."""
    parts = recording.parts or (recording.path,)
    files = [file for part in parts for file in sorted(each for each in part.rglob("*") if each.is_file()) or [part]]
    stats = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files]
    stamps = [frame.stamp_ns for frame in recording.frames]
    told = (__version__, config.dump(settings), stats, len(stamps), stamps[:1], stamps[-1:], recording.source)
    return hashlib.sha256(repr(told).encode()).hexdigest()
