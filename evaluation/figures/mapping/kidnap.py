"""The kidnapped-robot test: a chair that starts anywhere on its map relocalises by its lidar.

The map is made of the first 80 % of a recording; the starts lie in the last 20 %. The reference poses there come from
mapping the whole recording, aligned with the partial map by all common poses. So they are in the frame of that map, and
as good as it, since the tested scans close its loops. The recording's own poses (GMapping) are independent of waychair;
their distance to the reference is printed.
"""

from __future__ import annotations

import gzip
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evaluation.figures.mapping.logs import DATA
from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import arc, compose, interpolate, pose_from_array, transform_points, wrap_angle
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.maps.grid.occupancy import OccupancySettings, build_grid
from waychair.offline.mapping import MappingSettings, map_recording
from waychair.recordings.recording import read_recording
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.world import load_world
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.slam.localising.localiser import LocalisationState, Localiser, LocaliserSettings
from waychair.slam.mapping.tracking import odometry_of, twist_of
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.slam.scan.scan_points import motion_of_beams, scan_points
from waychair.trials.barn import upper_bound
from waychair.types import (
    BoolArray,
    FloatArray,
    Json,
    OccupancyGrid,
    Odometry,
    Pose2,
    Scan,
    SensorFrame,
    Twist,
    WheelTicks,
)

STARTS, LIMIT_M, SEED = 200, 3.0, 79
NEAR_M, NEAR_RAD = 0.3, math.radians(5.0)


@dataclass(frozen=True, slots=True)
class Split:
    """A map of the first part of a recording, the frames of the rest, their reference poses (N, 3) on that map, and
    which of them lie in the mapped area (N,)."""

    grid: OccupancyGrid
    base_from_laser: Pose2
    frames: tuple[SensorFrame, ...]
    truth: FloatArray
    mapped: BoolArray
    alignment_m: float


@dataclass(frozen=True, slots=True)
class KidnapOutcome:
    """The result of one start: whether the localiser reported OK, its errors [m], [rad] and distance driven [m] then,
    and the processor time of its slowest global search with the check of the candidates [s]."""

    said_ok: bool
    error_m: float
    error_rad: float
    way_m: float
    search_s: float

    @property
    def right(self) -> bool:
        """Whether the localiser reported OK near the reference."""
        return self.said_ok and self.error_m <= NEAR_M and self.error_rad <= NEAR_RAD

    @property
    def wrong(self) -> bool:
        """Whether the localiser reported OK away from the reference: the worst case."""
        return self.said_ok and not self.right


def split(path: Path, share: float = 0.8, until: float = 1.0) -> Split:
    """Map the first `share` of a recording, and the part up to `until` for the reference poses of the rest."""
    recording = read_recording(path)
    frames = tuple(frame for frame in recording.frames if frame.scan is not None)
    cut, frames = int(share * len(frames)), frames[: int(until * len(frames))]
    part = map_recording(replace(recording, frames=frames[:cut]), MappingSettings())
    whole = map_recording(replace(recording, frames=frames), MappingSettings()).result.trajectory.poses
    driven = part.result.trajectory.poses
    aligned = compose(alignment(whole[:cut], driven), whole)
    residual = float(np.hypot(*(aligned[:cut, :2] - driven[:, :2]).T).max())
    truth = aligned[cut:]
    mapped = in_mapped_area(part.grid, recording.base_from_laser, frames[cut:], truth, driven)
    return Split(part.grid, recording.base_from_laser, frames[cut:], truth, mapped, residual)


def alignment(from_poses: FloatArray, to_poses: FloatArray) -> FloatArray:
    """Return the rigid motion (3,) from positions (N, 3) to others by least squares (Umeyama 1991, no scale)."""
    a, b = from_poses[:, :2].mean(axis=0), to_poses[:, :2].mean(axis=0)
    p, q = from_poses[:, :2] - a, to_poses[:, :2] - b
    theta = math.atan2(float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum()), float((p * q).sum()))
    c, s = math.cos(theta), math.sin(theta)
    return np.array([b[0] - c * a[0] + s * a[1], b[1] - s * a[0] - c * a[1], theta])


def in_mapped_area(
    grid: OccupancyGrid, base_from_laser: Pose2, frames: Sequence[SensorFrame], truth: FloatArray, driven: FloatArray
) -> BoolArray:
    """Return (N,) whether a pose lies within 1 m of the mapping path and sees mostly (80 %) known space."""
    mapped = np.zeros(len(frames), bool)
    for k, frame in enumerate(frames):
        assert frame.scan is not None
        points = scan_points(frame.scan, base_from_laser, 20.0).points
        if len(points) == 0 or np.hypot(*(driven[:, :2] - truth[k, :2]).T).min() > 1.0:
            continue
        ends = transform_points(pose_from_array(truth[k]), points * (1.0 - 0.1 / np.hypot(*points.T))[:, None])
        cells = cells_from_points(grid, ends)
        on_grid = inside(grid, cells)
        mapped[k] = (grid.cells[tuple(cells[on_grid].T)] >= 0).sum() >= 0.8 * len(points)
    return mapped


def kidnapped(data: Split, start: int, settings: LocaliserSettings) -> KidnapOutcome:
    """Run one start without a pose, until OK, 3 m of driving, or the end of the data."""
    localiser = Localiser(data.grid, data.base_from_laser, None, settings)
    way, slowest = 0.0, 0.0
    for k in range(start, len(data.frames)):
        frame = data.frames[k]
        odometry = odometry_of(frame)
        assert frame.scan is not None
        assert odometry is not None
        way += math.dist(data.truth[k, :2], data.truth[k - 1, :2]) if k > start else 0.0
        if way > LIMIT_M:
            break
        began = time.process_time()
        found = localiser.process(frame.scan, odometry.odom_from_base, twist_of(frame))
        slowest = max(slowest, time.process_time() - began)
        if found.state is LocalisationState.OK:
            pose, true = found.map_from_base, data.truth[k]
            away, turned = math.dist((pose.x, pose.y), true[:2]), abs(wrap_angle(pose.theta - float(true[2])))
            return KidnapOutcome(True, away, turned, way, slowest)
    return KidnapOutcome(False, math.inf, math.inf, way, slowest)


def fr079(out: Path) -> Json:
    """Freiburg 079: 200 seeded starts in the mapped area, each followed by 3 m of driving, and 50 outside of it.

    Starts with less than 3 m of data left are not drawn. Starts outside the mapped area, at least 2 m from the mapping
    path, have no right answer there; they show the false positives on unknown places.
    """
    data = split(DATA / "lidar_fr079" / "fr079_laser.clf.gz")
    settings, rng = LocaliserSettings(), np.random.default_rng(SEED)
    pool = np.flatnonzero(data.mapped & (_way_left(data.truth) >= LIMIT_M))
    kidnapped(data, int(pool[0]), settings)  # compile the kernels
    outcomes = [kidnapped(data, int(k), settings) for k in rng.choice(pool, STARTS, replace=len(pool) < STARTS)]
    elsewhere = rng.choice(np.flatnonzero(~data.mapped & (_way_left(data.truth) >= LIMIT_M)), 50, replace=False)
    outside = [kidnapped(data, int(k), settings) for k in elsewhere]
    figures = _figures(outcomes)
    wrong_outside = sum(outcome.wrong for outcome in outside)
    return {
        "passed": figures["right_share"] >= 0.95
        and figures["wrong_ok"] == wrong_outside == 0
        and figures["search_s_max"] <= 0.5,
        **figures,
        "distinct_places_drawn_from": len(pool),
        "outside_starts": len(outside),
        "outside_ok": sum(outcome.said_ok for outcome in outside),
        "outside_wrong_ok": wrong_outside,
        "alignment_max_m": round(data.alignment_m, 4),
        "gmapping_to_truth_mean_m": _gmapping_difference(data),
    }


def simulated(out: Path) -> Json:
    """Worlds with identical rooms and with a real floor's corridors: no wrong pose is accepted."""
    figures = {}
    for world in ("alias", "second_floor"):
        data = simulated_split(world)
        outcomes = [
            kidnapped(data, int(k), LocaliserSettings())
            for k in np.linspace(0, np.flatnonzero(_way_left(data.truth) >= LIMIT_M)[-1], 40)
        ]
        figures[world] = _figures(outcomes)
    return {"passed": all(world["wrong_ok"] == 0 for world in figures.values()), **figures}


def simulated_split(name: str) -> Split:
    """Return a world's map by the true poses of one drive of its mapping route, and the frames of another drive."""
    frames, truth = simulated_drive(name, seed=1)
    scans = [frame.scan for frame in frames[::3] if frame.scan is not None]
    mount = CHAIR_A.base_from_laser
    sweeps = np.array([motion_of_beams(f.scan, twist_of(f) or Twist())[-1] for f in frames[::3] if f.scan is not None])
    poses = truth[::3]
    last = compose(compose(poses, sweeps), mount.array())
    grid = build_grid(compose(poses, mount.array()), scans, OccupancySettings(), last)
    others, truth = simulated_drive(name, seed=2)
    return Split(grid, mount, others, truth, np.ones(len(others), bool), 0.0)


def simulated_drive(name: str, seed: int) -> tuple[tuple[SensorFrame, ...], FloatArray]:
    """Return scans with wheel odometry along a world's mapping route, without people, and their true poses (N, 3)."""
    world = load_world(name).without_people()
    simulator, odometry = Simulator(world, CHAIR_A, SimulatorSettings(), seed), OdometryFilter(CHAIR_A)
    reading, scans, stamps, poses = Odometry(0, Pose2()), [], [simulator.now_ns], [simulator.truth()]
    for message in follow(simulator, Follower(world.route(), CHAIR_A.track, PlantSettings())):
        if simulator.now_ns > stamps[-1]:
            stamps.append(simulator.now_ns)
            poses.append(simulator.truth())
        if isinstance(message, WheelTicks):
            reading = odometry.update_wheels(message)
        elif isinstance(message, Scan):
            late = (message.stamp_ns - reading.stamp_ns) * 1e-9
            at_scan = reading.odom_from_base @ arc(reading.twist.v * late, reading.twist.omega * late)
            scans.append((message, replace(reading, stamp_ns=message.stamp_ns, odom_from_base=at_scan)))
    frames = tuple(SensorFrame(scan.stamp_ns, scan, wheels=(own,)) for scan, own in scans)
    after = np.clip(np.searchsorted(stamps, [frame.stamp_ns for frame in frames]), 1, len(stamps) - 1)
    truth = [
        interpolate(
            poses[k - 1], poses[k], (frame.stamp_ns - stamps[k - 1]) / (stamps[k] - stamps[k - 1])
        ).array()
        for k, frame in zip(after, frames, strict=True)
    ]  # fmt: skip
    return frames, np.array(truth)


def _way_left(truth: FloatArray) -> FloatArray:
    """Return the distances (N,) [m] along the path from each pose to the end."""
    steps = np.hypot(*np.diff(truth[:, :2], axis=0).T)
    left: FloatArray = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    return left


def _figures(outcomes: Sequence[KidnapOutcome]) -> Json:
    count, wrong = len(outcomes), sum(outcome.wrong for outcome in outcomes)
    ok = [outcome for outcome in outcomes if outcome.said_ok]
    return {
        "starts": count,
        "right_share": round(sum(outcome.right for outcome in outcomes) / count, 4),
        "wrong_ok": wrong,
        "wrong_ok_rate_95_percent_bound": round(upper_bound(wrong, count), 4),
        "undecided": count - len(ok),
        "error_m_median": round(float(np.median([outcome.error_m for outcome in ok])), 4) if ok else None,
        "error_m_max": round(max(outcome.error_m for outcome in ok), 4) if ok else None,
        "way_m_median": round(float(np.median([outcome.way_m for outcome in ok])), 3) if ok else None,
        "search_s_median": round(float(np.median([outcome.search_s for outcome in outcomes])), 3),
        "search_s_max": round(max(outcome.search_s for outcome in outcomes), 3),
    }


def _gmapping_difference(data: Split) -> float:
    """Return the mean distance [m] of the shipped GMapping poses to the reference, aligned over the scored part."""
    with gzip.open(DATA / "lidar_fr079" / "fr079_gmapping_poses.txt.gz", "rt") as file:
        poses = np.loadtxt(file)[-len(data.truth) :, 1:4]
    moved = compose(alignment(poses, data.truth), poses)
    return round(float(np.hypot(*(moved[:, :2] - data.truth[:, :2]).T).mean()), 4)
