"""Every fault that the checks of a building find, made in the building of the world `two_floors` by edits, and its remedy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from waychair.types import Json

LOBBY, BATH = "ground/r1", "ground/r2"
"""The hall of the ground storey, and the room behind its other door."""


@dataclass(frozen=True, slots=True)
class BuildingFault:
    """A fault: its code, the place that the checks name, edits that make it, and edits that are its remedy."""

    code: str
    place: str
    edits: Sequence[Json]
    remedy: Sequence[Json]


def _goal(path: str, name: str, x: float, y: float, *joined: str) -> Json:
    return {"do": "add_node", "submap": path, "kind": "end", "name": name, "x": x, "y": y, "joined": list(joined)}


def _cross(path: str, x: float, y: float, *joined: str) -> Json:
    return {"do": "add_node", "submap": path, "x": x, "y": y, "joined": list(joined)}


def _join(one: str, other: str) -> Json:
    return {"do": "join", "one": one, "other": other}


def _arc(arc: str, **values: object) -> Json:
    return {"do": "change_arc", "arc": arc, **values}


def _undone(*arcs: str) -> Json:
    return {"do": "delete_arcs", "arcs": list(arcs)}


_TO_BATH, _IN_BATH = "ground:d1>r2:d1", f"{BATH}:m1>d1"
_STOP = f"{LOBBY}:p2"

FAULTS = (
    BuildingFault("E1", f"{LOBBY}:c1", [_cross(LOBBY, 5.5, 3.2)], [{"do": "delete_nodes", "nodes": [f"{LOBBY}:c1"]}]),
    BuildingFault(
        "E2",
        _STOP,
        [_join(_STOP, f"{LOBBY}:{each}") for each in ("m1", "k2", "p1")],
        [{"do": "split_node", "node": _STOP}],
    ),
    BuildingFault("E3", _STOP, [_join(_STOP, f"{LOBBY}:m1")], [_undone(f"{_STOP}>m1")]),
    BuildingFault(
        "E4",
        f"{LOBBY}:p1>c1",
        [_cross(LOBBY, 1.5, 2.0, f"{LOBBY}:p1")],
        [{"do": "move_nodes", "nodes": [f"{LOBBY}:c1"], "x": 1.0, "y": 0.0}],
    ),
    BuildingFault("E5", _IN_BATH, [_arc(_IN_BATH, length=30.0)], [_arc(_IN_BATH)]),
    BuildingFault(
        "E5",
        f"{BATH}:m1>c1",
        [_cross(BATH, 5.5, 6.0, f"{BATH}:m1")],
        [{"do": "move_nodes", "nodes": [f"{BATH}:c1"], "x": -4.5, "y": 0.0}],
    ),
    BuildingFault("E6", _TO_BATH, [_arc(_TO_BATH, width=0.6)], [_arc(_TO_BATH, width=1.1)]),
    BuildingFault("E7", f"{BATH}:d1", [_undone(_TO_BATH)], [_join("ground:d1", f"{BATH}:d1")]),
    BuildingFault("E8", "lift Z", [{"do": "set_lift", "id": "Z"}], [{"do": "delete_lift", "id": "Z"}]),
    BuildingFault(
        "E9",
        "ground:d1>mez:d1",
        [
            {"do": "add_submap", "parent": "ground", "id": "mez", "storey": "upper"},
            {"do": "add_node", "submap": "ground/mez", "kind": "door", "x": 2.4, "y": 4.975},
            _join("ground:d1", "ground/mez:d1"),
        ],
        [_arc("ground:d1>mez:d1", ramp=True)],
    ),
    BuildingFault(
        "E10",
        "ground/x",
        [{"do": "add_submap", "parent": "ground", "id": "x", "name": "Cupboard"}],
        [{"do": "delete_submap", "path": "ground/x"}],
    ),
    BuildingFault("E11", f"{LOBBY}:e1", [_goal(LOBBY, "Island", 3.2, 1.2)], [_join(f"{LOBBY}:e1", f"{LOBBY}:m1")]),
    BuildingFault(
        "E12",
        f"{LOBBY}:k2",
        [_cross(LOBBY, 2.5, 2.85, f"{LOBBY}:p1")],
        [{"do": "merge_nodes", "kept": f"{LOBBY}:k2", "gone": f"{LOBBY}:c1"}],
    ),
    BuildingFault(
        "E13",
        f"{LOBBY}:e1",
        [_goal(LOBBY, "Entr\u00e1nce", 3.2, 1.2, f"{LOBBY}:m1")],
        [{"do": "change_node", "node": f"{LOBBY}:e1", "name": "Window"}],
    ),
    BuildingFault(
        "E14",
        f"{LOBBY}:p1",
        [{"do": "move_nodes", "nodes": [f"{LOBBY}:p1"], "x": -1.5, "y": -2.0}],
        [{"do": "move_nodes", "nodes": [f"{LOBBY}:p1"], "x": 1.5, "y": 2.0}],
    ),
    BuildingFault("E17", _TO_BATH, [_arc(_TO_BATH, width=5.0)], [_arc(_TO_BATH, width=1.1)]),
    BuildingFault("E18", _IN_BATH, [_arc(_IN_BATH, direction="there")], [_arc(_IN_BATH)]),
    BuildingFault(
        "W1",
        "ground/r1:d1",
        [_undone("ground:d2>r1:d2")],
        [_join("ground:d2", "ground/r1:d2")],
    ),
    BuildingFault(
        "W2",
        BATH,
        [_goal(BATH, f"Bed {k}", 0.6 + 0.35 * k, 6.2, f"{BATH}:m1") for k in range(1, 8)],
        [{"do": "split_submap", "nodes": [f"{BATH}:e1", f"{BATH}:e2"], "id": "bay", "name": "Bay"}],
    ),
    BuildingFault("W3", f"{LOBBY}:p1", [_arc(_IN_BATH, drive_s=4.0)], [_arc(_IN_BATH)]),
)
"""E15 (tables) and E16 (a missing map) come from files: the figure makes them by itself."""
