"""A recording becomes a map folder: read, map, draw the grid, write everything at once."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from waychair import config
from waychair.calibration.chair import CHAIR_A
from waychair.config import Settings, setting
from waychair.errors import NoScans
from waychair.files import write_json
from waychair.geometry import compose
from waychair.maps.map_files import save_map
from waychair.maps.occupancy import OccupancySettings, build_grid
from waychair.recording import InputSettings, Recording, write_tum
from waychair.runtime.mapping_report import Cost, mapping_report, torn_warnings, write_mapping_page
from waychair.runtime.resuming import Checkpoints, remove_checkpoint
from waychair.slam.dead_reckoning import DeadReckoning
from waychair.slam.graph import write_g2o
from waychair.slam.mapper import Mapper, MapperResult, MapperSettings, twist_of
from waychair.slam.mount_check import mount_warnings
from waychair.slam.odometry_model import OdometrySettings
from waychair.slam.scan_points import motion_of_beams
from waychair.types import Json, OccupancyGrid, SensorFrame, Twist


@dataclass(frozen=True, slots=True)
class MappingSettings(Settings):
    """Everything `waychair map` can be told in its configuration file."""

    input: InputSettings = field(default_factory=InputSettings)
    laser_height: float = setting(
        0.30, "m", "lidar above the floor; tells which beams meet it on a ramp", low=0.02, high=3.0
    )
    odometry: OdometrySettings = field(default_factory=OdometrySettings)
    mapper: MapperSettings = field(default_factory=MapperSettings)
    grid: OccupancySettings = field(default_factory=OccupancySettings)
    checkpoint_interval: float = setting(
        20.0, "s", "between the states kept aside, from which a stopped run goes on", low=0.0, high=1e6
    )


@dataclass(frozen=True, slots=True)
class Mapping:
    """A mapped recording: the grid, the mapper's result, and the report as it is written to report.json."""

    grid: OccupancyGrid
    result: MapperResult
    report: Json


def map_recording(
    recording: Recording,
    settings: MappingSettings,
    progress: Callable[[float], None] | None = None,
    *,
    keep_in: Path | None = None,
    reading_s: float = 0.0,
) -> Mapping:
    """Maps a whole recording; `progress` is called with the share of frames done.

    With a folder to keep its state in, a run that was stopped goes on where it was last kept, and gives what it would
    have given; the state is removed when the map is saved. `reading_s` is the CPU time that reading took, for the report.

    Raises:
        NoScans: the recording has no frame with a scan.
        OutputError: the folder cannot be written to.
    """
    started, cpu = time.perf_counter(), time.process_time()
    frames = _reckoned(recording, settings)
    if not frames:
        raise NoScans(f"{recording.path} holds no laser scan, so no map can be made of it")
    reckoned = time.process_time()
    kept = None if keep_in is None else Checkpoints(keep_in, recording, settings, settings.checkpoint_interval)
    mapper, first = (None if kept is None else kept.restored()) or (
        Mapper(settings.mapper, recording.base_from_laser),
        0,
    )
    key_seconds = []
    with nullcontext() if kept is None else kept.noted():
        for index in range(first, len(frames)):
            before, matches = time.process_time(), mapper.counts["matches"]
            mapper.process(frames[index])
            if mapper.counts["matches"] > matches:
                key_seconds.append(time.process_time() - before)
            if kept is not None:
                kept.offer(mapper, index + 1)
            if progress is not None:
                progress((index + 1) / len(frames))
    result = mapper.result()
    mapped = time.process_time()
    grid = _grid(frames, result, recording, settings.grid)
    now = time.process_time()
    stages = {
        "reading": reading_s,
        "odometry": reckoned - cpu,
        **result.seconds,
        "grid": now - mapped,
        "total": now - cpu + reading_s,
    }
    # a wrong mount tears the map as well, and is what has to be mended
    amiss = mount_warnings(frames, result.trajectory.poses, recording.base_from_laser) or torn_warnings(result)
    warnings = [*recording.warnings, *amiss]
    cost = Cost(stages, key_seconds, time.perf_counter() - started, peak_memory_mb())
    report = mapping_report(recording, warnings, result, grid, cost, first)
    return Mapping(grid, result, report)


def _reckoned(recording: Recording, settings: MappingSettings) -> list[SensorFrame]:
    """The frames with a scan, each with the odometry that wheels and IMU come to, its scan levelled."""
    mount = recording.base_from_laser
    body = replace(CHAIR_A, laser_x=mount.x, laser_y=mount.y, laser_theta=mount.theta, laser_z=settings.laser_height)
    reckoning = DeadReckoning(body, settings.odometry)
    return [frame for frame in map(reckoning.update, recording.frames) if frame.scan is not None]


def _grid(
    frames: list[SensorFrame], result: MapperResult, recording: Recording, settings: OccupancySettings
) -> OccupancyGrid:
    """The scans of the map drawn at their optimised poses, each beam from where the laser was at its time."""
    mount, drawn = recording.base_from_laser.array(), [frames[index] for index in result.scan_frames]
    poses = result.trajectory.poses[list(result.scan_frames)]
    scans = [frame.scan for frame in drawn if frame.scan is not None]
    sweeps = [motion_of_beams(scan, twist_of(frame) or Twist())[-1] for scan, frame in zip(scans, drawn, strict=True)]
    return build_grid(compose(poses, mount), scans, settings, compose(compose(poses, np.array(sweeps)), mount))


def save_mapping(folder: Path, mapping: Mapping, settings: MappingSettings) -> None:
    """Writes map.pgm, map.yaml, trajectory.tum, graph.g2o, config.yaml, report.json and report.html, each whole or not.

    Raises:
        OutputError: the folder cannot be written to.
    """
    write_tum(folder / "trajectory.tum", mapping.result.trajectory)
    write_g2o(folder / "graph.g2o", mapping.result.key_poses, mapping.result.edges)
    config.save(settings, folder / "config.yaml")
    write_json(folder / "report.json", mapping.report)
    write_mapping_page(folder / "report.html", mapping.report, mapping.grid, mapping.result)
    save_map(folder, mapping.grid)
    remove_checkpoint(folder)


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far [MB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3
