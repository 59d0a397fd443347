"""Maps by lidar alone, by depth alone and by both, of the same simulated drives: neither sensor sees everything."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from evaluation.scenes.hazards import DROP_OFFS
from evaluation.scenes.maps.depth_drive import drive_with_pictures, with_hazards
from evaluation.scenes.maps.depth_score import depth_score
from evaluation.scenes.maps.edge_approach import approach_edge
from evaluation.scenes.maps.map_score import wall_agreement
from waychair.calibration.chair_body import CHAIR_A
from waychair.files import write_bytes
from waychair.maps.depth.depth_scan import DepthSettings
from waychair.maps.folders.depth_layer import DROP_OFF
from waychair.offline.mapping import Mapping, MappingSettings, map_recording
from waychair.recordings.recording import Recording
from waychair.simulation.plan.world import load_world
from waychair.slam.mapping.depth_mapping import USES, DepthMappingSettings
from waychair.slam.trajectory_errors import truth_errors
from waychair.types import Json, RgbdFrame, SensorFrame

FLOORS = ("second_floor", "basement")
SECONDS = 120.0
EDGE_SEEDS = 20
NAMES = {"off": "lidar", "only": "depth", "on": "both"}


def limits(out: Path) -> Json:
    """Lidar alone misses low and overhanging objects and drop-offs; depth alone gets lost; both together do neither.

    The worlds are shipped floors without people, with seeded low boxes, shelves at arm-rest height and pits beside the
    path; the drives are the first `SECONDS` of their mapping routes, with pictures at 5 Hz. Bars with both sensors: no
    viewed object is missed, most viewed cells of pits are occupied, at most 1 in 100 occupied cells is false, and the
    ATE equals the lidar's. Lidar alone misses most of these objects and pits. Depth alone has an ATE a fifth larger and
    false walls. `things_shown` and `drops_shown` are the shares of viewed cells that are occupied, of objects (which a
    camera sees from one side) and of pits.
    """
    rows = [row for floor in FLOORS for row in compared(floor, SECONDS, out.with_name(f"{out.stem}_{floor}.png"))]
    return {"passed": all(_holds(rows, floor) for floor in FLOORS), "rows": rows}


def edges_mapped(out: Path, seeds: int = EDGE_SEEDS) -> Json:
    """A drop-off ahead, beside a turning chair, behind a reversing chair: its near part is in the grid in time."""
    rows: list[Json] = []
    for where in DROP_OFFS:
        runs = [approach_edge(where, seed) for seed in range(seeds)]
        points, known = sum(run.points for run in runs), sum(run.known for run in runs)
        nearest = min(run.nearest_m for run in runs)
        rows.append({"edge": where, "runs": seeds, "points": points, "known": known, "nearest_m": round(nearest, 3)})
        print(f"  {rows[-1]}", flush=True)
    return {"passed": all(row["known"] == row["points"] > 0 for row in rows), "rows": rows}


def _holds(rows: list[Json], floor: str) -> bool:
    of = {row["sensors"]: row for row in rows if row["floor"] == floor}
    lidar, depth, both = of["lidar"], of["depth"], of["both"]
    missed = {name: row["low_missed"] + row["overhanging_missed"] for name, row in of.items()}
    things = both["low"] + both["overhanging"]
    whole = missed["both"] == 0 and both["drops_shown"] >= 0.6 and both["false_cells"] <= 0.01 * both["cells"]
    unseen = missed["lidar"] > 0.5 * things and lidar["drops_shown"] < 0.2
    adrift = depth["ate_m"] > 1.2 * both["ate_m"] and depth["walls_true"] < both["walls_true"] - 0.05
    return bool(things and whole and both["ate_m"] <= lidar["ate_m"] and unseen and adrift)


def compared(floor: str, seconds: float, picture: Path | None = None, seed: int = 0) -> list[Json]:
    """Return a row for each of the three maps of one drive; the map of both sensors is drawn."""
    world = with_hazards(load_world(floor).without_people(), seed)
    frames: list[SensorFrame] = []
    pictures: list[RgbdFrame] = []

    def take(message: SensorFrame | RgbdFrame) -> None:
        if isinstance(message, SensorFrame):
            frames.append(message)
        else:  # colours are not needed here
            pictures.append(replace(message, image=np.zeros((1, 1, 3), np.uint8)))

    # half the size of a real picture, with every second column
    truth = drive_with_pictures(
        world, world.route(), take, camera_hz=5.0, size=(320, 240), seed=seed, until_ns=round(seconds * 1e9)
    )
    mount = CHAIR_A.base_from_camera
    recording = Recording(
        Path(floor), tuple(frames), CHAIR_A.base_from_laser, "simulated",
        pictures=lambda: iter(pictures), camera_mount=lambda: mount,
    )  # fmt: skip
    rows = []
    for use in USES:
        depth = DepthMappingSettings(use=use, view=DepthSettings(step=2))
        mapping = map_recording(recording, MappingSettings(depth=depth, vision="off"))
        errors = truth_errors(mapping.result.trajectory, truth)
        walls = wall_agreement(mapping.grid, world.grid, errors.truth_from_map, 0.05)
        score = depth_score(mapping.grid, world, errors.truth_from_map, truth.poses, CHAIR_A)
        rows.append(
            {
                "floor": floor,
                "sensors": NAMES[use],
                "ate_m": round(errors.rmse_m, 4),
                "walls_true": round(walls.true_cells, 4),
                "walls_found": round(walls.found_faces, 4),
                "low_missed": score.low_missed,
                "low": score.low,
                "overhanging_missed": score.overhanging_missed,
                "overhanging": score.overhanging,
                "things_shown": round(score.thing_share, 3),
                "drops_shown": round(score.drop_share, 3),
                "false_cells": score.false_cells,
                "cells": score.cells,
                "depth_cpu_s": round(mapping.report["cpu_seconds"].get("depth", 0.0), 2),
                "pictures": mapping.report["depth"]["pictures"],
            }
        )
        if use == "on" and picture is not None:
            _draw(picture, mapping)
    return rows


def _draw(path: Path, mapping: Mapping) -> None:
    """Draw the map, with obstacles by depth alone in red and drop-offs in magenta."""
    assert mapping.depth is not None
    shades = np.where(mapping.grid.cells < 0, 205, 255 - 2.5 * mapping.grid.cells).astype(np.uint8)
    colours = np.dstack([shades] * 3)
    colours[mapping.depth.cells > 0] = (40, 40, 220)
    colours[mapping.depth.cells == DROP_OFF] = (220, 0, 220)
    scale = max(1, math.ceil(1200 / colours.shape[1]))
    big = cv2.resize(np.flipud(colours), None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    write_bytes(path, cv2.imencode(".png", big)[1].tobytes())
