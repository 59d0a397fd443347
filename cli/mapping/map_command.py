"""`waychair map`: one recording becomes a map folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from waychair.cli.options.recording_options import StageProgress
    from waychair.offline.mapping import MappingSettings

from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.recording_options import RecordingOptions, stages
from waychair.types import Json

AS_RECORDED = RecordingOptions()


def map_command(
    recordings: tuple[Path, ...],
    /,
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    session: Path | None = None,
    reading: RecordingOptions = AS_RECORDED,
    config: Path | None = None,
    depth: Literal["on", "off", "only"] | None = None,
    vision: Literal["on", "off"] | None = None,
    resolution: float | None = None,
    quiet: bool = False,
) -> None:
    """Make a map of a recording.

    Reads CARMEN logs (.clf, .log) and CoreSLAM logs (.dat), ROS 1 bags, and ROS 2 bags (folder, .mcap, .db3), packed or
    not (.gz, .bz2, .xz, .zst), recognised by their content; several files are the parts of one bag. Writes map.yaml, map.pgm, trajectory.tum, graph.g2o, config.yaml, report.json,
    report.html, and session.npz for further drives. After an interruption the same command resumes near that point.

    Depth pictures in a bag add obstacles that the lidar does not see: table tops, low objects and drop-offs. depth.yaml
    and depth.pgm mark their cells.

    Depth pictures also close loops by appearance. memory.db holds the places; an interrupted run then restarts.

    From a folder of colour and depth pictures (TUM RGB-D's rgb/ and depth/, or frame-N.color and frame-N.depth.png) it
    writes trajectory.tum (3D poses of the camera's optical frame), memory.db, config.yaml and report.json. It fails
    where fewer than half of the pictures can be placed.

    Parameters
    ----------
    recordings
        The log or bag, a folder that holds it, or the files of one bag that was recorded in parts.
    out
        Folder for the map; with --session the default is the session's folder. A folder with another map that has drawn
        places or zones is refused.
    session
        Folder of an earlier map; the recording is a further drive that is joined to it. If the two have no common
        place, or the command is stopped, the map does not change.
    config
        YAML file with settings that differ from the defaults (see `waychair config map`).
    depth
        Use of a bag's depth pictures: on (besides the lidar), off, or only (instead of the lidar).
    vision
        Recognise places by a bag's depth pictures and close loops with them.
    resolution
        Side of the map's cells, in metres; default that of --config, else 0.05. A site that is too large for them is
        drawn with larger ones, with a warning.
    quiet
        Print nothing but errors.
    """
    from waychair.errors import OutputError, SessionError
    from waychair.offline.sessions import session_folder
    from waychair.recordings.recording_files import pictures_folder

    known = None if session is None else session_folder(session)
    out = out or known
    if out is None:
        raise OutputError("the map needs a folder: give --out FOLDER")
    if pictures_folder(recordings):
        if known is not None:
            raise SessionError("pictures without a lidar cannot be joined to a map: omit --session")
        if resolution is not None:
            raise BadArgument("pictures without a lidar make no grid: omit --resolution")
        _map_pictures(recordings, out, reading, config, quiet)
        return
    settings = _mapping_settings(config, reading, depth, vision, resolution)
    with stages(quiet) as progress:
        progress.warn(reading.without_pictures())
        report = _map_scans(recordings, out, known, settings, progress)
        if "camera" not in report:
            progress.warn(reading.without_colour_and_depth())
    if not quiet:
        print(_map_line(report, out))


def _mapping_settings(
    config: Path | None,
    reading: RecordingOptions,
    depth: Literal["on", "off", "only"] | None,
    vision: Literal["on", "off"] | None,
    resolution: float | None,
) -> MappingSettings:
    """Return the settings of the file, with the command's options over them.

    Raises:
        BadArgument: the resolution is impossible.
    """
    from dataclasses import replace

    from waychair.cli.options.configuration import load_recording_settings
    from waychair.errors import ConfigError
    from waychair.offline.mapping import MappingSettings

    settings = load_recording_settings(config, MappingSettings)
    try:
        grid = settings.grid if resolution is None else replace(settings.grid, resolution=resolution)
    except ConfigError as error:
        raise BadArgument(f"--{error}") from error
    return replace(
        settings,
        grid=grid,
        input=reading.over(settings.input),
        depth=settings.depth if depth is None else replace(settings.depth, use=depth),
        vision=settings.vision if vision is None else vision,
    )


def _map_scans(
    recordings: tuple[Path, ...], out: Path, known: Path | None, settings: MappingSettings, progress: StageProgress
) -> Json:
    """Make the map of a recording in `out`, or join it to the map in the folder `known`; return the map's report."""
    from waychair.offline.map_folders import refuse_drawn, refuse_other
    from waychair.offline.mapping import join_recording, map_recording, save_mapping
    from waychair.offline.sessions import replaced_folder

    started = time.process_time()
    log = progress.read(recordings, settings.input)
    reading_s = time.process_time() - started
    if known is None:
        refuse_other(out, log.frames, settings)
        mapping = map_recording(
            recording=log,
            settings=settings,
            progress=progress.stage("mapping"),
            keep_in=out,
            reading_s=reading_s,
            checking=progress.stage("checking"),
        )
        save_mapping(out, mapping, settings)
    else:
        if out.resolve() != known.resolve():
            refuse_drawn(out, "choose another folder with --out")
        with replaced_folder(out, known) as aside:
            mapping = join_recording(
                recording=log,
                settings=settings,
                folder=known,
                keep_in=aside,
                progress=progress.stage("joining"),
                reading_s=reading_s,
                checking=progress.stage("checking"),
            )
            save_mapping(aside, mapping, settings)
    progress.warn(mapping.report["warnings"][len(log.warnings) :])
    return mapping.report


def _map_line(report: Json, out: Path) -> str:
    """Return the summary of a map."""
    return (
        f"{report['frames']} scans over {report['distance_m']:.0f} m, {report['key_scans']} key scans, "
        f"{report['edges']['loop']} loop closures, {report['grid']['known_m2']:.0f} m2 known, "
        f"{_session_line(report)}{_depth_line(report['depth'])}{_memory_line(report)}{_aids_line(report)}"
        f"{report['cpu_seconds']['total']:.1f} s of CPU: {out}/map.yaml"
    )


def _aids_line(report: Json) -> str:
    """Return the summary of the aids that were not believed as they are, or an empty text."""
    told = dict.fromkeys(
        f"{aid['part']} of {aid['name']} {aid['state']}" for aid in report.get("aids", []) if aid["state"] != "noted"
    )
    return "".join(f"{part}, " for part in told)


def _session_line(report: Json) -> str:
    """Return the summary of a further drive, or an empty text."""
    if "session" not in report:
        return ""
    told = report["session"]
    return f"drive {told['number']} added {told['key_scans_new']} key scans to {told['key_scans_before']}, "


def _depth_line(depth: Json) -> str:
    """Return the summary of the depth pictures, or an empty text."""
    if not depth["kept"]:
        return ""
    return f"{depth['kept']} of {depth['pictures']} pictures with {depth['drop_offs_m2']:.1f} m2 of drop-offs, "


def _memory_line(report: Json) -> str:
    """Return the summary of the memory of places, or an empty text."""
    if "memory" not in report:
        return ""
    told, counts = report["memory"], report["memory"]["memory"]
    return (
        f"{counts['words']} words in {counts['stm']} + {counts['wm']} + {counts['ltm']} nodes (STM + WM + LTM), "
        f"{told['links']['by appearance']} loops by appearance, {told['revisits']} revisits, "
    )


def _map_pictures(
    recordings: tuple[Path, ...], out: Path, reading: RecordingOptions, config: Path | None, quiet: bool
) -> None:
    from dataclasses import replace

    from waychair.cli.options.configuration import load_recording_settings
    from waychair.offline.rgbd_mapping import RgbdMappingSettings, map_pictures, refuse_mostly_lost, save_pictures_map

    settings = load_recording_settings(config, RgbdMappingSettings)
    settings = replace(settings, input=reading.over(settings.input))
    with stages(quiet) as progress:
        folder = progress.read(recordings, settings.input)
        mapping = map_pictures(folder, settings, progress.stage("mapping"), keep_in=out)
        save_pictures_map(out, mapping, settings)
        progress.warn(mapping.report["warnings"][len(folder.warnings) :])
    report = mapping.report
    if not quiet:
        print(
            f"{report['source']}: {report['placed']} of {report['listed']} pictures placed over {report['distance_m']:.1f} m, "
            f"{report['counts']['key_frames']} key frames, {report['counts']['loops']} loop closures, "
            f"{_memory_line(report)}{report['frame_ms']['mean']:.0f} ms of CPU a picture: {out}/trajectory.tum"
        )
    refuse_mostly_lost(report, out)
