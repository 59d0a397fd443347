"""Drives on the maps of real buildings: each is mapped from its log, raised to a world, and driven to random places.

The environment variable `REAL_MAPS_DRIVES` reduces the fifty drives per building.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from evaluation.figures.mapping.logs import DATA
from evaluation.runs.kept_runs import over_seeds
from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import PlanningError
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import points_from_cells
from waychair.maps.grid.distance_field import near_distances
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.global_planner import plan
from waychair.trials.barn import upper_bound
from waychair.trials.navigate import navigate, with_closed_borders
from waychair.types import Json, OccupancyGrid, Place, Pose2

LOGS = {"intel": "lidar_intel/intel_first1088s.clf.gz", "fr079": "lidar_fr079/fr079_laser.clf.gz"}
DRIVES = int(os.environ.get("REAL_MAPS_DRIVES", "50"))
SUCCESS = 0.95

_NEAREST_M, _FARTHEST_M = 3.0, 30.0
_SEEN_M = 0.6
"""Distance [m] of starts and goals from anything solid or unknown, as a chair there cannot see behind itself."""


@dataclass(frozen=True, slots=True)
class RealMapDrive:
    """The result of one drive."""

    reached: bool
    contacts: int
    reason: str
    error_m: float
    seconds: float
    way_m: float


def real_maps(out: Path) -> Json:
    """The chair reaches 95 % of the places where it fits and to which a path exists, without a contact."""
    rows = []
    for name, log in LOGS.items():
        folder = out.with_suffix("") / name
        _mapped(DATA / log, folder)
        drives = over_seeds(f"real map {name}", partial(run_drive, folder), DRIVES)
        reached, contacts = sum(drive.reached for drive in drives), sum(drive.contacts for drive in drives)
        row: Json = {
            "building": name,
            "drives": len(drives),
            "reached": reached,
            "contacts": contacts,
            "contact_rate_bound_95": upper_bound(sum(drive.contacts > 0 for drive in drives), len(drives)),
            "way_m": sum(drive.way_m for drive in drives),
            "failures": [f"{seed}: {drive.reason}" for seed, drive in enumerate(drives) if not drive.reached],
        }
        print(f"  {row}", flush=True)
        rows.append(row)
    count, reached = sum(row["drives"] for row in rows), sum(row["reached"] for row in rows)
    contacts = sum(row["contacts"] for row in rows)
    passed = reached >= SUCCESS * count and contacts == 0
    return {"passed": passed, "drives": count, "reached": reached, "contacts": contacts, "buildings": rows}


def run_drive(folder: Path, seed: int) -> RealMapDrive:
    """Drive between two random places of a map with a path for chair A between them."""
    grid, costmap = _ground(folder)
    roomy = np.minimum(costmap.clearance, near_distances(grid.cells < 0, grid.resolution, 2 * _SEEN_M)) > _SEEN_M
    places = points_from_cells(grid, np.argwhere(roomy & (grid.cells >= 0)))
    rng = np.random.default_rng(seed)
    while True:
        start, goal = (
            Pose2(x, y, rng.uniform(-np.pi, np.pi)) for x, y in places[rng.integers(len(places), size=2)].tolist()
        )
        if not all(fits(CHAIR_A, 0.05, costmap.field, pose) for pose in (start, goal)):
            continue
        try:
            way = plan(costmap, start, goal).length()
        except PlanningError:
            continue
        if _NEAREST_M < way < _FARTHEST_M:
            break
    (leg,) = navigate(grid, start, [Place("goal", goal)], seed)
    return RealMapDrive(leg.reached, leg.contacts, leg.reason, leg.error_m, leg.duration_s, way)


@cache
def _ground(folder: Path) -> tuple[OccupancyGrid, Costmap]:
    grid = load_map(folder)
    return grid, costmap_from_grid(with_closed_borders(grid), CHAIR_A)


def _mapped(log: Path, folder: Path) -> None:
    """Map a log by `waychair map`."""
    command = [sys.executable, "-c", "from waychair.cli.main import main; main()"]
    subprocess.run([*command, "map", str(log), "--out", str(folder), "--quiet"], check=True)
