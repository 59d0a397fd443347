"""The editor's longer work on a draft: graphs from maps, lifts in line, files of other programs, tables, a drive of an arc."""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from waychair.errors import BuildingError, OutputError, WaychairError
from waychair.files import os_error_text, path_exists
from waychair.maps.building.building import MAPS, Building
from waychair.maps.building.hgraph import Arc, HGraph, NodeRef, inner_end
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import Zone, load_zones
from waychair.maps.editing.addresses import arc_at, ref_of_arc
from waychair.maps.editing.building_edits import AddStorey, add_storey_to
from waychair.maps.editing.cabins import Cabin, cabin_ahead
from waychair.maps.editing.draft import Draft, zoned
from waychair.maps.editing.lift_edits import SetLift, SetStop
from waychair.maps.editing.map_edits import patch_between
from waychair.maps.editing.operations import applied
from waychair.maps.exchange.exchange import SCALE, read_exchange, write_exchange
from waychair.maps.exchange.flat_graph import goal_places
from waychair.maps.folders.map_files import MAP_YAML, load_info, load_map, save_map, yaml_path
from waychair.planning.building.generation.storey_generation import GENERATED, aligned_storey, generated_storey
from waychair.types import OccupancyGrid, Place, Pose2
from waychair.ui.editor.session import Session

_DEEP = 3
"""Folders below the building's parent in which maps are looked for."""

MOST_MAPS = 50

ARRIVED_M = 0.15
"""An arc's end is reached so near to it [m]; the heading does not matter."""

BEFORE_M = 1.2
"""The drive through a door begins so far before it [m], straight on from the room's next node."""

FORMATS = {"geojson": "building.geojson", "rmf": "building.building.yaml", "csv": "building.csv.zip"}
"""Names of exported files by the format that a page asks for."""


def map_folders(folder: Path) -> list[str]:
    """Return the map folders near a building that none of its storeys has, relative to the building's parent."""
    parent, found = folder.resolve().parent, []
    for yaml in _yaml_files(parent, _DEEP):
        if not yaml.is_relative_to(folder.resolve()):
            found.append(yaml.parent.relative_to(parent).as_posix())
    return sorted(found)[:MOST_MAPS]


def _yaml_files(folder: Path, deep: int) -> Iterator[Path]:
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return
    for each in entries:
        if each.name == MAP_YAML:
            yield each
        elif deep and not each.name.startswith(".") and each.is_dir() and not each.is_symlink():
            yield from _yaml_files(each, deep - 1)


def add_storey(session: Session, revision: int, asked: AddStorey) -> str:
    """Add a storey whose `map` is a map folder, relative to the building's parent; it is copied. Return a sentence.

    Raises:
        MapError, PlaceError, ZoneError: it is no map folder, or a damaged one.
        BuildingError, OutputError: as `Session.do`, or the map cannot be copied.
    """
    before = session.draft
    after = add_storey_to(before, AddStorey(asked.id, asked.name, asked.height))
    if not asked.map:
        session.do_operation(revision, AddStorey(asked.id, asked.name, asked.height))
        return f"Added the storey '{asked.id}' without a map."
    source = session.folder.resolve().parent / asked.map
    load_info(yaml_path(source))  # it must be a map
    name, number = f"{MAPS}/{asked.id}", 1
    while path_exists(session.folder / name, BuildingError):  # of a storey that was undone, or somebody's own
        number += 1
        name = f"{MAPS}/{asked.id}-{number}"
    target = session.folder / name
    try:
        shutil.copytree(yaml_path(source).parent, target)
        session.add_map(asked.id, target)
        storeys = [replace(each, map=name) if each.id == asked.id else each for each in after.hgraph.storeys]
        after = Draft(
            replace(after.hgraph, storeys=tuple(storeys)),
            {**after.places, asked.id: load_places(target)},
            {**after.zones, asked.id: load_zones(target)},
            after.texts,
        )
        session.do_operation(revision, patch_between(f"add the storey '{asked.id}'", before, after))
    except (OSError, shutil.Error) as error:
        shutil.rmtree(target, ignore_errors=True)
        said = os_error_text(error) if isinstance(error, OSError) else "make room on the disk"
        raise OutputError(f"cannot copy the map {asked.map}: {said}") from error
    except WaychairError:
        shutil.rmtree(target, ignore_errors=True)
        raise
    return f"Added the storey '{asked.id}' with its map."


def join_by_lift(session: Session, revision: int, lift: SetLift, stops: Sequence[str]) -> str:
    """Make a lift with stops at nodes of several storeys, lay the storeys on each other by it, and look for its cabins.

    Return what was found, in words.

    Raises:
        BuildingError: as the operations.
    """
    before = session.draft
    after, said = applied(before, lift), []
    for text in stops:
        after = applied(after, SetStop(lift.id, text))
    for stop in after.hgraph.lifts[lift.id].stops[1:]:
        hgraph = aligned_storey(Building(session.folder, after.hgraph), stop.storey, after.places)
        if hgraph is not after.hgraph:
            said.append(f"The map of '{stop.storey}' was laid on the others.")
        after = replace(after, hgraph=hgraph)
    for stop in after.hgraph.lifts[lift.id].stops:
        try:
            after = with_cabin(after, lift.id, stop.at, map_of(session, stop.storey))
        except BuildingError as error:
            said.append(f"On '{stop.storey}' {error}.")
    session.do_operation(revision, patch_between(f"join {len(stops)} storeys by lift '{lift.id}'", before, after))
    return " ".join([f"The lift '{lift.id}' stops on {len(stops)} storeys.", *said])


def generated(session: Session, storey: str) -> tuple[Draft, str]:
    """Return the draft with a storey's graph made of its map, and what was found in words.

    Raises as `planning.building.generation.storey_generation.generated_storey`.
    """
    draft, name = session.draft, f"{GENERATED}/{storey}.json"
    last = json.loads(draft.texts[name]) if name in draft.texts else None
    made = generated_storey(
        Building(session.folder, draft.hgraph),
        storey,
        session.body,
        draft.places_of(storey),
        draft.zones_of(storey),
        last,
    )
    record = json.dumps(made.record, indent=2, allow_nan=False) + "\n"
    places = {**draft.places, storey: {**draft.places_of(storey), **made.places}}
    texts = {**draft.texts, name: record}
    said = [f"{len(made.sketch.rooms)} rooms, {len(made.sketch.doorways)} doors, {len(made.places)} new places."]
    said += [
        f"The opening of {each.width:.2f} m at ({each.middle[0]:.1f}, {each.middle[1]:.1f}) is too narrow for the chair."
        for each in made.sketch.shut
    ]
    said += [f"The chair cannot drive to the place '{each}'." for each in made.sketch.lost]
    return replace(draft, hgraph=made.building.hgraph, places=places, texts=texts), " ".join(said)


def aligned(session: Session, storey: str) -> HGraph:
    """Return the draft's graph with a storey laid on the others by the lifts that they share.

    Raises:
        BuildingError: there is no such storey.
    """
    if storey not in session.draft.hgraph.submaps:
        raise BuildingError(f"there is no storey '{storey}': add it first")
    return aligned_storey(session.building, storey, session.draft.places)


def cabin_of(draft: Draft, ref: NodeRef, grid: OccupancyGrid) -> Cabin:
    """Return the cabin before a node, as its storey's map shows it: in the direction of its place, or else around it.

    Raises:
        BuildingError: the map shows none.
    """
    node, storey = draft.hgraph.node(ref), draft.hgraph.storey_of(ref.submap)
    place = None if node is None else draft.places_of(storey).get(node.name)
    first = 0.0 if place is None else place.pose.theta
    point = draft.map_point(ref)
    for turn in (0, 1, -1, 2, -2, 3, -3, 4):
        found = cabin_ahead(grid, Pose2(*point, first + turn * math.pi / 4))
        if found is not None:
            return found
    raise BuildingError("the map shows no cabin before this node: measure it, and type its middle, width and depth")


def with_cabin(draft: Draft, lift: str, ref: NodeRef, grid: OccupancyGrid) -> Draft:
    """Return the draft with the cabin that the map shows at a lift's stop; the lift takes its sizes if it has none.

    Raises:
        BuildingError: as `cabin_of`, or there is no such lift or stop.
    """
    known = draft.hgraph.lifts.get(lift)
    stop = None if known is None else next((each for each in known.stops if each.at == ref), None)
    if known is None or stop is None:
        raise BuildingError(f"lift '{lift}' does not stop at {ref}: make it a stop first")
    found = cabin_of(draft, ref, grid)
    pose = (round(found.middle.x, 3), round(found.middle.y, 3), round(found.middle.theta, 4))
    closed = "" if stop.closure is None else stop.closure.reason
    draft = applied(draft, SetStop(lift, str(ref), stop.door_width, pose, closed))
    sizes = known.cabin_width or found.width, known.cabin_depth or found.depth, known.door_width or found.door
    return applied(draft, SetLift(lift, known.name, *sizes, known.wait, known.board, known.per_storey))


def set_cabin(session: Session, revision: int, lift: str, ref: NodeRef) -> str:
    """Give a lift's stop the cabin that the map shows there; return a sentence. Raises as `with_cabin`."""
    before = session.draft
    after = with_cabin(before, lift, ref, map_of(session, before.hgraph.storey_of(ref.submap)))
    session.do_operation(revision, patch_between(f"set the cabin of lift '{lift}' at {ref}", before, after))
    made = after.hgraph.lifts[lift]
    return f"The map shows a cabin; the lift's is {made.cabin_width:.2f} m wide and {made.cabin_depth:.2f} m deep."


def take_import(
    session: Session, revision: int, hgraph: HGraph, grids: Mapping[str, OccupancyGrid], notes: Sequence[str]
) -> str:
    """Make an imported building the draft; its maps are written into the folder. Return a sentence.

    Raises:
        StaleEdit, OutputError: as `Session.do`.
        BuildingError: a storey of the building has a map already.
    """
    for storey in grids:
        if path_exists(session.folder / MAPS / storey, BuildingError):
            raise BuildingError(f"there is a map in {MAPS}/{storey} already: open the editor on an empty folder")
    for storey, grid in grids.items():
        save_map(session.folder / MAPS / storey, grid)
        session.add_map(storey, session.folder / MAPS / storey)
    before = session.draft
    places = {storey: goal_places(hgraph, storey) for storey in grids}
    after = Draft(hgraph, places, dict.fromkeys(grids, ()), {})
    session.do_operation(revision, patch_between(f"import the building '{hgraph.name}'", before, after))
    more = f" and {len(notes) - 3} more notes" if len(notes) > 3 else ""
    return " ".join([f"Imported {len(hgraph.submaps) - 1} sub-maps.", *notes[:3]]) + more


def imported(name: str, data: bytes) -> tuple[HGraph, dict[str, OccupancyGrid], Sequence[str]]:
    """Return the building in a file of another program, its maps by storey, and notes on parts that are not used.

    Raises:
        BuildingError: it is no such file.
    """
    with tempfile.TemporaryDirectory(prefix="waychair-") as folder:
        path = Path(folder) / Path(name).name
        path.write_bytes(data)
        found = read_exchange(path, "", None, SCALE)
    return found.hgraph, dict(found.grids), found.notes


def exported(session: Session, format_: str) -> tuple[str, bytes]:
    """Return the name and the bytes of the draft as a file for another program.

    Raises:
        BuildingError: there is no such format, or the draft cannot be written in it.
    """
    if format_ not in FORMATS:
        raise BuildingError(f"'{format_}' is no format: choose {', '.join(FORMATS)}")
    name = FORMATS[format_]
    with tempfile.TemporaryDirectory(prefix="waychair-") as folder:
        path = Path(folder) / ("building" if format_ == "csv" else name)
        write_exchange(session.building, path)
        if format_ == "csv":
            path = Path(shutil.make_archive(str(Path(folder) / "building.csv"), "zip", path))
        return name, path.read_bytes()


def ends_of_arc(draft: Draft, text: str) -> tuple[str, tuple[float, float], tuple[float, float]]:
    """Return an arc's storey and its two ends in the storey's map [m], in the direction in which it may be driven.

    A doorway, whose two sides are at one place, is driven from a point before it to the next node of its room.

    Raises:
        BuildingError: there is no such arc, a zone or a closure forbids it, or a door leads to a room without nodes.
    """
    ref = ref_of_arc(text)
    hgraph = zoned(draft)
    arc = arc_at(hgraph, ref)
    if arc.way.closure is not None:
        raise BuildingError(f"the arc is closed: {arc.way.closure.reason}")
    storey, start = hgraph.storey_of(ref.submap), draft.map_point(NodeRef(ref.submap, arc.start))
    if isinstance(arc, Arc):
        return storey, start, draft.map_point(NodeRef(ref.submap, arc.end))
    inner = inner_end(hgraph.submaps[ref.submap], arc)
    room = hgraph.submaps[inner.submap]
    behind = [other for each in room.arcs if (other := {each.start: each.end, each.end: each.start}.get(inner.node))]
    if not behind:
        raise BuildingError(f"the door {inner} leads to no other node of its room: join it to one first")
    door, end = draft.map_point(inner), draft.map_point(NodeRef(room.path, behind[0]))
    far = max(math.dist(door, end), 1e-6)
    before = (door[0] + BEFORE_M * (door[0] - end[0]) / far, door[1] + BEFORE_M * (door[1] - end[1]) / far)
    return (storey, end, before) if arc.outwards else (storey, before, end)


def drive_along(
    grid: OccupancyGrid, zones: Sequence[Zone], one: tuple[float, float], other: tuple[float, float]
) -> str:
    """Let a simulated chair drive an arc in the world of its storey's map; return what happened, in a sentence.

    Raises:
        PlanningError, WorldError: the chair cannot stand at the arc's start.
    """
    from waychair.trials.navigate import navigate

    heading = math.atan2(other[1] - one[1], other[0] - one[0])
    goal = Place("the arc's end", Pose2(*other, heading), ARRIVED_M, math.pi)
    (record,) = navigate(grid, Pose2(*one, heading), [goal], zones=zones)
    seconds = float(record.times_s[-1] - record.times_s[0]) if len(record.times_s) else 0.0
    least = f"{float(record.clearance.min()):.2f} m from the nearest thing at least" if len(record.clearance) else ""
    touched = f", with {record.contacts} contacts" if record.contacts else ""
    if record.reached:
        return f"The chair drove it in {seconds:.0f} s, {least}{touched}."
    return f"The chair did not arrive: {record.reason}{touched}."


def map_of(session: Session, storey: str) -> OccupancyGrid:
    """Return the map of a storey; raises BuildingError without one, MapError for a damaged one."""
    folder = session.building.map_folder(storey)
    if folder is None:
        raise BuildingError(f"storey '{storey}' has no map")
    return load_map(folder)
