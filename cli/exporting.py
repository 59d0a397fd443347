"""`waychair export`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from waychair.cli.options.recording_options import RecordingOptions

AS_RECORDED = RecordingOptions()


def export_command(
    source: Path,
    /,
    *,
    ply: Annotated[Path, Parameter(name=["--ply", "--out", "-o"])],
    voxel: float = 0.02,
    reading: RecordingOptions = AS_RECORDED,
    config: Path | None = None,
    quiet: bool = False,
) -> None:
    """Write the coloured point cloud of a recording or a map with depth pictures.

    Parameters
    ----------
    source
        A bag or a folder of pictures (mapped first), or the folder of a map made of one.
    ply
        The .ply file to write.
    voxel
        Side of the cubes, in metres, that keep one point each.
    config
        YAML file with settings that differ from the defaults (see `waychair config map`), for reading and mapping.
    quiet
        Print nothing but errors.
    """
    from waychair.cli.options.configuration import load_recording_settings
    from waychair.cli.options.messages import warn
    from waychair.cli.options.progress import told_stages
    from waychair.offline.cloud_export import CloudSettings, export_cloud
    from waychair.offline.mapping import MappingSettings
    from waychair.offline.rgbd_mapping import RgbdMappingSettings
    from waychair.recordings.rgbd_folders import is_rgbd_folder

    settings: MappingSettings | RgbdMappingSettings
    if is_rgbd_folder(source):
        settings = load_recording_settings(config, RgbdMappingSettings)
    else:
        settings = load_recording_settings(config, MappingSettings)
    settings = replace(settings, input=reading.over(settings.input))
    with told_stages(quiet) as show:
        done = export_cloud(source, ply, CloudSettings(voxel=voxel), settings, show)
    if not quiet:
        for warning in done.warnings:
            warn(warning)
        print(
            f"{done.points} points of {done.key_frames} key frames among {done.pictures} pictures: "
            f"{ply.with_suffix('.ply')}"
        )
