"""Depth images of a recording in a map, together with its scans or instead of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import NoPictures, RecordingError
from waychair.maps.depth.depth_scan import frame_problem, planar_scan
from waychair.maps.folders.depth_layer import DROP_OFF
from waychair.recordings.recording import Recording
from waychair.slam.mapping.depth_mapping import PLAIN, DepthMappingSettings
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.types import ImuSample, Json, OccupancyGrid, Odometry, Pose2, Pose3, SensorFrame, WheelTicks

_Reading = WheelTicks | Odometry | ImuSample


def mount_of_camera(recording: Recording, settings: DepthMappingSettings) -> tuple[Pose3 | None, list[str]]:
    """Return the mount of the camera's optical frame, None where depth images are not used, and warnings.

    Raises:
        NoPictures: the map is to be made of depth images alone, and the camera's mount is unknown.
    """
    if settings.use == "off":
        return None, []
    if settings.mount:
        x, y, z, yaw, pitch = settings.mount
        body = replace(CHAIR_A, camera_x=x, camera_y=y, camera_z=z, camera_yaw=yaw, camera_pitch=pitch)
        return body.base_from_camera, []
    try:
        mount = recording.camera_mount()
        pictured = mount is not None or next(recording.pictures(), None) is not None
    except RecordingError as error:
        if settings.use == "only":
            raise
        return None, [f"the pictures are not used: {error}"]
    if mount is not None:
        return mount, []
    if settings.use == "only":
        raise NoPictures(f"{recording.path} has no depth images with a known camera mount: {_ADVICE}")
    if not pictured:
        return None, []
    return None, [f"the pictures are not used, since the camera's mount is unknown: {_ADVICE}"]


_ADVICE = "record /tf_static with it, or set depth: mount: [X, Y, Z, YAW, PITCH] in --config"


def see_pictures(live: LiveMapping, recording: Recording) -> list[str]:
    """Add the depth images of a recording to the map of its scans; return a warning if not all could be read."""
    try:
        for picture in recording.pictures():
            live.see(picture)
    except RecordingError as error:
        return [f"the pictures cannot be read after {live.depth.counts['pictures']}: {error}"]
    return []


def live_from_pictures(
    recording: Recording,
    settings: LiveMappingSettings,
    base_from_camera: Pose3 | None,
    progress: Callable[[float], None] | None = None,
) -> LiveMapping:
    """Map a recording by its depth images in place of the lidar, with wheels and IMU.

    Raises:
        NoPictures: there is no usable depth image.
    """
    assert base_from_camera is not None
    lens = Pose2(float(base_from_camera.translation[0]), float(base_from_camera.translation[1]), 0.0)
    live = LiveMapping(settings, lens, base_from_camera=base_from_camera)
    readings = sorted(
        (reading for frame in recording.frames for reading in (*frame.wheels, *frame.imu)),
        key=lambda each: each.stamp_ns,
    )
    last_ns = readings[-1].stamp_ns if readings else 0
    began_ns, at = readings[0].stamp_ns if readings else 0, 0
    for picture in recording.pictures():
        if live.mapper.frames and picture.stamp_ns <= live.mapper.frames[-1].stamp_ns:
            live.see(picture)  # counts it as late
            continue
        if frame_problem(picture, settings.depth.view) is None:
            begin, at = at, _first_after(readings, picture.stamp_ns, at)
            frame = _frame(picture.stamp_ns, readings[begin:at])
            reckoned = live.reckon(frame)
            live.include(replace(reckoned, scan=planar_scan(live.depth.scan(picture))))
        live.see(picture)
        if progress is not None and last_ns > began_ns:
            progress(min(1.0, max(0.0, (picture.stamp_ns - began_ns) / (last_ns - began_ns))))
    if not live.mapper.frames:
        told = "; ".join(f"{count} {reason}" for reason, count in {**recording.unread, **live.depth.counts}.items())
        raise NoPictures(f"no map can be made of the pictures of {recording.path} ({told or 'there are none'})")
    return live


def _first_after(readings: list[_Reading], stamp_ns: int, at: int) -> int:
    while at < len(readings) and readings[at].stamp_ns <= stamp_ns:
        at += 1
    return at


def _frame(stamp_ns: int, readings: list[_Reading]) -> SensorFrame:
    imu = tuple(reading for reading in readings if isinstance(reading, ImuSample))
    return SensorFrame(
        stamp_ns, wheels=tuple(reading for reading in readings if not isinstance(reading, ImuSample)), imu=imu
    )


def depth_report(counts: Counter[str], layer: OccupancyGrid | None) -> Json:
    """Return the counts of depth images, and the map area that only they have seen [m2]."""
    report: Json = {name: counts[name] for name in PLAIN}
    report["left_out"] = {reason: count for reason, count in counts.items() if reason not in PLAIN}
    if layer is not None:
        cell = layer.resolution**2
        report["drop_offs_m2"] = round(float((layer.cells == DROP_OFF).sum()) * cell, 2)
        report["seen_by_depth_m2"] = round(float(((layer.cells > 0) & (layer.cells != DROP_OFF)).sum()) * cell, 2)
    return report


def warnings_of(counts: Counter[str], unread: Counter[str]) -> list[str]:
    """Return one sentence for each reason for which images were left out."""
    left_out = [f"{n} of {counts['pictures']} {reason}" for reason, n in counts.items() if reason not in PLAIN]
    return [*left_out, *(f"{count} pictures left out: {reason}" for reason, count in unread.items())]
