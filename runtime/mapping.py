"""A recording becomes a map folder: read, map, draw the grid, write everything at once."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from waychair import config
from waychair.config import Settings
from waychair.errors import NoScans
from waychair.files import write_json
from waychair.geometry import compose
from waychair.maps.map_files import save_map
from waychair.maps.occupancy import OccupancySettings, build_grid
from waychair.recording import Recording, write_tum
from waychair.slam.graph import EdgeKind, write_g2o
from waychair.slam.mapper import Mapper, MapperResult, MapperSettings, twist_of
from waychair.slam.scan_points import motion_of_beams
from waychair.types import Json, OccupancyGrid, Twist


@dataclass(frozen=True, slots=True)
class MappingSettings(Settings):
    """Everything `waychair map` can be told in its configuration file."""

    mapper: MapperSettings = field(default_factory=MapperSettings)
    grid: OccupancySettings = field(default_factory=OccupancySettings)


@dataclass(frozen=True, slots=True)
class Mapping:
    """A mapped recording: the grid, the mapper's result, and the report as it is written to report.json."""

    grid: OccupancyGrid
    result: MapperResult
    report: Json


def map_recording(
    recording: Recording, settings: MappingSettings, progress: Callable[[float], None] | None = None
) -> Mapping:
    """Maps a whole recording; `progress` is called with the share of frames done.

    Raises:
        NoScans: the recording has no frame with a scan.
    """
    frames = [frame for frame in recording.frames if frame.scan is not None]
    if not frames:
        raise NoScans(f"{recording.path} holds no laser scan, so no map can be made of it")
    started, cpu = time.perf_counter(), time.process_time()
    mapper = Mapper(settings.mapper, recording.base_from_laser)
    for index, frame in enumerate(frames):
        mapper.process(frame)
        if progress is not None:
            progress((index + 1) / len(frames))
    result = mapper.result()
    grid_started = time.process_time()
    mount, keys = recording.base_from_laser.array(), [frames[index] for index in result.key_frames]
    scans = [frame.scan for frame in keys if frame.scan is not None]
    sweeps = [motion_of_beams(scan, twist_of(frame) or Twist())[-1] for scan, frame in zip(scans, keys, strict=True)]
    last = compose(compose(result.key_poses, np.array(sweeps)), mount)
    grid = build_grid(compose(result.key_poses, mount), scans, settings.grid, last)
    seconds = {**result.seconds, "grid": time.process_time() - grid_started, "total": time.process_time() - cpu}
    report = _report(recording, result, grid, seconds, time.perf_counter() - started)
    return Mapping(grid, result, report)


def save_mapping(folder: Path, mapping: Mapping, settings: MappingSettings) -> None:
    """Writes map.pgm, map.yaml, trajectory.tum, graph.g2o, config.yaml and report.json, each whole or not at all.

    Raises:
        OutputError: the folder cannot be written to.
    """
    write_tum(folder / "trajectory.tum", mapping.result.trajectory)
    write_g2o(folder / "graph.g2o", mapping.result.key_poses, mapping.result.edges)
    config.save(settings, folder / "config.yaml")
    write_json(folder / "report.json", mapping.report)
    save_map(folder, mapping.grid)


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far [MB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3


def _report(
    recording: Recording, result: MapperResult, grid: OccupancyGrid, seconds: dict[str, float], wall: float
) -> Json:
    poses, stamps = result.trajectory.poses, result.trajectory.stamps_ns
    kinds = [edge.kind for edge in result.edges]
    return {
        "input": str(recording.path),
        "source": recording.source,
        "warnings": list(recording.warnings),
        "frames": len(stamps),
        "duration_s": round(float(stamps.max() - stamps.min()) * 1e-9, 3),
        "distance_m": round(float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()), 3),
        "key_scans": len(result.key_poses),
        "edges": {kind.value: kinds.count(kind) for kind in EdgeKind},
        "counts": result.counts,
        "grid": {
            "width": grid.cells.shape[1],
            "height": grid.cells.shape[0],
            "resolution_m": grid.resolution,
            "known_m2": round(float((grid.cells >= 0).sum()) * grid.resolution**2, 2),
        },
        "cpu_seconds": {stage: round(value, 3) for stage, value in seconds.items()},
        "wall_seconds": round(wall, 3),
        "peak_memory_mb": round(peak_memory_mb(), 1),
    }
