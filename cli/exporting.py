"""Commands that write what others read."""

from __future__ import annotations

from pathlib import Path


def export_command(source: Path, /, *, ply: Path, voxel: float = 0.02) -> None:
    """Write the coloured point cloud of the key frames of a recording with pictures and depth.

    Parameters
    ----------
    source
        A bag or a folder of pictures, which is mapped first, or the folder of a map that was made of one.
    ply
        The file to write.
    voxel
        Of the points in a cube of this side, in metres, one is kept.
    """
    from waychair.runtime.cloud_export import CloudSettings, export_cloud

    done = export_cloud(source, ply, CloudSettings(voxel=voxel))
    print(
        f"{done.points} points of {done.key_frames} key frames among {done.pictures} pictures: {ply.with_suffix('.ply')}"
    )
