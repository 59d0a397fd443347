"""Checkpoints of a mapping run: the mapper's state is saved in the output folder, and the next run resumes from it."""

from __future__ import annotations

import hashlib
import signal
import threading
import time
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from waychair import __version__, config
from waychair.config import Settings
from waychair.errors import OutputError
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
        self._asked_to_stop = False

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
        """Let an interrupt from the keyboard within the block wait for the next `offer`, which saves the mapper first.

        A second interrupt ends the block at once. The interrupt carries a note about the checkpoint.
        """
        in_main = threading.current_thread() is threading.main_thread()  # only there signals can be heard
        earlier = signal.signal(signal.SIGINT, self._ask_to_stop) if in_main else None
        try:
            yield
        except KeyboardInterrupt as stop:
            if self.path.exists():
                stop.add_note("run the same command again to resume from its checkpoint")
            raise
        finally:
            if in_main:
                signal.signal(signal.SIGINT, earlier or signal.default_int_handler)

    def _ask_to_stop(self, number: int, frame: FrameType | None) -> None:
        if self._asked_to_stop:
            raise KeyboardInterrupt
        self._asked_to_stop = True

    def offer(self, mapper: Mapper, frames: int) -> None:
        """Save the mapper with its number of frames, if it is time or the run was interrupted.

        Raises:
            OutputError: the folder cannot be written to, or the disk is full; the checkpoint before stays.
            KeyboardInterrupt: the run was interrupted; the mapper is saved.
        """
        started = time.monotonic()
        if started < self._next and not self._asked_to_stop:
            return
        arrays: dict[str, Any] = {"fingerprint": self._fingerprint, "frames": np.array(frames), **state_of(mapper)}
        try:
            with replacing(self.path) as aside, aside.open("wb") as file:
                np.savez(file, **arrays)
        except OutputError as error:
            if not self.path.exists():
                raise
            raise OutputError(
                f"{error}. The same command goes on from the checkpoint before, which is whole"
            ) from error
        if self._asked_to_stop:
            raise KeyboardInterrupt
        now = time.monotonic()
        self._next = now + max(self._interval_s, (now - started) / _MOST_TIME)


def remove_checkpoint(folder: Path) -> None:
    """Remove the checkpoint after a finished run, and the half-written files of killed runs."""
    stem, _, suffix = CHECKPOINT.partition(".")
    for path in (folder / CHECKPOINT, *folder.glob(f".{stem}.*.{suffix}")):
        path.unlink(missing_ok=True)


def files_of(parts: Iterable[Path]) -> list[Path]:
    """Return the files of a recording, which is in files or folders, in order of their names."""
    return [file for part in parts for file in sorted(each for each in part.rglob("*") if each.is_file()) or [part]]


def _fingerprint(recording: Recording, settings: Settings) -> str:
    """Return a hash over the recording's files and frames, the settings and the program's version."""
    files = files_of(recording.parts or (recording.path,))
    stats = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files]
    stamps = [frame.stamp_ns for frame in recording.frames]
    told = (__version__, config.dump(settings), stats, len(stamps), stamps[:1], stamps[-1:], recording.source)
    return hashlib.sha256(repr(told).encode()).hexdigest()
