"""Extra local smoothing in a multigrid cycle: the cycle stays symmetric, and fewer cycles are needed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planning.plain_multigrid import ROUND, drawn, plain_cycle, scattered, walls_of
from waychair.planning.harmonic import multigrid_patches as module
from waychair.planning.harmonic.conjugate_gradients import conjugate_gradients
from waychair.planning.harmonic.laplace_solvers import laplace_problem
from waychair.planning.harmonic.multigrid import v_cycle, v_cycle_resumably
from waychair.planning.harmonic.multigrid_levels import MultigridLevel, levels_from
from waychair.planning.harmonic.multigrid_patches import CellRectangle, SmoothingPatches, smoothing_patches
from waychair.resumable import finished
from waychair.types import Float32Array, FloatArray


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Patches on grids small enough for a plain reference."""
    monkeypatch.setattr(module, "_WORTH", 0)
    monkeypatch.setattr(module, "_LARGEST_SHARE", 1.0)
    monkeypatch.setattr(module, "_ROUND", ROUND)


def place(top: int, left: int, bottom: int, right: int) -> CellRectangle:
    return np.array([top, left]), np.array([bottom, right])


PLACES = [place(4, 5, 6, 6), place(5, 9, 5, 9), place(18, 1, 21, 3)]
"""Two patches that overlap with their surroundings, and one at a corner."""


def made(seed: int = 5) -> tuple[Float32Array, tuple[MultigridLevel, ...], SmoothingPatches]:
    walls = walls_of(scattered(seed, 21, 30))
    levels = levels_from(walls)
    return walls, levels, smoothing_patches(levels, PLACES)


@pytest.mark.usefixtures("small")
@pytest.mark.nightly
def test_the_v_cycle_with_patches_equals_a_plain_reference() -> None:
    walls, levels, patches = made()
    b = drawn(walls, 0)
    levels[0].b[:] = b
    v_cycle(levels, patches)
    plain = plain_cycle(levels, PLACES, b.ravel()).reshape(b.shape)
    assert len(patches[0]) == len(PLACES)
    np.testing.assert_allclose(levels[0].x, plain, atol=2e-5 * np.abs(plain).max())
    np.testing.assert_array_equal(levels[0].b, b.astype(np.float32))


@pytest.mark.usefixtures("small")
def test_with_patches_it_is_symmetric_and_positive_and_returns_its_product() -> None:
    walls, levels, patches = made(4)
    first, second = drawn(walls, 0), drawn(walls, 1)

    def cycled(b: FloatArray) -> FloatArray:
        levels[0].b[:] = b
        product = finished(v_cycle_resumably(levels, patches))
        x = levels[0].x.astype(np.float64)
        assert product == pytest.approx(np.vdot(b, x), rel=1e-5)
        return x

    assert np.vdot(first, cycled(second)) == pytest.approx(np.vdot(second, cycled(first)), rel=1e-4)
    assert np.vdot(first, cycled(first)) > 0


def test_a_single_obstacle_on_open_floor_takes_fewer_cycles_with_a_patch_round_it() -> None:
    side, goal = 600, (200, 300)
    free = np.ones((side, side), np.bool_)
    rng = np.random.default_rng(1)
    cells = np.array([400, 250]) + rng.integers(-20, 21, (20, 2))
    free[cells[:, 0], cells[:, 1]] = False
    walls = walls_of(laplace_problem(free, goal))
    b = np.zeros((side + 2, side + 2))
    for d, e in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        b[goal[0] + 1 + d, goal[1] + 1 + e] = 1.0
    levels = levels_from(walls)
    places = [place(200, 300, 202, 302), (cells.min(axis=0) + 1, cells.max(axis=0) + 1)]

    def cycles(patches: SmoothingPatches) -> int:
        residual, count = finished(conjugate_gradients(walls, levels, np.zeros_like(b), b, 1e-8, 30, None, patches))
        assert residual <= 1e-8
        return count

    assert cycles(smoothing_patches(levels, places)) <= cycles(()) - 2


def test_there_are_no_patches_where_they_would_take_more_time_than_they_save() -> None:
    levels = levels_from(walls_of(scattered(1, 60, 60)))
    assert smoothing_patches(levels, [place(30, 30, 31, 31)]) == ()
    large = levels_from(np.zeros((520, 520), np.float32))
    assert smoothing_patches(large, [place(1, 1, 400, 400)])[0] == ()
