"""`waychair localize` and `waychair evaluate`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.recording_options import RecordingOptions, stages

if TYPE_CHECKING:
    from waychair.slam.trajectory_errors import Errors, SpaceErrors, TruthErrors

AS_RECORDED = RecordingOptions()


def localize_command(
    recordings: tuple[Path, ...],
    /,
    *,
    map: Path,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    start: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    reading: RecordingOptions = AS_RECORDED,
    config: Path | None = None,
    quiet: bool = False,
) -> None:
    """Localise the chair of a recording on a map.

    Writes trajectory.tum, config.yaml and report.json.

    Parameters
    ----------
    recordings
        A log or bag that `waychair map` can read, or the files of one bag that was recorded in parts.
    map
        Map folder or its map.yaml.
    out
        Folder for the trajectory and the report.
    start
        X,Y,YAW: the chair's pose in the map at the first scan, in metres and radians; default: relocalise.
    config
        YAML file with settings that differ from the defaults (see `waychair config map`).
    quiet
        Print nothing but errors.
    """
    from dataclasses import replace

    from waychair.cli.options.arguments import BadArgument, pose_from_text
    from waychair.cli.options.configuration import load_recording_settings
    from waychair.cli.options.messages import warnings_unless
    from waychair.maps.folders.depth_layer import load_depth_layer, scanned_part
    from waychair.maps.folders.map_files import load_map
    from waychair.offline.localising import LocalisingSettings, localise_recording, save_localised

    settings = load_recording_settings(config, LocalisingSettings)
    settings = replace(settings, input=reading.over(settings.input))
    begin = None if start is None else pose_from_text(start, "--start")
    grid = load_map(map, warnings_unless(quiet))
    grid = scanned_part(grid, load_depth_layer(map, grid))
    if out.resolve() in (map.resolve(), map.resolve().parent):
        raise BadArgument(f"--out {out} is the map's folder, whose files would be overwritten: choose another one")
    with stages(quiet) as progress:
        progress.warn((*reading.without_pictures(), *reading.without_colour_and_depth()))
        log = progress.read(recordings, settings.input)
        localised = localise_recording(
            log, grid, settings, begin, progress.stage("localising"), progress.stage("checking")
        )
        save_localised(out, localised, settings)
        progress.warn(localised.report["warnings"][len(log.warnings) :])
    if not quiet:
        report = localised.report
        states = ", ".join(f"{count} {state}" for state, count in report["states"].items())
        print(
            f"{report['frames']} scans over {report['distance_m']:.0f} m: {states}, "
            f"{100 * report['mean_inliers']:.0f} % of the points on walls, "
            f"{report['cpu_seconds']['total']:.1f} s of CPU: {out}/trajectory.tum"
        )


def evaluate_command(
    trajectory: Path,
    /,
    *,
    relations: Path | None = None,
    truth: Path | None = None,
    base_from_laser: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    json: bool = False,
) -> None:
    """Evaluate a trajectory against relations or a true trajectory.

    Parameters
    ----------
    trajectory
        A trajectory in TUM format, as written by `waychair map`.
    relations
        File of published relations between poses (Kuemmerle et al. 2009), gzipped or not: gives errors in metres and
        degrees, separately for local ones and across loops (stamps more than 60 s apart).
    truth
        The true trajectory in TUM format: gives the absolute trajectory error after alignment, in the plane, or in space
        where one of the two is of something that moves in space, such as a hand-held camera.
    base_from_laser
        X,Y,YAW: mount of the laser, if the relations are of the laser and the trajectory is of the base.
    json
        Print JSON.
    """
    import json as text
    from dataclasses import asdict

    from waychair.cli.options.arguments import BadArgument, pose_from_text
    from waychair.recordings.recording import planar_part, read_tum, read_tum_in_space
    from waychair.slam.trajectory_alignment import leaves_plane
    from waychair.slam.trajectory_errors import read_relations, relation_errors, space_errors, truth_errors

    if (relations is None) == (truth is None):
        raise BadArgument("give either --relations or --truth")
    if relations is not None:
        mount = None if base_from_laser is None else pose_from_text(base_from_laser, "--base-from-laser")
        found = relation_errors(read_tum(trajectory), read_relations(relations), mount)
        lines = [
            f"{found.every.count} of {found.total} relations",
            _line("all", found.every),
            _line("local", found.local),
            _line("across loops", found.loop),
        ]
        values = asdict(found)
    else:
        assert truth is not None
        poses, true = read_tum_in_space(trajectory), read_tum_in_space(truth)
        space = leaves_plane(poses) or leaves_plane(true)
        errors: SpaceErrors | TruthErrors
        errors = space_errors(poses, true) if space else truth_errors(planar_part(poses), planar_part(true))
        count, where = errors.errors.count, "space" if space else "the plane"
        lines = [
            f"{count} of {errors.total} poses, RMSE {errors.rmse_m:.4f} m, aligned in {where}",
            _line("absolute", errors.errors),
        ]
        if _is_constant(errors.errors):
            lines.append(
                f"the rotations differ by about {errors.errors.mean_deg:.0f} degrees everywhere: the two files may be of "
                "different frames, such as a camera's and the chair's"
            )
        values = asdict(errors)
    print(text.dumps(_without_nan(values)) if json else "\n".join(lines))


def _is_constant(errors: Errors) -> bool:
    """Return whether the rotation's error is large and about the same at all poses."""
    return errors.mean_deg > 10.0 and errors.std_deg < 0.2 * errors.mean_deg


def _line(name: str, errors: Errors) -> str:
    if errors.count == 0:
        return f"{name:>13}: none"
    return (
        f"{name:>13}: {errors.count:5d}, {errors.mean_m:.4f} +- {errors.std_m:.4f} m (largest {errors.max_m:.3f}), "
        f"{errors.mean_deg:.3f} +- {errors.std_deg:.3f} degrees (largest {errors.max_deg:.2f})"
    )


def _without_nan(values: object) -> object:
    """Return the values with null for nan, which JSON does not have."""
    if isinstance(values, dict):
        return {key: _without_nan(value) for key, value in values.items()}
    return None if isinstance(values, float) and math.isnan(values) else values
