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
from waychair.files import is_file, os_error_text, read_bytes, replacing
from waychair.maps.building.building import Building
from waychair.maps.building.hgraph import Arc, GraphDoorway
from waychair.maps.building.hgraph_edits import arc_ref
from waychair.maps.building.hgraph_files import GENERAL, SUBMAPS
from waychair.maps.drawn.anchors import ANCHORS_YAML, GRAPH
from waychair.maps.drawn.places import PLACES_YAML
from waychair.maps.drawn.zones import ZONES_YAML
from waychair.planning.building.overlay import Tables

TABLES = "tables.bin"

_DRAWN = (PLACES_YAML, ZONES_YAML, ANCHORS_YAML, GRAPH)
"""The files of a map folder that move nodes or change the costs of arcs."""

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


def graph_key(building: Building, now_ns: int) -> str:
    """Return the key of the graph that a building's routes are found in at a time [ns since 1970, UTC].

    It is the hash of the text files, of all drawings and nodes of its maps that move nodes or change costs, and of the
    closures that have ended.

    Raises:
        BuildingError: a file cannot be read.
    """
    digest = hashlib.sha256(text_key(building.folder).encode())
    for storey in building.hgraph.storeys:
        folder = building.map_folder(storey.id)
        for name in () if folder is None else _DRAWN:
            path = folder / name if folder is not None else building.folder
            if is_file(path, BuildingError):
                digest.update(f"{storey.id} {name}\n".encode())
                digest.update(read_bytes(path, BuildingError))
    for path_, submap in building.hgraph.submaps.items():
        both: tuple[Arc | GraphDoorway, ...] = (*submap.arcs, *submap.doorways)
        ended = [each for each in both if each.way.closure is not None and not each.way.closure.holds(now_ns)]
        digest.update("".join(f"{path_} {arc_ref(submap, each)}\n" for each in ended).encode())
    for lift in building.hgraph.lifts.values():
        again = [stop.storey for stop in lift.stops if stop.closure is not None and not stop.closure.holds(now_ns)]
        digest.update("".join(f"@{lift.id} {storey}\n" for storey in again).encode())
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
