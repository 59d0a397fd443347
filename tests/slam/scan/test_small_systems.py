"""Three equations solved by Cholesky's method."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.slam.scan.small_systems import solved


@pytest.mark.parametrize("seed", range(5))
def test_the_solution_is_that_of_lapack(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(3, 3)) * (1.0, 10.0**seed, 0.1)
    matrix, right = rows.T @ rows + 1e-6 * np.eye(3), rng.normal(size=3)
    assert solved(matrix, right) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-6)


def test_a_matrix_that_is_not_positive_definite_has_no_solution() -> None:
    for diagonal in ((-1.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, math.nan)):
        assert not np.isfinite(solved(np.diag(diagonal), np.ones(3))).all()
