"""Mapping of a recording: the recording becomes a map folder, or is joined to an existing one."""

from __future__ import annotations

import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from waychair import config
from waychair.config import setting
from waychair.errors import NoScans, SessionError
from waychair.files import remove, replacing_together, write_json
from waychair.maps.folders.depth_layer import save_depth_layer
from waychair.maps.folders.map_files import save_map
from waychair.offline.aids import checked_recording
from waychair.offline.checkpoints import Checkpoints, remove_checkpoint
from waychair.offline.depth_recording import (
    depth_report,
    live_from_pictures,
    mount_of_camera,
    see_pictures,
    warnings_of,
)
from waychair.offline.mapping_report import Cost, mapping_report, torn_warnings, write_mapping_page
from waychair.offline.memory_file import MEMORY, remove_memory
from waychair.offline.sessions import (
    SESSION,
    MapState,
    check_sensors,
    continue_map,
    load_state,
    save_state,
    state_of_map,
)
from waychair.recordings.recording import InputSettings, Recording, write_tum
from waychair.slam.frames.first_motion import start_index
from waychair.slam.frames.mount_check import mount_warnings
from waychair.slam.graph.graph_optimisation import write_g2o
from waychair.slam.mapping.appearance_settings import AppearanceSettings
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.types import Json, OccupancyGrid, Pose2, Pose3

if TYPE_CHECKING:
    from waychair.offline.appearance_mapping import MemoryBuilder
    from waychair.offline.camera_check import CheckedPictures

_LEAST_SCANS = 10  # a recording of fewer is no drive


@dataclass(frozen=True, slots=True)
class MappingSettings(LiveMappingSettings):
    """All settings of `waychair map`."""

    input: InputSettings = field(default_factory=InputSettings)
    checkpoint_interval: float = setting(
        20.0,
        "s",
        "time between checkpoints of mapping; larger: more is repeated after an interruption",
        low=0.0,
        high=1e6,
    )
    vision: Literal["on", "off"] = setting(
        "on", "", "loop closures by pictures; on: where there are pictures; off: loops are closed by scans alone"
    )
    appearance: AppearanceSettings = field(default_factory=AppearanceSettings)


@dataclass(frozen=True, slots=True)
class Mapping:
    """A mapped recording: the grid, the mapper's result, and the content of report.json.

    `depth` is the layer of the grid that only the camera has seen (`maps.folders.depth_layer`), None without depth images.
    """

    grid: OccupancyGrid
    result: MapperResult
    report: Json
    depth: OccupancyGrid | None = None
    state: MapState | None = None
    """The state from which a further drive can continue the map."""
    pictures: CheckedPictures | None = None
    """The recording with the pictures that were used, None where none were."""


def map_recording(
    recording: Recording,
    settings: MappingSettings,
    progress: Callable[[float], None] | None = None,
    *,
    keep_in: Path | None = None,
    reading_s: float = 0.0,
    checking: Callable[[float], None] | None = None,
) -> Mapping:
    """Map a whole recording; `progress` is called with the share of frames done.

    Before, `checking` is called with the share of the scans by which odometry and IMU are checked.

    With the folder `keep_in`, a stopped run resumes from its last checkpoint and gives the same map as an uninterrupted
    one; the checkpoint is removed when the map is saved. `reading_s` is the CPU time of reading, for the report.

    Frames before the first motion are left out, except the last scan before it, if the chair has an IMU
    (`first_motion`).

    Depth images are drawn after the scans, left out, or mapped instead of the scans, as the settings say. Unless vision
    is off, pictures also close loops, and their memory of places is saved in the folder; such a run cannot be resumed.

    Raises:
        NoScans: the recording has no frame with a scan.
        NoPictures: the map is to be made from depth images alone, and there is none, or no camera mount.
        OutputError: the folder cannot be written to.
    """
    started, cpu = time.perf_counter(), time.process_time()
    camera, amiss = mount_of_camera(recording, settings.depth)
    lens = _lens(recording, settings, camera)
    pictures = _checked_pictures(recording, settings, camera or lens)
    recording = recording if pictures is None else pictures.recording
    if settings.depth.use == "only":
        live = live_from_pictures(recording, settings, camera, progress)
        return _finished(live, recording, (started, cpu, reading_s), amiss, 0, pictures)
    checked = checked_recording(recording, settings.mapper.matching.range_max, checking)
    recording, amiss = checked.recording, [*checked.sentences, *amiss, *_too_short(recording)]
    recording = replace(recording, frames=recording.frames[start_index(recording.frames) :])
    live = LiveMapping(settings, recording.base_from_laser, base_from_camera=camera)
    live.seconds["checking"] = checked.seconds
    frames = [frame for frame in map(live.reckon, recording.frames) if frame.scan is not None]
    if not frames:
        raise NoScans(f"{recording.path} holds no laser scan, so no map can be made of it")
    builder = None if lens is None else _begun_memory(recording, settings.appearance, lens, keep_in)
    kept = None
    if keep_in is not None and builder is None:
        kept = Checkpoints(keep_in, recording, settings, settings.checkpoint_interval)
    mapper, first = (None if kept is None else kept.restored()) or (live.mapper, 0)
    live.resume(mapper, frames[:first])
    with nullcontext() if kept is None else kept.noted():
        for index in range(first, len(frames)):
            live.include(frames[index])
            if builder is not None:
                builder.follow(live.mapper, frames[index])
            if kept is not None:
                kept.offer(live.mapper, index + 1)
            if progress is not None:
                progress((index + 1) / len(frames))
    if camera is not None:
        amiss += see_pictures(live, recording)
    mapping = _finished(
        live=live,
        recording=recording,
        began=(started, cpu, reading_s),
        amiss=amiss,
        first=first,
        pictures=pictures,
        builder=builder,
    )
    mapping.report["health"] += checked.health()
    mapping.report["aids"] = checked.data()
    return replace(mapping, state=state_of_map(live, lens, _features(settings)))


def join_recording(
    recording: Recording,
    settings: MappingSettings,
    folder: Path,
    keep_in: Path,
    progress: Callable[[float], None] | None = None,
    *,
    reading_s: float = 0.0,
    checking: Callable[[float], None] | None = None,
) -> Mapping:
    """Map a recording as a further drive through the building of a map folder; return the map of both (see `sessions`).

    `progress` and `checking` as for `map_recording`.

    The memory of places is continued in `keep_in`, a copy of the folder; the folder itself is only read. A node with a
    link to an earlier one is removed once it leaves the short-term memory (`reduce_graph`), so that the number of nodes
    does not grow with the number of drives.

    Raises:
        NoScans: the recording has no frame with a scan.
        SessionError: the folder has no saved session, the drive was recorded by other sensors, or it never meets the
            map.
    """
    # here, since a map of scans alone has no need of them
    from waychair.offline.appearance_mapping import continue_memory, move_memory
    from waychair.slam.drive_joining import DriveJoiner

    started, cpu = time.perf_counter(), time.process_time()
    if settings.depth.use == "only":
        raise SessionError("a drive is joined to a map by its laser scans: leave out --depth only")
    checked = checked_recording(recording, settings.mapper.matching.range_max, checking)
    recording = checked.recording
    camera, amiss = mount_of_camera(recording, settings.depth)
    amiss = [*checked.sentences, *amiss]
    lens, state = _lens(recording, settings, camera), load_state(folder)
    check_sensors(state, recording.base_from_laser, settings, lens, _features(settings))
    lean = replace(settings.appearance, memory=replace(settings.appearance.memory, reduce_graph=True))
    settings = replace(settings, appearance=lean)
    pictures = _checked_pictures(recording, settings, camera or lens)
    recording = recording if pictures is None else pictures.recording
    start = _beginning(recording, settings, state, folder, lens)
    live = LiveMapping(settings, recording.base_from_laser, base_from_camera=camera)
    grid = continue_map(live, load_state(folder))
    mapper, known = live.mapper, len(live.mapper.keys)
    joiner = DriveJoiner(grid, mapper)
    if start is not None:
        mapper.begin_at(*start)
    builder = None if lens is None else continue_memory(recording, lean, lens, keep_in, known)
    count = len(recording.frames)
    for number, frame in enumerate(map(live.reckon, recording.frames)):
        if frame.scan is not None:
            live.include(frame)
            if builder is not None:
                builder.follow(mapper, frame)
            if start is None:
                joiner.follow(mapper, frame)
        if progress is not None:
            progress((number + 1) / count)
    mapper.end_searches()
    if not mapper.keys.reaches(mapper.frames[-1].key, known):
        raise SessionError("the drive ends without a connection to the map: record one that ends on mapped ground")
    if camera is not None:
        amiss += see_pictures(live, recording)
    mapping = _finished(
        live=live,
        recording=recording,
        began=(started, cpu, reading_s),
        amiss=amiss,
        first=0,
        pictures=pictures,
        builder=builder,
    )
    if builder is None:
        move_memory(keep_in, mapper)
    mapping.report["health"] += checked.health()
    mapping.report["aids"] = checked.data()
    mapping.report["session"] = {
        "number": live.scans.session + 1,
        "began_on_known_ground": start is not None,
        "key_scans_before": known,
        "key_scans_new": len(mapper.keys) - known,
    }
    return replace(mapping, state=state_of_map(live, lens, _features(settings)))


def _beginning(
    recording: Recording, settings: MappingSettings, state: MapState, folder: Path, lens: Pose3 | None
) -> tuple[int, Pose2] | None:
    """Return where the drive begins on the map, found by mapping it up to the first accepted loop closure."""
    from waychair.offline.appearance_mapping import continue_memory
    from waychair.slam.drive_joining import beginning

    scratch = LiveMapping(settings, recording.base_from_laser)
    grid, mapper = continue_map(scratch, state), state.mapper
    frames = [frame for frame in map(scratch.reckon, recording.frames) if frame.scan is not None]
    if not frames:
        raise NoScans(f"{recording.path} holds no laser scan, so it cannot be joined to a map")
    with tempfile.TemporaryDirectory() as work:
        if (folder / MEMORY).exists():
            shutil.copy(folder / MEMORY, work)
        builder = None
        if lens is not None:
            builder = continue_memory(recording, settings.appearance, lens, Path(work), len(mapper.keys))
        try:
            return beginning(
                mapper, grid, frames, lambda mapper, frame: builder.follow(mapper, frame) if builder else None
            )
        finally:
            if builder is not None:
                builder.appearance.memory.close()


def _too_short(recording: Recording) -> list[str]:
    """Return a warning about a recording with too few scans for a map of more than one view."""
    count = sum(frame.scan is not None for frame in recording.frames)
    if count >= _LEAST_SCANS:
        return []
    return [f"{recording.path} holds only {count} scans: the map shows what is seen from one place; record a drive"]


def _lens(recording: Recording, settings: MappingSettings, camera: Pose3 | None) -> Pose3 | None:
    """Return the mount of the camera for place recognition; None where there is none."""
    if settings.vision == "off":
        return None
    if settings.depth.use == "off":  # then the caller has not looked for the mount
        camera, _ = mount_of_camera(recording, replace(settings.depth, use="on"))
    return camera


def _checked_pictures(recording: Recording, settings: MappingSettings, mount: Pose3 | None) -> CheckedPictures | None:
    """Return the pictures as they are to be used, with the check of their camera; None where none are used."""
    if mount is None:
        return None
    from waychair.offline.camera_check import checked_pictures  # only pictures have need of it

    return checked_pictures(recording, settings.input.rgbd.register)


def _begun_memory(
    recording: Recording, settings: AppearanceSettings, lens: Pose3, folder: Path | None
) -> MemoryBuilder | None:
    from waychair.offline.appearance_mapping import begin_memory  # only pictures have need of it

    return begin_memory(recording, settings, lens, folder)


def _features(settings: MappingSettings) -> str:
    return settings.appearance.places.features.detector


def _finished(
    live: LiveMapping,
    recording: Recording,
    began: tuple[float, float, float],
    amiss: list[str],
    first: int,
    pictures: CheckedPictures | None,
    builder: MemoryBuilder | None = None,
) -> Mapping:
    """Return the settled map; `began`: wall clock and CPU time at the beginning, and the CPU time of reading [s]."""
    started, cpu, reading_s = began
    result = live.settle()
    memory = None
    if builder is not None:
        memory = builder.finish(live.mapper)
        live.seconds["vision"] = builder.seconds
        amiss = [*amiss, *builder.warnings]
    checked = None if pictures is None or pictures.check is None else pictures
    if checked is not None:
        live.seconds["camera"] = checked.seconds
        amiss = [*amiss, *checked.sentences()]
    stages = {"reading": reading_s, **live.seconds, **result.seconds}
    stages["total"] = time.process_time() - cpu + reading_s
    cost = Cost(stages, live.key_seconds, time.perf_counter() - started, peak_memory_mb())
    recording = replace(recording, warnings=(*recording.warnings, *amiss))
    mapping = _reported(live, result, recording, cost, first)
    if memory is not None:
        mapping.report["memory"] = memory
    if checked is not None:
        mapping.report["camera"] = checked.data()
    return replace(mapping, pictures=pictures)


def live_result(live: LiveMapping, name: Path, source: str) -> Mapping:
    """Return the settled map of a drive so far, with its report; `name` and `source` name the origin of the frames.

    Raises:
        NoScans: no frame with a scan has come yet.
    """
    result = live.settle()
    stages = {**live.seconds, **result.seconds}
    stages["total"] = sum(stages.values())
    stamps = result.trajectory.stamps_ns
    wall = float(stamps.max() - stamps.min()) * 1e-9
    cost = Cost(stages, live.key_seconds, wall, peak_memory_mb())
    return _reported(live, result, Recording(name, (), live.base_from_laser, source), cost, 0)


def _reported(live: LiveMapping, result: MapperResult, source: Recording, cost: Cost, resumed_at: int) -> Mapping:
    grid, depth = live.layered_grid()
    # a wrong mount also tears the map; its warning names the cause
    amiss = mount_warnings(live.odometry, result.drive_trajectory.poses, live.base_from_laser) or torn_warnings(result)
    left_out = [*([live.size_warning] if live.size_warning else []), *warnings_of(live.depth.counts, source.unread)]
    report = mapping_report(
        recording=source,
        warnings=[*source.warnings, *amiss, *left_out],
        result=result,
        grid=grid,
        cost=cost,
        resumed_at=resumed_at,
    )
    report["depth"] = depth_report(live.depth.counts, depth)
    return Mapping(grid, result, report, depth)


def save_mapping(folder: Path, mapping: Mapping, settings: LiveMappingSettings) -> None:
    """Write map.pgm, map.yaml, trajectory.tum, graph.g2o, config.yaml, report.json and report.html, all or none.

    With depth images also depth.pgm and depth.yaml; for a recording with scans session.npz, from which a further drive
    can continue. Other files of an earlier map are removed; its places and zones stay (see `map_folders`).

    Raises:
        OutputError: the folder cannot be written to.
    """
    with replacing_together(folder) as aside:
        write_tum(aside / "trajectory.tum", mapping.result.drive_trajectory)
        write_g2o(aside / "graph.g2o", mapping.result.key_poses, mapping.result.edges)
        config.save(settings, aside / "config.yaml")
        write_json(aside / "report.json", mapping.report)
        write_mapping_page(aside / "report.html", mapping.report, mapping.grid, mapping.result)
        save_depth_layer(aside, mapping.depth)
        save_map(aside, mapping.grid)
        if mapping.state is not None:
            save_state(aside, mapping.state)
    if "memory" not in mapping.report and "session" not in mapping.report:
        remove_memory(folder)
    if mapping.depth is None:
        save_depth_layer(folder, None)
    if mapping.state is None:
        remove(folder / SESSION)
    remove_checkpoint(folder)


def peak_memory_mb() -> float:
    """Return the largest resident memory of this process so far [MB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3
