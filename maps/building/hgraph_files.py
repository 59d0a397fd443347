"""The text files of a building: `hgraph.txt` in general, and one file for each sub-map below `submaps/`.

The general file holds the building's name and costs, the storeys, the tree of sub-maps and the lifts; the file of the
sub-map `ground/west` is `submaps/ground/west.txt`, that of the root `submaps/root.txt`. Reading and writing again gives the
same bytes: lines that still hold are written as they were read, comments included. All files are written aside first,
then renamed, the general file last, so that a full disk leaves the old building whole. A list of the renames lets a save
that was cut off be finished.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from waychair.errors import BuildingError, BuildingNotFound
from waychair.files import is_file, read_text
from waychair.maps.building.costs import CostSettings
from waychair.maps.building.hgraph import ROOT, HGraph, Stop, SubMap, parent_path
from waychair.maps.building.records import END, Record, line_of, record_of_line, records
from waychair.maps.building.rewriting import finish_writing, rewritten, write_all
from waychair.maps.building.text_forms import (
    arc_line,
    arc_of,
    beacon_line,
    beacon_of,
    checked_line,
    costs_line,
    costs_of,
    doorway_line,
    doorway_of,
    lift_line,
    lift_of,
    node_line,
    node_of,
    stop_line,
    stop_of,
    storey_line,
    storey_of,
    submap_line,
    submap_of,
)

GENERAL = "hgraph.txt"
SUBMAPS = "submaps"
ROOT_FILE = "root"

SAVING = ".saving"
"""The list of a save's renames; there only while a building is being saved, or after a save that was cut off."""


@dataclass(frozen=True, slots=True)
class Source:
    """The text of a file, and the model object that it was read into."""

    text: str
    holder: object


def submap_file(folder: Path, path: str) -> Path:
    """Return the file of a sub-map of the building in a folder."""
    return folder / SUBMAPS / f"{path or ROOT_FILE}.txt"


def read_hgraph(folder: Path, progress: Callable[[float], None] | None = None) -> HGraph:
    """Return the graph of the building in a folder; `progress` is told the share that is read.

    A save that was cut off between two files is finished first.

    Raises:
        OutputError: it cannot be finished.
        BuildingNotFound: there is no building.
        BuildingError: a file is missing, cut off or damaged; the message names the file and the line.
    """
    finish_writing(folder / SAVING)
    path = folder / GENERAL
    if not is_file(path, BuildingError):
        raise BuildingNotFound(f"there is no building in {folder}: it has no {GENERAL}; make one with building new")
    text = read_text(path, BuildingError)
    general = general_from_text(path, text)
    submaps = {}
    for index, (key, submap) in enumerate(general.submaps.items()):
        file = submap_file(folder, key)
        if not is_file(file, BuildingError):
            raise BuildingError(
                f"{file} is missing, though {path} names '{key or ROOT_FILE}': restore it, or take it out"
            )
        submaps[key] = submap_from_text(file, read_text(file, BuildingError), submap)
        if progress is not None and index % 1000 == 999:
            progress(index / len(general.submaps))
    read = replace(general, submaps=submaps)
    return replace(read, source=Source(text, read))


def write_hgraph(folder: Path, hgraph: HGraph, others: Mapping[Path, str] = MappingProxyType({})) -> None:
    """Write the text files of a building; those of sub-maps that are gone are removed.

    `others` are texts of files that change together with them.

    Raises:
        BuildingError: a name cannot be written on one line.
        OutputError: a file cannot be written; then all files are as before.
    """
    submaps = {submap_file(folder, path): submap_text(submap) for path, submap in hgraph.submaps.items()}
    texts = {**others, **submaps}
    texts[folder / GENERAL] = general_text(hgraph)
    write_all(texts, folder / SUBMAPS, folder / SAVING)


def general_from_text(path: Path, text: str) -> HGraph:
    """Return a building whose sub-maps have no nodes yet, from the text of its general file.

    Raises:
        BuildingError: a line is broken, doubled, or names a storey, lift or parent that is not there.
    """
    names: list[str] = []
    costs = CostSettings()
    storeys, submaps, lifts = [], {ROOT: SubMap(ROOT)}, {}
    stops: dict[str, list[Stop]] = {}
    known: set[str] = set()
    for record in records(path, text):
        if record.kind == "building":
            names.append(record.text("name"))
        elif record.kind == "cost":
            costs = costs_of(record)
        elif record.kind == "storey":
            storey = storey_of(record)
            _refuse_known(record, known, "storey", storey.id)
            storeys.append(storey)
        elif record.kind == "submap":
            submap = submap_of(record)
            _refuse_known(record, known, "sub-map", submap.path)
            if parent_path(submap.path) not in submaps:
                raise record.error(
                    f"sub-map '{submap.path}' has no parent above it: name '{parent_path(submap.path)}' first"
                )
            if submap.storey:
                _refuse_unknown(record, known, "storey", submap.storey)
            submaps[submap.path] = submap
        elif record.kind == "lift":
            lift = lift_of(record)
            _refuse_known(record, known, "lift", lift.id)
            lifts[lift.id] = lift
        elif record.kind == "stop":
            lift_id, stop = stop_of(record)
            _refuse_unknown(record, known, "lift", lift_id)
            _refuse_unknown(record, known, "storey", stop.storey)
            stops.setdefault(lift_id, []).append(stop)
        else:
            raise _unknown_kind(record, "building, cost, storey, submap, lift, stop")
    if len(names) != 1:
        raise BuildingError(f"{path} has {len(names)} records 'building name=...': write exactly one")
    storeys.sort(key=lambda storey: storey.height)
    order = {storey.id: index for index, storey in enumerate(storeys)}
    for of_lift in stops.values():
        of_lift.sort(key=lambda stop: order[stop.storey])
    with_stops = {key: replace(lift, stops=tuple(stops.get(key, ()))) for key, lift in lifts.items()}
    return HGraph(names[0], tuple(storeys), submaps, with_stops, costs)


def submap_from_text(path: Path, text: str, bare: SubMap) -> SubMap:
    """Return a sub-map with its nodes, arcs, doorways and beacons, from the text of its file.

    Raises:
        BuildingError: a line is broken, a node's id is doubled, or an arc's end is no node.
    """
    nodes, arcs, doorways, beacons = {}, [], [], []
    ends: list[tuple[Record, str]] = []
    for record in records(path, text):
        if record.kind == "node":
            node = node_of(record)
            if node.id in nodes:
                raise record.error(f"there is a node '{node.id}' already: give it another id")
            nodes[node.id] = node
        elif record.kind == "arc":
            arc = arc_of(record)
            if arc.start not in nodes or arc.end not in nodes:
                ends += [(record, arc.start), (record, arc.end)]
            arcs.append(arc)
        elif record.kind == "door":
            doorway = doorway_of(record)
            if doorway.start not in nodes:
                ends.append((record, doorway.start))
            doorways.append(doorway)
        elif record.kind == "beacon":
            beacons.append(beacon_of(record))
        else:
            raise _unknown_kind(record, "node, arc, door, beacon")
    for record, end in ends:  # nodes may follow their arcs
        if end not in nodes:
            raise record.error(f"there is no node '{end}' in this sub-map: add it, or correct its id")
    read = replace(bare, nodes=nodes, arcs=tuple(arcs), doorways=tuple(doorways), beacons=tuple(beacons))
    return replace(read, source=Source(text, read))


def submap_text(submap: SubMap) -> str:
    """Return the text of a sub-map's file; lines that still hold are as they were read."""
    if isinstance(submap.source, Source) and _same_content(submap, submap.source.holder):
        return submap.source.text
    lines = list(_submap_lines(submap))
    return _written(lines, submap.source, _submap_line)


def general_text(hgraph: HGraph) -> str:
    """Return the text of the general file; lines that still hold are as they were read."""
    lines = list(_general_lines(hgraph))
    return _written(lines, hgraph.source, _general_line)


def _written(lines: list[str], source: object, normal: Callable[[Record], str]) -> str:
    if not isinstance(source, Source):
        return "\n".join([*lines, END, ""])

    def form(number: int, line: str) -> tuple[str, str] | None:
        record = record_of_line(Path("-"), number, line)
        return None if record is None else (record.kind, normal(record))

    return rewritten(source.text, lines, form)


def _same_content(submap: SubMap, other: object) -> bool:
    return (
        isinstance(other, SubMap)
        and submap.nodes is other.nodes
        and submap.arcs is other.arcs
        and submap.doorways is other.doorways
        and submap.beacons is other.beacons
    )


def _submap_lines(submap: SubMap) -> Iterator[str]:
    for node in submap.nodes.values():
        yield checked_line(node_line(node), lambda node=node: f"node '{node.id}'")  # type: ignore[misc]
    for arc in submap.arcs:
        yield checked_line(arc_line(arc), lambda arc=arc: f"arc '{arc.start}>{arc.end}'")  # type: ignore[misc]
    for doorway in submap.doorways:
        yield checked_line(doorway_line(doorway), lambda each=doorway: f"door '{each.start}'")  # type: ignore[misc]
    for beacon in submap.beacons:
        yield beacon_line(beacon)


def _submap_line(record: Record) -> str:
    lines: Mapping[str, Callable[[], str]] = {
        "node": lambda: node_line(node_of(record)),
        "arc": lambda: arc_line(arc_of(record)),
        "door": lambda: doorway_line(doorway_of(record)),
        "beacon": lambda: beacon_line(beacon_of(record)),
    }
    return lines[record.kind]()


def _general_lines(hgraph: HGraph) -> Iterator[str]:
    yield checked_line(_building_line(hgraph.name), lambda: "the building")
    yield costs_line(hgraph.costs)
    for storey in hgraph.storeys:
        yield checked_line(storey_line(storey), lambda each=storey: f"storey '{each.id}'")  # type: ignore[misc]
    for path, submap in hgraph.submaps.items():
        if path:
            yield checked_line(submap_line(submap), lambda path=path: f"sub-map '{path}'")  # type: ignore[misc]
    for lift in hgraph.lifts.values():
        yield checked_line(lift_line(lift), lambda each=lift: f"lift '{each.id}'")  # type: ignore[misc]
        for stop in lift.stops:
            yield checked_line(stop_line(lift.id, stop), lambda each=lift: f"lift '{each.id}'")  # type: ignore[misc]


def _general_line(record: Record) -> str:
    lines: Mapping[str, Callable[[], str]] = {
        "building": lambda: _building_line(record.text("name")),
        "cost": lambda: costs_line(costs_of(record)),
        "storey": lambda: storey_line(storey_of(record)),
        "submap": lambda: submap_line(submap_of(record)),
        "lift": lambda: lift_line(lift_of(record)),
        "stop": lambda: stop_line(*stop_of(record)),
    }
    return lines[record.kind]()


def _building_line(name: str) -> str:
    return line_of("building", [("name", name)])


def _refuse_known(record: Record, known: set[str], what: str, name: str) -> None:
    if f"{what} {name}" in known:
        raise record.error(f"there is a {what} '{name}' already: give it another name")
    known.add(f"{what} {name}")


def _refuse_unknown(record: Record, known: set[str], what: str, name: str) -> None:
    if f"{what} {name}" not in known:
        raise record.error(f"there is no {what} '{name}' above this line: add it, or correct the name")


def _unknown_kind(record: Record, kinds: str) -> BuildingError:
    return record.error(f"'{record.kind}' is no kind of record here: write {kinds}")
