"""`waychair building generate`, `learn`, `import` and `export`: graphs from maps and drives, and files of other programs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
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
    from waychair.maps.exchange.exchange import read_exchange
    from waychair.maps.exchange.flat_graph import write_imported

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
    from waychair.maps.exchange.exchange import write_exchange

    write_exchange(load_building(folder), target)
    print(f"wrote {target}")


def learn_command(folder: Path, storey: str, trajectory: Path, /) -> None:
    """Learn how long the chair drives along the arcs of a storey. From five drives on, the median replaces the estimate.

    Parameters
    ----------
    folder
        Folder of the building.
    storey
        Id of the storey that was driven on.
    trajectory
        The drive in the storey's map: trajectory.tum of waychair localize.
    """
    from waychair.maps.building.building import load_building
    from waychair.planning.building.learnt_drives import learn_drive
    from waychair.recordings.recording import read_tum

    drive = read_tum(trajectory)
    driven = learn_drive(load_building(folder), storey, drive.stamps_ns, drive.poses)
    print(f"{sum(map(len, driven.values()))} times of {len(driven)} arcs")


def generate_command(
    folder: Path, storey: str, /, *, body: str = "A", lift: tuple[str, ...] = (), quiet: bool = False
) -> None:
    """Make the graph of a storey from its map: rooms, doors, corridors and places that the chair can drive to.

    Made again after the map has changed, it keeps records that people added, moved, named or took away.

    Parameters
    ----------
    folder
        Folder of the building.
    storey
        Id of the storey, which must have a map.
    body
        The chair's body: A, B, A_mid, A_front or robot.
    lift
        A lift and the place in front of its door on this storey, as LIFT=PLACE; can be given more than once. Lifts also
        lay the storey's map on those of the other storeys.
    quiet
        Print nothing but errors.
    """
    from waychair.cli.options.arguments import BadArgument, body_named
    from waychair.cli.options.messages import sayer
    from waychair.cli.options.progress import told_stages
    from waychair.maps.building.building import load_building
    from waychair.planning.building.generation.storey_generation import (
        aligned_storey,
        generated_storey,
        save_generation,
        with_lift_stop,
    )

    chair = body_named(body)
    stops = [each.partition("=") for each in lift]
    for name, equals, place in stops:
        if not name or not equals or not place:
            raise BadArgument(f"--lift is '{name}{equals}{place}': give a lift and a place, as A=lift")
    say = sayer(quiet)
    with told_stages(quiet) as show:
        building = load_building(folder, partial(show, "reading the building"))
        made = generated_storey(building, storey, chair, progress=show)
    hgraph = made.building.hgraph
    for name, _, place in stops:
        hgraph = with_lift_stop(hgraph, storey, name, place)
    joined = replace(made.building, hgraph=hgraph)
    if stops:
        joined = replace(joined, hgraph=aligned_storey(joined, storey))
    save_generation(replace(made, building=joined), storey)
    for opening in made.sketch.shut:
        x, y = opening.middle
        say(f"the opening of {opening.width:.2f} m at ({x:.1f}, {y:.1f}) is too narrow for body {body}")
    for name in made.sketch.lost:
        say(f"place '{name}' cannot be driven to by body {body}")
    corridors = len({door.start for door in made.sketch.doorways})
    say(
        f"storey '{storey}': {len(made.sketch.rooms)} rooms, {corridors} doors, {len(made.places)} new places; "
        f"check it with waychair building check {folder}"
    )
