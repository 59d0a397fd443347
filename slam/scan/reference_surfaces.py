"""The reference that a scan is matched against: the surfaces of a few key scans on one small grid.

Points fall into cells of side `resolution`. A cell keeps the mean point and mean normal of up to two surfaces, because
the two sides of a thin wall have opposite normals. The occupied cells, blurred by a Gaussian, are the likelihood of a
beam's end; its sliding maxima over 2^h x 2^h cells are the bounds of the branch and bound search.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.slam.scan.scan_points import ScanPoints, ScanStore
from waychair.types import Bytes, Float32Array, FloatArray, IntArray

Slots: TypeAlias = NDArray[np.int32]

LEVELS = 5
"""Levels of the bounds: 1, 2, 4, 8 and 16 cells."""


@dataclass(frozen=True, slots=True)
class ScanReference:
    """Surfaces on a grid with corner `origin` [m] in the map frame.

    - `slots` (H, W, 2): row in `surfaces` of each side of each cell, 0 for none.
    - `surfaces` (S, 4): mean x, y [m] and mean unit normal; row 0 is unused.
    - `bounds` (LEVELS, H, W) u8: level 0 is the likelihood, level h its maximum over 2^h x 2^h cells from the cell on.
    """

    origin: FloatArray
    resolution: float
    surfaces: FloatArray
    slots: Slots
    bounds: Bytes


def reference_from_scans(
    store: ScanStore, poses: FloatArray, members: Sequence[int] | IntArray, centre: FloatArray, reach: float,
    resolution: float, sigma: float,
) -> ScanReference:  # fmt: skip
    """Return the reference of the key scans `members` at map poses `poses` (N, 3), within `reach` [m] of `centre` (2,)."""
    points, normals, offsets = store.arrays
    members = np.asarray(members, np.int64)
    origin = np.floor((centre[:2] - reach) / resolution) * resolution
    size, kernel = math.ceil(2 * reach / resolution), _kernel(sigma / resolution)
    margin = _margin(kernel)
    surfaces, slots, hits = _gather(points, normals, offsets, members, poses[members], origin, size, margin, resolution)
    likelihood = _smear(hits, size, kernel)
    return ScanReference(origin, resolution, surfaces, slots, block_maxima(likelihood, LEVELS))


def reference_from_points(points: FloatArray, normals: FloatArray, resolution: float, sigma: float) -> ScanReference:
    """Return the reference of points (N, 2) and normals (N, 2) in the map frame."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    reach = float(max(high - low)) / 2 + (_margin(_kernel(sigma / resolution)) + 2) * resolution
    store = ScanStore()
    store.append(ScanPoints(points, normals))
    return reference_from_scans(
        store, np.zeros((1, 3)), members=[0], centre=(low + high) / 2, reach=reach, resolution=resolution, sigma=sigma
    )


def _margin(kernel: Bytes) -> int:
    """Return the width [cells] of the margin of zero likelihood along the grid's lower edges.

    A block that begins outside the grid may reach into it. It counts as 0, which is a bound only if its cells are 0.
    """
    return int(2 ** (LEVELS - 1)) + len(kernel) // 2


def _kernel(sigma: float) -> Bytes:
    """Return a Gaussian kernel with peak 255 over +-2.5 sigma [cells], at least one cell on each side."""
    half = max(1, math.ceil(2.5 * sigma))
    steps = np.arange(-half, half + 1)
    gauss = np.exp(-0.5 * (steps[:, None] ** 2 + steps[None, :] ** 2) / sigma**2)
    kernel: Bytes = np.round(255 * gauss).astype(np.uint8)
    return kernel


def block_maxima(likelihood: Bytes, count: int) -> Bytes:
    """Return (count, H, W): level h holds, for each cell, the maximum over the 2^h x 2^h cells from it on.

    Only cells on the grid count (Hess et al. 2016, section V.B).
    """
    levels = np.empty((count, *likelihood.shape), np.uint8)
    levels[0] = likelihood
    for h in range(1, count):
        levels[h] = doubled_blocks(levels[h - 1], 2 ** (h - 1))
    return levels


def doubled_blocks(below: Bytes, side: int) -> Bytes:
    """Return the maxima (H, W) over blocks of twice the side, from those over blocks of `side` cells."""
    across = below.copy()
    np.maximum(across[:, :-side], below[:, side:], out=across[:, :-side])
    here = across.copy()
    np.maximum(here[:-side], across[side:], out=here[:-side])
    return here


@njit(cache=True)
def _gather(
    points: Float32Array,
    normals: Float32Array,
    offsets: IntArray,
    members: IntArray,
    poses: FloatArray,
    origin: FloatArray,
    size: int,
    margin: int,
    resolution: float,
) -> tuple[FloatArray, Slots, IntArray]:
    """Return the mean surfaces, the slots of each cell's two sides, and the flat indices of occupied cells.

    Occupied cells within `margin` of the lower edges are left out.
    """
    total = 0
    for member in members:
        total += offsets[member + 1] - offsets[member]
    surfaces = np.zeros((total + 1, 4))
    counts = np.zeros(total + 1, np.int64)
    slots = np.zeros((size, size, 2), np.int32)
    seen = np.zeros((size, size), np.bool_)
    hits = np.empty(total, np.int64)
    last, used = 0, 0
    for k in range(len(members)):
        x0, y0 = poses[k, 0], poses[k, 1]
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for i in range(offsets[members[k]], offsets[members[k] + 1]):
            x = x0 + c * points[i, 0] - s * points[i, 1]
            y = y0 + s * points[i, 0] + c * points[i, 1]
            col = math.floor((x - origin[0]) / resolution)
            row = math.floor((y - origin[1]) / resolution)
            if not (0 <= col < size and 0 <= row < size):
                continue
            if col >= margin and row >= margin and not seen[row, col]:
                seen[row, col] = True
                hits[used] = row * size + col
                used += 1
            nx = c * normals[i, 0] - s * normals[i, 1]
            ny = s * normals[i, 0] + c * normals[i, 1]
            if nx == 0.0 and ny == 0.0:
                continue
            slot = slots[row, col, 0]
            side = 1 if slot > 0 and surfaces[slot, 2] * nx + surfaces[slot, 3] * ny < 0 else 0
            slot = slots[row, col, side]
            if slot == 0:
                last += 1
                slot = last
                slots[row, col, side] = slot
            counts[slot] += 1
            surfaces[slot, 0] += x
            surfaces[slot, 1] += y
            surfaces[slot, 2] += nx
            surfaces[slot, 3] += ny
    for slot in range(1, last + 1):
        norm = math.hypot(surfaces[slot, 2], surfaces[slot, 3])
        surfaces[slot, :2] /= counts[slot]
        surfaces[slot, 2:] /= norm
    return surfaces[: last + 1], slots, hits[:used]


@njit(cache=True)
def _smear(hits: IntArray, size: int, kernel: Bytes) -> Bytes:
    """Return (size, size) u8: at each cell the largest kernel value of the hit cells around it."""
    likelihood = np.zeros((size, size), np.uint8)
    half = len(kernel) // 2
    for hit in hits:
        row, col = hit // size, hit % size
        for dr in range(max(-half, -row), min(half, size - 1 - row) + 1):
            for dc in range(max(-half, -col), min(half, size - 1 - col) + 1):
                here = likelihood[row + dr, col + dc]
                likelihood[row + dr, col + dc] = max(here, kernel[dr + half, dc + half])
    return likelihood
