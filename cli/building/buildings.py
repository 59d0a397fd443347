"""`waychair building`: buildings of several storeys as hierarchical graphs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from waychair.cli.options.arguments import BadArgument, PositiveInt, body_named
from waychair.cli.options.messages import sayer
from waychair.cli.options.progress import prepare_kernels, told_share, told_stages, told_time
from waychair.errors import BuildingError

if TYPE_CHECKING:
    from waychair.maps.building.building import Building
    from waychair.maps.building.graph_arrays import GraphArrays
    from waychair.planning.building.border_tables import BorderTables
    from waychair.planning.building.hierarchical import Route, RoutePlanner

buildings_app = App(name="building", help="Make, check and route through buildings of several storeys.")

buildings_app.command(
    "waychair.cli.building.building_imports:import_command",
    name="import",
    help="Make a building of another program's file.",
)
buildings_app.command(
    "waychair.cli.building.building_imports:export_command", name="export", help="Write a building for another program."
)
buildings_app.command(
    "waychair.cli.building.building_imports:generate_command",
    name="generate",
    help="Make the graph of a mapped storey.",
)


buildings_app.command(
    "waychair.cli.building.building_imports:learn_command",
    name="learn",
    help="Learn driving times from a drive's trajectory.",
)


buildings_app.command(
    "waychair.cli.building.building_journeys:cabin_command",
    name="cabin",
    help="Say where a lift's cabin is on a storey's map.",
)
buildings_app.command(
    "waychair.cli.building.building_journeys:drive_command",
    name="drive",
    help="Let a simulated chair travel over storeys.",
)

buildings_app.command(
    "waychair.cli.building.building_tags:tag_command",
    name="tag",
    help="Write an AprilTag to print, which tells a chair where it is.",
)

buildings_app.command(
    "waychair.cli.building.building_editor:edit_command",
    name="edit",
    help="Open the editor of a building in the browser.",
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

    from waychair.maps.building.checks.hgraph_checks import FindingSeverity, check
    from waychair.maps.building.zone_rules import with_zones
    from waychair.planning.building.surroundings import surroundings

    chair = None if body is None else body_named(body)
    building = _loaded(folder)
    prepare_kernels()
    with told_time("checking"):
        found = check(with_zones(building), surroundings(building, chair))
    errors = sum(each.severity is FindingSeverity.ERROR for each in found)
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
    from waychair.maps.building.zone_rules import with_zones
    from waychair.planning.building.border_tables import BorderTables
    from waychair.planning.building.table_files import TABLES, graph_key, save_tables

    say, now_ns = sayer(quiet), time.time_ns()
    building = _loaded(folder, quiet)
    graph = indexed(with_zones(building), now_ns).graph
    prepare_kernels(quiet)
    begun = time.perf_counter()
    with told_share("making the tables", quiet) as show:
        tables = BorderTables(graph, progress=show)
    took = time.perf_counter() - begun
    save_tables(folder / TABLES, tables.tables, graph_key(building, now_ns))
    per_node = tables.nbytes / max(1, len(graph.xy))
    say(f"{len(graph.xy)} nodes, {len(graph.parent)} sub-maps: {took:.2f} s, {per_node:.0f} bytes a node")


@buildings_app.command(name="route")
def route_command(
    folder: Path,
    /,
    *,
    start: Annotated[str, Parameter(name="--from", allow_leading_hyphen=True)],
    goal: Annotated[str, Parameter(name="--to", allow_leading_hyphen=True)],
    avoid: tuple[str, ...] = (),
    method: str = "tables",
    body: str = "A",
    json: bool = False,
) -> None:
    """Print the cheapest route between two places of a building: its movements and its cost.

    Parameters
    ----------
    folder
        Folder of the building.
    start
        Place, as `Ground/West/Waiting room` or its last part, node, as `ground/west:n3`, or point of a storey's map, as
        `12.5,3@ground`.
    goal
        Place, node or point, as for --from.
    avoid
        Lift, node or arc (`ground/west:n1>n2`) that the route must avoid; can be given more than once.
    method
        tables, tetranauta, tetranauta-without-tables, astar, dijkstra or brute-force.
    body
        The chair's body, which drives from a point to the nearest node: A, B, A_mid, A_front or robot.
    json
        Print JSON.
    """
    from waychair.planning.building.route_ends import route_end

    chair = body_named(body)
    building = _loaded(folder)
    planner = _planner(building, method)
    first, last = (route_end(building, planner, text, chair) for text in (start, goal))
    route = planner.route(first.node, last.node, avoid)
    if json:
        _print_json({**_route_values(route), "to_start_m": first.aside, "from_goal_m": last.aside})
        return
    if first.aside:
        print(f"drive to {first.node}, {first.aside:.1f} m")
    for movement in route.movements:
        print(movement.sentence())
    if last.aside:
        print(f"drive on from {last.node}, {last.aside:.1f} m")
    lifts, aside = sum(bool(leg.lift) for leg in route.legs), first.aside + last.aside
    minutes = (route.cost / 1000.0 + aside) / planner.hgraph.costs.speed_mps / 60.0
    print(f"{route.length + aside:.1f} m of driving, {lifts} lifts, about {minutes:.1f} min")


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
def bench_command(source: Path, /, *, queries: PositiveInt = 1000, json: bool = False) -> None:
    """Time each method on random goals of a building, and compare all with Dijkstra.

    Parameters
    ----------
    source
        Folder of a building, or a file that `import` reads, such as nodes.csv beside edges.csv.
    queries
        Number of queries.
    json
        Print JSON.
    """
    from waychair.files import is_file
    from waychair.maps.building.indexed import indexed
    from waychair.maps.building.zone_rules import with_zones
    from waychair.maps.exchange.exchange import SCALE, read_exchange
    from waychair.maps.exchange.floor_csv import NODES
    from waychair.planning.building.method_bench import bench

    if is_file(source, BuildingError) or is_file(source / NODES, BuildingError):
        hgraph = read_exchange(source, "", None, SCALE).hgraph
    else:
        hgraph = with_zones(_loaded(source))
    with told_stages() as show:
        rows = bench(hgraph, indexed(hgraph), queries, show)
    if json:
        _print_json({"methods": rows})
        return
    for row in rows:
        print(", ".join(f"{key} {value}" for key, value in row.items()))


def _loaded(folder: Path, quiet: bool = False) -> Building:
    from waychair.maps.building.building import load_building

    with told_share("reading the building", quiet) as show:
        return load_building(folder, show)


def _planner(building: Building, method: str) -> RoutePlanner:
    import time

    from waychair.maps.building.indexed import indexed
    from waychair.maps.building.zone_rules import with_zones
    from waychair.planning.building.hierarchical import Method, RoutePlanner

    if method not in list(Method):
        raise BadArgument(f"--method is '{method}': choose {', '.join(Method)}")
    hgraph, now_ns = with_zones(building), time.time_ns()
    prepare_kernels()
    built = indexed(hgraph, now_ns)
    if method != Method.TABLES:
        return RoutePlanner(hgraph, Method(method), built=built)
    return RoutePlanner(hgraph, built=built, tables=_kept_tables(building, built.graph, now_ns))


def _kept_tables(building: Building, graph: GraphArrays, now_ns: int) -> BorderTables | None:
    """Return the tables of the cache file, None if it is stale."""
    from waychair.planning.building.border_tables import BorderTables
    from waychair.planning.building.table_files import TABLES, StaleTables, graph_key, load_tables

    try:
        return BorderTables(graph, load_tables(building.folder / TABLES, graph_key(building, now_ns)))
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
