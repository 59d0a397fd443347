"""The cache file of a building's border tables, keyed by the hash of its text files: `tables.bin` in its folder.

A line of JSON (version, key, arrays with names, types and shapes, checksum), then the arrays' bytes. A file of another
graph, another version or with a broken checksum is not used; tables are then made anew.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from waychair.errors import BuildingError, MapError
from waychair.files import is_file, os_error_text, replacing
from waychair.maps.building.hgraph_files import GENERAL, SUBMAPS
from waychair.planning.building.overlay import Tables

TABLES = "tables.bin"
VERSION = 2
"""Raised when the tables of the same graph would differ."""


class StaleTables(BuildingError):
    """The cache file holds the tables of another graph, or none that can be used."""


def text_key(folder: Path) -> str:
    """Return the key of a building's text files: the hash of their names and bytes.

    Raises:
        BuildingError: a file cannot be read.
    """
    digest = hashlib.sha256(f"tables {VERSION}\n".encode())
    try:
        for path in [folder / GENERAL, *sorted((folder / SUBMAPS).rglob("*.txt"))]:
            data = path.read_bytes()
            digest.update(f"{path.relative_to(folder)} {len(data)}\n".encode())
            digest.update(data)
    except OSError as error:
        raise BuildingError(f"cannot read {folder}: {os_error_text(error)}") from error
    return digest.hexdigest()


def save_tables(path: Path, tables: Tables, key: str) -> None:
    """Write tables and their key, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    arrays = [np.ascontiguousarray(array) for array in tables]
    check = 0
    for array in arrays:
        check = zlib.crc32(array.data.cast("B") if array.size else b"", check)
    head = {
        "version": VERSION,
        "key": key,
        "arrays": [[array.dtype.str, list(array.shape)] for array in arrays],
        "crc32": check,
    }
    with replacing(path, lasting=False) as aside, aside.open("wb") as file:
        file.write(json.dumps(head).encode() + b"\n")
        for array in arrays:
            array.tofile(file)


def tables_key(path: Path) -> str:
    """Return the key of the graph whose tables a file holds.

    Raises:
        StaleTables: the file is damaged.
    """
    try:
        with path.open("rb") as file:
            return str(json.loads(file.readline())["key"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StaleTables(f"{path} is damaged: make the tables anew with waychair building tables") from error


def load_tables(path: Path, key: str) -> Tables:
    """Return the tables of a graph with this key.

    Raises:
        StaleTables: there is no file, or it is damaged, of another version or of another graph.
    """
    if not is_file(path, MapError):
        raise StaleTables(f"there are no tables in {path}: make them with waychair building tables")
    try:
        with path.open("rb") as file:
            head: dict[str, Any] = json.loads(file.readline())
            if head["version"] != VERSION or head["key"] != key:
                raise StaleTables(f"{path} holds the tables of another graph: make them with waychair building tables")
            arrays, check = [], 0
            for kind, shape in head["arrays"]:
                array = np.fromfile(file, np.dtype(kind), int(np.prod(shape, dtype=np.int64))).reshape(shape)
                check = zlib.crc32(array.data.cast("B") if array.size else b"", check)
                arrays.append(array)
            if check != head["crc32"]:
                raise StaleTables(f"{path} is damaged: make the tables anew with waychair building tables")
        return Tables(*arrays)
    except (ValueError, KeyError, TypeError) as error:
        raise StaleTables(f"{path} is damaged: make the tables anew with waychair building tables") from error
    except OSError as error:
        raise StaleTables(f"cannot read {path}: {os_error_text(error)}") from error
