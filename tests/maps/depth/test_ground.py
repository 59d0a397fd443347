"""The ground is followed over ramps, ends at drop-offs, and is missing where it should be seen."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from waychair.maps.depth.ground import BELOW, GROUND, MISSING, NOTHING, STANDS, _beams, follow_ground

HEIGHT, BEGIN = 0.95, 0.35
FALLS = np.linspace(0.6, 0.1, 120)
"""Return the beams of one column, from a lens at this height [m], the steepest first."""


def plain_follow(
    away: list[float],
    z: list[float],
    falls: list[float],
    lens_z: float,
    begin: float,
    least: float,
    slope: float,
    reach: float,
    missing: float,
) -> tuple[list[int], list[float], list[bool]]:
    """A plain reference for one column: all ground so far limits the ground that may follow."""
    ground = [(begin, 0.0)]
    kind, foot, rim = [NOTHING] * len(away), [math.nan] * len(away), [False] * len(away)
    last_row, lost, hidden, before, run = -1, False, math.inf, (begin, 0.0), list[int]()

    def miss(until: float) -> None:
        if run and until - foot[run[0]] >= missing:
            for row in run:
                kind[row] = MISSING
        run.clear()

    for row, (d, here, fall) in enumerate(zip(away, z, falls, strict=True)):
        last, level = max(each for each, _ in ground), ground[-1][1]
        meets = max((lens_z - level) / fall if fall > 0.0 else math.inf, last)
        if math.isnan(d):
            if meets < min(reach, hidden):
                foot[row] = meets
                run.append(row)
            continue
        # the length of ground between, counted along the chain of its farthest points
        spans = [max(each for each, _ in ground[: k + 1]) for k in range(len(ground))]
        upper = min(height + slope * (max(d, last) - span) for span, (_, height) in zip(spans, ground, strict=True))
        fall_off = 0.0 if lost else slope
        lower = max(
            height - slope * (last - span) - fall_off * (max(d, last) - last)
            for span, (_, height) in zip(spans, ground, strict=True)
        )
        rises = lost and here < level + least and here - before[1] > slope * max(d - before[0], 0.0) + 0.012
        before, where = (d, here), d
        if here > upper + least:
            kind[row], hidden = STANDS, min(hidden, d)
        elif here < lower - least or rises:
            where = meets
            if where < reach:
                kind[row], foot[row] = BELOW, where
                if not lost and last_row >= 0:
                    rim[last_row] = True
                lost = True
        else:
            kind[row], foot[row] = GROUND, d if d < reach else math.nan
            ground.append((d, here))
            last_row, lost = row, False
        miss(min(where, reach))
    miss(min(hidden, reach))
    return kind, foot, rim


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_the_kernel_of_beams_equals_plain_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth, rays = rng.uniform(0.3, 8.0, (5, 7)).astype(np.float32), rng.uniform(-1, 1, (5, 7, 3))
    depth[rng.random((5, 7)) < 0.3] = rng.choice(np.array([math.nan, math.inf, 0.0, -1.0], np.float32))
    lens = np.array([0.4, 0.0, 0.95])
    plain = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.nan).astype(np.float64)
    flat = np.hypot(rays[..., 0], rays[..., 1])
    expected = lens + plain[..., None] * rays, rays[..., :2] / flat[..., None], flat * plain, -rays[..., 2] / flat
    for found, each in zip(_beams(depth, rays, lens), expected, strict=True):
        assert found == pytest.approx(each, nan_ok=True)


@given(st.integers(0, 2**32 - 1))
@example(128000000)  # ground that goes on beyond a drop-off, a little lower
@settings(max_examples=60, deadline=None)
def test_the_kernel_equals_plain_python(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 50
    falls = np.sort(rng.uniform(-0.05, 0.8, count))[::-1].copy()
    z = np.where(rng.random(count) < 0.5, 0.0, np.cumsum(rng.uniform(-0.3, 0.3, count)))
    away = np.abs((HEIGHT - z) / np.where(falls == 0.0, 1.0, falls))
    away[rng.random(count) < 0.3] = np.nan
    arguments = (HEIGHT, BEGIN, 0.06, 0.12, 3.5, 0.3)
    kind, foot, rim = follow_ground(away[:, None], z[:, None], falls[:, None], *arguments)
    plain = plain_follow(away.tolist(), z.tolist(), falls.tolist(), *arguments)
    assert kind[:, 0].tolist() == plain[0]
    np.testing.assert_allclose(foot[:, 0], plain[1])
    assert rim[:, 0].tolist() == plain[2]


def follow(ends: list[tuple[float, float]], unseen: tuple[float, float] = (9.0, 9.0)) -> tuple[list[int], list[float]]:
    """Kind and foot of the column's beams over a profile of corners (away, z) [m]; nothing comes from some stretch."""
    profile = np.array([(0.0, 0.0), *ends, (9.0, ends[-1][1])])
    along = np.linspace(0.0, 1.0, 4001)
    parts = [a + (b - a) * along[:, None] for a, b in pairwise(profile)]
    x, height = np.concatenate(parts).T
    hits = np.array([int(np.argmax(HEIGHT - fall * x <= height)) for fall in FALLS])  # 0: nowhere
    away, z = np.where(hits, x[hits], np.nan), height[hits]
    away[(away >= unseen[0]) & (away < unseen[1])] = np.nan
    kind, foot, _ = follow_ground(away[:, None], z[:, None], FALLS[:, None], HEIGHT, BEGIN, 0.06, 0.12, 3.5, 0.3)
    return kind[:, 0].tolist(), foot[:, 0].tolist()


@pytest.mark.parametrize("depth", [0.15, 0.5, 1.5])
def test_a_pit_is_marked_from_edge_to_edge(depth: float) -> None:
    kind, foot = follow([(2.0, 0.0), (2.0, -depth), (3.0, -depth), (3.0, 0.0)])
    mouth = [each for each, what in zip(foot, kind, strict=True) if what == BELOW]
    assert min(mouth) == pytest.approx(2.0, abs=0.08)
    assert max(mouth) == pytest.approx(3.0, abs=0.15)
    assert max(np.diff(sorted(mouth))) < 0.1
    beyond = {what for each, what in zip(foot, kind, strict=True) if each > 3.2}
    assert beyond == {GROUND}


def test_stairs_down_are_a_drop_off_and_a_step_up_is_an_obstacle() -> None:
    down, _ = follow([(2.0, 0.0), (2.0, -0.17), (2.28, -0.17), (2.28, -0.34), (2.56, -0.34), (2.56, -0.51)])
    assert BELOW in down
    assert STANDS not in down
    up, _ = follow([(2.0, 0.0), (2.0, 0.12)])
    assert STANDS in up
    assert BELOW not in up


@pytest.mark.parametrize("slope", [-1 / 12, -0.05, 0.05, 1 / 12])
def test_a_ramp_is_ground_all_the_way_up_and_down(slope: float) -> None:
    kind, _ = follow([(2.0, 0.0), (3.0, slope), (4.0, 0.0)])
    assert set(kind) <= {GROUND, NOTHING}


def test_ground_is_missing_on_a_long_unseen_stretch_but_not_behind_an_obstacle() -> None:
    kind, foot = follow([(8.0, 0.0)], unseen=(2.0, 2.6))
    missed = [each for each, what in zip(foot, kind, strict=True) if what == MISSING]
    assert 2.0 <= min(missed) < max(missed) < 2.6
    assert MISSING not in follow([(8.0, 0.0)], unseen=(2.0, 2.2))[0]
    wall, _ = follow([(2.0, 0.0), (2.0, 0.4), (2.1, 0.4)], unseen=(2.05, 9.0))
    assert STANDS in wall
    assert MISSING not in wall
