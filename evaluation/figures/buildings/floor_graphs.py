"""Graphs made from the maps of the simulated worlds: they pass their own checks, and a chair drives between their goals."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.building.building import add_storey, new_building
from waychair.maps.building.checks.hgraph_checks import FindingSeverity, GraphSurroundings, check
from waychair.maps.building.hgraph import HGraph, NodeKind, Storey
from waychair.maps.drawn.places import load_places, save_places
from waychair.maps.folders.map_files import load_map, save_map
from waychair.planning.building.generation.storey_generation import generated_storey, save_generation
from waychair.simulation.plan.world import World, levels_of, load_world, shipped_worlds
from waychair.trials.navigate import navigate
from waychair.types import Json, Place

STOREY = "storey"
MOST_DRIVES = 20
"""Random drives from goal to goal in each world; `FLOOR_GRAPH_DRIVES` takes fewer, `FLOOR_GRAPH_WORLDS` some worlds."""


def floor_graphs(out: Path) -> Json:
    """Each world's graph has no error, and all random End-to-End drives arrive."""
    drives = int(os.environ.get("FLOOR_GRAPH_DRIVES") or MOST_DRIVES)
    wanted = os.environ.get("FLOOR_GRAPH_WORLDS")
    rows: dict[str, Json] = {}
    for name in wanted.split(",") if wanted else shipped_worlds():
        for level in levels_of(name):
            rows[f"{name}/{level}"] = _row(load_world(name, level), drives)
    passed = all(row["errors"] == 0 and row["arrived"] == row["drives"] for row in rows.values())
    sums = {key: sum(int(row[key]) for row in rows.values()) for key in ("goals", "errors", "drives", "arrived")}
    return {"passed": passed, "worlds": len(rows), **sums, "each": rows}


def _row(world: World, drives: int) -> Json:
    """Return the size and the faults of a world's graph, and how many of its drives arrived."""
    with tempfile.TemporaryDirectory() as folder:
        building = add_storey(new_building(Path(folder) / "b", world.name), Storey(STOREY, "", 0.0, f"maps/{STOREY}"))
        maps = building.folder / "maps" / STOREY
        save_map(maps, world.grid)
        save_places(maps, {place.name: place for place in world.places})
        made = generated_storey(building, STOREY, CHAIR_A)
        save_generation(made, STOREY)
        places, grid, hgraph = load_places(maps), load_map(maps), made.building.hgraph
    around = GraphSurroundings(CHAIR_A.width, CHAIR_A.length, {STOREY: grid}, {STOREY: places})
    found = [finding for finding in check(hgraph, around) if finding.severity is FindingSeverity.ERROR]
    tour = _tour(hgraph, places, drives)
    records = navigate(grid, world.start, tour, world=world) if tour else ()
    return {
        "goals": sum(node.kind is NodeKind.END for _, node in hgraph.nodes()),
        "rooms": len(made.sketch.rooms),
        "lost": list(made.sketch.lost),
        "errors": len(found),
        "faults": [finding.sentence for finding in found],
        "drives": len(tour),
        "arrived": sum(record.reached for record in records),
        "failed": [f"{record.place}: {record.reason}" for record in records if not record.reached],
    }


def _tour(hgraph: HGraph, places: dict[str, Place], drives: int) -> list[Place]:
    """Return random goals of a graph, no two in a row the same; none where there is only one."""
    names = [node.name for _, node in hgraph.nodes() if node.kind is NodeKind.END]
    if len(names) < 2:
        return []
    random, tour = np.random.default_rng(1), [names[0]]
    while len(tour) < drives:
        tour.append(str(random.choice([name for name in names if name != tour[-1]])))
    return [places[name] for name in tour]
