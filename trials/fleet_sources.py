"""Traffic graphs for the command line: of a floor plan, a traffic graph's text file, or a mapped floor."""

from __future__ import annotations

from pathlib import Path

from waychair.errors import TrafficError
from waychair.files import is_file, is_folder, read_bytes
from waychair.maps.drawn.places import load_places
from waychair.maps.folders.map_files import load_map
from waychair.maps.traffic.corridors import NARROW, corridor_graph, floor_plan_names, load_corridors
from waychair.maps.traffic.mapped_floor import mapped_floor_graph, places_on
from waychair.maps.traffic.traffic_files import FIRST_LINE, read_traffic
from waychair.maps.traffic.traffic_graph import TrafficGraph


def graph_from_source(
    source: str, *, width: float = NARROW, chair_width: float = 0.60, rooms: bool = False, bays: bool = False
) -> TrafficGraph:
    """Return the graph of a shipped floor plan's name, or of a path: plan, traffic graph, map folder or its YAML file.

    A building's H-graph is not read yet: this is where it will come in.

    `width` [m], `rooms` and `bays` are of floor plans (`corridors.corridor_graph`).

    Raises:
        TrafficError: there is no such thing, or it is damaged or impossible.
        MapError: the map cannot be read.
    """
    if source in floor_plan_names():
        return corridor_graph(load_corridors(source), width, chair_width=chair_width, rooms=rooms, bays=bays)
    path = Path(source)
    if is_folder(path, TrafficError) or _is_map(path):
        grid = load_map(path)
        places = places_on(grid, load_places(path))
        name = path.resolve().name if is_folder(path, TrafficError) else path.stem
        return mapped_floor_graph(grid, places, name=name, chair_width=chair_width)
    if is_file(path, TrafficError) and read_bytes(path, TrafficError).startswith(FIRST_LINE.encode()):
        return read_traffic(path)
    if path.suffix in (".yaml", ".yml"):
        return corridor_graph(load_corridors(path), width, chair_width=chair_width, rooms=rooms, bays=bays)
    if not is_file(path, TrafficError):
        known = ", ".join(floor_plan_names())
        raise TrafficError(f"there is no floor plan or map '{source}'; give a path or one of {known}")
    return read_traffic(path)


def _is_map(path: Path) -> bool:
    """Return whether a path is the YAML file of a map, which names an image."""
    yaml = path.suffix in (".yaml", ".yml") and is_file(path, TrafficError)
    return yaml and any(line.startswith(b"image:") for line in read_bytes(path, TrafficError).splitlines())
