"""Addresses of nodes and arcs as pages and logs write them, records checked as their files would be, and free ids."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import Arc, ArcRef, GraphDoorway, HGraph, Node, NodeKind, NodeRef, SubMap
from waychair.maps.building.hgraph_edits import arc_ref
from waychair.maps.building.records import Record, record_of_line
from waychair.maps.building.text_forms import is_id

_ANYWHERE = Path("-")

PREFIXES = {NodeKind.END: "e", NodeKind.CROSS: "c", NodeKind.BRIDGE: "d", NodeKind.LIFT: "v"}
"""First letters of the ids of new nodes, as generated ones have them."""


def node_ref(text: str) -> NodeRef:
    """Return a node's address of `PATH:NODE`.

    Raises:
        BuildingError: it is none.
    """
    path, colon, node = text.rpartition(":")
    if not colon or not is_id(node):
        raise BuildingError(f"'{text}' is no address of a node: write PATH:NODE, as in ground/west:c1")
    return NodeRef(path, node)


def ref_of_arc(text: str) -> ArcRef:
    """Return an arc's or doorway's address of `PATH:START>END` or `PATH:START>CHILD:NODE`.

    Raises:
        BuildingError: it is none.
    """
    path, colon, ends = text.partition(":")
    start, arrow, end = ends.partition(">")
    if not colon or not arrow or not start or not end:
        raise BuildingError(f"'{text}' is no address of an arc: write PATH:START>END, as in ground/west:c1>c2")
    return ArcRef(path, start, end)


def submap_at(hgraph: HGraph, path: str) -> SubMap:
    """Return a sub-map; raises BuildingError without it."""
    submap = hgraph.submaps.get(path)
    if submap is None:
        raise BuildingError(f"there is no sub-map '{path}': somebody has deleted or moved it")
    return submap


def node_at(hgraph: HGraph, ref: NodeRef) -> Node:
    """Return a node; raises BuildingError without it."""
    node = hgraph.node(ref)
    if node is None:
        raise BuildingError(f"there is no node {ref}: somebody has deleted or moved it")
    return node


def arc_at(hgraph: HGraph, ref: ArcRef) -> Arc | GraphDoorway:
    """Return an arc or doorway, whichever of its ends is named first; raises BuildingError without it."""
    submap = submap_at(hgraph, ref.submap)
    both: tuple[Arc | GraphDoorway, ...] = (*submap.arcs, *submap.doorways)
    for each in both:
        if {ref.start, ref.end} == set(arc_ref(submap, each)[1:]):
            return each
    raise BuildingError(f"there is no arc {ref}: somebody has deleted or moved it")


def free_id(prefix: str, taken: Iterable[str]) -> str:
    """Return the first id of this prefix and a number that is not taken."""
    known, number = set(taken), 1
    while f"{prefix}{number}" in known:
        number += 1
    return f"{prefix}{number}"


def checked_line_of(line: str, read: Callable[[Record], object]) -> None:
    """Refuse a record's line that could not be read again, or that is longer than one line.

    Raises:
        BuildingError: a name or a number is impossible.
    """
    if not line.isprintable():
        raise BuildingError("a name has a line break or control character: take it out")
    record = record_of_line(_ANYWHERE, 1, line)
    assert record is not None
    try:
        read(record)
    except BuildingError as error:
        raise BuildingError(str(error).partition("line 1: ")[2] or str(error)) from error
