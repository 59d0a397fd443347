"""Basins of clearance: the floor, flooded from the cells that are farthest from walls towards the walls.

Each local maximum of the clearance begins a basin. Where two basins meet, the clearance has a saddle: the middle of the
narrowest place between them, half as wide as that place. A saddle that is almost as wide as the smaller basin joins
the two (watershed with merging by relative saddle height; Bormann et al. 2016 survey such methods).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.types import BoolArray, Float32Array, IntArray

Labels = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Basins:
    """Basins of a floor.

    Attributes:
        labels: (H, W) int32, 0 for walls, else the basin's number from 1.
        peaks: (N + 1,) float32, greatest clearance of each basin [m]; 0 for number 0.
        clearance: (H, W) float32, distance of each cell's centre from the nearest wall cell's centre [m].
    """

    labels: Labels
    peaks: Float32Array
    clearance: Float32Array


@dataclass(frozen=True, slots=True)
class Contacts:
    """Pairs of neighbouring labels, each once, with their widest saddle.

    Attributes:
        pairs: (K, 2) int64 labels, the smaller first.
        saddles: (K,) float32, the greatest clearance at their common edge [m].
    """

    pairs: IntArray
    saddles: Float32Array


def clearance_from_walls(walls: BoolArray, resolution: float) -> Float32Array:
    """Return (H, W) float32 the distance [m] of each cell from walls, and from beyond the grid's edge."""
    floor = np.pad(~walls, 1).astype(np.uint8)
    cells = cv2.distanceTransform(floor, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    return np.asarray(cells, np.float32) * np.float32(resolution)


def basins_of(clearance: Float32Array, resolution: float, joined_from: float, widest: float) -> Basins:
    """Return the basins of a floor.

    Args:
        clearance: (H, W) [m] of `clearance_from_walls`.
        resolution: side of a cell [m].
        joined_from: two basins are one where their saddle exceeds this share of the lower peak.
        widest: or where their saddle exceeds this [m], half the widest place that parts two rooms.
    """
    padded = np.pad(clearance, 1)
    level = np.minimum(np.round(padded.ravel() * (16 / resolution)), 65535).astype(np.uint16)
    inside = np.flatnonzero(level)
    order = inside[np.argsort(65535 - level[inside], kind="stable")]
    labels, peaks = _flood(order, padded.ravel(), padded.shape[1], np.float32(joined_from), np.float32(widest))
    return Basins(labels.reshape(padded.shape)[1:-1, 1:-1].copy(), peaks, clearance)


_BEFORE = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Steps (rows, columns) to half of a cell's eight neighbours: each pair of neighbours is visited once."""


def edge_cells(labels: Labels, clearance: Float32Array) -> tuple[IntArray, IntArray, Float32Array]:
    """Return the cells at the edges between labels.

    Returns:
        cells: (M, 2) rows and columns of one cell of each pair of neighbouring cells with two labels.
        pairs: (M, 2) the two labels, the smaller first.
        clearance: (M,) float32, the lesser clearance of the two cells [m].
    """
    height, width = labels.shape
    cells, pairs, widths = [], [], []
    for down, right in _BEFORE:
        here = np.s_[: height - down, max(0, -right) : width - max(0, right)]
        there = np.s_[down:, max(0, right) : width + min(0, right)]
        one, other = labels[here], labels[there]
        rows, columns = np.nonzero((one != other) & (one > 0) & (other > 0))
        cells.append(np.column_stack([rows, columns + max(0, -right)]))
        pairs.append(np.sort(np.column_stack([one[rows, columns], other[rows, columns]]), axis=1))
        widths.append(np.minimum(clearance[here][rows, columns], clearance[there][rows, columns]))
    return np.concatenate(cells), np.concatenate(pairs).astype(np.int64), np.concatenate(widths)


def contacts_of(labels: Labels, clearance: Float32Array) -> Contacts:
    """Return which labels touch, and how widely."""
    _, pairs, widths = edge_cells(labels, clearance)
    if not len(pairs):
        return Contacts(np.empty((0, 2), np.int64), np.empty(0, np.float32))
    unique, which = np.unique(pairs, axis=0, return_inverse=True)
    saddles = np.zeros(len(unique), np.float32)
    np.maximum.at(saddles, which.ravel(), widths)
    return Contacts(unique, saddles)


@njit(cache=True, inline="always")
def _root(parents: Labels, label: int) -> int:
    """Return the label that a basin was joined to, and shorten the way to it."""
    while parents[label] != label:
        parents[label] = parents[parents[label]]
        label = parents[label]
    return label


@njit(cache=True, nogil=True)
def _flood(
    order: IntArray, clearance: Float32Array, width: int, joined_from: np.float32, widest: np.float32
) -> tuple[Labels, Float32Array]:
    """Return labels (cells,) from 1 and their peaks; `order` lists the cells by falling clearance, `width` is a row's.

    A cell takes the label of the neighbour that lies in the direction of steepest ascent, so that an edge runs straight
    from the saddle to both jambs.
    """
    labels = np.zeros(len(clearance), np.int32)
    parents = np.zeros(len(order) + 1, np.int32)
    peaks = np.zeros(len(order) + 1, np.float32)
    count = 0
    steps = np.array([-width, -1, 1, width, -width - 1, -width + 1, width - 1, width + 1])
    nearness = np.array([1, 1, 1, 1, 0.70710678, 0.70710678, 0.70710678, 0.70710678], np.float32)
    for cell in order:
        here = clearance[cell]
        first, own, steepest = 0, 0, np.float32(-1)
        for step, near in zip(steps, nearness):  # noqa: B905 (numba)
            label = labels[cell + step]
            if label == 0:
                continue
            slope = (clearance[cell + step] - here) * near
            if slope > steepest:
                steepest, own = slope, label
            label = _root(parents, label)
            if first == 0 or label == first:
                first = label
                continue
            high, low = (first, label) if peaks[first] >= peaks[label] else (label, first)
            if here > joined_from * peaks[low] or here > widest:
                parents[low] = high
            first = high
        if first == 0:
            count += 1
            parents[count], peaks[count] = count, here
            own = count
        labels[cell] = own

    numbers = np.zeros(count + 1, np.int32)
    left = 0
    for label in range(1, count + 1):
        if parents[label] == label:
            left += 1
            numbers[label] = left
            peaks[left] = peaks[label]
    for cell in order:
        labels[cell] = numbers[_root(parents, labels[cell])]
    return labels, peaks[: left + 1].copy()
