"""`waychair export`."""

from __future__ import annotations

from pathlib import Path


def export_command(source: Path, /, *, ply: Path, voxel: float = 0.02) -> None:
    """Write the coloured point cloud of a recording or a map with depth pictures.

    Parameters
    ----------
    source
        A bag or a folder of pictures (mapped first), or the folder of a map made of one.
    ply
        The .ply file to write.
    voxel
        Side of the cubes, in metres, that keep one point each.
    """
    from waychair.offline.cloud_export import CloudSettings, export_cloud

    done = export_cloud(source, ply, CloudSettings(voxel=voxel))
    print(
        f"{done.points} points of {done.key_frames} key frames among {done.pictures} pictures: {ply.with_suffix('.ply')}"
    )
