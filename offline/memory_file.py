"""The file of the memory of places in a map folder, known without the memory itself."""

from __future__ import annotations

from pathlib import Path

from waychair.errors import OutputError

MEMORY = "memory.db"
"""Name of the memory's file in a map folder."""


def remove_memory(folder: Path) -> None:
    """Remove the memory from a folder.

    Raises:
        OutputError: the folder cannot be written to.
    """
    try:
        for ending in ("", "-wal", "-shm"):
            (folder / (MEMORY + ending)).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}; choose another folder") from error
