"""Traffic graphs for the command line: of a floor plan, a traffic graph's text file, a mapped floor, or a building."""

from __future__ import annotations

import time
from pathlib import Path

from waychair.errors import TrafficError
from waychair.files import is_file, is_folder, read_bytes
from waychair.maps.building.building import load_building
from waychair.maps.building.building_traffic import BuildingTraffic, building_traffic
from waychair.maps.building.hgraph import HGraph
from waychair.maps.building.hgraph_files import GENERAL
from waychair.maps.drawn.places import load_places
from waychair.maps.exchange.exchange import SCALE, read_exchange
from waychair.maps.exchange.floor_csv import NODES
from waychair.maps.folders.map_files import load_map
from waychair.maps.traffic.corridors import NARROW, corridor_graph, floor_plan_names, load_corridors
from waychair.maps.traffic.mapped_floor import mapped_floor_graph, places_on
from waychair.maps.traffic.traffic_files import FIRST_LINE, read_traffic
from waychair.maps.traffic.traffic_graph import TrafficGraph


def graph_from_source(
    source: str, *, width: float = NARROW, chair_width: float = 0.60, rooms: bool = False, bays: bool = False
) -> TrafficGraph:
    """Return the graph of a source as `traffic_from_source` does, without its notes."""
    return traffic_from_source(source, width=width, chair_width=chair_width, rooms=rooms, bays=bays).graph


def traffic_from_source(
    source: str, *, width: float = NARROW, chair_width: float = 0.60, rooms: bool = False, bays: bool = False
) -> BuildingTraffic:
    """Return the graph of a shipped floor plan's name, or of a path, with notes on what is left out or guessed.

    A path is a floor plan, traffic graph, map folder or its YAML file, a building's folder, or a file of another program from
    which a building can be made. `width` [m], `rooms` and `bays` are of floor plans (`corridors.corridor_graph`).

    Raises:
        TrafficError: there is no such thing, or it is damaged or impossible.
        BuildingError: the building's files are damaged.
        MapError: the map cannot be read.
    """
    if source in floor_plan_names():
        return BuildingTraffic(
            corridor_graph(load_corridors(source), width, chair_width=chair_width, rooms=rooms, bays=bays)
        )
    path = Path(source)
    hgraph = _building(path)
    if hgraph is not None:
        return building_traffic(hgraph, chair_width=chair_width, now_ns=time.time_ns())
    if is_folder(path, TrafficError) or _is_map(path):
        grid = load_map(path)
        places = places_on(grid, load_places(path))
        name = path.resolve().name if is_folder(path, TrafficError) else path.stem
        return BuildingTraffic(mapped_floor_graph(grid, places, name=name, chair_width=chair_width))
    if is_file(path, TrafficError) and read_bytes(path, TrafficError).startswith(FIRST_LINE.encode()):
        return BuildingTraffic(read_traffic(path))
    if path.suffix in (".yaml", ".yml"):
        return BuildingTraffic(
            corridor_graph(load_corridors(path), width, chair_width=chair_width, rooms=rooms, bays=bays)
        )
    if not is_file(path, TrafficError):
        known = ", ".join(floor_plan_names())
        raise TrafficError(f"there is no floor plan, map or building '{source}'; give a path or one of {known}")
    return BuildingTraffic(read_traffic(path))


def _building(path: Path) -> HGraph | None:
    """Return the building in a folder, or in a file or folder of another program; None if the path is something else."""
    if is_folder(path, TrafficError):
        if is_file(path / GENERAL, TrafficError):
            return load_building(path).hgraph
        return read_exchange(path, "", None, SCALE).hgraph if is_file(path / NODES, TrafficError) else None
    other = path.name.endswith((".building.yaml", ".geojson"))
    return read_exchange(path, "", None, SCALE).hgraph if other and is_file(path, TrafficError) else None


def _is_map(path: Path) -> bool:
    """Return whether a path is the YAML file of a map, which names an image."""
    yaml = path.suffix in (".yaml", ".yml") and is_file(path, TrafficError)
    return yaml and any(line.startswith(b"image:") for line in read_bytes(path, TrafficError).splitlines())
