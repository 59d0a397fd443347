"""Mapping of a folder of colour and depth images: visual odometry with loop closures gives a trajectory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from waychair import __version__, config
from waychair.config import Settings
from waychair.errors import NoPictures
from waychair.files import write_json
from waychair.offline.appearance_mapping import memory_report, new_memory
from waychair.offline.camera_check import CheckedPictures, checked_pictures
from waychair.offline.mapping import peak_memory_mb
from waychair.offline.memory_file import remove_memory
from waychair.recordings.picture_pairs import LEAST_KEPT
from waychair.recordings.recording import InputSettings, Recording, write_tum
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.rgbd.rgbd_mapper import NEAR_DISTANCE, RgbdMap, RgbdMapper, RgbdMapperSettings
from waychair.types import Json, RgbdFrame


@dataclass(frozen=True, slots=True)
class RgbdMappingSettings(Settings):
    """All settings of `waychair map` for a folder of images."""

    input: InputSettings = field(default_factory=InputSettings)
    rgbd: RgbdMapperSettings = field(default_factory=RgbdMapperSettings)


@dataclass(frozen=True, slots=True)
class RgbdMapping:
    """The map of a recording, the content of its report.json, and the pictures that it is made of."""

    result: RgbdMap
    report: Json
    pictures: CheckedPictures


def map_pictures(
    recording: Recording,
    settings: RgbdMappingSettings,
    progress: Callable[[float], None] | None = None,
    keep_in: Path | None = None,
) -> RgbdMapping:
    """Estimate the pose of every usable image; unusable ones are left out and counted by reason.

    The memory of places is written in the folder `keep_in` during the mapping, or kept in RAM without one.

    Raises:
        NoPictures: no image has depth and enough features to begin a map.
        OutputError: the folder cannot be written to.
    """
    started, cpu = time.perf_counter(), time.process_time()
    memory = NodeMemory(settings.rgbd.memory) if keep_in is None else new_memory(keep_in, settings.rgbd.memory)
    mapper = RgbdMapper(settings.rgbd, memory)
    checked = checked_pictures(recording, settings.input.rgbd.register)
    recording = checked.recording
    spent: list[float] = []
    for frame in _in_order(recording):
        before = time.process_time()
        mapper.process(frame)
        spent.append(time.process_time() - before)
        if progress is not None:
            progress(min(1.0, len(spent) / max(recording.picture_count, 1)))
    mapper.finish()
    result, told = mapper.result(), memory_report(mapper.places.places, NEAR_DISTANCE)
    memory.close()
    if len(result.trajectory.stamps_ns) == 0:
        if keep_in is not None:
            remove_memory(keep_in)
        why = "; ".join(f"{reason}: {count}" for reason, count in {**recording.unread, **result.states}.items())
        raise NoPictures(f"no pose can be estimated from the pictures of {recording.path} ({why or 'there are none'})")
    report = _report(recording, result, spent, time.process_time() - cpu, time.perf_counter() - started)
    report["camera"], report["cpu_seconds"]["camera"] = checked.data(), round(checked.seconds, 3)
    report["warnings"] += checked.sentences()
    report["warnings"] += [*memory.store.notes, *([] if memory.store.fault is None else [str(memory.store.fault)])]
    return RgbdMapping(result, {**report, "memory": told}, checked)


def save_pictures_map(folder: Path, mapping: RgbdMapping, settings: RgbdMappingSettings) -> None:
    """Write trajectory.tum, config.yaml and report.json, each atomically; `map_pictures` has written memory.db.

    Raises:
        OutputError: the folder cannot be written to.
    """
    write_tum(folder / "trajectory.tum", mapping.result.trajectory)
    config.save(settings, folder / "config.yaml")
    write_json(folder / "report.json", mapping.report)


def refuse_mostly_lost(report: Json, folder: Path) -> None:
    """Refuse a map from which most of the pictures are missing.

    Raises:
        NoPictures: fewer than half of the listed pictures have a pose.
    """
    if report["placed"] >= LEAST_KEPT * report["listed"]:
        return
    reasons = {**report["unread"], **report["states"]}
    why = ", ".join(f"{reason}: {count}" for reason, count in reasons.items() if reason != "placed")
    raise NoPictures(
        f"only {report['placed']} of {report['listed']} pictures of {report['input']} could be placed ({why}); {folder} holds "
        "their trajectory, but most of the drive is missing from it"
    )


def _in_order(recording: Recording) -> Iterator[RgbdFrame]:
    """Yield the images in order of time; count those that are not later than the one before."""
    latest: int | None = None
    for frame in recording.pictures():
        if latest is not None and frame.stamp_ns <= latest:
            recording.unread["picture is not later than the one before"] += 1
            continue
        latest = frame.stamp_ns
        yield frame


def _report(recording: Recording, result: RgbdMap, spent: list[float], cpu_s: float, wall_s: float) -> Json:
    stamps, positions = result.trajectory.stamps_ns, result.trajectory.positions
    pieces = len(set(result.pieces))
    warnings = [f"{count} pictures left out: {reason}" for reason, count in recording.unread.items()]
    if pieces > 1:
        warnings.append(f"the map is in {pieces} unconnected pieces: record a drive that returns to known places")
    milliseconds = 1e3 * np.array(spent[1:] or spent)  # the first also compiles the kernels
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return {
        "waychair": __version__,
        "input": str(recording.path),
        "source": recording.source,
        "frame": "the optical frame (x right, y down, z forward) of the first picture",
        "warnings": [*recording.warnings, *warnings],
        "pictures": len(spent),
        "listed": max(recording.listed, len(spent)),
        "placed": len(stamps),
        "states": result.states,
        "unread": dict(recording.unread),
        "duration_s": round(float(stamps[-1] - stamps[0]) * 1e-9, 3),
        "times_real_time": round(float(stamps[-1] - stamps[0]) * 1e-9 / max(wall_s, 1e-3), 1),
        "distance_m": round(float(steps.sum()), 3),
        "pieces": pieces,
        "counts": result.counts,
        "loops": [{"from": loop.i, "to": loop.j, "inliers": loop.inliers} for loop in result.loops],
        "loop_search": {
            "proposed": result.counts["proposed"],
            "verified": result.counts["confirmed"] + len(result.loops) + len(result.rejected),
            "closed": len(result.loops),
            "rejected": len(result.rejected),
        },
        "rejected_loops": list(result.rejected),
        "frame_ms": {
            "mean": round(float(milliseconds.mean()), 2),
            "p95": round(float(np.quantile(milliseconds, 0.95)), 2),
            "max": round(float(milliseconds.max()), 2),
        },
        "cpu_seconds": {**{name: round(value, 3) for name, value in result.seconds.items()}, "total": round(cpu_s, 3)},
        "wall_seconds": round(wall_s, 3),
        "peak_memory_mb": round(peak_memory_mb(), 1),
    }
