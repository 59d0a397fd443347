"""The appearance of surfaces: a table of numbers for each kind, from which `shaders.py` draws it.

No image is stored. Every pattern is a sum of the same parts: soft clouds, joints between pieces, and four layers of
marks (stains, scratches, pores, specks) from coarse to fine, so that a camera finds corners near and far.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from waychair.simulation.scene.scene import MATERIALS, Colour
from waychair.types import Float32Array

GLASS = "glass"
"""The look that is blended over the surfaces behind it."""

GLASS_OPACITY = 0.25
"""Opacity of glass in colour, and the part of depth pixels that it corrupts."""


@dataclass(frozen=True, slots=True)
class Clouds:
    """Soft blotches: length and height [m], and contrast relative to the mean brightness."""

    length: float = 0.5
    height: float = 0.5
    contrast: float = 0.15


@dataclass(frozen=True, slots=True)
class Joints:
    """Lines of `width` between pieces of `length` by `height` [m]; `contrast` of lines and `tint` between pieces."""

    length: float
    height: float
    width: float
    contrast: float
    tint: float


@dataclass(frozen=True, slots=True)
class LookPattern:
    """The numbers of a pattern; marks lie in cells of four sizes [m], at most one per cell."""

    clouds: Clouds = Clouds()
    joints: Joints | None = None
    cells: tuple[float, float, float, float] = (0.45, 0.15, 0.05, 0.017)
    contrasts: tuple[float, float, float, float] = (0.2, 0.3, 0.3, 0.3)
    density: float = 0.5  # part of the cells with a mark
    stretch: float = 1.0  # length over height of the marks
    tilt: float = 2.0  # spread of the marks' slant; 0: all upright
    colourful: float = 0.0  # spread of the marks' colour, beside their brightness
    variety: float = 0.0  # spread of the whole surface's colour by its seed


WOOD_CELLS = (0.4, 0.12, 0.04, 0.012)
METAL_CELLS = (0.35, 0.1, 0.03, 0.01)
POSTER_CELLS = (0.24, 0.08, 0.032, 0.012)

PATTERNS: Mapping[str, LookPattern] = MappingProxyType(
    {
        "plaster": LookPattern(Clouds(0.7, 0.5, 0.14), contrasts=(0.30, 0.42, 0.50, 0.45), density=0.45, variety=0.05),
        "concrete": LookPattern(
            Clouds(0.8, 0.3, 0.28), Joints(2.4, 1.2, 0.008, 0.4, 0.1), contrasts=(0.35, 0.5, 0.6, 0.5)
        ),
        "tiles": LookPattern(Clouds(0.9, 0.9, 0.12), Joints(0.45, 0.45, 0.006, 0.5, 0.14), contrasts=(0.2, 0.4, 0.6, 0.5)),
        "panels": LookPattern(
            Clouds(1.5, 1.5, 0.08), Joints(0.6, 0.6, 0.012, 0.5, 0.06), contrasts=(0.2, 0.4, 0.5, 0.5), density=0.6
        ),
        "wood": LookPattern(
            Clouds(0.9, 0.04, 0.35), Joints(1.0, 0.25, 0.004, 0.5, 0.15), WOOD_CELLS, (0.2, 0.4, 0.45, 0.4),
            density=0.4, stretch=3.0, tilt=0.4, colourful=0.15, variety=0.3,
        ),
        "cloth": LookPattern(
            Clouds(0.3, 0.3, 0.15), Joints(0.012, 0.012, 0.003, 0.3, 0.2), contrasts=(0.3, 0.4, 0.3, 0.2),
            colourful=0.3, variety=0.15,
        ),
        "leather": LookPattern(Clouds(0.2, 0.2, 0.3), Joints(0.5, 0.35, 0.01, 0.4, 0.1), contrasts=(0.1, 0.2, 0.3, 0.4)),
        "metal": LookPattern(
            Clouds(1.0, 0.02, 0.14), Joints(0.9, 0.9, 0.006, 0.5, 0.08), METAL_CELLS, (0.15, 0.3, 0.3, 0.3),
            density=0.3, stretch=3.0, tilt=0.6,
        ),
        "glass": LookPattern(Clouds(1.0, 1.0, 0.05), contrasts=(0.05, 0.0, 0.1, 0.1), density=0.1),
        "mirror": LookPattern(Clouds(1.2, 0.8, 0.25), contrasts=(0.05, 0.0, 0.05, 0.0), density=0.1),
        "skin": LookPattern(Clouds(0.1, 0.1, 0.1), contrasts=(0.1, 0.1, 0.1, 0.1), variety=0.3),
        "poster": LookPattern(
            Clouds(0.3, 0.2, 0.2), None, POSTER_CELLS, (1.0, 0.8, 0.7, 0.5),
            density=0.7, stretch=1.4, tilt=1.0, colourful=0.6, variety=0.6,
        ),
        "clothes": LookPattern(Clouds(0.2, 0.4, 0.2), contrasts=(0.5, 0.4, 0.3, 0.2), colourful=0.3, variety=0.9),
        "print": LookPattern(Clouds(0.5, 0.5, 0.0), contrasts=(0.0, 0.0, 0.0, 0.0)),
        "lamp": LookPattern(Clouds(0.5, 0.5, 0.02), contrasts=(0.0, 0.0, 0.02, 0.0)),
    }
)  # fmt: skip
"""Patterns by the names of `scene.PATTERNS`, and of surfaces that have no material."""


@dataclass(frozen=True, slots=True)
class Look:
    """A pattern in a mean colour; `returns` is the part of its pixels that a depth camera can measure."""

    pattern: str
    colour: Colour
    returns: float = 1.0


LOOKS: Mapping[str, Look] = MappingProxyType(
    {name: Look(material.pattern, material.colour) for name, material in MATERIALS.items()}
    | {
        "black_leather": Look("leather", MATERIALS["black_leather"].colour, 0.5),
        "mirror": Look("mirror", MATERIALS["mirror"].colour, 0.0),
        "poster": Look("poster", (0.6, 0.6, 0.6)),
        "paper": Look("print", (0.82, 0.82, 0.80)),
        "ink": Look("print", (0.04, 0.04, 0.04)),
        "clothes": Look("clothes", (0.3, 0.3, 0.3)),
        "skin": Look("skin", (0.55, 0.38, 0.28)),
        "lamp": Look("lamp", (0.98, 0.98, 0.95), 0.6),
    }
)
"""Looks by material, and of surfaces that have no material."""

LOOK_ROWS = 7
"""Rows of four numbers per look in `look_table`."""


def look_table() -> Float32Array:
    """Return (looks, LOOK_ROWS, 4) float32: the numbers of all looks in the order of `LOOKS`, for the shaders."""
    return np.array([_rows(look, PATTERNS[look.pattern]) for look in LOOKS.values()], np.float32)


def _rows(look: Look, p: LookPattern) -> list[tuple[float, ...]]:
    """Return the rows of a look; lengths become their number per metre."""
    joints, tint = (0.0, 0.0, 0.0, 0.0), 0.0
    if p.joints:
        joints, tint = (1.0 / p.joints.length, 1.0 / p.joints.height, p.joints.width, p.joints.contrast), p.joints.tint
    return [
        (*look.colour, look.returns),
        (1.0 / p.clouds.length, 1.0 / p.clouds.height, p.clouds.contrast, p.colourful),
        joints,
        tuple(1.0 / side for side in p.cells),
        p.contrasts,
        (p.density, 1.0 / p.stretch, p.tilt, tint),
        (p.variety, 0.0, 0.0, 0.0),
    ]
