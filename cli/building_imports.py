"""`waychair building import` and `export`: files of Open-RMF, of Nav2's route server, and CSV files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

Scale = Annotated[float, Parameter(validator=validators.Number(gt=0.0, lte=100.0))]


def import_command(
    source: Path, folder: Path, /, *, name: str = "", graph: int | None = None, scale: Scale = 0.1
) -> None:
    """Make a building of another program's file. All of the file is kept, and written back by export.

    Parameters
    ----------
    source
        A .building.yaml of Open-RMF, a .geojson of Nav2's route server, or a folder with nodes.csv and edges.csv.
    folder
        Folder of the new building.
    name
        Name of the building; else that in the file.
    graph
        Number of the robots' graph in an Open-RMF file, its graph_idx; else the lowest.
    scale
        Metres a pixel of CSV files, which do not state it.
    """
    from waychair.maps.building.building import stats
    from waychair.maps.building.exchange import read_exchange
    from waychair.maps.building.flat_graph import write_imported

    imported = read_exchange(source, name, graph, scale)
    building = write_imported(folder, imported)
    shown = 10
    for note in imported.notes[:shown]:
        print(note)
    if len(imported.notes) > shown:
        print(f"and {len(imported.notes) - shown} more of this kind")
    counts = stats(building.hgraph)
    print(
        f"made the building '{building.hgraph.name}' in {folder}: {counts['storeys']} storeys, {counts['nodes']} nodes, "
        f"{counts['arcs']} arcs, {counts['lifts']} lifts; check it with waychair building check {folder}"
    )


def export_command(folder: Path, target: Path, /) -> None:
    """Write a building for another program. A building that came from such a file changes only what was edited.

    Parameters
    ----------
    folder
        Folder of the building.
    target
        A .building.yaml for Open-RMF, a .geojson for Nav2's route server, or a folder for nodes.csv and edges.csv.
    """
    from waychair.maps.building.building import load_building
    from waychair.maps.building.exchange import write_exchange

    write_exchange(load_building(folder), target)
    print(f"wrote {target}")
