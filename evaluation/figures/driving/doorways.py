"""Doorways found without a map: in real logs, in simulated approaches, and proposed in photographs."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import cv2
import numpy as np

from evaluation.scenes.door_approaches import (
    approach,
    approaches,
    behind_glass,
    depth_look,
    forbidden,
    laser_look,
    lidar_look,
    share,
    sonar_listen,
)
from evaluation.scenes.door_logs import (
    DoorDrive,
    find_over_drive,
    found_rows,
    in_labels_frame,
    scans_at,
    scans_of,
    scorer,
    seen_ahead,
    write_rows,
)
from waychair.errors import RecordingDamaged
from waychair.planning.seen.door_frames import Box, door_frames, overlap
from waychair.trials.barn import upper_bound
from waychair.types import Json

DATA = Path(os.environ.get("WAYCHAIR_DATA", "../shared/data"))

RECALL, PRECISION = 0.95, 0.85
POSITION_M, NORMAL_DEG, WIDTH_M, WIDTH_P90_M = 0.03, 1.5, 0.03, 0.08
AHEAD_M, AHEAD_SHARE = 1.5, 0.80
"""Bars of `doorways_real`."""

BY_M, WIDTH_OFF_M, EXACT, SEED = 2.0, 0.05, 0.95, 2031
OVERLAP, FIRST_TRIAL = 0.5, (18 / 53, 12 / 18)
"""Intersection by union of a hit, and the shares of boxes found and of false alarms of a first trial, to be bettered."""

FOUND = {"lidar": 0.98, "depth": 0.95, "laser": 0.90, "all": 0.99}
"""Bars of `doorways_sim`: the share found by 2 m before the door, and of widths within 5 cm."""


def doorways_real(out: Path) -> Json:
    """Every building with labels: its log at corrected poses, the labels' own scorer, one setting.

    `DOORWAYS_BUILDINGS=intel,fr079` takes some. The doorways found go to a file beside the figures. Where the mapper has
    left its trajectory beside them (`BUILDING/trajectory.tum`), the figures on the raw log by its poses are added; they
    decide nothing.
    """
    folder = DATA / "doors_lidar"
    if not folder.is_dir():
        return {"passed": True, "skipped": f"there is no folder {folder}"}
    score = scorer(folder)
    labels, areas = score.rows(folder / "doorways.csv"), score.rows(folder / "areas.csv")
    chosen = os.environ.get("DOORWAYS_BUILDINGS", ",".join(sorted({label["building"] for label in labels}))).split(",")
    figures: dict[str, Json] = {}
    by_mapper: dict[str, Json] = {}
    rows: list[Json] = []
    for building in chosen:
        drive = find_over_drive(scans_of(building, DATA))
        here = found_rows(building, drive)
        rows += here
        known = [label for label in labels if label["building"] == building]
        figures[building] = score.score(here, known, areas)[building] | _on_line(drive, known)
        trajectory = out.parent / building / "trajectory.tum"
        if trajectory.is_file() and known:
            mapped = find_over_drive(scans_at(building, DATA, trajectory))
            mapped = in_labels_frame(building, DATA, trajectory, mapped)
            by_mapper[f"{building}_by_mapper"] = score.score(found_rows(building, mapped), known, areas)[building]
            by_mapper[f"{building}_by_mapper"] |= _on_line(mapped, known)
    write_rows(out.with_suffix(".csv"), rows)
    passed = all(_passed(each) for each in figures.values())
    return {
        "passed": passed,
        **{f"recall_{name}": each["recall"] for name, each in figures.items()},
        **figures,
        **by_mapper,
    }


def _on_line(drive: DoorDrive, labels: list[Json]) -> Json:
    """Return the share of doorways seen early enough, and of those under one identity, among the visited ones; the same
    for doorways that range had validated by then; and the time of an update."""
    seen = [ahead for label in labels if (ahead := seen_ahead(drive, drive.offered, label)) is not None]
    sure = [ahead for label in labels if (ahead := seen_ahead(drive, drive.validated, label)) is not None]
    return {
        "visited": len(seen),
        "seen_ahead_share": sum(ahead >= AHEAD_M for ahead, _ in seen) / max(1, len(seen)),
        "one_identity_share": sum(count == 1 for _, count in seen) / max(1, len(seen)),
        "validated_ahead_share": sum(ahead >= AHEAD_M for ahead, _ in sure) / max(1, len(sure)),
        "ahead_m": [round(ahead, 2) for ahead, _ in seen],
        "update_ms": [round(1e3 * float(np.quantile(drive.seconds, q)), 2) for q in (0.5, 0.99)],
    }


def _passed(figures: Json) -> bool:
    return bool(
        figures["recall"] >= RECALL
        and figures["precision"] >= PRECISION
        and figures["position_m"][0] <= POSITION_M
        and figures["normal_deg"][0] <= NORMAL_DEG
        and figures["width_m"][0] <= WIDTH_M
        and figures["width_m"][1] <= WIDTH_P90_M
        and figures["seen_ahead_share"] >= AHEAD_SHARE
    )


def doorways_sim(out: Path) -> Json:
    """Doors of all shipped worlds approached at 0 to 70 degrees, and doors that no chair may be sent through.

    `DOORWAYS_RUNS` reduces the 200 approaches of each sensor, and the forbidden and glass doors in proportion;
    `DOORWAYS_SENSORS=lidar,depth` takes some sensors.
    """
    runs = int(os.environ.get("DOORWAYS_RUNS", "200"))
    sensors = {"lidar": lidar_look, "depth": depth_look, "laser": laser_look}
    chosen = os.environ.get("DOORWAYS_SENSORS", "lidar,depth,laser,all").split(",")
    figures: dict[str, Json] = {}
    for name in chosen:
        found = []
        for number, case in enumerate(approaches(runs, SEED)):
            looks = {one: sensors[one](case.world, number) for one in (sensors if name == "all" else (name,))}
            found.append((case, approach(case, looks, number)))
        early = [one.first_m >= BY_M for _, one in found]
        exact = [abs(one.last.width - case.width) <= WIDTH_OFF_M for case, one in found if one.last is not None]
        figures[name] = {"runs": len(found), f"found_by_{BY_M:g}_m": share(early), "width_within_5_cm": share(exact)}
    cases = forbidden(round(2.5 * runs), SEED)
    said = [approach(case, {"lidar": lidar_look(case.world, k)}, k).wide_enough for k, case in enumerate(cases)]
    figures["forbidden"] = _never(said, "said_wide_enough")
    panes = behind_glass(runs, SEED)
    opened = [
        approach(case, {"lidar": lidar_look(case.world, k)}, k, listen=sonar_listen(case.world, k)).open
        for k, case in enumerate(panes)
    ]
    figures["glass"] = _never(opened, "said_open")
    passed = sum(said) + sum(opened) == 0 and all(
        figures[name][f"found_by_{BY_M:g}_m"] >= FOUND[name] and figures[name]["width_within_5_cm"] >= EXACT
        for name in chosen
    )
    return {"passed": passed, **figures}


def _never(said: list[bool], name: str) -> Json:
    """Return how often a thing was said that must never be, with the upper end of its 95 % interval."""
    return {"runs": len(said), name: sum(said), "upper_bound": upper_bound(sum(said), len(said))}


def doorways_photos(out: Path) -> Json:
    """Photographs: recall of door boxes among the three best proposals, and pictures without a door with a proposal."""
    folder = DATA / "doors_photos"
    if not folder.is_dir():
        return {"passed": True, "skipped": f"there is no folder {folder}"}
    doors: dict[str, list[Box]] = {}
    with (folder / "boxes.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            boxes = doors.setdefault(row["image"], [])
            if row["x0"]:
                boxes.append((float(row["x0"]), float(row["y0"]), float(row["x1"]), float(row["y1"])))
    hits, alarms = 0, 0
    for image, boxes in doors.items():
        picture = cv2.imread(str(folder / "images" / f"{image}.jpg"))
        if picture is None:
            raise RecordingDamaged(f"the picture {image}.jpg of {folder} cannot be read; copy it again from its source")
        found = door_frames(np.asarray(picture, np.uint8))
        hits += sum(any(overlap(one.box, box) >= OVERLAP for one in found) for box in boxes)
        alarms += not boxes and bool(found)
    count, empty = sum(len(boxes) for boxes in doors.values()), sum(not boxes for boxes in doors.values())
    passed = hits / max(1, count) > FIRST_TRIAL[0] and alarms / max(1, empty) < FIRST_TRIAL[1]
    return {"passed": passed, "boxes": count, "found": hits, "pictures_without_door": empty, "false_alarms": alarms}
