"""Folders of colour and depth pictures: the TUM RGB-D benchmark's layout, and numbered frames with their poses.

TUM (Sturm et al., IROS 2012, and the benchmark's page on file formats): `rgb/` and `depth/` with stamps [s] as names,
`rgb.txt` and `depth.txt` that list them, or `associations.txt` that lists pairs. Depth is 16 bit, 5000 units to a metre,
0 for none, registered pixel by pixel to the colour picture. `groundtruth.txt` holds true poses of the optical frame.

Numbered frames (the layout of 7-Scenes, Shotton et al., CVPR 2013, and of tsdf-fusion): `frame-N.color.*`,
`frame-N.depth.png` in millimetres, `frame-N.pose.txt` with the true world_from_camera (4, 4), and optionally
`camera-intrinsics.txt` (3, 3). Their stamps are N divided by the frame rate.

Lens distortion is removed on reading, so that an `RgbdFrame` is always of a pinhole camera. `picture_pairs` finds the
pictures, `picture_doubts` tells where their scale or camera is unlikely.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from waychair.config import Settings, setting
from waychair.errors import ConfigError, RecordingDamaged, RecordingNotFound
from waychair.geometry import rotations
from waychair.recordings.picture_doubts import (
    SAMPLE,
    DepthSample,
    doubt_about_centre,
    doubt_about_scale,
    sampled,
    scaled_matrix,
)
from waychair.recordings.picture_pairs import FRAME_RATE, Pair, is_numbered, is_tum, numbered_files, read_pairs
from waychair.recordings.stamps import read_pose_rows, read_rows
from waychair.types import Bytes, Float32Array, FloatArray, RgbdFrame, Trajectory3

CAMERAS = {
    "fr1": (517.306, 516.469, 318.643, 255.314, 0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
    "fr2": (520.909, 521.007, 325.141, 249.702, 0.231222, -0.784899, -0.003257, -0.000105, 0.917205),
    "fr3": (535.4, 539.2, 320.1, 247.6),
}
"""fx, fy, cx, cy [px], k1, k2, p1, p2, k3 of the benchmark's three cameras, from its page on file formats."""

READOUT = 0.02
"""Rolling-shutter readout time [s] of those cameras: from the first to the last row of a colour picture.

Estimated from freiburg1_rpy alone: patches fit best at 0.016 to 0.02 s, and the trajectory's error against the truth is
0.013 to 0.014 m from 0.016 to 0.028 s, and 0.05 m for a global shutter.
"""

_UNNAMED_CAMERA = (525.0, 525.0, 319.5, 239.5)  # the default that the benchmark's page recommends
_CAMERA_NAME = re.compile(r"(?:freiburg|fr)([123])(?!\d)")
_INTRINSICS = "camera-intrinsics.txt"
_NO_DEPTH = 65535  # the code of 7-Scenes for missing depth
_CAMERA_SIZE = (640, 480)  # px; pictures of the named cameras and of the unnamed one
_SIZES = (0.2, 5.0)  # least and largest factor between the sizes of a camera's pictures

TUM_DEPTH_SCALE, NUMBERED_DEPTH_SCALE = 5000.0, 1000.0  # depth units in a metre


@dataclass(frozen=True, slots=True)
class RgbdSettings(Settings):
    """Facts that a folder of pictures does not state, and the use of a wrong camera's estimate, also in a bag."""

    camera: str = setting(
        "",
        "px",
        "camera: fr1, fr2, fr3 or FX,FY,CX,CY[,K1,K2,P1,P2[,K3]]; empty: by a file in the folder, or the folder's name",
    )
    depth_scale: float = setting(
        0.0,
        "1/m",
        "units of the depth pictures in a metre; larger: everything becomes smaller; 0: 5000 for rgb/ and depth/, 1000 for "
        "numbered frames",
        low=0.0,
        high=1e6,
    )
    register: Literal["check", "auto"] = setting(
        "check",
        "",
        "colour and depth that are not of the given camera; check: a warning says so, with an estimate; auto: the estimated "
        "camera is used",
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.camera:
            camera_from_text(self.camera)


@dataclass(frozen=True, slots=True)
class CameraIntrinsics:
    """A camera's matrix (3, 3) [px], lens distortion (5,) k1, k2, p1, p2, k3 of Brown's model, and readout time [s].

    `size` is the width and height [px] of the pictures that the matrix is of, None where it is not known.
    """

    matrix: FloatArray
    distortion: FloatArray
    readout: float = 0.0
    size: tuple[int, int] | None = None

    @property
    def undistorted(self) -> bool:
        """Return whether the lens is free of distortion."""
        return not self.distortion.any()


@dataclass(frozen=True, slots=True)
class RgbdFolder:
    """A folder's pairs by ascending stamp, its camera and depth scale, and warnings about it.

    `listed` is the number of pairs, or of colour pictures, in its lists, lost ones among them.
    """

    path: Path
    pairs: tuple[Pair, ...]
    camera: CameraIntrinsics
    depth_scale: float
    source: str
    warnings: tuple[str, ...]
    listed: int = 0


def is_rgbd_folder(path: Path) -> bool:
    """Return whether a folder holds colour and depth pictures in one of the two layouts."""
    return path.is_dir() and (is_tum(path) or is_numbered(path))


def read_rgbd_folder(path: Path, settings: RgbdSettings) -> RgbdFolder:
    """Return the pairs of pictures in a folder; only a sample of them is decoded (see `frames_of`).

    Raises:
        RecordingDamaged: a list has a wrong form, no colour picture has a depth picture, or most are lost.
        ConfigError: the camera's file does not hold a camera matrix.
    """
    numbered = not is_tum(path)
    pairs = read_pairs(path)
    warnings = list(pairs.warnings)
    camera, known, doubt = _camera_of(path, settings, numbered)
    scale = settings.depth_scale or (NUMBERED_DEPTH_SCALE if numbered else TUM_DEPTH_SCALE)
    sample = _sample(pairs.usable)
    if sample is not None:
        factor = _factor(camera, sample.size)
        if factor != 1.0:
            known += f", scaled by {factor:g}"
            warnings.append(
                f"the pictures have {sample.size[0]} x {sample.size[1]} pixels and those of the camera {_CAMERA_SIZE[0]} x "
                f"{_CAMERA_SIZE[1]}: its matrix was scaled by {factor:g}; give --camera FX,FY,CX,CY if that is wrong"
            )
            camera = replace(camera, matrix=scaled_matrix(camera.matrix, factor), size=sample.size)
        told = [doubt_about_centre(sample.size, camera.matrix)]
        if not sample.metres:
            told.append(doubt_about_scale(sample, scale))
        warnings += [each for each in told if each]
        scale = 1.0 if sample.metres else scale
    if doubt:
        warnings.append(doubt)
    layout = "numbered colour and depth frames" if numbered else "TUM colour and depth folders"
    fx, fy, cx, cy = (camera.matrix[k] for k in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return RgbdFolder(
        path=path,
        pairs=pairs.usable,
        camera=camera,
        depth_scale=scale,
        source=f"{layout}, camera by {known}: {fx:.1f},{fy:.1f},{cx:.1f},{cy:.1f}, {scale:g} depth units to a metre",
        warnings=tuple(warnings),
        listed=pairs.listed,
    )


def _sample(pairs: Sequence[Pair]) -> DepthSample | None:
    """Return quantiles and size of a few depth pictures, evenly spread; None if none can be decoded."""
    chosen = pairs[:: max(1, len(pairs) // SAMPLE)]
    return sampled([units for pair in chosen if isinstance(units := _depth(pair.depth), np.ndarray)])


def _factor(camera: CameraIntrinsics, size: tuple[int, int]) -> float:
    """Return by how much pictures are larger than those of the camera; 1 where its size or their shape is another."""
    if camera.size is None:
        return 1.0
    across, down = size[0] / camera.size[0], size[1] / camera.size[1]
    return across if across == down and _SIZES[0] <= across <= _SIZES[1] else 1.0


def frames_of(folder: RgbdFolder, unread: Counter[str] | None = None) -> Iterator[RgbdFrame]:
    """Yield each pair as a frame of a pinhole camera; unreadable pairs are left out and counted in `unread` by reason."""
    import cv2

    unread = Counter() if unread is None else unread
    lens: Any = None
    for pair in folder.pairs:
        image, units = _colour(pair.colour), _depth(pair.depth)
        if isinstance(image, str) or isinstance(units, str):
            unread[image if isinstance(image, str) else str(units)] += 1
            continue
        if image.shape[:2] != units.shape:
            unread["colour and depth differ in size"] += 1
            continue
        depth = _metres(units, folder.depth_scale)
        if not folder.camera.undistorted:
            if lens is None or lens[0].shape[:2] != depth.shape:
                lens = _undistortion_maps(folder.camera, depth.shape)
            undistorted = cv2.remap(image, lens[0], lens[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            image = np.asarray(undistorted, np.uint8)
            # nearest neighbour, since interpolated depth makes mixed pixels at edges
            undistorted = cv2.remap(depth, lens[0], None, cv2.INTER_NEAREST, borderValue=math.nan)  # type: ignore[call-overload]
            depth = np.asarray(undistorted, np.float32)
        yield RgbdFrame(pair.stamp_ns, image, depth, folder.camera.matrix, folder.camera.readout / len(depth))


def _undistortion_maps(camera: CameraIntrinsics, shape: tuple[int, ...]) -> Any:
    """Return OpenCV's two undistortion maps for pictures of a shape (H, W)."""
    import cv2

    size = (shape[1], shape[0])
    return cv2.initUndistortRectifyMap(camera.matrix, camera.distortion, np.eye(3), camera.matrix, size, cv2.CV_16SC2)


def read_truth(path: Path) -> Trajectory3:
    """Return the true poses beside the pictures, of the optical frame in the world.

    Raises:
        RecordingNotFound: the folder holds no true poses.
        RecordingDamaged: a pose file has a wrong form.
    """
    if is_tum(path):
        return _tum_truth(path / "groundtruth.txt")
    stamps, rotations, positions = [], [], []
    for number, colour in numbered_files(path):
        file = path / f"frame-{colour.name.split('.')[0].removeprefix('frame-')}.pose.txt"
        if not file.is_file():
            continue
        pose = _matrix(file, (4, 4))
        stamps.append(round(number / FRAME_RATE * 1e9))
        rotations.append(pose[:3, :3])
        positions.append(pose[:3, 3])
    if not stamps:
        raise RecordingNotFound(f"{path} holds no true poses: frame-N.pose.txt are missing")
    return Trajectory3(np.array(stamps, np.int64), np.array(rotations), np.array(positions))


def camera_from_text(text: str) -> CameraIntrinsics:
    """Return the camera of a text: `fr1`, `fr2`, `fr3`, or four, eight or nine numbers separated by commas.

    Raises:
        ConfigError: the text has another form.
    """
    if text.strip().lower() in CAMERAS:
        return _camera(CAMERAS[text.strip().lower()], READOUT, _CAMERA_SIZE)
    try:
        values = tuple(float(field) for field in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (4, 8, 9) or not all(map(math.isfinite, values)) or min(values[:2]) <= 0.0:
        raise ConfigError(
            f"camera '{text}' is unknown: give fr1, fr2, fr3, or FX,FY,CX,CY[,K1,K2,P1,P2[,K3]] in pixels"
        )
    return _camera(values)


def _camera(values: tuple[float, ...], readout: float = 0.0, size: tuple[int, int] | None = None) -> CameraIntrinsics:
    fx, fy, cx, cy, *distortion = values
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return CameraIntrinsics(matrix, np.array([*distortion, *[0.0] * (5 - len(distortion))]), readout, size)


def _camera_of(path: Path, settings: RgbdSettings, numbered: bool) -> tuple[CameraIntrinsics, str, str]:
    """Return the camera, the source of its parameters, and a warning where they are a guess."""
    if settings.camera:
        name = settings.camera.strip().lower()
        return camera_from_text(settings.camera), name if name in CAMERAS else "the settings", ""
    if (path / _INTRINSICS).is_file():
        matrix = _matrix(path / _INTRINSICS, (3, 3))
        if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
            raise ConfigError(f"{path / _INTRINSICS} holds no camera matrix; name the camera in the settings")
        return CameraIntrinsics(matrix, np.zeros(5)), _INTRINSICS, ""
    named = _CAMERA_NAME.search(path.resolve().name.lower())
    if named is not None and not numbered:
        return _camera(CAMERAS[f"fr{named[1]}"], READOUT, _CAMERA_SIZE), f"the folder's name (fr{named[1]})", ""
    fx, fy, cx, cy = _UNNAMED_CAMERA
    doubt = f"the camera of {path} is not known; fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g} are assumed: name it with --camera"
    return _camera(_UNNAMED_CAMERA, size=_CAMERA_SIZE), "default", doubt


def _colour(path: Path) -> Bytes | str:
    """Return the decoded file in RGB order, or why there is none."""
    import cv2

    return _decoded(path, cv2.IMREAD_COLOR_RGB)


def _depth(path: Path) -> Any:
    """Return the decoded file (H, W) of whole units or of float metres, or why there is none."""
    import cv2

    found = _decoded(path, cv2.IMREAD_UNCHANGED)
    if isinstance(found, str):
        return found
    if found.ndim != 2:
        return "depth picture has colours: it was made for the eye, not as distances"
    if found.dtype == np.uint8:
        return "depth picture has 8 bits: it was made for the eye, not as distances"
    return found if found.dtype in (np.uint16, np.float32) else f"depth picture holds {found.dtype} numbers"


def _decoded(path: Path, flags: int) -> Bytes | str:
    import cv2

    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
        found = cv2.imdecode(data, flags) if len(data) else None
    except FileNotFoundError:
        return "picture is missing"
    except (OSError, cv2.error):
        found = None
    return "picture cannot be decoded" if found is None else np.asarray(found)


def _metres(units: Bytes, scale: float) -> Float32Array:
    depth = units.astype(np.float32)
    depth *= np.float32(1.0 / scale)
    depth[~(units > 0) | (units == _NO_DEPTH)] = np.nan
    return depth


def _matrix(path: Path, shape: tuple[int, int]) -> FloatArray:
    try:
        values = np.array([[float(field) for field in fields] for fields in _plain_rows(path)])
    except ValueError as error:
        raise RecordingDamaged(f"{path} is not a matrix of numbers: {error}") from error
    if values.shape != shape or not np.isfinite(values).all():
        raise RecordingDamaged(f"{path} must hold {shape[0]} x {shape[1]} finite numbers")
    return values


def _plain_rows(path: Path) -> list[tuple[str, ...]]:
    return [row.fields for row in read_rows(path)]


def _tum_truth(path: Path) -> Trajectory3:
    if not path.is_file():
        raise RecordingNotFound(f"there are no true poses at {path}")
    stamps, table = read_pose_rows(path)
    return Trajectory3(stamps, rotations(table[:, 3:]), table[:, :3])
