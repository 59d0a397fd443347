"""`waychair map` and `waychair places`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from waychair.cli.options.arguments import NonNegativeInt

if TYPE_CHECKING:
    from collections.abc import Iterable

    from waychair.types import Place

from waychair.cli.options.recording_options import RecordingOptions, stages
from waychair.types import Json

AS_RECORDED = RecordingOptions()


def map_command(
    recording: Path,
    /,
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    session: Path | None = None,
    reading: RecordingOptions = AS_RECORDED,
    config: Path | None = None,
    depth: Literal["on", "off", "only"] | None = None,
    vision: Literal["on", "off"] | None = None,
    quiet: bool = False,
) -> None:
    """Make a map of a recording.

    Reads CARMEN logs (.clf, .log) and CoreSLAM logs (.dat), gzipped or not, ROS 1 bags, and ROS 2 bags (folder, .mcap,
    .db3), recognised by their content. Writes map.yaml, map.pgm, trajectory.tum, graph.g2o, config.yaml, report.json,
    report.html, and session.npz for further drives. After an interruption the same command resumes near that point.

    Depth pictures in a bag add obstacles that the lidar does not see: table tops, low objects and drop-offs. depth.yaml
    and depth.pgm mark their cells.

    Depth pictures also close loops by appearance. memory.db holds the places; an interrupted run then restarts.

    From a folder of colour and depth pictures (TUM RGB-D's rgb/ and depth/, or frame-N.color and frame-N.depth.png) it
    writes trajectory.tum (3D poses of the camera's optical frame), memory.db, config.yaml and report.json.

    Parameters
    ----------
    recording
        The log or bag.
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
    quiet
        Print nothing but errors.
    """
    from dataclasses import replace

    from waychair.cli.options.configuration import load_recording_settings
    from waychair.errors import OutputError, SessionError
    from waychair.offline.map_folders import refuse_drawn, refuse_other
    from waychair.offline.mapping import MappingSettings, join_recording, map_recording, save_mapping
    from waychair.offline.sessions import replaced_folder, session_folder
    from waychair.recordings.rgbd_folders import is_rgbd_folder

    known = None if session is None else session_folder(session)
    out = out or known
    if out is None:
        raise OutputError("the map needs a folder: give --out FOLDER")
    if is_rgbd_folder(recording):
        if known is not None:
            raise SessionError("pictures without a lidar cannot be joined to a map: omit --session")
        _map_pictures(recording, out, reading, config, quiet)
        return
    settings = load_recording_settings(config, MappingSettings)
    settings = replace(settings, input=reading.over(settings.input))
    settings = settings if depth is None else replace(settings, depth=replace(settings.depth, use=depth))
    settings = settings if vision is None else replace(settings, vision=vision)
    with stages(quiet) as progress:
        started = time.process_time()
        log = progress.read(recording, settings.input)
        reading_s = time.process_time() - started
        if known is None:
            refuse_other(out, log.frames, settings)
            mapping = map_recording(log, settings, progress.stage("mapping"), keep_in=out, reading_s=reading_s)
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
                )
                save_mapping(aside, mapping, settings)
        progress.warn(mapping.report["warnings"][len(log.warnings) :])
    if not quiet:
        report = mapping.report
        print(
            f"{report['frames']} scans over {report['distance_m']:.0f} m, {report['key_scans']} key scans, "
            f"{report['edges']['loop']} loop closures, {report['grid']['known_m2']:.0f} m2 known, "
            f"{_session_line(report)}{_depth_line(report['depth'])}{_memory_line(report)}{report['cpu_seconds']['total']:.1f} s of CPU: {out}/map.yaml"
        )


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


def _map_pictures(recording: Path, out: Path, reading: RecordingOptions, config: Path | None, quiet: bool) -> None:
    from dataclasses import replace

    from waychair.cli.options.configuration import load_recording_settings
    from waychair.offline.rgbd_mapping import RgbdMappingSettings, map_pictures, save_pictures_map

    settings = load_recording_settings(config, RgbdMappingSettings)
    settings = replace(settings, input=reading.over(settings.input))
    with stages(quiet) as progress:
        folder = progress.read(recording, settings.input)
        mapping = map_pictures(folder, settings, progress.stage("mapping"), keep_in=out)
        save_pictures_map(out, mapping, settings)
        progress.warn(mapping.report["warnings"][len(folder.warnings) :])
    if not quiet:
        report = mapping.report
        print(
            f"{report['placed']} of {report['pictures']} pictures placed over {report['distance_m']:.1f} m, "
            f"{report['counts']['key_frames']} key frames, {report['counts']['loops']} loop closures, "
            f"{_memory_line(report)}{report['frame_ms']['mean']:.0f} ms of CPU a picture: {out}/trajectory.tum"
        )


def places_command(
    *,
    map: Path | None = None,
    add: Annotated[tuple[str, str] | None, Parameter(allow_leading_hyphen=True)] = None,
    domain: NonNegativeInt | None = None,
    namespace: str = "",
) -> None:
    """List the named places of a map, or add one.

    Parameters
    ----------
    map
        Map folder or its map.yaml; default the map of the running chair.
    add
        NAME X,Y,YAW: place to add, in metres and radians in the map.
    domain
        ROS domain of the running chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.cli.options.arguments import BadArgument, pose_from_text
    from waychair.maps.drawn.places import add_place, check_place, load_places
    from waychair.maps.folders.map_files import load_map
    from waychair.types import Place

    if map is None:
        if add is not None:
            raise BadArgument("--add needs a --map to add the place to")
        _print_running_places(domain, namespace)
        return
    grid = load_map(map)
    if add is not None:
        name, text = add
        place = Place(name, pose_from_text(text, "--add"))
        check_place(grid, place)
        add_place(map, name, place.pose, replace=True)
    places = load_places(map)
    _print_places(places.values())
    if not places:
        print(f"the map has no places: add one with waychair places --map {map} --add NAME X,Y,YAW")


def _print_places(places: Iterable[Place]) -> None:
    for place in places:
        pose = place.pose
        print(f"{place.name}: {pose.x:.2f}, {pose.y:.2f}, {pose.theta:.2f}")


def _print_running_places(domain: int | None, namespace: str) -> None:
    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain, namespace=namespace) as client:
        _print_places(client.places().values())
