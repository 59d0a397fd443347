"""From the shades of a map's image to cells, by the rules of map_server and of the programs that save maps.

Savers write 205 of 255 for an unknown cell, and those of scale mode without transparency 127 or 128. With nav2's
`free_thresh: 0.25` every loader takes 205 for free floor: (255 - 205) / 255 = 0.196 (SteveMacenski/slam_toolbox#587).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from waychair.errors import MapError
from waychair.maps.grid.cells import OCCUPIED_FROM
from waychair.maps.grid.map_images import MapImage, Shades
from waychair.types import UNKNOWN, BoolArray, Cells, FloatArray

Mode = Literal["trinary", "scale", "raw"]

OCCUPIED_PIXEL, FREE_PIXEL, UNKNOWN_PIXEL = 0, 254, 205
"""The shades of a saved map."""

_HALF_GREY = 127.5
"""The unknown of savers that write half grey, 127 or 128."""

_NEARLY_ALL = 0.95
"""Least share of an image's greys, all but black and white, that the shade for unknown has in a saved map.

People edit maps in drawing programs, whose brushes leave a few other greys."""

_BLOCK = 1 << 22  # pixels converted at once: numpy takes 8 bytes for each


@dataclass(frozen=True, slots=True)
class ShadeRule:
    """How a map's YAML turns shades into cells."""

    mode: Mode = "trinary"
    negate: bool = False
    occupied_thresh: float = 0.65
    free_thresh: float = 0.196


def cells_from_image(image: MapImage, rule: ShadeRule, where: str) -> tuple[Cells, tuple[str, ...]]:
    """Return the cells (H, W) in the order of the pixels, and warnings; `where` names the map in these and in errors.

    Pixels that are not wholly opaque are unknown.

    Raises:
        MapError: the mode, or `negate`, does not fit the image: its walls would become free floor.
    """
    counts = _counts(image)
    bytes_: FloatArray = np.arange(image.white + 1, dtype=np.float64) * (255.0 / image.white)
    values = _values(bytes_, rule)
    _refuse_exchanged(counts, bytes_, image.white, rule, where)
    unknown, shade = _unknown_shade(counts, bytes_, image, rule)
    taken = unknown & (values >= 0) & (values < OCCUPIED_FROM)
    number = int(counts[taken].sum())
    values[taken] = UNKNOWN
    cells = _looked_up(image, values.astype(np.int8))
    if not number:
        return cells, ()
    made = "mode scale" if rule.mode == "scale" else f"free_thresh {rule.free_thresh:g}"
    advice = "; write free_thresh: 0.196" if rule.mode == "trinary" and shade == str(UNKNOWN_PIXEL) else ""
    sentence = (
        f"{where}: {number} cells of the shade {shade}, which map savers write for unknown, stay unknown, although {made} "
        f"would make them free floor{advice}"
    )
    return cells, (sentence,)


def _values(bytes_: FloatArray, rule: ShadeRule) -> FloatArray:
    """Return the cells' values [%] of all shades (S,), given as parts of 255, by map_server's rules."""
    if rule.mode == "raw":
        values = np.rint(bytes_)
        return np.where(values <= 100.0, values, float(UNKNOWN))
    occupancy = bytes_ / 255.0 if rule.negate else 1.0 - bytes_ / 255.0
    if rule.mode == "scale":
        span = rule.occupied_thresh - rule.free_thresh
        scaled: FloatArray = np.clip(np.rint((occupancy - rule.free_thresh) / span * 100.0), 0, 100)
        return scaled
    values = np.full(occupancy.shape, float(UNKNOWN))
    values[occupancy > rule.occupied_thresh] = 100.0
    values[occupancy < rule.free_thresh] = 0.0
    return values


def _unknown_shade(counts: Shades, bytes_: FloatArray, image: MapImage, rule: ShadeRule) -> tuple[BoolArray, str]:
    """Return which shades (S,) stand for unknown as in a saved map, and their name; none in other images."""
    none = np.zeros(len(bytes_), np.bool_)
    if rule.mode == "raw" or (rule.mode == "scale" and image.opaque is not None):
        return none, ""
    shown = 255.0 - bytes_ if rule.negate else bytes_
    grey = ~(_is(shown, 0.0, image.white) | _is(shown, FREE_PIXEL, image.white) | _is(shown, 255.0, image.white))
    greys = counts[grey].sum()
    for shade, name in ((float(UNKNOWN_PIXEL), str(UNKNOWN_PIXEL)), (_HALF_GREY, "127 or 128")):
        alike = grey & _is(shown, shade, image.white)
        if greys and counts[alike].sum() >= _NEARLY_ALL * greys:
            return alike, name
    return none, ""


def _refuse_exchanged(counts: Shades, bytes_: FloatArray, white: int, rule: ShadeRule, where: str) -> None:
    """Refuse a trinary map of a saver that is read as its negative or as raw values.

    Raises:
        MapError: it is one.
    """
    if rule.mode != "raw" and not rule.negate:
        return
    free, unknown = _is(bytes_, FREE_PIXEL, white), _is(bytes_, UNKNOWN_PIXEL, white)
    others = ~(free | unknown | _is(bytes_, 0.0, white) | _is(bytes_, 255.0, white))
    if not counts[unknown].any() or counts[others].any():
        return
    wrong, right = ("mode: raw", "mode: trinary") if rule.mode == "raw" else ("negate: 1", "negate: 0")
    raise MapError(
        f"{where}: `{wrong}` would make free floor of black, but the image's shades 0, 205 and 254 are those of a map saver, "
        f"whose walls are black; write `{right}`"
    )


def _is(bytes_: FloatArray, shade: float, white: int) -> BoolArray:
    """Return which shades (S,), as parts of 255, are a given one, rounded to the steps of the image."""
    near: BoolArray = np.abs(bytes_ - shade) < max(1.0, 255.0 / white)
    return near


def _counts(image: MapImage) -> Shades:
    """Return how many opaque pixels each shade has."""
    counts = np.zeros(image.white + 1, np.int64)
    for rows in _blocks(image):
        shades = image.shades[rows]
        shown = shades.ravel() if image.opaque is None else shades[image.opaque[rows]]
        counts += np.bincount(shown, minlength=image.white + 1)
    return counts


def _looked_up(image: MapImage, values: Cells) -> Cells:
    cells = np.empty(image.shades.shape, np.int8)
    for rows in _blocks(image):
        cells[rows] = values[image.shades[rows]]
        if image.opaque is not None:
            cells[rows][~image.opaque[rows]] = UNKNOWN
    return cells


def _blocks(image: MapImage) -> list[slice]:
    """Return slices of rows."""
    height, width = image.shades.shape
    step = max(1, _BLOCK // max(1, width))
    return [slice(at, at + step) for at in range(0, height, step)]
