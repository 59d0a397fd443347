"""Folders of colour and depth pictures: the TUM RGB-D benchmark's layout, and numbered frames with their poses.

TUM (Sturm et al., IROS 2012, and the benchmark's page on file formats): `rgb/` and `depth/` with stamps [s] as names,
`rgb.txt` and `depth.txt` that list them, or `associations.txt` that lists pairs. Depth is 16 bit, 5000 units to a metre,
0 for none, registered pixel by pixel to the colour picture. `groundtruth.txt` holds true poses of the optical frame.

Numbered frames (the layout of 7-Scenes, Shotton et al., CVPR 2013, and of tsdf-fusion): `frame-N.color.*`,
`frame-N.depth.png` in millimetres, `frame-N.pose.txt` with the true world_from_camera (4, 4), and optionally
`camera-intrinsics.txt` (3, 3). Their stamps are N divided by the frame rate.

Lens distortion is removed on reading, so that an `RgbdFrame` is always of a pinhole camera.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from waychair.config import Settings, setting
from waychair.errors import ConfigError, RecordingDamaged, RecordingNotFound
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
_NUMBERED = re.compile(r"frame-(\d+)\.color\.(?:png|jpe?g)$")
_CAMERA_NAME = re.compile(r"(?:freiburg|fr)([123])(?!\d)")
_INTRINSICS = "camera-intrinsics.txt"
_NO_DEPTH = 65535  # the code of 7-Scenes for missing depth
_SLACK = 1e-6  # s; tolerance for rounding of decimal stamps

MAX_SPREAD = 0.02  # s; a colour picture and its depth are this far apart at most
FRAME_RATE = 30.0  # Hz; of numbered frames, which have no stamps
TUM_DEPTH_SCALE, NUMBERED_DEPTH_SCALE = 5000.0, 1000.0  # depth units in a metre


@dataclass(frozen=True, slots=True)
class RgbdSettings(Settings):
    """Facts that a folder of pictures does not state."""

    camera: str = setting(
        "",
        "px",
        "camera: fr1, fr2, fr3 or FX,FY,CX,CY[,K1,K2,P1,P2[,K3]]; empty: by a file in the folder, or the folder's name",
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.camera:
            camera_from_text(self.camera)


@dataclass(frozen=True, slots=True)
class CameraIntrinsics:
    """A camera's matrix (3, 3) [px], lens distortion (5,) k1, k2, p1, p2, k3 of Brown's model, and readout time [s]."""

    matrix: FloatArray
    distortion: FloatArray
    readout: float = 0.0

    @property
    def undistorted(self) -> bool:
        """Return whether the lens is free of distortion."""
        return not self.distortion.any()


@dataclass(frozen=True, slots=True)
class Pair:
    """A colour picture with its stamp, and its depth picture."""

    stamp_ns: int
    colour: Path
    depth: Path


@dataclass(frozen=True, slots=True)
class RgbdFolder:
    """A folder's pairs by ascending stamp, its camera and depth scale, and warnings about it."""

    path: Path
    pairs: tuple[Pair, ...]
    camera: CameraIntrinsics
    depth_scale: float
    source: str
    warnings: tuple[str, ...]


def is_rgbd_folder(path: Path) -> bool:
    """Return whether a folder holds colour and depth pictures in one of the two layouts."""
    return path.is_dir() and (_is_tum(path) or _is_numbered(path))


def read_rgbd_folder(path: Path, settings: RgbdSettings) -> RgbdFolder:
    """Return the pairs of pictures in a folder, without decoding them (see `frames_of`).

    Raises:
        RecordingDamaged: a list has a wrong form, or no colour picture has a depth picture.
        ConfigError: the camera's file does not hold a camera matrix.
    """
    numbered = not _is_tum(path)
    pairs, warnings = _numbered_pairs(path) if numbered else _tum_pairs(path)
    if not pairs:
        raise RecordingDamaged(
            f"no colour picture in {path} has a depth picture within {MAX_SPREAD:g} s: copy both folders again"
        )
    late = sum(b.stamp_ns <= a.stamp_ns for a, b in pairwise(pairs))
    ascending = tuple(sorted({pair.stamp_ns: pair for pair in pairs}.values(), key=lambda pair: pair.stamp_ns))
    if late:
        twice = len(pairs) - len(ascending)
        warnings.append(
            f"{late} pairs are not later than the one before them: they were sorted"
            + (f", {twice} with a duplicate stamp left out" if twice else "")
        )
    camera, known, doubt = _camera_of(path, settings, numbered)
    if doubt:
        warnings.append(doubt)
    scale = NUMBERED_DEPTH_SCALE if numbered else TUM_DEPTH_SCALE
    layout = "numbered colour and depth frames" if numbered else "TUM colour and depth folders"
    return RgbdFolder(
        path=path,
        pairs=ascending,
        camera=camera,
        depth_scale=scale,
        source=f"{layout}, camera by {known}",
        warnings=tuple(warnings),
    )


def frames_of(folder: RgbdFolder, unread: Counter[str] | None = None) -> Iterator[RgbdFrame]:
    """Yield each pair as a frame of a pinhole camera; unreadable pairs are left out and counted in `unread` by reason."""
    import cv2

    unread = Counter() if unread is None else unread
    lens: Any = None
    for pair in folder.pairs:
        image, units = _picture(pair.colour, colour=True), _picture(pair.depth, colour=False)
        if image is None or units is None:
            missing = pair.colour if image is None else pair.depth
            unread[f"picture {'cannot be decoded' if missing.is_file() else 'is missing'}"] += 1
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
    if _is_tum(path):
        return _tum_truth(path / "groundtruth.txt")
    stamps, rotations, positions = [], [], []
    for number, colour in _numbered_files(path):
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
        return _camera(CAMERAS[text.strip().lower()], READOUT)
    try:
        values = tuple(float(field) for field in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (4, 8, 9) or not all(map(math.isfinite, values)) or min(values[:2]) <= 0.0:
        raise ConfigError(
            f"camera '{text}' is unknown: give fr1, fr2, fr3, or FX,FY,CX,CY[,K1,K2,P1,P2[,K3]] in pixels"
        )
    return _camera(values)


def _camera(values: tuple[float, ...], readout: float = 0.0) -> CameraIntrinsics:
    fx, fy, cx, cy, *distortion = values
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return CameraIntrinsics(matrix, np.array([*distortion, *[0.0] * (5 - len(distortion))]), readout)


def _camera_of(path: Path, settings: RgbdSettings, numbered: bool) -> tuple[CameraIntrinsics, str, str]:
    """Return the camera, the source of its parameters, and a warning where they are a guess."""
    if settings.camera:
        return camera_from_text(settings.camera), "the settings", ""
    if (path / _INTRINSICS).is_file():
        matrix = _matrix(path / _INTRINSICS, (3, 3))
        if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
            raise ConfigError(f"{path / _INTRINSICS} holds no camera matrix; name the camera in the settings")
        return CameraIntrinsics(matrix, np.zeros(5)), _INTRINSICS, ""
    named = _CAMERA_NAME.search(path.resolve().name.lower())
    if named is not None and not numbered:
        return _camera(CAMERAS[f"fr{named[1]}"], READOUT), f"the folder's name (fr{named[1]})", ""
    fx, fy, cx, cy = _UNNAMED_CAMERA
    doubt = f"the camera of {path} is not known; fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g} are assumed: name it with --camera"
    return _camera(_UNNAMED_CAMERA), "default", doubt


def _is_tum(path: Path) -> bool:
    return (path / "rgb").is_dir() and (path / "depth").is_dir()


def _is_numbered(path: Path) -> bool:
    return any(_NUMBERED.match(file.name) for file in path.iterdir())


def _tum_pairs(path: Path) -> tuple[list[Pair], list[str]]:
    """Return the pairs from the list of pairs if there is one, else each colour picture with its nearest depth in time."""
    listed = next((path / name for name in ("associations.txt", "associate.txt") if (path / name).is_file()), None)
    if listed is not None:
        return [_listed_pair(path, listed, number, fields) for number, fields in _rows(listed)], []
    colours, depths = _listed_pictures(path, "rgb"), _listed_pictures(path, "depth")
    if not colours or not depths:
        return [], []
    stamps = np.array([stamp for stamp, _ in depths])
    order = np.argsort(stamps, kind="stable")
    pairs, alone = [], 0
    for stamp, colour in colours:
        at = int(np.clip(np.searchsorted(stamps[order], stamp), 1, max(1, len(stamps) - 1)))
        near = min(order[max(0, at - 1) : at + 1].tolist(), key=lambda k: abs(depths[k][0] - stamp))
        if abs(depths[near][0] - stamp) <= MAX_SPREAD + _SLACK:
            pairs.append(Pair(round(stamp * 1e9), colour, depths[near][1]))
        else:
            alone += 1
    lost = [f"{alone} colour pictures have no depth within {MAX_SPREAD:g} s"] if alone else []
    return pairs, lost


def _listed_pair(path: Path, listed: Path, number: int, fields: list[str]) -> Pair:
    """Return the pair of a line `stamp file stamp file`, with the colour picture first or second."""
    try:
        first, second = (float(fields[0]), path / fields[1]), (float(fields[2]), path / fields[3])
    except (ValueError, IndexError) as error:
        raise RecordingDamaged(f"{listed} line {number} is not `stamp file stamp file`: {error}") from error
    if fields[1].startswith("depth"):
        first, second = second, first
    return Pair(_nanoseconds(fields[2] if first[1] == path / fields[3] else fields[0]), first[1], second[1])


def _listed_pictures(path: Path, kind: str) -> list[tuple[float, Path]]:
    """Return stamps and files of `rgb` or `depth`, from their list if there is one, else from the file names."""
    listed = path / f"{kind}.txt"
    if not listed.is_file():
        files = sorted((path / kind).iterdir())
        return [(stamp, file) for file in files if (stamp := _stamp_of(file)) is not None]
    pictures = []
    for number, fields in _rows(listed):
        try:
            pictures.append((float(fields[0]), path / fields[1]))
        except (ValueError, IndexError) as error:
            raise RecordingDamaged(f"{listed} line {number} is not `stamp file`: {error}") from error
    return pictures


def _stamp_of(file: Path) -> float | None:
    try:
        return float(file.stem)
    except ValueError:
        return None


def _nanoseconds(text: str) -> int:
    """Return seconds as whole nanoseconds; a float of 1.3e9 s would resolve only 0.24 microseconds."""
    whole, _, part = text.partition(".")
    return int(whole) * 1_000_000_000 + int(f"{part[:9]:0<9}")


def _numbered_files(path: Path) -> list[tuple[int, Path]]:
    found = [(match, file) for file in path.iterdir() if (match := _NUMBERED.match(file.name))]
    return sorted((int(match[1]), file) for match, file in found)


def _numbered_pairs(path: Path) -> tuple[list[Pair], list[str]]:
    pairs = []
    for number, colour in _numbered_files(path):
        depth = path / f"{colour.name.split('.')[0]}.depth.png"
        pairs.append(Pair(round(number / FRAME_RATE * 1e9), colour, depth))
    return pairs, []


def _picture(path: Path, *, colour: bool) -> Bytes | None:
    """Return the decoded file, colours in RGB order; None where it is missing or damaged."""
    import cv2

    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
        found = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB if colour else cv2.IMREAD_UNCHANGED) if len(data) else None
    except (OSError, cv2.error):
        return None
    if found is None or (not colour and (found.ndim != 2 or found.dtype != np.uint16)):
        return None
    return np.asarray(found)


def _metres(units: Bytes, scale: float) -> Float32Array:
    depth = units.astype(np.float32)
    depth *= np.float32(1.0 / scale)
    depth[(units == 0) | (units == _NO_DEPTH)] = np.nan
    return depth


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return the line number and the fields of each line that is not a comment."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise RecordingDamaged(f"cannot read {path}: {error.strerror}") from error
    rows = [(number, line.replace(",", " ").split()) for number, line in enumerate(text.splitlines(), start=1)]
    return [(number, fields) for number, fields in rows if fields and not fields[0].startswith("#")]


def _matrix(path: Path, shape: tuple[int, int]) -> FloatArray:
    try:
        values = np.array([[float(field) for field in fields] for _, fields in _rows(path)])
    except ValueError as error:
        raise RecordingDamaged(f"{path} is not a matrix of numbers: {error}") from error
    if values.shape != shape or not np.isfinite(values).all():
        raise RecordingDamaged(f"{path} must hold {shape[0]} x {shape[1]} finite numbers")
    return values


def _tum_truth(path: Path) -> Trajectory3:
    from scipy.spatial.transform import Rotation

    if not path.is_file():
        raise RecordingNotFound(f"there are no true poses at {path}")
    stamps, values = [], []
    for number, fields in _rows(path):
        try:
            stamps.append(_nanoseconds(fields[0]))
            values.append([float(field) for field in fields[1:8]])
            if len(values[-1]) != 7 or not np.isfinite(values[-1]).all() or not any(values[-1][3:]):
                raise ValueError("these numbers are not a pose")
        except ValueError as error:
            raise RecordingDamaged(f"{path} line {number} is not `stamp x y z qx qy qz qw`: {error}") from error
    table = np.array(values).reshape(-1, 7)
    return Trajectory3(np.array(stamps, np.int64), Rotation.from_quat(table[:, 3:]).as_matrix(), table[:, :3])
