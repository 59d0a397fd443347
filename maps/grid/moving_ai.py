"""Benchmark maps and queries of the Moving AI Lab: `NAME.map`, and `NAME.map.scen` with the known optimal costs.

Format after N. Sturtevant, "Benchmarks for Grid-Based Pathfinding", IEEE Trans. Comput. Intell. AI in Games 4(2), 2012.
A map is four lines of header (type octile, height, width, map) and then its rows, the top one first; `.`, `G` and `S`
are free, `@`, `O`, `T` and `W` are not. A query is a tab-separated line: bucket, map, width, height, start column and
row, goal column and row, cost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.errors import MapError, MapNotFound
from waychair.files import is_file, is_folder, read_bytes
from waychair.maps.grid.cells import check_size
from waychair.types import BoolArray
from waychair.yaml_files import quoted

SUFFIX = ".map"
_FREE = b".GS"
_SOLID = b"@OTW"
_LETTERS = ", ".join((_FREE + _SOLID).decode())


@dataclass(frozen=True, slots=True)
class ScenarioQuery:
    """Start and goal as (row, column), row 0 on top, and the optimal cost [cells; a diagonal step is sqrt 2].

    `shape` is the height and width of the query's map.
    """

    start: tuple[int, int]
    goal: tuple[int, int]
    optimal: float
    shape: tuple[int, int]


def is_moving_ai(path: Path) -> bool:
    """Return whether a path names a file of this format, and not a map folder with that suffix."""
    return path.suffix.lower() == SUFFIX and not is_folder(path, MapError)


def load_free_cells(path: Path) -> BoolArray:
    """Return which cells (H, W) of a Moving AI map are free, row 0 on top.

    Raises:
        MapNotFound: there is no such file.
        MapError: the file is no such map; the message names the line.
    """
    if not is_file(path, MapError):
        raise MapNotFound(f"there is no map at {path}; give a Moving AI .map file")
    lines = read_bytes(path, MapError).split(b"\n")
    lines = [line.rstrip(b"\r") for line in lines]
    if len(lines) < 4 or lines[0].split()[:1] != [b"type"] or lines[3].strip() != b"map":
        raise MapError(f"{path} is no Moving AI map: it must begin with the lines type, height, width and map")
    height, width = (_extent(path, lines, i, name) for i, name in ((1, b"height"), (2, b"width")))
    check_size(f"the map {path}", height, width)
    rows = lines[4 : 4 + height]
    wrong = next((i for i, row in enumerate(rows) if len(row) != width), len(rows))
    if wrong < height:
        found = f"{len(rows[wrong])} cells" if wrong < len(rows) else "nothing"
        raise MapError(f"{path} line {wrong + 5}: {found} where {width} cells were announced; copy the map again")
    further = next((i for i, line in enumerate(lines[4 + height :], start=5 + height) if line.strip()), None)
    if further is not None:
        raise MapError(f"{path} line {further}: more rows than the {height} that were announced; copy the map again")
    letters = np.frombuffer(b"".join(rows), np.uint8).reshape(height, width)
    unknown = np.argwhere(~np.isin(letters, np.frombuffer(_FREE + _SOLID, np.uint8)))
    if len(unknown):
        row, column = unknown[0].tolist()
        letter = quoted(chr(letters[row, column]))
        raise MapError(f"{path} line {row + 5}: {letter} in column {column} is none of {_LETTERS}; copy the map again")
    free: BoolArray = np.isin(letters, np.frombuffer(_FREE, np.uint8))
    return free


def load_queries(path: Path) -> list[ScenarioQuery]:
    """Return the queries of a scenario, in the order of the file.

    Raises:
        MapNotFound: there is no such file.
        MapError: a line is broken; the message names it.
    """
    if not is_file(path, MapError):
        raise MapNotFound(f"there is no scenario at {path}; give a Moving AI .scen file")
    lines = read_bytes(path, MapError).decode("utf-8", "replace").splitlines()
    if not lines or not lines[0].startswith("version"):
        raise MapError(f"{path} is no Moving AI scenario: its first line must be its version")
    queries = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        fields = line.split("\t") if "\t" in line else line.split()
        try:
            width, height, x0, y0, x1, y1 = (int(field) for field in fields[2:8])
            optimal = float(fields[8])
        except (ValueError, IndexError) as error:
            raise MapError(f"{path} line {number}: a query is nine fields, the last seven of them numbers") from error
        if not (math.isfinite(optimal) and optimal >= 0.0):
            raise MapError(f"{path} line {number}: {optimal} is no cost; copy the scenario again")
        queries.append(ScenarioQuery((y0, x0), (y1, x1), optimal, (height, width)))
    if not queries:
        raise MapError(f"{path} holds no query; give a scenario with some")
    return queries


def check_queries(queries: Sequence[ScenarioQuery], free: BoolArray) -> None:
    """Refuse queries that belong to another map, or that begin or end in a cell that is not in `free` (H, W).

    Raises:
        MapError: the sizes differ, or an end lies outside or is occupied; the message names the query.
    """
    height, width = free.shape
    for number, query in enumerate(queries, start=1):
        if query.shape != free.shape:
            raise MapError(
                f"query {number} of the scenario is of a map of {query.shape[1]} columns and {query.shape[0]} rows, "
                f"not of this one of {width} and {height}; give the scenario of this map"
            )
        for name, (row, column) in (("start", query.start), ("goal", query.goal)):
            within = 0 <= row < height and 0 <= column < width
            if not within or not free[row, column]:
                raise MapError(
                    f"query {number} of the scenario: its {name} in column {column}, row {row} "
                    f"{'is occupied' if within else 'lies outside the map'}; give the scenario of this map"
                )


def _extent(path: Path, lines: list[bytes], index: int, name: bytes) -> int:
    words = lines[index].split()
    as_announced = len(words) == 2 and words[0] == name and words[1].isdigit() and len(words[1]) < 10
    extent = int(words[1]) if as_announced else 0
    if extent == 0:
        raise MapError(f"{path} line {index + 1}: it must read `{name.decode()} N` with N cells, one or more")
    return extent
