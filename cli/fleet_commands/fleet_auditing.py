"""`waychair fleet audit`, and `waychair fleet simulate --planner order`: chairs by the coordinator's order, and its log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonEmptyPath

if TYPE_CHECKING:
    from waychair.maps.traffic.traffic_graph import TrafficGraph
    from waychair.planning.fleet.audit import Audited
    from waychair.trials.fleet.fleet_report import BestBay, OrderedHours
    from waychair.types import Json

_SHOWN = 10
"""Faults and waits that are printed."""


def simulate_by_order(
    graph: TrafficGraph,
    chairs: int,
    persons: int,
    rule: str,
    hours: float,
    seeds: int,
    bays: int,
    log: Path | None,
    json: bool,
) -> None:
    """Simulate chairs that drive by the coordinator's order, and print their figures; see `fleet simulate`."""
    from waychair.cli.options.progress import part_of, prepare_kernels, told_share
    from waychair.files import write_text
    from waychair.simulation.graph_traffic.crowd import MOST_PEOPLE
    from waychair.trials.fleet.fleet_graph import mean
    from waychair.trials.fleet.fleet_ordered import Stops
    from waychair.trials.fleet.fleet_report import bay_that_helps, ordered_hours, stops_by_people

    if persons > MOST_PEOPLE:
        raise BadArgument(f"{persons} people are impossible; give 0 to {MOST_PEOPLE}")
    stops = Stops() if rule == "chairs" else stops_by_people(graph, persons)
    top = 1 if rule == "flexible" else None
    prepare_kernels()
    records: list[Json] = []
    found: list[OrderedHours] = []
    with told_share("simulating") as show:
        for seed in range(seeds):
            run = ordered_hours(
                graph,
                chairs=chairs,
                hours=hours,
                seed=seed,
                stops=stops,
                top=top,
                log=records.append if log is not None and seed == 0 else None,
                progress=part_of(show, seed, seeds),
            )
            found.append(run)
            if not json:
                delay = f", mean delay {mean(run.delays):.1f} s" * bool(run.delays)
                print(f"seed {seed}: {len(run.delays)} tasks{delay}" + ", locked up" * run.locked_up, flush=True)
    if log is not None:
        import json as text

        write_text(log, "".join(text.dumps(record) + "\n" for record in records))
    bay = None
    if bays:
        with told_share("trying the bays") as show:
            bay = bay_that_helps(
                graph, chairs=chairs, hours=hours, seed=0, stops=stops, tries=bays, top=top, progress=show
            )
    _print_ordered(graph, found, bay, bays, json)


def _print_ordered(graph: TrafficGraph, found: list[OrderedHours], bay: BestBay | None, bays: int, json: bool) -> None:
    from waychair.errors import TaskError
    from waychair.trials.fleet.fleet_graph import mean
    from waychair.trials.fleet.fleet_report import corridor_sentence, waits_by_corridor

    delays = [delay for run in found for delay in run.delays]
    total_h = sum(run.hours for run in found)
    waited: dict[str, float] = {}
    for run in found:
        for place, seconds in run.waited_s.items():
            waited[place] = waited.get(place, 0.0) + seconds / total_h
    corridors = waits_by_corridor(graph, waited)
    lifts = {lift.name: corridors.get(lift.name, 0.0) for lift in graph.lifts}
    locked = sum(run.locked_up for run in found)
    if json:
        import json as text

        values: Json = {
            "plan": graph.name,
            "tasks": len(delays),
            "mean_delay_s": mean(delays) if delays else None,
            "waited_s_per_hour_by_corridor": corridors,
            "waited_s_per_hour_by_lift": lifts,
            "bay": None if bay is None else bay.as_json(),
            "jain": [run.jain for run in found],
            "foreseen_right": [run.foreseen_right for run in found],
            "most_overtaken": max(run.most_overtaken for run in found),
            "lockups": locked,
            "lockup_share_below_95": 3.0 / len(found) if locked == 0 else None,
        }
        print(text.dumps(values, allow_nan=False))
        return
    if not delays:
        raise TaskError(f"{graph.name}: no chair has reached a goal; give more --hours, or fewer --persons")
    bound = f"; with 95 % confidence in less than {min(1.0, 3.0 / len(found)):.0%} of runs" if locked == 0 else ""
    print(f"{graph.name}: {len(delays)} tasks, mean delay {mean(delays):.1f} s; {locked} lock-ups{bound}")
    costly = corridor_sentence(graph, corridors, 1.0)
    if costly is not None:
        print(costly)
    for name, seconds in sorted(lifts.items(), key=lambda item: -item[1]):
        print(f"Chairs wait {seconds:.0f} s an hour for lift {name}")
    if bay is not None:
        print(f"{bay.sentence} (seed 0)")
    elif bays:
        print("No bay in the corridors with the most waiting saves anything (seed 0)")


def audit_command(
    log: NonEmptyPath = Path("out/fleet/order.jsonl"),
    /,
    *,
    chair: Annotated[int | None, Parameter(help="Only the waits of this chair.")] = None,
    json: bool = False,
) -> None:
    """Check the log of several chairs' grants and movements, and tell each wait: for which chair, why and how long.

    Fails if a rule was broken: one chair in a section, entering only in turn, one slot for each, no ring of waits, nobody
    overtaken thrice, nobody standing ten minutes with a free way.

    Parameters
    ----------
    log
        File of one JSON record a line, as waychair fleet simulate --log writes it.
    chair
        Print the waits of this chair only.
    json
        Print JSON.
    """
    from waychair.errors import TaskError
    from waychair.files import read_text
    from waychair.planning.fleet.audit import audited

    lines = read_text(log, TaskError).splitlines()
    found = audited(_records(log, lines))
    if not found.records:
        raise TaskError(f"{log} has no record: make it with waychair fleet simulate PLAN --planner order --log {log}")
    waits = found.waits_of(chair)
    if json:
        import json as text

        values: Json = {
            "records": found.records,
            "hours": found.hours,
            "arrivals": {str(who): count for who, count in sorted(found.arrivals.items())},
            "waits": waits,
            "waited_s_by_place": found.seconds_by_place(),
            "foreseen_right": found.foreseen_right(),
            "faults": found.faults,
        }
        print(text.dumps(values, allow_nan=False))
    else:
        _print_audit(found, waits, chair)
    if found.faults:
        raise TaskError(f"{log} breaks {len(found.faults)} rule(s), the first in {found.faults[0]}")


def _records(log: Path, lines: list[str]) -> list[Json]:
    import json as text

    from waychair.errors import TaskError

    records: list[Json] = []
    for number, line in enumerate(lines, start=1):
        try:
            records.append(text.loads(line))
        except ValueError:
            raise TaskError(f"line {number} of {log} is no JSON record: make the log again") from None
    return records


def _print_audit(found: Audited, waits: list[Json], chair: int | None) -> None:
    right = found.foreseen_right()
    told = "" if right is None else f", {right:.0%} of them foreseen within 5 s or a quarter"
    print(
        f"{found.records} records of {found.hours:.1f} h: {sum(found.arrivals.values())} arrivals, {len(found.waits)} waits"
        f"{told}; {len(found.faults)} rules broken"
    )
    for fault in found.faults[:_SHOWN]:
        print(fault)
    longest = sorted(waits, key=lambda each: -each["real_s"])[:_SHOWN] if chair is None else waits
    for each in longest:
        whom = "" if each["first"] is None else f" for chair {each['first']}"
        foreseen = "" if each["foreseen_s"] is None else f", {each['foreseen_s']:.0f} s foreseen"
        print(
            f"at {each['begun_ms'] / 1e3:.0f} s chair {each['waits']} waited {each['real_s']:.0f} s{whom} before "
            f"{each['place']} ({each['rule']}{foreseen})"
        )
    if chair is not None and not waits:
        print(f"chair {chair} never waited")
