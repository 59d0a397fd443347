"""`waychair building cabin` and `drive`: lifts' cabins on the storeys' maps, and simulated journeys in a building."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import NonNegativeInt, pose_from_text


def cabin_command(
    folder: Path,
    lift: str,
    storey: str,
    at: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *,
    width: float | None = None,
    depth: float | None = None,
    door: float | None = None,
) -> None:
    """Say where a lift's cabin is on a storey's map, so that a chair can ride in it.

    Parameters
    ----------
    folder
        Folder of the building.
    lift
        Id of the lift.
    storey
        Id of the storey at which it stops.
    at
        X,Y,YAW of the cabin's middle in that storey's map, facing the door.
    width
        Width of the cabin in metres.
    depth
        Depth of the cabin from its door to its back in metres.
    door
        Clear width of the door in metres.
    """
    from dataclasses import replace

    from waychair.errors import BuildingError
    from waychair.maps.building.building import load_building, save_building
    from waychair.maps.building.hgraph_edits import with_lift

    cabin = pose_from_text(at, "the cabin")
    building = load_building(folder)
    known = building.hgraph.lifts.get(lift)
    if known is None:
        names = ", ".join(building.hgraph.lifts) or "none yet"
        raise BuildingError(f"there is no lift '{lift}' in {folder}: it has {names}")
    if all(stop.storey != storey for stop in known.stops):
        raise BuildingError(f"lift '{lift}' does not stop on '{storey}': add the stop with waychair building generate")
    stops = tuple(replace(stop, cabin=cabin) if stop.storey == storey else stop for stop in known.stops)
    changed = replace(
        known,
        stops=stops,
        cabin_width=known.cabin_width if width is None else width,
        cabin_depth=known.cabin_depth if depth is None else depth,
        door_width=known.door_width if door is None else door,
    )
    save_building(replace(building, hgraph=with_lift(building.hgraph, changed)))
    print(f"lift '{lift}' on '{storey}' has its cabin at {cabin.x:g}, {cabin.y:g}")


def drive_command(
    folder: Path,
    /,
    *,
    start: Annotated[str, Parameter(name="--from")],
    goal: Annotated[str, Parameter(name=["--to", "--goal"])],
    seed: NonNegativeInt = 0,
    passengers: NonNegativeInt = 0,
    learn: bool = False,
    quiet: bool = False,
) -> None:
    """Let a simulated chair travel between two places of a building, also on different storeys. Fails if it does not arrive.

    Parameters
    ----------
    folder
        Folder of the building.
    start
        Place, as `Ground/West/Waiting room` or its last part.
    goal
        Place, as for --from.
    seed
        Seed of the simulated chair and of the passengers.
    passengers
        People who travel by the lifts all the time.
    learn
        Keep the driving times in the building, where they replace the estimates once an arc has five.
    quiet
        Print nothing but errors.
    """
    import time
    from concurrent.futures import ThreadPoolExecutor

    from waychair.cli.options.messages import sayer
    from waychair.cli.options.progress import prepare_kernels, told_share, told_time
    from waychair.maps.building.building import load_building
    from waychair.maps.building.indexed import indexed
    from waychair.maps.building.zone_rules import with_zones
    from waychair.planning.building.hierarchical import Method, RoutePlanner
    from waychair.runtime.drive_times import DriveTimes
    from waychair.runtime.journeys import TravelState
    from waychair.simulation.simulator import Simulator
    from waychair.trials.travel.building_drive import drive_in_building

    say, told = sayer(quiet), [""]

    def tell(state: TravelState, simulator: Simulator) -> None:
        times.step(state.chair, state.storey)
        tell_time(f"{simulator.now_ns * 1e-9:.0f} s of the journey, on storey {state.storey}")
        if state.order.sentence != told[0]:
            told[0] = state.order.sentence
            say(f"{simulator.now_ns * 1e-9:6.1f} s, storey {state.storey}: {told[0]}")

    with told_share("reading the building", quiet) as show:
        building = load_building(folder, show)
    prepare_kernels(quiet)
    hgraph = with_zones(building)
    planner = RoutePlanner(hgraph, Method.ASTAR, built=indexed(hgraph, time.time_ns()))
    with ThreadPoolExecutor(1, "times") as worker, told_time("travelling", quiet) as tell_time:
        times = DriveTimes(folder, lambda: learn, worker)
        record = drive_in_building(building, planner, planner.node(start), planner.node(goal), seed, passengers, tell)
    if not record.arrived:
        print(f"waychair: {goal} was not reached: {record.why}", file=sys.stderr)
        sys.exit(1)
    say(f"arrived after {record.seconds:.0f} s with {record.rides} rides and {record.contacts} contacts")
