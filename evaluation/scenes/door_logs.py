"""Doorways found over a recorded drive at corrected poses, scored against labels, and how early each one was seen."""

from __future__ import annotations

import csv
import importlib.util
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np

from waychair.control.drive.doors.doorway_tracker import DoorwayTracker
from waychair.planning.seen.doorways import Doorway
from waychair.recordings.text.carmen import decompressed_text, read_carmen
from waychair.types import FloatArray, Json, Pose2, Scan

MATCHED_M, MATCHED_DEG = 0.30, 20.0
"""A doorway is a labelled one within this distance and turn, as the labels' scorer has it."""

TICK_NS, MOST_TICKS = 50_000_000, 10
"""ns; a chair's control tick, and the most of them that are counted between two scans."""

VISIT_M, RUN_UP_M = 3.0, 1.5
"""m; the chair visits a doorway when it comes this near; the visit's nearest point is where it passes. A visit counts if
the drive before that point is at least this long: a log may begin beside a doorway."""


@dataclass(frozen=True, slots=True)
class DoorDrive:
    """One drive: the doorways believed at its end; for each identity ever offered its poses with the path [m] driven when
    it stood there first; the same for validated ones; the path driven at each scan (N,) [m], the laser's poses (N, 3), and
    the time [s] of each update (N,)."""

    doorways: tuple[Doorway, ...]
    offered: dict[int, list[tuple[Pose2, float]]]
    validated: dict[int, list[tuple[Pose2, float]]]
    path: FloatArray
    poses: FloatArray
    seconds: FloatArray


def scans_of(building: str, data: Path) -> Iterator[tuple[Scan, Pose2]]:
    """Yield the scans of a building's log with the laser's corrected poses, in order.

    Buildings without a log of their own are looked for among the logs with corrected poses.

    Raises:
        RecordingError: the log cannot be read.
        OSError: there is no log of this building.
    """
    if building == "fr079":
        folder = data / "lidar_fr079"
        text, _ = decompressed_text((folder / "fr079_gmapping_poses.txt.gz").read_bytes(), "fr079's poses")
        rows = np.array([line.split() for line in text.splitlines() if not line.startswith(b"#")], np.float64)
        corrected = {round(row[0] * 1e6): row[1:] for row in rows}
        for frame in read_carmen((folder / "fr079_laser.clf.gz").read_bytes(), building).frames:
            at = corrected.get(round(frame.stamp_ns / 1e3))
            if frame.scan is not None and at is not None:
                yield frame.scan, Pose2(*at)
        return
    own = {"intel": data / "lidar_intel" / "intel_gmapping_910.log.gz"}
    log = own.get(building, data / "lidar_radish_corrected" / f"{building}-corrected.log.gz")
    for frame in read_carmen(log.read_bytes(), building).frames:
        pose = frame.wheels[0]
        if frame.scan is not None and hasattr(pose, "odom_from_base"):
            yield frame.scan, pose.odom_from_base


def scans_at(building: str, data: Path, trajectory: Path) -> Iterator[tuple[Scan, Pose2]]:
    """Yield every scan of a building's raw log with its pose in a trajectory of the mapper (TUM: stamp x y z qx qy qz qw).

    Raises:
        RecordingError: the log cannot be read.
        OSError: there is no raw log of this building, or no trajectory.
    """
    raw = {
        "intel": data / "lidar_intel" / "intel_first1088s.clf.gz",
        "fr079": data / "lidar_fr079" / "fr079_laser.clf.gz",
    }
    if building not in raw:
        raise OSError(f"there is no raw log of {building}")
    rows = np.loadtxt(trajectory, ndmin=2)
    theta = 2.0 * np.arctan2(rows[:, 6], rows[:, 7])
    mapped = {
        round(t * 1e6): Pose2(float(x), float(y), float(a)) for t, x, y, a in zip(*rows[:, :3].T, theta, strict=True)
    }
    for frame in read_carmen(raw[building].read_bytes(), building).frames:
        at = mapped.get(round(frame.stamp_ns / 1e3))
        if frame.scan is not None and at is not None:
            yield frame.scan, at


def in_labels_frame(building: str, data: Path, trajectory: Path, drive: DoorDrive) -> DoorDrive:
    """Return a drive in the frame of the labels: each doorway by the corrected and the mapped pose of the same scan, the
    nearest one to the doorway. Scans are the same if their ranges are."""
    corrected = {scan.ranges.tobytes(): pose for scan, pose in scans_of(building, data)}
    pairs = [
        (corrected[scan.ranges.tobytes()], pose)
        for scan, pose in scans_at(building, data, trajectory)
        if scan.ranges.tobytes() in corrected
    ]
    places = np.array([pose.array()[:2] for _, pose in pairs])

    def moved(pose: Pose2) -> Pose2:
        label, mapped = pairs[int(np.argmin(np.hypot(places[:, 0] - pose.x, places[:, 1] - pose.y)))]
        return label @ mapped.inverse() @ pose

    def all_moved(found: dict[int, list[tuple[Pose2, float]]]) -> dict[int, list[tuple[Pose2, float]]]:
        return {number: [(moved(pose), at) for pose, at in places] for number, places in found.items()}

    poses = np.array([moved(Pose2(*pose)).array() for pose in drive.poses])
    doorways = tuple(replace(door, pose=moved(door.pose)) for door in drive.doorways)
    return DoorDrive(doorways, all_moved(drive.offered), all_moved(drive.validated), drive.path, poses, drive.seconds)


def find_over_drive(scans: Iterator[tuple[Scan, Pose2]]) -> DoorDrive:
    """Return the doorways that the tracker finds, scan by scan, with its one setting."""
    tracker, before, stamp_ns = DoorwayTracker(), None, 0
    offered, validated = dict[int, list[tuple[Pose2, float]]](), dict[int, list[tuple[Pose2, float]]]()
    path, poses, seconds = [0.0], list[FloatArray](), list[float]()
    for scan, pose in scans:
        if before is not None:
            path.append(path[-1] + math.hypot(pose.x - before.x, pose.y - before.y))
        for _ in range(min(MOST_TICKS, round((scan.stamp_ns - stamp_ns) / TICK_NS) - 1)):
            tracker.work()  # control ticks between two scans
        before, stamp_ns = pose, scan.stamp_ns
        poses.append(pose.array())
        start = time.perf_counter()
        doorways = tracker.update(scan, pose, scan.stamp_ns)
        seconds.append(time.perf_counter() - start)
        for doorway in doorways:
            _note(offered, doorway, path[-1])
            if doorway.validated:
                _note(validated, doorway, path[-1])
    believed = tuple(doorway for doorway in tracker.doorways if doorway.validated)
    return DoorDrive(believed, offered, validated, np.array(path[: len(poses)]), np.array(poses), np.array(seconds))


def _note(found: dict[int, list[tuple[Pose2, float]]], doorway: Doorway, path: float) -> None:
    """Add where a doorway stands if it has moved by more than the blur of its evidence."""
    places = found.setdefault(doorway.number, [])
    if not places or math.hypot(doorway.pose.x - places[-1][0].x, doorway.pose.y - places[-1][0].y) > 0.02:
        places.append((doorway.pose, path))


def scorer(folder: Path) -> ModuleType:
    """Return the scorer that lies beside the labels in `folder`.

    Raises:
        OSError: there is none.
    """
    found = importlib.util.spec_from_file_location("score_doorways", folder / "score_doorways.py")
    if found is None or found.loader is None:
        raise OSError(f"{folder} holds no scorer")
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def found_rows(building: str, drive: DoorDrive) -> list[Json]:
    """Return the believed doorways as the scorer's rows."""
    return [
        {
            "building": building,
            "x": doorway.pose.x,
            "y": doorway.pose.y,
            "normal_deg": math.degrees(doorway.pose.theta),
            "width": doorway.width,
        }
        for doorway in drive.doorways
    ]


def write_rows(path: Path, rows: list[Json]) -> None:
    """Write rows of found doorways as the scorer reads them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, ["building", "x", "y", "normal_deg", "width"])
        writer.writeheader()
        writer.writerows(rows)


def seen_ahead(drive: DoorDrive, found: dict[int, list[tuple[Pose2, float]]], label: Json) -> tuple[float, int] | None:
    """Return how far [m of path] before the first pass a labelled doorway was found, and its number of identities.

    The pass is the nearest point of the first visit that counts. None if there is none; a doorway that was never found, or
    only after the pass, gives a distance below zero.
    """
    apart = np.hypot(drive.poses[:, 0] - label["x"], drive.poses[:, 1] - label["y"])
    near = np.flatnonzero(apart < VISIT_M)
    visits = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if len(near) else []
    passes = [drive.path[visit[np.argmin(apart[visit])]] for visit in visits]
    passed = next((at for at in passes if at >= RUN_UP_M), None)
    if passed is None:
        return None
    mine = [[at for pose, at in places if _matches(pose, label)] for places in found.values()]
    mine = [places for places in mine if places]
    return (passed - min(min(places) for places in mine) if mine else -math.inf), len(mine)


def _matches(pose: Pose2, label: Json) -> bool:
    turn = abs(math.remainder(math.degrees(pose.theta) - label["normal_deg"], 180.0))
    return math.hypot(pose.x - label["x"], pose.y - label["y"]) <= MATCHED_M and turn <= MATCHED_DEG
