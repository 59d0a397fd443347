"""How far each arc of a fan from one pose is free: the inner loop of the dynamic window.

`footprint.free_time` handles one arc. Here thousands start at the same pose, which makes each cheap: arcs of one
turning speed pass through the same headings at the same times, and their positions scale with the speed. Cosines, sines
and positions are tabulated once per turning speed.

Between two free poses the body can only touch obstacles outside both rectangles. A corner that moves by a lengthways
and b sideways is, at a share t of the step, b t outside the first and a (1 - t) outside the second: the sliver is
a b / (a + b) deep, nothing on a straight line, little on an arc. Two poses that are free by that much more prove
everything between them free; the step is halved only where they are not.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.planning.body.footprint import SLACK, SWEPT, DiscTree, Footprint, layer_outline, whole_outline
from waychair.types import Float32Array, FloatArray

FINE = 256
"""Number of finest steps over the horizon."""

_LONGEST = 4.0
"""Displacement [cells] of the body's fastest point in a coarsest step."""

_TRUST = 4
"""Number of steps that must succeed before a longer one is tried again."""


@njit(cache=True, nogil=True)
def free_times(
    shape: Footprint, start: FloatArray, candidates: FloatArray, certain: FloatArray, horizon: float
) -> FloatArray:
    """Return (N,) how long [s] the body can follow each arc, up to the horizon; 0 where it does not fit at the start.

    start (3,) [cells, cells, rad]; candidates (N, 2) of v [m/s] and omega [rad/s], fastest if sorted by omega;
    certain (N,) [s]: no obstacle is skipped up to this time, beyond it steps are coarse.
    """
    times = np.zeros(len(candidates))
    table = np.empty((FINE + 1, 4))
    reach = math.hypot(shape.discs[0, 0], shape.discs[0, 1]) + shape.discs[0, 2]
    half_width = shape.discs[0, 3]
    tabled = math.nan
    for i in range(len(candidates)):
        v, omega = candidates[i, 0] / shape.cell, candidates[i, 1]
        if omega != tabled:
            fill_table(table, start[2], omega, horizon / FINE)
            tabled = omega
        last = min(math.ceil(certain[i] / horizon * FINE), FINE)
        turn, step = abs(omega), horizon / FINE
        free = _free_steps(whole_outline(shape), start, table, v, turn, step, last, reach, half_width)
        for k in range(len(shape.layer_ends)):
            if free > 0:
                outline = layer_outline(shape, k)
                free = min(free, _free_steps(outline, start, table, v, turn, step, last, reach, half_width))
        times[i] = horizon if free == FINE else max(free, 0) * horizon / FINE
    return times


@njit(cache=True, nogil=True)
def fill_table(table: FloatArray, theta: float, omega: float, step: float) -> None:
    """Fill (K, 4): cos, sin of the heading, x and y per unit of speed, every `step` [s] along an arc from a heading."""
    half = 0.5 * omega * step
    chord = step * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    ahead, aside = chord * math.cos(half), chord * math.sin(half)
    turn_c, turn_s = math.cos(omega * step), math.sin(omega * step)
    c, s, x, y = math.cos(theta), math.sin(theta), 0.0, 0.0
    for k in range(len(table)):
        table[k, 0], table[k, 1], table[k, 2], table[k, 3] = c, s, x, y
        x += c * ahead - s * aside
        y += s * ahead + c * aside
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s


@njit(cache=True)
def _free_steps(
    outline: DiscTree,
    start: FloatArray,
    table: FloatArray,
    v: float,
    turn: float,
    step: float,
    last: int,
    reach: float,
    half_width: float,
) -> int:
    """Return how many fine steps are free, every one checked up to `last`; -1 where the start is not free."""
    tight = SLACK - SWEPT
    if not _fits(outline, start, table[0], v, tight):
        return -1
    # A corner's displacement lengthways and sideways per fine step, and how far its edges bulge in turning.
    along, across = (abs(v) + turn * half_width) * step, turn * reach * step
    bulge = (abs(v) + turn * reach) * turn * step * step / 8
    coarsest = max(1, min(int(_LONGEST / max((abs(v) + turn * reach) * step, 1e-9)), FINE // 4))
    sliver = along * across / max(along + across, 1e-12)
    here, stride, known, trusted = 0, coarsest, tight, 0
    while here < FINE:
        if here >= last:
            ahead = min(here + coarsest, FINE)
            if not _fits(outline, start, table[ahead], v, tight):
                return here
            here = ahead
            continue
        ahead = min(here + stride, FINE)
        n = ahead - here
        slack = tight + n * sliver + n * n * bulge
        if (slack <= known or _fits(outline, start, table[here], v, slack)) and _fits(
            outline, start, table[ahead], v, slack
        ):
            here, known, trusted = ahead, slack, trusted + 1
            if trusted >= _TRUST and stride < coarsest:
                stride, trusted = min(2 * stride, coarsest), 0
        elif n == 1:
            return here
        else:
            stride, trusted = n // 2, 0
    return FINE


@njit(cache=True, inline="always")
def _fits(outline: DiscTree, start: FloatArray, row: FloatArray, v: float, slack: float) -> bool:
    """Return whether no obstacle lies within the body and `slack` [cells] around it, at a row of the table."""
    c, s = row[0], row[1]
    x, y = start[0] + v * row[2], start[1] + v * row[3]
    discs, skip, metres, cell = outline
    height, width = metres.shape
    middle_x, middle_y = x + c * discs[0, 0] - s * discs[0, 1], y + s * discs[0, 0] + c * discs[0, 1]
    border = min(min(middle_x, width - middle_x), min(middle_y, height - middle_y))
    inland = border > discs[0, 2] + slack + 1.0
    i = 0
    while i < len(skip):
        u, w, radius = discs[i, 0], discs[i, 1], discs[i, 2]
        column, line = x + c * u - s * w, y + s * u + c * w
        if inland:
            distance = _bilinear(metres, column, line)
        else:
            border = min(min(column, width - column), min(line, height - line))
            distance = 0.0 if border < 1.0 else min(_bilinear(metres, column, line), border * cell)
        if distance >= (radius + slack) * cell:
            i = skip[i]
        elif skip[i] == i + 1 or distance < (discs[i, 3] + slack - 1.0) * cell:
            return False
        else:
            i += 1
    return True


@njit(cache=True, inline="always")
def _bilinear(metres: Float32Array, column: float, row: float) -> float:
    """Return `distance_field.interpolated` for a point at least one cell inside the field."""
    x, y = column - 0.5, row - 0.5
    left, below = int(x), int(y)
    x -= left
    y -= below
    low = metres[below, left] + x * (metres[below, left + 1] - metres[below, left])
    high = metres[below + 1, left] + x * (metres[below + 1, left + 1] - metres[below + 1, left])
    return float(low + y * (high - low))
