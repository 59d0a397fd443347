"""What lidar alone, depth alone and both make of the same simulated drives: none of the two sees all."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from waychair.calibration.chair import CHAIR_A
from waychair.files import write_bytes
from waychair.maps.depth_layer import DROP_OFF
from waychair.maps.depth_scan import DepthSettings
from waychair.recording import Recording
from waychair.runtime.depth_mapping import USES, DepthMappingSettings
from waychair.runtime.mapping import Mapping, MappingSettings, map_recording
from waychair.simulation.world import load_world
from waychair.slam.evaluation import truth_errors
from waychair.trials.depth_drive import drive_with_pictures, with_hazards
from waychair.trials.depth_score import depth_score
from waychair.trials.edge_approach import approach_edge
from waychair.trials.hazards import DROP_OFFS
from waychair.trials.map_score import wall_agreement
from waychair.types import Json, RgbdFrame, SensorFrame

FLOORS = ("second_floor", "basement")
SECONDS = 120.0
EDGE_SEEDS = 20
NAMES = {"off": "lidar", "only": "depth", "on": "both"}


def limits(out: Path) -> Json:
    """Lidar alone misses what is low, overhangs or falls away; depth alone loses the way; both do neither.

    The floors stand as they ship, with low boxes, shelves at the height of the arm rests and pits added beside the way
    (seeded), and nobody in them; the first `SECONDS` of their mapping routes, pictures at 5 Hz. Bars: with both, none of
    the things that were in view is missed, most of the pits' cells in view are occupied, at most 1 in 100 occupied cells
    is made up, and the ATE is the lidar's; lidar alone misses most of these things and pits; depth alone has an ATE a
    fifth larger and puts walls where there are none. `things_shown` and `drops_shown` are the shares of cells in view
    that are occupied, of things, which a camera sees from one side, and of pits.
    """
    rows = [row for floor in FLOORS for row in compared(floor, SECONDS, out.with_name(f"{out.stem}_{floor}.png"))]
    return {"passed": all(_holds(rows, floor) for floor in FLOORS), "rows": rows}


def edges_mapped(out: Path, seeds: int = EDGE_SEEDS) -> Json:
    """An edge ahead, beside while turning, behind while backing: all of it that comes near is in the grid by then."""
    rows = []
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
    """One drive and its three maps, a row each; the one of both sensors is drawn."""
    world = with_hazards(load_world(floor).without_people(), seed)
    frames: list[SensorFrame] = []
    pictures: list[RgbdFrame] = []

    def take(message: SensorFrame | RgbdFrame) -> None:
        if isinstance(message, SensorFrame):
            frames.append(message)
        else:  # its colours are not needed here
            pictures.append(replace(message, image=np.zeros((1, 1, 3), np.uint8)))

    # half the size of a real picture, of which every second beam is taken
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
    """The map, what only depth sees in red, drop-offs in magenta."""
    assert mapping.depth is not None
    shades = np.where(mapping.grid.cells < 0, 205, 255 - 2.5 * mapping.grid.cells).astype(np.uint8)
    colours = np.dstack([shades] * 3)
    colours[mapping.depth.cells > 0] = (40, 40, 220)
    colours[mapping.depth.cells == DROP_OFF] = (220, 0, 220)
    scale = max(1, math.ceil(1200 / colours.shape[1]))
    big = cv2.resize(np.flipud(colours), None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    write_bytes(path, cv2.imencode(".png", big)[1].tobytes())
