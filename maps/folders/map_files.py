"""Occupancy grids in the files of ROS map_server: `map.yaml` beside an image whose first row is the top.

Formats and thresholds follow the documentation of ROS map_server and of nav2_map_server (trinary, scale, raw).
"""

from __future__ import annotations

import difflib
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Any, get_args

import numpy as np
import yaml

from waychair.errors import MapError, MapNotFound
from waychair.files import is_file, is_folder, write_bytes, write_text
from waychair.geometry import MAX_COORDINATE, is_possible_pose
from waychair.maps.drawn.erased import clear_erased, load_erased
from waychair.maps.folders.map_shades import (
    FREE_PIXEL,
    OCCUPIED_PIXEL,
    UNKNOWN_PIXEL,
    Mode,
    ShadeRule,
    cells_from_image,
)
from waychair.maps.grid.cells import MOST_CELLS, OCCUPIED_FROM, coarser
from waychair.maps.grid.map_images import read_image
from waychair.pose_text import ImpossiblePose, checked_turn
from waychair.types import Bytes, Cells, OccupancyGrid, Pose2
from waychair.yaml_files import load_yaml, quoted

MAP_YAML = "map.yaml"
RAW_UNKNOWN_PIXEL = 255
FREE_BELOW = 50
"""Cells below this value [%], more likely free than not, are drawn as free; from here to OCCUPIED_FROM as unknown."""

OCCUPIED_THRESH = 0.65
FREE_THRESH = 0.196
"""map_server's thresholds; nav2's saver writes 0.25 for the second (see `map_shades`)."""

_log = logging.getLogger(__name__)

_REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


@dataclass(frozen=True, slots=True)
class MapInfo:
    """The content of a map's YAML: image path, resolution [m], pose of the image's lower left corner, rule of shades."""

    image: Path
    resolution: float
    map_from_grid: Pose2
    rule: ShadeRule = field(default_factory=ShadeRule)


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
    import cv2  # here, since maps of lidars alone are saved without it

    known = grid.cells >= 0
    shades = np.where(known, np.rint(255.0 * (1.0 - grid.cells / 100.0)), UNKNOWN_PIXEL).astype(np.uint8)
    pixels = np.dstack([shades, shades, shades, np.where(known, 255, 0).astype(np.uint8)])
    return bytes(cv2.imencode(".png", np.ascontiguousarray(np.flipud(pixels)))[1].tobytes())


def load_map(
    path: Path, warn: Callable[[str], object] = _log.warning, *, resolution: float | None = None
) -> OccupancyGrid:
    """Return the grid of a map folder or YAML file; the image may be a PGM, PNG or BMP.

    Cells that people have erased (`maps.drawn.erased`) are free. Cells that a map saver left unknown are unknown, whatever
    the thresholds say. `resolution` [m] joins cells to larger ones; a map of more than `MOST_CELLS` is joined likewise.
    `warn` gets a sentence about each deviation from the files; by default it is logged.

    Raises:
        ZoneError: the file of erased parts is broken.
        MapNotFound: the YAML or the image it names is not there.
        MapError: the YAML or the image is broken, or contradict each other; the message says where. Or the resolution is
            no multiple of the map's.
    """
    yaml_file = yaml_path(path)
    info = load_info(yaml_file)
    cells, warnings = cells_from_image(read_image(info.image), info.rule, str(yaml_file))
    for warning in warnings:
        warn(warning)
    grid = OccupancyGrid(np.ascontiguousarray(np.flipud(cells)), info.resolution, info.map_from_grid)
    grid = clear_erased(grid, load_erased(path))
    if resolution is not None:
        grid = coarser(grid, _times(yaml_file, info.resolution, resolution))
    height, width = grid.cells.shape
    times = max(1, math.ceil(math.sqrt(height * width / MOST_CELLS)))
    while math.ceil(height / times) * math.ceil(width / times) > MOST_CELLS:
        times += 1
    large = coarser(grid, times)
    if times > 1:
        warn(
            f"{yaml_file}: the map has {width} by {height} cells, more than the {MOST_CELLS} that can be planned on; they are "
            f"joined to cells of {large.resolution:g} m, as by --resolution {large.resolution:g}, which are occupied where "
            "any part is"
        )
    return large


def _times(path: Path, own: float, wanted: float) -> int:
    """Return how many cells of a map's own resolution [m] make one of the wanted resolution.

    Raises:
        MapError: the wanted resolution is no multiple of the map's own.
    """
    times = max(1, round(wanted / own)) if math.isfinite(wanted) else 1
    if not abs(times * own - wanted) <= 1e-6 * own * times:
        raise MapError(
            f"{path} has cells of {own:g} m, which cannot be joined to cells of {wanted:g} m; give {own:g} or a multiple, "
            f"such as {own * max(2, times):g}"
        )
    return times


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
    _check_keys(path, values)
    mode = values.get("mode", "trinary")
    if mode not in get_args(Mode):
        raise MapError(f"{path}: mode is {quoted(mode)}; it must be one of {', '.join(get_args(Mode))}")
    low, high = (_number(path, values, key, 0.0, 1.0) for key in ("free_thresh", "occupied_thresh"))
    if low >= high:
        raise MapError(f"{path}: free_thresh {low} must be less than occupied_thresh {high}")
    negate = _number(path=path, values=values, key="negate", low=0.0, high=1.0, or_bool=True) != 0.0
    return MapInfo(
        image=_image_path(path, values["image"]),
        resolution=_number(path, values, "resolution", 1e-6, 1e6),
        map_from_grid=_origin(path, values["origin"]),
        rule=ShadeRule(mode, negate, high, low),
    )


def _check_keys(path: Path, values: Mapping[Any, Any]) -> None:
    """Refuse a file that lacks a key; a misspelt one is named.

    Raises:
        MapError: a key is missing.
    """
    missing = [key for key in _REQUIRED if values.get(key) is None]
    if not missing:
        return
    others = [str(key) for key in values if key not in (*_REQUIRED, "mode")]
    near = difflib.get_close_matches(missing[0], others, n=1)
    if near:
        raise MapError(f"{path} lacks {', '.join(missing)}; rename its key '{near[0]}' to {missing[0]}")
    raise MapError(f"{path} lacks {', '.join(missing)}; add {'it' if len(missing) == 1 else 'them'}")


def _image_path(path: Path, image: Any) -> Path:
    """Return the path of a map's image.

    Raises:
        MapError: it is not a name.
        MapNotFound: it is not where the YAML says, but beside it.
    """
    if not isinstance(image, str):
        raise MapError(f"{path}: image is {quoted(image)}; it must be the name of a file")
    named = path.parent / image
    beside = path.parent / PureWindowsPath(image).name  # knows both kinds of slashes
    if not is_file(named, MapError) and is_file(beside, MapError):
        raise MapNotFound(
            f"the map's image {named} is not there, but {beside.name} lies beside {path.name}; write "
            f"`image: {beside.name}` in that file"
        )
    return named


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
    if not is_possible_pose(x, y):
        raise MapError(f"{path}: origin is {quoted(origin)}; x and y may be up to {MAX_COORDINATE:g} m from 0")
    try:
        return Pose2(x, y, checked_turn(theta))
    except ImpossiblePose as error:
        raise MapError(
            f"{path}: origin is {quoted(origin)}; its yaw must be in radians, at most a full turn (90 degrees are 1.571)"
        ) from error


def _trinary_pixels(cells: Cells) -> Bytes:
    pixels = np.full(cells.shape, UNKNOWN_PIXEL, np.uint8)
    pixels[(cells >= 0) & (cells < FREE_BELOW)] = FREE_PIXEL
    pixels[cells >= OCCUPIED_FROM] = OCCUPIED_PIXEL
    return pixels


def _raw_pixels(cells: Cells) -> Bytes:
    pixels: Bytes = np.where(cells < 0, RAW_UNKNOWN_PIXEL, cells).astype(np.uint8)
    return pixels
