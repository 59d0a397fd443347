"""Loop closure by pictures and lidar: the two floors of the wheelchair paper, and a world of identical rooms.

The figures (revisits, recall, false loops) are defined in `evaluation.scenes.maps.revisits`.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import numpy as np

from evaluation.scenes.maps.revisits import map_drive, record_drive, score, trajectory_error
from waychair.offline.appearance_mapping import memory_report
from waychair.offline.paper_tables import paper_tables
from waychair.slam.mapping.appearance_loops import NEAR_DISTANCE
from waychair.types import Json

RATE_HZ = 2.0
"""Pictures per second in the recording; more would be rendered for nothing."""


def floors(out: Path) -> Json:
    """Second floor (203 m) and basement (140 m): recall >= 95 %, all revisits closed, no false loop; Tables 1 to 3."""
    figures: Json = {}
    reports = []
    passed = True
    for world in ("second_floor", "basement"):
        scored, report = _floor(world)
        passed = passed and scored["recall"] >= 0.95 and scored["closed"] == scored["revisits"]
        passed = passed and scored["false_links"] == 0 and scored["false_edges"] == 0
        figures |= {f"{world}_{name}": value for name, value in scored.items()}
        reports.append(report)
    tables = [dataclasses.asdict(table) for table in paper_tables(reports)]
    return {"passed": passed, **figures, "tables": tables}


def alias(out: Path) -> Json:
    """Six identical rooms: no false loop is accepted, by pictures or by lidar."""
    scored, _ = _floor("alias")
    return {"passed": scored["false_links"] == 0 and scored["false_edges"] == 0, **scored}


def _floor(world: str) -> tuple[Json, Json]:
    """Return the figures of a drive along the world's route, recorded once and mapped with and without camera."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "drive.mcap"
        record_drive(world, bag, RATE_HZ)
        seen, blind = map_drive(bag), map_drive(bag, camera=False)
    assert seen.appearance is not None
    scored = score(seen)
    scored["ate_m"], scored["ate_lidar_only_m"] = (trajectory_error(each) for each in (seen, blind))
    steps = np.diff(seen.result.trajectory.poses[:, :2], axis=0)
    report: Json = {
        "distance_m": float(np.hypot(*steps.T).sum()),
        "memory": memory_report(seen.appearance.places, NEAR_DISTANCE),
    }
    scored["frame_ms"] = report["memory"]["per_picture"]["total_ms"]
    scored["frame_p99_ms"] = report["memory"]["per_picture"]["total_p99_ms"]
    return scored, report
