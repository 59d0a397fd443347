"""`waychair building`: buildings of several storeys as hierarchical graphs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from waychair.cli.options.arguments import BadArgument, PositiveInt
from waychair.cli.options.messages import sayer
from waychair.cli.options.progress import announce_compiling

if TYPE_CHECKING:
    from waychair.maps.building.building import Building
    from waychair.planning.building.border_tables import BorderTables
    from waychair.planning.building.hierarchical import Route, RoutePlanner

buildings_app = App(name="building", help="Make, check and route through buildings of several storeys.")

buildings_app.command(
    "waychair.cli.building_imports:import_command", name="import", help="Make a building of another program's file."
)
buildings_app.command(
    "waychair.cli.building_imports:export_command", name="export", help="Write a building for another program."
)
buildings_app.command(
    "waychair.cli.building_imports:generate_command", name="generate", help="Make the graph of a mapped storey."
)


@buildings_app.command(name="new")
def new_command(folder: Path, /, *, name: str) -> None:
    """Make a building without storeys.

    Parameters
    ----------
    folder
        Folder of the building; it must not hold one yet.
    name
        Name of the building.
    """
    from waychair.maps.building.building import new_building

    new_building(folder, name)
    print(f"made the building '{name}' in {folder}: add its storeys with waychair building add {folder} STOREY")


@buildings_app.command(name="add")
def add_command(folder: Path, storey: str, /, *, map: Path | None = None, height: float = 0.0, name: str = "") -> None:
    """Add a storey to a building.

    Parameters
    ----------
    folder
        Folder of the building.
    storey
        Id of the storey: letters, digits, _, - and .
    map
        Map folder of the storey; it is copied into the building's folder.
    height
        Height above the ground in metres.
    name
        Name of the storey for people.
    """
    from waychair.maps.building.building import add_storey, load_building, save_building, save_with_map
    from waychair.maps.building.hgraph import Storey

    building = add_storey(load_building(folder), Storey(storey, name, height))
    if map is None:
        save_building(building)
    else:
        save_with_map(building, storey, map)
    print(f"added storey '{storey}' to '{building.hgraph.name}'")


@buildings_app.command(name="check")
def check_command(folder: Path, /, *, body: str | None = None, json: bool = False) -> None:
    """Check a building's graph, and list its faults with their places and remedies. Fails if there are errors.

    Parameters
    ----------
    folder
        Folder of the building.
    body
        The chair's body, whose doors and ways are checked: A, B, A_mid, A_front or robot.
    json
        Print JSON.
    """
    from collections import Counter

    from waychair.calibration.chair_body import BODIES
    from waychair.errors import BuildingError
    from waychair.maps.building.hgraph_checks import Severity, check
    from waychair.planning.building.surroundings import surroundings

    if body is not None and body not in BODIES:
        raise BadArgument(f"unknown body '{body}': take {', '.join(BODIES)}")
    building = _loaded(folder)
    found = check(building.hgraph, surroundings(building, None if body is None else BODIES[body]))
    errors = sum(each.severity is Severity.ERROR for each in found)
    if json:
        rows = [
            {
                "code": each.code,
                "severity": str(each.severity),
                "place": each.place,
                "sentence": each.sentence,
                "remedy": each.remedy,
            }
            for each in found
        ]
        _print_json({"findings": rows, "counts": dict(Counter(each.code for each in found)), "errors": errors})
    else:
        for each in found:
            print(f"{each.code} {each.severity}: {each.sentence}: {each.remedy}")
        print(f"{errors} errors, {len(found) - errors} warnings")
    if errors:
        raise BuildingError(f"{folder} has {errors} errors: see above")


@buildings_app.command(name="tables")
def tables_command(folder: Path, /, *, quiet: bool = False) -> None:
    """Make the border tables of a building, from which routes are read in microseconds.

    Parameters
    ----------
    folder
        Folder of the building.
    quiet
        Print nothing but errors.
    """
    import time

    from waychair.maps.building.indexed import indexed
    from waychair.planning.building.border_tables import BorderTables
    from waychair.planning.building.table_files import TABLES, save_tables, text_key

    say = sayer(quiet)
    graph = indexed(_loaded(folder).hgraph).graph
    announce_compiling()
    begun = time.perf_counter()
    tables = BorderTables(graph)
    took = time.perf_counter() - begun
    save_tables(folder / TABLES, tables.tables, text_key(folder))
    per_node = tables.nbytes / max(1, len(graph.xy))
    say(f"{len(graph.xy)} nodes, {len(graph.parent)} sub-maps: {took:.2f} s, {per_node:.0f} bytes a node")


@buildings_app.command(name="route")
def route_command(
    folder: Path,
    /,
    *,
    start: Annotated[str, Parameter(name="--from")],
    goal: Annotated[str, Parameter(name="--to")],
    avoid: tuple[str, ...] = (),
    method: str = "tables",
    json: bool = False,
) -> None:
    """Print the cheapest route between two places of a building: its movements and its cost.

    Parameters
    ----------
    folder
        Folder of the building.
    start
        Place, as `Ground/West/Waiting room` or its last part, or node, as `ground/west:n3`.
    goal
        Place or node, as for --from.
    avoid
        Lift or node that the route must avoid; can be given more than once.
    method
        tables, tetranauta, tetranauta-without-tables, astar, dijkstra or brute-force.
    json
        Print JSON.
    """
    planner = _planner(folder, method)
    route = planner.route(planner.node(start), planner.node(goal), avoid)
    if json:
        _print_json(_route_values(route))
        return
    for movement in route.movements:
        print(movement.sentence())
    lifts = sum(bool(leg.lift) for leg in route.legs)
    speed = planner.hgraph.costs.speed_mps
    minutes = route.cost / 1000.0 / speed / 60.0
    print(f"{route.length:.1f} m of driving, {lifts} lifts, about {minutes:.1f} min")


@buildings_app.command(name="stats")
def stats_command(folder: Path, /, *, json: bool = False) -> None:
    """Print how large a building is.

    Parameters
    ----------
    folder
        Folder of the building.
    json
        Print JSON.
    """
    from waychair.maps.building.building import stats

    values = stats(_loaded(folder).hgraph)
    if json:
        _print_json(values)
        return
    for key, value in values.items():
        print(f"{key.replace('_', ' ')}: {value}")


@buildings_app.command(name="bench")
def bench_command(folder: Path, /, *, queries: PositiveInt = 1000, json: bool = False) -> None:
    """Time each method on random goals of a building, and compare all with Dijkstra.

    Parameters
    ----------
    folder
        Folder of the building.
    queries
        Number of queries.
    json
        Print JSON.
    """
    from waychair.maps.building.indexed import indexed
    from waychair.planning.building.method_bench import bench

    announce_compiling()
    hgraph = _loaded(folder).hgraph
    rows = bench(hgraph, indexed(hgraph), queries)
    if json:
        _print_json({"methods": rows})
        return
    for row in rows:
        print(", ".join(f"{key} {value}" for key, value in row.items()))


def _loaded(folder: Path) -> Building:
    from waychair.maps.building.building import load_building

    return load_building(folder)


def _planner(folder: Path, method: str) -> RoutePlanner:
    from waychair.maps.building.indexed import indexed
    from waychair.planning.building.hierarchical import Method, RoutePlanner

    if method not in list(Method):
        raise BadArgument(f"--method is '{method}': choose {', '.join(Method)}")
    hgraph = _loaded(folder).hgraph
    announce_compiling()
    built = indexed(hgraph)
    if method != Method.TABLES:
        return RoutePlanner(hgraph, Method(method), built=built)
    tables = _kept_tables(folder, built.graph)
    return RoutePlanner(hgraph, built=built, tables=tables)


def _kept_tables(folder: Path, graph: object) -> BorderTables | None:
    """Return the tables of the cache file, None if it is stale."""
    from waychair.planning.building.border_tables import BorderTables
    from waychair.planning.building.table_files import TABLES, StaleTables, load_tables, text_key

    try:
        return BorderTables(graph, load_tables(folder / TABLES, text_key(folder)))  # type: ignore[arg-type]
    except StaleTables:
        return None


def _route_values(route: Route) -> dict[str, object]:
    return {
        "cost_m": route.cost / 1000.0,
        "length_m": route.length,
        "legs": [
            {
                "storey": leg.storey,
                "lift": leg.lift,
                "nodes": [str(ref) for ref in leg.nodes],
                "length_m": leg.length,
                "cost_m": leg.cost / 1000.0,
            }
            for leg in route.legs
        ],
        "movements": [
            {"kind": str(each.kind), "at": str(each.at), "sentence": each.sentence(), "cost_m": each.cost / 1000.0}
            for each in route.movements
        ],
    }


def _print_json(values: object) -> None:
    import json

    print(json.dumps(values, allow_nan=False))
