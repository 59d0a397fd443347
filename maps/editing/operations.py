"""Every edit of a building as data: `applied(draft, operation)` returns the next draft.

Operations are plain values (`Operation`), so that a page sends them as JSON, a log keeps them, and they can be done again
on a building that somebody else has changed meanwhile. Coordinates of nodes are metres in the storey's map.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from waychair.errors import BuildingError
from waychair.maps.editing import arc_edits as arcs
from waychair.maps.editing import building_edits as building
from waychair.maps.editing import lift_edits as lifts
from waychair.maps.editing import map_edits as maps
from waychair.maps.editing import node_edits as nodes
from waychair.maps.editing.arc_edits import Operation
from waychair.maps.editing.draft import Draft

_DOING: dict[type[Operation], tuple[Callable[[Draft, Any], Draft], Callable[[Any], str]]] = {
    nodes.AddNode: (nodes.add_node, lambda it: f"add a node {it.name}".rstrip()),
    nodes.ChangeNode: (nodes.change_node, lambda it: f"change {it.node}"),
    nodes.MoveNodes: (nodes.move_nodes, lambda it: f"move {_some(it.nodes, 'nodes')}"),
    nodes.DeleteNodes: (nodes.delete_nodes, lambda it: f"delete {_some(it.nodes, 'nodes')}"),
    nodes.MergeNodes: (nodes.merge_nodes, lambda it: f"make {it.kept} and {it.gone} one node"),
    nodes.SplitNode: (nodes.split_node, lambda it: f"split {it.node}"),
    arcs.Join: (arcs.join, lambda it: f"join {it.one} and {it.other}"),
    arcs.ChangeArc: (arcs.change_arc, lambda it: f"change the arc {it.arc}"),
    arcs.DeleteArcs: (arcs.delete_arcs, lambda it: f"delete {_some(it.arcs, 'arcs')}"),
    arcs.SplitArc: (arcs.split_arc, lambda it: f"split the arc {it.arc}"),
    arcs.CrossArcs: (arcs.cross_arcs, lambda it: f"put a node where {it.one} and {it.other} cross"),
    building.ChangeBuilding: (building.change_building, lambda it: "change the building's name or costs"),
    building.AddStorey: (building.add_storey_to, lambda it: f"add storey '{it.id}'"),
    building.ChangeStorey: (building.change_storey, lambda it: f"change storey '{it.id}'"),
    building.DeleteStorey: (building.delete_storey, lambda it: f"delete storey '{it.id}'"),
    building.AddSubmap: (building.add_submap, lambda it: f"add sub-map '{it.id}'"),
    building.ChangeSubmap: (building.change_submap, lambda it: f"change sub-map '{it.path}'"),
    building.MoveSubmap: (building.move_submap, lambda it: f"move sub-map '{it.path}' to '{it.to}'"),
    building.DeleteSubmap: (building.delete_submap, lambda it: f"delete sub-map '{it.path}'"),
    building.SplitSubmap: (building.split_submap, lambda it: f"make the room '{it.id}' of {_some(it.nodes, 'nodes')}"),
    building.MergeSubmap: (building.merge_submap, lambda it: f"dissolve sub-map '{it.path}'"),
    lifts.SetLift: (lifts.set_lift, lambda it: f"set lift '{it.id}'"),
    lifts.DeleteLift: (lifts.delete_lift, lambda it: f"delete lift '{it.id}'"),
    lifts.SetStop: (lifts.set_stop, lambda it: f"lift '{it.lift}' stops at {it.at}"),
    lifts.DeleteStop: (lifts.delete_stop, lambda it: f"lift '{it.lift}' does not stop at {it.at}"),
    lifts.SetBeacon: (lifts.set_beacon, lambda it: f"set beacon '{it.id}'"),
    lifts.DeleteBeacon: (lifts.delete_beacon, lambda it: f"delete beacon '{it.id}'"),
    maps.SetPlace: (maps.set_place, lambda it: f"set the place '{it.name}'"),
    maps.DeletePlace: (maps.delete_place, lambda it: f"delete the place '{it.name}'"),
    maps.SetZone: (maps.set_zone, lambda it: f"set the zone '{it.name}'"),
    maps.DeleteZone: (maps.delete_zone, lambda it: f"delete the zone '{it.name}'"),
    maps.Patch: (maps.patch, lambda it: it.what),
}
"""How each operation is done, and what it does in words."""


def operation_of(values: object) -> Operation:
    """Return the operation of JSON values.

    Raises:
        BuildingError: they are none.
    """
    name = values.get("do") if isinstance(values, dict) else None
    kind = _BY_NAME.get(str(name))
    if kind is None:
        raise BuildingError(f"'{name}' is no edit: reload this page")
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise BuildingError(f"the edit '{name}' is invalid: {error}") from error


def applied(draft: Draft, operation: Operation) -> Draft:
    """Return the draft after an operation.

    Raises:
        BuildingError, PlaceError, ZoneError: it cannot be done, with the reason and advice; the draft stays as it is.
    """
    return _DOING[type(operation)][0](draft, operation)


def words(operation: Operation) -> str:
    """Return what an operation does, in words, as in `add a node`."""
    return _DOING[type(operation)][1](operation)


def _some(addresses: tuple[str, ...], what: str) -> str:
    return addresses[0] if len(addresses) == 1 else f"{len(addresses)} {what}"


_BY_NAME = {str(kind.__struct_config__.tag): kind for kind in _DOING}
