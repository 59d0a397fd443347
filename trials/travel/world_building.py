"""The building's folder of a world of several levels: their plans as maps, a graph made of each, and the lifts that join them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from waychair.calibration.chair_body import ChairBody
from waychair.errors import WorldError
from waychair.maps.building.building import Building, add_storey, new_building, save_building, save_with_map
from waychair.maps.building.hgraph import Beacon, HGraph, Storey
from waychair.maps.building.hgraph_edits import with_lift, with_submap
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.planning.building.generation.storey_generation import generated_storey, save_generation, with_lift_stop
from waychair.simulation.lifts.lifts import CallableLift, Lifts
from waychair.simulation.plan.world import World


def building_of_world(
    levels: Sequence[World],
    folder: Path,
    body: ChairBody,
    progress: Callable[[str], None] = lambda level: None,
) -> Building:
    """Write the building of these levels, from bottom to top, into an empty folder and return it.

    `progress` is called with each level before its graph is made.

    Raises:
        BuildingError: there is a building in the folder already, or a level's name cannot name a storey.
        WorldError: a lift has no place in front of its door, named as the lift or `lift NAME`, on one of its levels.
        OutputError: the folder cannot be written to.
    """
    lifts = Lifts(levels)
    building = new_building(folder, levels[0].name.partition("/")[0] or "building")
    for world in levels:
        progress(world.level)
        building = add_storey(building, Storey(world.level, storey_title(world.level), lifts.heights[world.level]))
        plan = folder / "plans" / world.level
        plan.mkdir(parents=True)
        save_map(plan, world.grid)
        save_places(plan, {place.name: place for place in world.places})
        building = save_with_map(building, world.level, plan)
        made = generated_storey(building, world.level, body)
        save_generation(made, world.level)
        building = made.building
    hgraph = building.hgraph
    for lift in lifts.lifts.values():
        hgraph = _with_lift(hgraph, lift, lifts)
    for world in levels:
        hgraph = _with_tags(hgraph, world)
    building = replace(building, hgraph=hgraph)
    save_building(building)
    return building


def _with_lift(hgraph: HGraph, lift: CallableLift, lifts: Lifts) -> HGraph:
    """Return the graph with a lift, its stops at the places in front of its doors."""
    for stop in lift.stops:
        hgraph = with_lift_stop(hgraph, stop, lift.name, lift_place(lifts.levels[stop], lift.name))
    known, cabin = hgraph.lifts[lift.name], lift.cabins[lift.stops[0]]
    stops = tuple(replace(each, cabin=lift.cabins[each.storey].middle) for each in known.stops)
    widths = [door.width for door in lift.doors.values()]
    sized = replace(
        known, stops=stops, cabin_width=cabin.width, cabin_depth=cabin.length, door_width=round(min(widths), 3)
    )
    return with_lift(hgraph, sized)


def _with_tags(hgraph: HGraph, world: World) -> HGraph:
    """Return the graph with the AprilTags on a level's walls as beacons of its storey's uppermost sub-map."""
    if not world.tags:
        return hgraph
    path = next(each for each in hgraph.submaps if hgraph.storey_of(each) == world.level)
    tags = tuple(Beacon(str(tag.number), tag.middle) for tag in world.tags)
    return with_submap(hgraph, replace(hgraph.submaps[path], beacons=tags))


def lift_place(world: World, lift: str) -> str:
    """Return the name of the place in front of a lift's door, which is named as the lift or `lift NAME`.

    Raises:
        WorldError: there is none.
    """
    names = {place.name for place in world.places}
    found = next((name for name in (f"lift {lift}", lift) if name in names), None)
    if found is None:
        raise WorldError(f"level '{world.level}' has no place in front of lift '{lift}': name one 'lift {lift}'")
    return found


def storey_title(level: str) -> str:
    """Return a storey's name for people."""
    return f"Floor {level}" if level.isdigit() else level.capitalize()
