"""`waychair fleet`: several chairs in one building."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter, validators

from waychair.cli.options.arguments import BadArgument, NonNegativeInt, PositiveInt, body_named

if TYPE_CHECKING:
    from waychair.maps.traffic.traffic_graph import TrafficGraph
    from waychair.trials.fleet.fleet_graph import FleetHours
    from waychair.types import Json

fleet_app = App(name="fleet", help="Simulate several chairs in one building, and check its corridors.")
fleet_app.command(
    "waychair.cli.fleet_commands.fleet_solving:solve_command",
    name="solve",
    help="Find short paths for many agents on a grid.",
)
fleet_app.command(
    "waychair.cli.fleet_commands.fleet_auditing:audit_command",
    name="audit",
    help="Check a log of grants, and say who waited for whom.",
)

fleet_app.command(
    "waychair.cli.fleet_commands.fleet_demo:demo_command",
    name="demo",
    help="Let several whole chairs share a building.",
)

fleet_app.command(
    "waychair.cli.fleet_commands.fleet_network:router_command",
    name="router",
    help="Join the chairs of networks that keep computers apart.",
)
fleet_app.command("waychair.cli.fleet_commands.fleet_network:keys_app", name="keys")
for _name, _help in (
    ("voter", "Vote among chairs from a computer without one."),
    ("status", "Say which chairs are there, and which one orders."),
    ("watch", "Say so every second."),
):
    fleet_app.command(f"waychair.cli.fleet_commands.fleet_network:{_name}_command", name=_name, help=_help)

_MOST_HOURS = 1000
"""Longer runs take minutes; more seeds say more than longer runs."""

PositiveFloat = Annotated[float, Parameter(validator=validators.Number(gt=0))]


@fleet_app.command(name="simulate")
def simulate_command(
    plan: str,
    /,
    *,
    chairs: PositiveInt = 3,
    persons: NonNegativeInt = 7,
    rule: Literal["humans", "flexible", "chairs"] = "humans",
    planner: Literal["order", "fwpp", "fwpp-printed", "fwpp-exact", "shortest"] = "fwpp",
    hours: PositiveFloat = 1.0,
    seeds: PositiveInt = 4,
    width: PositiveFloat = 1.2,
    rooms: bool = False,
    bays: NonNegativeInt = 0,
    log: Annotated[Path | None, Parameter(name=["--log"])] = None,
    json: bool = False,
) -> None:
    """Let chairs drive random tasks among people on the corridors of a building, and print their delays.

    A task's delay is its time less that of the shortest way with nobody about. Every chair drives 0.33 m/s, every person
    walks 0.6 m/s.

    Parameters
    ----------
    plan
        A shipped floor plan (2bconR, 2d-grid, 3tie, 4cross, 9cube, I, Rectangle, T or fig8), a plan's .yaml file, a map
        folder, a building's folder, or a traffic graph's text file.
    chairs
        Number of chairs.
    persons
        Number of people who walk about.
    rule
        humans: chairs stand for people; flexible: chair 0 has top priority and people stand for it; chairs: people stand.
    planner
        order: the coordinator; where there are rooms or places nobody passes anybody at a node, and people make chairs stop;
        fwpp: the paper's Plan-FWPP as it is meant; fwpp-printed: as it is printed; fwpp-exact: with exact conflicts;
        shortest: without regard to other chairs.
    hours
        Simulated hours of each run.
    seeds
        Number of runs, with seeds 0, 1, 2, ...
    width
        Width of a floor plan's corridors in metres; from 1.55 on two chairs pass each other.
    rooms
        Chairs drive between rooms beside the corridors of a floor plan, instead of between all nodes.
    bays
        With --planner order: try one bay in each of so many corridors with the most waiting, and say which saves most.
    log
        With --planner order: write every decision and movement of the first seed into this file, for waychair fleet audit.
    json
        Print JSON.
    """
    from waychair.cli.options.progress import part_of, prepare_kernels, told_share
    from waychair.planning.fleet.paper.plan_fwpp import Conflicts
    from waychair.simulation.graph_traffic.crowd import RightOfWay
    from waychair.trials.fleet.fleet_coordinated import coordinated_hours
    from waychair.trials.fleet.fleet_graph import fleet_hours
    from waychair.trials.fleet.fleet_sources import graph_from_source

    if hours > _MOST_HOURS:
        raise BadArgument(f"--hours {hours:g} is more than {_MOST_HOURS}; give a smaller number, and more --seeds")
    graph = graph_from_source(plan, width=width, rooms=rooms)
    if planner == "order" and graph.refuges:
        from waychair.cli.fleet_commands.fleet_auditing import simulate_by_order

        simulate_by_order(graph, chairs, persons, rule, hours, seeds, bays, log, json)
        return
    if bays or log is not None:
        raise BadArgument("--bays and --log need --planner order and places to wait in; give --rooms for a floor plan")
    if graph.lifts:
        raise BadArgument(f"the paper's planners know no lifts, and {graph.name} has some; give --planner order")
    readings = {
        "fwpp": Conflicts.READ,
        "fwpp-printed": Conflicts.PRINTED,
        "fwpp-exact": Conflicts.EXACT,
        "shortest": Conflicts.NONE,
    }
    prepare_kernels()
    runs: list[FleetHours] = []
    run_hours = coordinated_hours if planner == "order" else partial(fleet_hours, conflicts=readings[planner])
    with told_share("simulating") as show:
        for seed in range(seeds):
            run = run_hours(
                graph,
                chairs=chairs,
                people=persons,
                rule=RightOfWay(rule),
                hours=hours,
                seed=seed,
                progress=part_of(show, seed, seeds),
            )
            runs.append(run)
            if not json:
                print(f"seed {seed}: {_tasks(run)}", flush=True)
    _print_result(graph, runs, json)


def _tasks(run: FleetHours) -> str:
    count = sum(len(chair) for chair in run.delays)
    delay = f", mean delay {run.mean_delay:.1f} s" if count else ""
    return f"{count} tasks{delay}" + (", locked up" if run.locked_up else "")


def _print_result(graph: TrafficGraph, runs: list[FleetHours], json: bool) -> None:
    from waychair.errors import TaskError
    from waychair.trials.fleet.fleet_graph import hours_as_json, mean

    name = graph.name
    delays = [delay for run in runs for chair in run.delays for delay in chair]
    locked = sum(run.locked_up for run in runs)
    people = mean([run.people_waited for run in runs])
    queued = sum(run.queued.sum(axis=1) for run in runs) / sum(run.hours for run in runs)
    worst = int(queued.argmax())
    if json:
        import json as text

        values: Json = {
            "plan": name,
            "tasks": len(delays),
            "mean_delay_s": mean(delays) if delays else None,
            "people_waited_s_per_hour": people,
            "waited_s_per_hour_by_section": {
                section.name: float(seconds) for section, seconds in zip(graph.sections, queued, strict=True)
            },
            "lockups": locked,
            "lockup_share_below_95": 3.0 / len(runs) if locked == 0 else None,
            "runs": [hours_as_json(run) for run in runs],
        }
        print(text.dumps(values, allow_nan=False))
        return
    if not delays:
        raise TaskError(f"{name}: no chair has reached a goal; give more --hours, or fewer --persons")
    bound = f"; with 95 % confidence in less than {min(1.0, 3.0 / len(runs)):.0%} of runs" if locked == 0 else ""
    print(
        f"{name}: {len(delays)} tasks, mean delay {mean(delays):.1f} s; a person stands {people:.0f} s an hour for chairs; "
        f"{locked} lock-ups{bound}"
    )
    if queued[worst] > 0:
        print(f"Chairs wait most at section {graph.sections[worst].name}: {queued[worst]:.0f} s an hour")


@fleet_app.command(name="check")
def check_command(
    map: str,
    /,
    *,
    width: PositiveFloat = 1.2,
    body: str = "A",
    rooms: bool = True,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    json: bool = False,
) -> None:
    """Say where chairs can pass, meet and wait in a building, and which places shut off others. Fails if one does.

    Parameters
    ----------
    map
        Map folder or its .yaml file, a building's folder or a file that a building can be imported from, traffic graph's text
        file, shipped floor plan, or a plan's .yaml file.
    width
        Width of a floor plan's corridors in metres.
    body
        The chair's body: A, B, A_mid, A_front or robot.
    rooms
        Rooms beside the corridors of a floor plan.
    out
        Write the traffic graph into this text file.
    json
        Print JSON.
    """
    from waychair.errors import TrafficError
    from waychair.maps.traffic.single_file import districts, runs
    from waychair.maps.traffic.traffic_files import write_traffic
    from waychair.maps.traffic.well_formed import well_formed
    from waychair.trials.fleet.fleet_sources import traffic_from_source

    chair = body_named(body)
    traffic = traffic_from_source(map, width=width, chair_width=chair.width, rooms=rooms)
    graph = traffic.graph
    found = well_formed(graph)
    single = runs(graph)
    metres = sum(section.length for section in graph.sections)
    longest = max((sum(graph.section[name].length for name in run.sections) for run in single), default=0.0)
    if out is not None:
        write_traffic(out, graph)
    if json:
        import json as text

        values: Json = {
            "name": graph.name,
            "fingerprint": graph.fingerprint,
            "nodes": len(graph.nodes),
            "sections": len(graph.sections),
            "metres": metres,
            "refuges": len(graph.refuges),
            "runs": len(single),
            "longest_run_m": longest,
            "lifts": len(graph.lifts),
            "districts": len(districts(graph)),
            "notes": list(traffic.notes),
            "shut_off": [{"refuge": each.refuge, "others": list(each.others)} for each in found],
        }
        print(text.dumps(values, allow_nan=False))
    else:
        print(
            f"{graph.name}: {len(graph.nodes)} nodes, {len(graph.sections)} sections of {metres:.0f} m in all, "
            f"{len(graph.refuges)} refuges, {len(single)} runs in which two chairs cannot pass (the longest {longest:.0f} m)"
        )
        for note in traffic.notes:
            print(note)
        for each in found:
            print(each.sentence)
    if found:
        cut_off = [each for each in found if not each.refuge]
        shuts = len(found) - len(cut_off)
        why = ["some places are cut off from the others"] * bool(cut_off)
        why += [f"{shuts} place{'s' * (shuts > 1)} would shut off others"] * bool(shuts)
        raise TrafficError(f"{graph.name} is not well formed: {' and '.join(why)}")
