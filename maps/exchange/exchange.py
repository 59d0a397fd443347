"""Buildings from other programs' files, and back: the format is taken from the file's name."""

from __future__ import annotations

import enum
import json
from dataclasses import replace
from pathlib import Path

from waychair.errors import BuildingError
from waychair.files import is_folder, read_bytes, write_text
from waychair.maps.building.building import Building
from waychair.maps.building.hgraph import HGraph
from waychair.maps.building.rewriting import write_all
from waychair.maps.exchange import floor_csv, open_rmf, route_graph
from waychair.maps.exchange.flat_graph import Imported, kept_file

SCALE = floor_csv.METRES_A_PIXEL
"""Metres a pixel of CSV files, where nobody states it."""

OPTIONS = "options.json"
"""The kept file with the options of the import, which its export needs again."""


class Exchange(enum.StrEnum):
    """The formats of other programs."""

    OPEN_RMF = "open-rmf"
    ROUTE_GRAPH = "nav2"
    FLOOR_CSV = "csv"


def exchange_of(path: Path) -> Exchange:
    """Return the format that a file name, or the folder of two CSV files, stands for.

    Raises:
        BuildingError: it stands for none.
    """
    if path.suffix in (".yaml", ".yml"):
        return Exchange.OPEN_RMF
    if path.suffix in (".geojson", ".json"):
        return Exchange.ROUTE_GRAPH
    if not path.suffix or path.suffix == ".csv":
        return Exchange.FLOOR_CSV
    raise BuildingError(
        f"{path.name} is no format that is read or written: name a .building.yaml of Open-RMF, a .geojson of Nav2, "
        "or a folder with nodes.csv and edges.csv"
    )


def read_exchange(path: Path, name: str, graph: int | None, scale: float) -> Imported:
    """Return the building in a file of another program.

    Args:
        path: file, or folder of nodes.csv and edges.csv.
        name: the building's name; "" for that in the file, or the file's own.
        graph: `graph_idx` of Open-RMF; None for the lowest.
        scale: metres a pixel of the CSV files.

    Raises:
        BuildingError: as the formats' own readers.
    """
    format_ = exchange_of(path)
    title = name or path.name.partition(".")[0]
    if format_ is Exchange.OPEN_RMF:
        found = open_rmf.building_from_open_rmf(read_bytes(path, BuildingError), path.name, graph)
        title = name or found.hgraph.name
    elif format_ is Exchange.ROUTE_GRAPH:
        found = route_graph.building_from_route_graph(read_bytes(path, BuildingError), path.name)
    else:
        title = name or (path if is_folder(path, BuildingError) else path.parent).name
        nodes, edges = (read_bytes(each, BuildingError) for each in csv_files(path))
        found = floor_csv.building_from_floor_csv(nodes, edges, title, scale)
    options = json.dumps({"graph": graph, "scale": scale}).encode()
    return replace(found, hgraph=replace(found.hgraph, name=title), kept={**found.kept, OPTIONS: options})


def csv_files(path: Path) -> tuple[Path, Path]:
    """Return the files of nodes and of edges in a folder, or of one of them: `nodes` and `edges` in their names differ.

    Raises:
        BuildingError: the file's name has neither word.
    """
    if is_folder(path, BuildingError):
        return path / floor_csv.NODES, path / floor_csv.EDGES
    for one, other in (("nodes", "edges"), ("Nodes", "Edges")):
        if one in path.name:
            return path, path.with_name(path.name.replace(one, other))
        if other in path.name:
            return path.with_name(path.name.replace(other, one)), path
    raise BuildingError(f"{path.name} is neither nodes nor edges: name the CSV files nodes.csv and edges.csv")


def write_exchange(building: Building, path: Path) -> None:
    """Write a building to a file of another program, or a folder for two CSV files.

    A building that was imported from this format keeps everything in its file that nobody changed.

    Raises:
        BuildingError: the name stands for no format, or the kept file is damaged.
        OutputError: the file cannot be written.
    """
    format_, folder = exchange_of(path), building.folder
    graph, scale = _options(folder)
    hgraph: HGraph = building.hgraph
    if format_ is Exchange.OPEN_RMF:
        write_text(path, open_rmf.open_rmf_of(hgraph, kept_file(folder, open_rmf.KEPT_NAME), graph))
    elif format_ is Exchange.ROUTE_GRAPH:
        write_text(path, route_graph.route_graph_of(hgraph, kept_file(folder, route_graph.KEPT_NAME)))
    else:
        kept = [kept_file(folder, each) for each in (floor_csv.NODES, floor_csv.EDGES)]
        target = path.parent if path.suffix else path
        both = None if kept[0] is None or kept[1] is None else (kept[0], kept[1])
        texts = floor_csv.floor_csv_of(hgraph, both, scale)
        write_all({target / floor_csv.NODES: texts[0], target / floor_csv.EDGES: texts[1]})


def _options(folder: Path) -> tuple[int | None, float]:
    data = kept_file(folder, OPTIONS)
    if data is None:
        return None, floor_csv.METRES_A_PIXEL
    try:
        options = json.loads(data)
        graph, scale = options["graph"], float(options["scale"])
    except (ValueError, KeyError, TypeError) as error:
        raise BuildingError(f"{folder}/imported/{OPTIONS} is damaged: import the building again") from error
    return graph if isinstance(graph, int) else None, scale
