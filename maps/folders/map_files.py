"""Occupancy grids in the files of ROS map_server: `map.yaml` beside an image whose first row is the top.

Formats and thresholds follow the documentation of ROS map_server and of nav2_map_server (trinary, scale, raw).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np
import yaml

from waychair.errors import MapError, MapNotFound
from waychair.files import is_file, is_folder, write_bytes, write_text
from waychair.geometry import MAX_ANGLE, MAX_COORDINATE, is_possible_pose
from waychair.maps.drawn.erased import clear_erased, load_erased
from waychair.maps.grid.cells import OCCUPIED_FROM
from waychair.maps.grid.map_images import read_image
from waychair.types import UNKNOWN, BoolArray, Bytes, Cells, FloatArray, OccupancyGrid, Pose2
from waychair.yaml_files import load_yaml, quoted

MAP_YAML = "map.yaml"
OCCUPIED_PIXEL, FREE_PIXEL, UNKNOWN_PIXEL = 0, 254, 205
RAW_UNKNOWN_PIXEL = 255
FREE_BELOW = 50
"""Cells below this value [%], more likely free than not, are drawn as free; from here to OCCUPIED_FROM as unknown."""

OCCUPIED_THRESH = 0.65
FREE_THRESH = 0.196
"""map_server's thresholds. nav2's saver writes 0.25 for the second, but the grey of an unknown cell stands for
(255 - 205) / 255 = 0.19608: with 0.25 every loader reads unknown cells as free (SteveMacenski/slam_toolbox#587)."""

Mode = Literal["trinary", "scale", "raw"]
_REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


@dataclass(frozen=True, slots=True)
class MapInfo:
    """The content of a map's YAML: image path, resolution [m], pose of the image's lower left corner, pixel format."""

    image: Path
    resolution: float
    map_from_grid: Pose2
    mode: Mode
    negate: bool
    occupied_thresh: float
    free_thresh: float


def save_map(folder: Path, grid: OccupancyGrid, *, mode: Mode = "trinary", name: str = "map") -> None:
    """Write the image (map.pgm, for scale map.png) and then map.yaml into a folder, each whole or not at all.

    `name` replaces `map` in both file names.

    Trinary keeps occupied (from 65 %), free (below 50 %) and unknown; raw and scale keep every value. Scale has
    the thresholds 0 and 1, so that percents survive, and unknown cells are transparent.

    Raises:
        OutputError: the folder cannot be made or written to.
    """
    file, image = (f"{name}.png", _scale_image(grid)) if mode == "scale" else (f"{name}.pgm", _pgm(grid, mode))
    origin = grid.map_from_grid
    values = {
        "image": file,
        "mode": mode,
        "resolution": float(grid.resolution),
        "origin": [float(origin.x), float(origin.y), float(origin.theta)],
        "negate": 0,
        "occupied_thresh": 1.0 if mode == "scale" else OCCUPIED_THRESH,
        "free_thresh": 0.0 if mode == "scale" else FREE_THRESH,
    }
    write_bytes(folder / file, image)
    write_text(folder / f"{name}.yaml", yaml.safe_dump(values, sort_keys=False, default_flow_style=None))


def _pgm(grid: OccupancyGrid, mode: Mode) -> bytes:
    pixels = _trinary_pixels(grid.cells) if mode == "trinary" else _raw_pixels(grid.cells)
    height, width = grid.cells.shape
    header = f"P5\n# {grid.resolution!r} m/pix\n{width} {height}\n255\n"
    return header.encode() + np.flipud(pixels).tobytes()


def _scale_image(grid: OccupancyGrid) -> bytes:
    """Return a PNG as nav2's map saver writes it: black is 100 %, white 0 %, transparent is unknown."""
    known = grid.cells >= 0
    shades = np.where(known, np.rint(255.0 * (1.0 - grid.cells / 100.0)), UNKNOWN_PIXEL).astype(np.uint8)
    pixels = np.dstack([shades, shades, shades, np.where(known, 255, 0).astype(np.uint8)])
    return bytes(cv2.imencode(".png", np.ascontiguousarray(np.flipud(pixels)))[1].tobytes())


def load_map(path: Path) -> OccupancyGrid:
    """Return the grid of a map folder or YAML file; the image may be of any kind that OpenCV reads (PGM, PNG, BMP).

    Cells that people have erased (`maps.drawn.erased`) are free.

    Raises:
        ZoneError: the file of erased parts is broken.
        MapNotFound: the YAML or the image it names is not there.
        MapError: the YAML or the image is broken; the message says where.
    """
    info = load_info(yaml_path(path))
    image, brightest = read_image(info.image)
    cells_from_image = _CELLS_FROM_IMAGE[info.mode]
    if image.shape[2] == 1:  # each shade is converted once, so that large maps take little memory
        shades = np.arange(brightest + 1.0).reshape(1, -1, 1) / brightest
        cells = cells_from_image(shades, info)[0][image[..., 0]]
    else:
        cells = cells_from_image(image / float(brightest), info)
    grid = OccupancyGrid(np.ascontiguousarray(np.flipud(cells)), info.resolution, info.map_from_grid)
    return clear_erased(grid, load_erased(path))


def yaml_path(path: Path) -> Path:
    """Return the YAML file of a map, given its folder or that file."""
    return path / MAP_YAML if is_folder(path, MapError) else path


def load_info(path: Path) -> MapInfo:
    """Return the checked content of a map's YAML file.

    Raises:
        MapNotFound: there is no such file.
        MapError: it is not YAML, lacks a key, or holds an impossible value.
    """
    if not is_file(path, MapError):
        raise MapNotFound(f"there is no map at {path}; give a folder with a {MAP_YAML}, or the .yaml file itself")
    values = load_yaml(path, MapError, "give the .yaml file of a map, not its image")
    if not isinstance(values, dict):
        raise MapError(f"{path} must hold `key: value` lines, with {', '.join(_REQUIRED)}")
    missing = [key for key in _REQUIRED if values.get(key) is None]
    if missing:
        raise MapError(f"{path} lacks {', '.join(missing)}; add {'it' if len(missing) == 1 else 'them'}")
    mode = values.get("mode", "trinary")
    if mode not in get_args(Mode):
        raise MapError(f"{path}: mode is {quoted(mode)}; it must be one of {', '.join(get_args(Mode))}")
    low, high = (_number(path, values, key, 0.0, 1.0) for key in ("free_thresh", "occupied_thresh"))
    if low >= high:
        raise MapError(f"{path}: free_thresh {low} must be less than occupied_thresh {high}")
    return MapInfo(
        image=path.parent / str(values["image"]),
        resolution=_number(path, values, "resolution", 1e-6, 1e6),
        map_from_grid=_origin(path, values["origin"]),
        mode=mode,
        negate=_number(path=path, values=values, key="negate", low=0.0, high=1.0, or_bool=True) != 0.0,
        occupied_thresh=high,
        free_thresh=low,
    )


def _number(
    path: Path, values: Mapping[str, Any], key: str, low: float, high: float, *, or_bool: bool = False
) -> float:
    try:
        value = float(values[key]) if or_bool else _float(values[key])
    except (TypeError, ValueError) as error:
        raise MapError(f"{path}: {key} is {quoted(values[key])}; it must be a number") from error
    if not low <= value <= high:
        raise MapError(f"{path}: {key} is {value}; it must lie in [{low:g}, {high:g}]")
    return value


def _float(value: Any) -> float:
    """Return a number; `yes` and `true`, which Python takes for 1, raise TypeError."""
    if isinstance(value, bool):
        raise TypeError(value)
    return float(value)


def _origin(path: Path, origin: Any) -> Pose2:
    try:
        x, y, theta = (_float(value) for value in origin)
    except (TypeError, ValueError) as error:
        raise MapError(f"{path}: origin is {quoted(origin)}; it must be [x, y, yaw] in metres and radians") from error
    if not is_possible_pose(x, y, theta):
        raise MapError(
            f"{path}: origin is {quoted(origin)}; x and y may be up to {MAX_COORDINATE:g} m from 0, "
            f"yaw {MAX_ANGLE:g} rad"
        )
    return Pose2(x, y, theta)


def _trinary_pixels(cells: Cells) -> Bytes:
    pixels = np.full(cells.shape, UNKNOWN_PIXEL, np.uint8)
    pixels[(cells >= 0) & (cells < FREE_BELOW)] = FREE_PIXEL
    pixels[cells >= OCCUPIED_FROM] = OCCUPIED_PIXEL
    return pixels


def _raw_pixels(cells: Cells) -> Bytes:
    pixels: Bytes = np.where(cells < 0, RAW_UNKNOWN_PIXEL, cells).astype(np.uint8)
    return pixels


def _trinary_cells(image: FloatArray, info: MapInfo) -> Cells:
    """Return 100 above the occupied threshold, 0 below the free one, else unknown; transparent pixels are unknown."""
    shades, opaque = _opaque_part(image)
    occupancy = _occupancy(shades, info)
    cells = np.full(occupancy.shape, UNKNOWN, np.int8)
    cells[occupancy > info.occupied_thresh] = 100
    cells[occupancy < info.free_thresh] = 0
    cells[~opaque] = UNKNOWN
    return cells


def _scale_cells(image: FloatArray, info: MapInfo) -> Cells:
    """Return 0..100 linearly between the thresholds; a pixel that is not opaque is unknown."""
    shades, opaque = _opaque_part(image)
    occupancy = _occupancy(shades, info)
    span = info.occupied_thresh - info.free_thresh
    cells = np.clip(np.rint((occupancy - info.free_thresh) / span * 100.0), 0, 100).astype(np.int8)
    cells[~opaque] = UNKNOWN
    return cells


def _opaque_part(image: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the channels (H, W, C) without transparency, and which pixels (H, W) are opaque."""
    if image.shape[2] not in (2, 4):
        return image, np.ones(image.shape[:2], np.bool_)
    opaque: BoolArray = image[..., -1] >= 1.0
    return image[..., :-1], opaque


def _occupancy(image: FloatArray, info: MapInfo) -> FloatArray:
    """Return the probability (H, W) that a cell is occupied: high for dark pixels unless negated."""
    shade: FloatArray = image.mean(axis=2)
    return shade if info.negate else 1.0 - shade


def _raw_cells(image: FloatArray, _: MapInfo) -> Cells:
    """Return the pixels as values; beyond 100 a cell is unknown."""
    values = np.rint(image[..., 0] * 255.0)
    cells: Cells = np.where(values <= 100.0, values, UNKNOWN).astype(np.int8)
    return cells


_CELLS_FROM_IMAGE: dict[Mode, Callable[[FloatArray, MapInfo], Cells]] = {
    "trinary": _trinary_cells,
    "scale": _scale_cells,
    "raw": _raw_cells,
}
