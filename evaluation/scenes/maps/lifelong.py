"""Lifelong mapping of one floor with furniture that moves from session to session: does the map stay small and right?

Each session moves a part of the furniture, drives the floor's mapping route from another corner, and joins the drive to
the map. The figures are

- *nodes*: key scans of the map, against those of the first session.
- *health*: the share of scans with localisation OK when the new drive is localised on the map of the earlier sessions,
  so that some furniture has moved since the map was made.
- *ghosts*: occupied cells where a piece stood that was absent in this session and the one before, more than 0.2 m from
  anything solid now; as a share of the cells with which the removed pieces were drawn.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np

from evaluation.runs.simulated_frames import FrameGathering
from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import interpolate, rotation, transform_points
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import cells_from_points, cells_under, inside, occupied, points_from_cells
from waychair.maps.grid.distance_field import distance_field
from waychair.offline.mapping import Mapping, MappingSettings, join_recording, map_recording, save_mapping
from waychair.offline.sessions import replaced_folder
from waychair.recordings.recording import Recording
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.floor_plan import FloorPlan, PlanBox
from waychair.simulation.plan.plan_file import load_building
from waychair.simulation.plan.world import WORLDS, World, world_from_plan
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.slam.localising.localiser import LocalisationState, Localiser, LocaliserSettings
from waychair.slam.mapping.tracking import odometry_of, twist_of
from waychair.slam.odometry.dead_reckoning import DeadReckoning
from waychair.slam.trajectory_errors import truth_errors
from waychair.types import (
    BoolArray,
    Float32Array,
    FloatArray,
    Json,
    OccupancyGrid,
    Pose2,
    SensorFrame,
    Trajectory,
)

PIECES, MOVED = 12, 4
"""The number of movable pieces of furniture, and how many move between two sessions."""

_BESIDE_WAY, _ROUND_CORNER = 0.5, 0.95  # [m] kept free beside the axle's path, and round its corners
_CLEAR = 0.2  # [m]: an occupied cell farther from anything solid is a ghost


@dataclass(frozen=True, slots=True)
class LifelongSession:
    """A session: its world, its movable pieces, and the drive's frames with the true poses at the scans."""

    world: World
    pieces: tuple[PlanBox, ...]
    frames: tuple[SensorFrame, ...]
    truth: Trajectory


@dataclass(slots=True)
class Lifelong:
    """The sessions so far; `rows` are their figures."""

    folder: Path
    sessions: list[LifelongSession] = field(default_factory=list)
    rows: list[Json] = field(default_factory=list)
    drawn: dict[PlanBox, int] = field(default_factory=dict)
    """The number of cells with which each piece was drawn."""

    def add(self, drive: LifelongSession) -> None:
        """Join a session's drive to the map and score it.

        Raises:
            SessionError: the drive cannot be joined to the map.
        """
        health = 1.0 if not self.sessions else localisation_share(load_map(self.folder), self.sessions[0], drive)
        mapping = join_session(self.folder, drive, len(self.sessions))
        self.sessions.append(drive)
        errors = truth_errors(mapping.result.drive_trajectory, drive.truth)
        solid = distance_field(drive.world.grid).metres
        ghosts, gone = self._ghosts(mapping.grid, errors.truth_from_map, solid)
        for piece in drive.pieces:
            self.drawn[piece] = max(self.drawn.get(piece, 0), _cells_on(mapping.grid, errors.truth_from_map, piece))
        self.rows.append(
            {
                "session": len(self.sessions),
                "nodes": len(mapping.result.key_poses),
                "health_ok": round(health, 4),
                "ghosts": ghosts,
                "gone": gone,
                "ate_m": round(errors.rmse_m, 4),
                "known_m2": mapping.report["grid"]["known_m2"],
                "cpu_s": round(mapping.report["cpu_seconds"]["total"], 1),
            }
        )

    def figures(self) -> Json:
        """Return the figures over all sessions."""
        gone = sum(row["gone"] for row in self.rows)
        return {
            "sessions": len(self.rows),
            "nodes_first": self.rows[0]["nodes"],
            "nodes_last": self.rows[-1]["nodes"],
            "growth": round(self.rows[-1]["nodes"] / self.rows[0]["nodes"], 4),
            "health_ok_worst": min(row["health_ok"] for row in self.rows),
            "health_ok_mean": round(float(np.mean([row["health_ok"] for row in self.rows[1:] or self.rows])), 4),
            "ghost_cells": sum(row["ghosts"] for row in self.rows),
            "ghost_share": round(sum(row["ghosts"] for row in self.rows) / max(gone, 1), 4),
            "cells_of_what_was_moved": gone,
            "ate_m_worst": max(row["ate_m"] for row in self.rows),
        }

    def _ghosts(self, grid: OccupancyGrid, truth_from_map: Pose2, solid: Float32Array) -> tuple[int, int]:
        """Return the ghost cells of pieces absent for two sessions, and the cells that these pieces were drawn with."""
        if len(self.sessions) < 3:
            return 0, 0
        here = {piece for drive in self.sessions[-2:] for piece in drive.pieces}
        gone = {piece for drive in self.sessions[:-2] for piece in drive.pieces} - here
        world, found = self.sessions[-1].world.grid, 0
        for piece in gone:
            at = _occupied_on(grid, truth_from_map, piece)
            found += int((solid[tuple(cells_under(world, at).T)] > _CLEAR).sum())
        return found, sum(self.drawn[piece] for piece in gone)


def drive_sessions(name: str, count: int, seed: int, share: float = 1.0) -> Iterator[LifelongSession]:
    """Yield drives through a shipped floor with furniture that moves between two drives.

    `share` is the part of the mapping route that is driven. The whole route is driven round from the drive's start; of
    a part, only the section ahead of the start.
    """
    building = load_building(WORLDS / f"{name}.yaml")
    plan, rng = building.levels[0].plan, np.random.default_rng(seed)
    route = np.array(plan.routes["mapping"], float)
    route = route[: max(3, round(share * len(route)))]
    empty = world_from_plan(msgspec.structs.replace(plan, people=[]), building.name)
    driven = np.concatenate([route, route[:1]]) if share == 1.0 else route  # the closed loop
    loop = _closed_route(empty, route)
    pieces: list[PlanBox] = []
    for number in range(count):
        going = set(rng.permutation(PIECES)[:MOVED].tolist()) if number else set()
        pieces = [piece for k, piece in enumerate(pieces) if k not in going]
        pieces += placed_furniture(empty, driven, pieces, PIECES - len(pieces), rng)
        way = _from_corner(loop if number and share == 1.0 else route, number, share)
        yield _drive_session(plan, building.name, way, tuple(pieces), seed + 1000 * number)


def placed_furniture(
    world: World, route: FloatArray, others: Sequence[PlanBox], count: int, rng: np.random.Generator
) -> list[PlanBox]:
    """Return `count` more pieces in sight of the route (N, 2) [m], clear of the path, of each other and of solids."""
    room, made = distance_field(world.grid).metres, list[PlanBox]()
    way = _route_points(route)
    while len(made) < count:
        at = way[int(rng.integers(len(way)))] + rng.uniform(-2.5, 2.5, 2)
        length, width = rng.uniform(0.4, 1.0), rng.uniform(0.3, 0.5)
        yaw = float(rng.choice([0.0, math.pi / 2]) + rng.normal(0.0, 0.1))
        piece = PlanBox(tuple(at.tolist()), (float(length), float(width)), yaw, high=1.0)
        outline = _rectangle_points(piece)
        cells = cells_from_points(world.grid, outline)
        if not inside(world.grid, cells).all() or room[tuple(cells.T)].min() < 0.1:
            continue
        if not _is_visible(room, world.grid, way, at) or _least_distance(outline, way) < _BESIDE_WAY:
            continue
        if (
            _least_distance(outline, route) < _ROUND_CORNER
            or _least_distance(outline, [[world.start.x, world.start.y]]) < _ROUND_CORNER
        ):
            continue
        if any(math.dist(at, other.centre) < 1.2 for other in (*others, *made)):
            continue
        made.append(piece)
    return made


def join_session(folder: Path, drive: LifelongSession, number: int) -> Mapping:
    """Join a drive to the map in the folder, save the result there and return it."""
    settings = MappingSettings()
    recording = Recording(Path(f"session-{number + 1}"), drive.frames, CHAIR_A.base_from_laser, "simulated")
    if number == 0:
        mapping = map_recording(recording, settings)
        save_mapping(folder, mapping, settings)
        return mapping
    with replaced_folder(folder, folder) as aside:
        mapping = join_recording(recording, settings, folder, aside)
        save_mapping(aside, mapping, settings)
    return mapping


def localisation_share(grid: OccupancyGrid, first: LifelongSession, drive: LifelongSession, every: int = 2) -> float:
    """Return the share of scans with localisation OK for a chair that knows the drive's start on the map.

    The map's origin is the first pose of the first drive. Every `every`-th frame is used.
    """
    origin, start = (Pose2(*each.truth.poses[0].tolist()) for each in (first, drive))
    localiser = Localiser(grid, CHAIR_A.base_from_laser, origin.inverse() @ start, LocaliserSettings())
    reckoning, states = DeadReckoning(CHAIR_A), []
    for number, frame in enumerate(map(reckoning.update, drive.frames)):
        odometry = odometry_of(frame)
        if number % every or frame.scan is None or odometry is None:
            continue
        states.append(localiser.process(frame.scan, odometry.odom_from_base, twist_of(frame)).state)
    return sum(state is LocalisationState.OK for state in states) / len(states)


def _closed_route(world: World, route: FloatArray) -> FloatArray:
    """Return the route (N, 2) [m] for repeated rounds: without its end point if there is no space to turn there."""
    end = distance_field(world.grid).metres[tuple(cells_from_points(world.grid, route[-1:]).T)]
    return route[:-1] if end[0] < _ROUND_CORNER else route


def _from_corner(route: FloatArray, number: int, share: float) -> FloatArray:
    """Return the route from the session's corner on; the first session begins where the route does."""
    if share < 1.0:
        return route[number % max(1, len(route) // 3) :]
    first = 3 * number % (len(route) - 1)
    return np.concatenate([route[first:], route[: first + 1]]) if first else route


def _drive_session(
    plan: FloorPlan, building: str, way: FloatArray, pieces: tuple[PlanBox, ...], seed: int
) -> LifelongSession:
    """Return a drive along a path, from the plan's start if that is near, else from the path's first point."""
    start = Pose2(*plan.start)
    if math.dist((start.x, start.y), way[0]) > 0.1:
        ahead = next(point for point in way[1:] if math.dist(point, way[0]) > 0.1)
        (x, y), (dx, dy) = way[0].tolist(), (ahead - way[0]).tolist()
        start = Pose2(x, y, math.atan2(dy, dx))
    furnished = msgspec.structs.replace(plan, boxes=[*plan.boxes, *pieces], people=[])
    world = replace(world_from_plan(furnished, building), start=start)
    simulator = Simulator(world, CHAIR_A, SimulatorSettings(), seed)
    stamps, poses, frames, gathering = [simulator.now_ns], [simulator.truth()], list[SensorFrame](), FrameGathering()
    for message in follow(simulator, Follower(way, CHAIR_A.track, PlantSettings())):
        if simulator.now_ns > stamps[-1]:
            stamps.append(simulator.now_ns)
            poses.append(simulator.truth())
        if (frame := gathering.add(message)) is not None:
            frames.append(frame)
    at = np.array([frame.stamp_ns for frame in frames], np.int64)
    truth = Trajectory(at, np.array([_pose_at(stamp, stamps, poses) for stamp in at.tolist()]))
    return LifelongSession(world, pieces, tuple(frames), truth)


def _pose_at(stamp_ns: int, stamps: list[int], poses: list[Pose2]) -> FloatArray:
    """Return the true pose (3,) at a stamp, interpolated between the simulator's ticks."""
    after = min(max(int(np.searchsorted(stamps, stamp_ns)), 1), len(stamps) - 1)
    part = (stamp_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    return interpolate(poses[after - 1], poses[after], part).array()


def _route_points(route: FloatArray, step: float = 0.1) -> FloatArray:
    """Return points (M, 2) along the route's segments, at most `step` [m] apart."""
    legs = [
        a + (b - a) * np.linspace(0.0, 1.0, max(2, math.ceil(math.dist(a, b) / step)))[:, None]
        for a, b in itertools.pairwise(route)
    ]
    return np.concatenate(legs)


def _rectangle_points(piece: PlanBox, step: float = 0.05) -> FloatArray:
    """Return points (N, 2) [m] that cover the piece's rectangle."""
    x, y = (np.arange(-side / 2, side / 2 + step / 2, step) for side in piece.size)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    outline: FloatArray = points @ rotation(piece.yaw).T + np.array(piece.centre)
    return outline


def _least_distance(points: FloatArray, others: FloatArray | list[list[float]]) -> float:
    away = points[:, None] - np.asarray(others, float)[None]
    return float(np.hypot(away[..., 0], away[..., 1]).min())


def _is_visible(room: Float32Array, grid: OccupancyGrid, way: FloatArray, at: FloatArray) -> bool:
    """Return whether nothing solid lies between a point and the nearest point of the path."""
    nearest = way[int(np.argmin(np.hypot(*(way - at).T)))]
    line = nearest + (at - nearest) * np.linspace(0.0, 1.0, 60)[:, None]
    return bool((room[tuple(cells_from_points(grid, line).T)] > 0.0).all())


def _occupied_on(grid: OccupancyGrid, truth_from_map: Pose2, piece: PlanBox) -> FloatArray:
    """Return centres (N, 2) [m, world] of the map's occupied cells within a piece's rectangle, or a cell beside it."""
    cells = np.argwhere(occupied(grid))
    at = transform_points(truth_from_map, points_from_cells(grid, cells))
    local = np.abs((at - np.array(piece.centre)) @ rotation(piece.yaw))
    on: BoolArray = (local <= np.array(piece.size) / 2 + grid.resolution).all(axis=1)
    return at[on]


def _cells_on(grid: OccupancyGrid, truth_from_map: Pose2, piece: PlanBox) -> int:
    return len(_occupied_on(grid, truth_from_map, piece))
