"""Export of a recording's key frames as a coloured point cloud in a PLY file."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.config import Settings, setting
from waychair.errors import MapError, MissingExtra, NoPictures
from waychair.files import replacing
from waychair.geometry import in_space, interpolate, pose_from_array
from waychair.install_advice import install_command
from waychair.maps.depth.depth_scan import DepthSettings, frame_problem
from waychair.maps.folders.map_files import yaml_path
from waychair.offline.camera_check import CheckedPictures, checked_pictures
from waychair.offline.depth_recording import mount_of_camera
from waychair.offline.mapping import MappingSettings, map_recording
from waychair.offline.rgbd_mapping import RgbdMappingSettings, map_pictures
from waychair.recordings.recording import Recording, read_recording, read_tum, read_tum_in_space
from waychair.recordings.rgbd_folders import is_rgbd_folder
from waychair.slam.camera.coloured_points import coloured_points
from waychair.slam.camera.picture_registration import angle_between
from waychair.slam.mapping.depth_mapping import DepthMapping
from waychair.slam.odometry.dead_reckoning import DeadReckoning
from waychair.types import IntArray, Json, Pose3, RgbdFrame, Trajectory, Trajectory3

_KEY_DISTANCE = 0.3  # m; distance after which an image becomes a key frame
_KEY_ANGLE = math.radians(15)  # rad; turn after which an image becomes a key frame
_MAX_GAP_S = 0.5  # s; greatest time between the two poses around an image


@dataclass(frozen=True, slots=True)
class CloudSettings(Settings):
    """Selection of the images and pixels of a cloud."""

    voxel: float = setting(
        0.02, "m", "side of the cubes with one point each; larger: a coarser and smaller file", low=0.001, high=1.0
    )
    range_max: float = setting(
        4.0,
        "m",
        "largest distance of exported points from the camera; larger: more and noisier points",
        low=0.2,
        high=50.0,
    )
    view: DepthSettings = field(default_factory=DepthSettings)


@dataclass(frozen=True, slots=True)
class PosedImage:
    """An image and the pose of its optical frame in map."""

    picture: RgbdFrame
    map_from_camera: Pose3


@dataclass(frozen=True, slots=True)
class ExportCounts:
    """Numbers of a cloud: key frames in it, images read, and points; and warnings about the camera."""

    key_frames: int
    pictures: int
    points: int
    warnings: tuple[str, ...] = ()


def export_cloud(
    source: Path,
    ply: Path,
    settings: CloudSettings | None = None,
    mapping: MappingSettings | RgbdMappingSettings | None = None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> ExportCounts:
    """Write the cloud of a recording, which is mapped first, or of a map folder, whose recording must still exist.

    `mapping` tells how the recording is read and mapped; settings of the other kind of recording only tell how to read it.
    `progress` is called with a stage and the share (0 to 1) of it that is done. The camera is checked; its estimate is
    used where the settings say so, or where the map was made with it.

    Raises:
        MissingExtra: Open3D, which makes and writes clouds, is not installed.
        NoPictures: no image with depth has a pose.
        MapError: the map does not name its recording.
        RecordingError: the recording cannot be read, or is missing.
        OutputError: the file cannot be written.
    """
    s, clouds = settings or CloudSettings(), _open3d()
    sum_, pictures, keys, last = clouds.geometry.PointCloud(), 0, 0, None
    images, warnings = posed_images(source, mapping or MappingSettings(), progress)
    for posed in images:
        pictures += 1
        if frame_problem(posed.picture, s.view) is not None or not _is_key(last, posed.map_from_camera):
            continue
        last, keys = posed.map_from_camera, keys + 1
        points, colours = coloured_points(posed.picture, posed.map_from_camera, s.range_max)
        seen = clouds.geometry.PointCloud(clouds.utility.Vector3dVector(points))
        seen.colors = clouds.utility.Vector3dVector(colours)
        sum_ = (sum_ + seen.voxel_down_sample(s.voxel)).voxel_down_sample(s.voxel)
    if not keys:
        raise NoPictures(f"no picture with depth of {source} has a pose, so there is no cloud to write")
    with replacing(ply.with_suffix(".ply")) as aside:
        if not clouds.io.write_point_cloud(str(aside), sum_):
            raise OSError(f"Open3D cannot write {aside.name}")
    return ExportCounts(keys, pictures, len(sum_.points), tuple(warnings))


def _open3d() -> Any:
    try:
        open3d = importlib.import_module("open3d")
    except ImportError as error:
        raise MissingExtra(
            f"clouds are made by Open3D, which cannot be used ({error}): {install_command('clouds')}"
        ) from error
    return open3d


def _is_key(last: Pose3 | None, here: Pose3) -> bool:
    if last is None:
        return True
    away = float(np.linalg.norm(here.translation - last.translation))
    return away >= _KEY_DISTANCE or angle_between(last, here) >= _KEY_ANGLE


def posed_images(
    source: Path,
    settings: MappingSettings | RgbdMappingSettings,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> tuple[Iterator[PosedImage], list[str]]:
    """Return the images of a recording, or of a map's recording, that have a pose, in order, and the camera's warnings.

    Raises as `export_cloud`, but for the cloud's file and Open3D.
    """
    report = yaml_path(source).with_name("report.json")
    folder = report.parent if (report.parent / "trajectory.tum").is_file() and report.is_file() else None
    made = None if folder is None else _read_report(report)
    recording = read_recording(
        [source] if made is None else made.parts, settings.input, progress=partial(progress, "reading")
    )
    map_progress = partial(progress, "mapping")
    register = "auto" if made is not None and made.registered else settings.input.rgbd.register
    checked: CheckedPictures | None
    if is_rgbd_folder(recording.path):
        if folder is None:
            pictured = settings if isinstance(settings, RgbdMappingSettings) else RgbdMappingSettings()
            mapped = map_pictures(recording, pictured, map_progress)
            way, checked = mapped.result.trajectory, mapped.pictures
        else:
            way, checked = read_tum_in_space(folder / "trajectory.tum"), checked_pictures(recording, register)
        images = _in_space(checked.recording, way)
        return _told(images, way.stamps_ns, progress), checked.sentences()
    scanned = settings if isinstance(settings, MappingSettings) else MappingSettings()
    mount, amiss = mount_of_camera(recording, scanned.depth)
    if mount is None:
        raise NoPictures(amiss[0] if amiss else f"{recording.path} holds no pictures with depth")
    if folder is None:
        mapping = map_recording(
            recording, replace(scanned, vision="off"), map_progress, checking=partial(progress, "checking")
        )
        flat, checked = mapping.result.trajectory, mapping.pictures
        assert checked is not None, "the camera's mount is known"
    else:
        flat, checked = read_tum(folder / "trajectory.tum"), checked_pictures(recording, register)
    return _told(_on_floor(checked.recording, mount, flat), flat.stamps_ns, progress), checked.sentences()


def _told(
    images: Iterator[PosedImage], stamps_ns: IntArray, progress: Callable[[str, float], None]
) -> Iterator[PosedImage]:
    """Yield images of a drive with poses at these stamps (N,), and tell how far they are."""
    first, last = int(stamps_ns.min()), int(stamps_ns.max())
    for image in images:
        progress("joining the cloud", (image.picture.stamp_ns - first) / max(1, last - first))
        yield image


@dataclass(frozen=True, slots=True)
class _MadeMap:
    """The files of the recording that a map was made of, and whether its pictures were used by the estimated camera."""

    parts: list[Path]
    registered: bool


def _read_report(report: Path) -> _MadeMap:
    try:
        told: Json = json.loads(report.read_text(encoding="utf-8"))
        parts = [Path(str(part)) for part in told.get("parts") or [told["input"]]]
        return _MadeMap(parts, bool(told.get("camera", {}).get("estimate_used")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise MapError(f"{report} does not say which recording the map was made of: make the map again") from error


def _in_space(recording: Recording, way: Trajectory3) -> Iterator[PosedImage]:
    """Yield images of a folder, whose trajectory has the images' own stamps."""
    at = {stamp // 1000: k for k, stamp in enumerate(way.stamps_ns.tolist())}
    for picture in recording.pictures():
        k = at.get(picture.stamp_ns // 1000)
        if k is not None:
            yield PosedImage(picture, Pose3(way.rotations[k], way.positions[k]))


def _on_floor(recording: Recording, mount: Pose3, way: Trajectory) -> Iterator[PosedImage]:
    """Yield images of a bag, with poses between those of its scans and the tilt from its IMU."""
    leaning, reckoning = DepthMapping(MappingSettings().depth, mount, CHAIR_A.front), DeadReckoning(CHAIR_A)
    for frame in recording.frames:
        reckoning.update(replace(frame, scan=None))
        leaning.note_tilt(reckoning.tilt)
    order = np.argsort(way.stamps_ns, kind="stable")
    stamps, poses = way.stamps_ns[order], way.poses[order]
    for picture in recording.pictures():
        after = int(np.searchsorted(stamps, picture.stamp_ns))
        if after in (0, len(stamps)) or stamps[after] - stamps[after - 1] > _MAX_GAP_S * 1e9:
            continue
        part = (picture.stamp_ns - int(stamps[after - 1])) / max(1, int(stamps[after] - stamps[after - 1]))
        pose = interpolate(pose_from_array(poses[after - 1]), pose_from_array(poses[after]), part)
        lean = Pose3(leaning.tilt_at(picture.stamp_ns).level_from_base(), np.zeros(3))
        yield PosedImage(picture, in_space(pose) @ lean @ mount)
