"""The rubber band: no sharp turns, no longer path, and never less than the permitted clearance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from evaluation.speed.harmonic import CELL, SCENES, BandScene, bands, rectangle_fits
from evaluation.speed.paper_band import log_between, polyline_length

from waychair.geometry import evenly_spaced
from waychair.planning.harmonic.harmonic_field import log_field
from waychair.planning.harmonic.laplace_solvers import laplace_problem
from waychair.planning.route.path_turns import turning_angles
from waychair.types import FloatArray


def sharpest(points: FloatArray) -> float:
    """Sharpest turn [deg] at every 0.10 m."""
    return math.degrees(turning_angles(evenly_spaced(points, 0.10 / CELL)).max())


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_after_the_band_no_turn_is_sharp_no_path_longer_and_the_chair_fits(scene: BandScene) -> None:
    lines = bands(scene)
    assert sharpest(lines.descent) > 35
    assert sharpest(lines.ours) <= 15
    assert polyline_length(lines.ours) <= polyline_length(lines.descent)
    assert rectangle_fits(lines.costmap, lines.ours)
    np.testing.assert_allclose(lines.ours[[0, -1]], lines.descent[[0, -1]])


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_the_papers_band_softens_the_turns_and_shortens_the_path(scene: BandScene) -> None:
    lines = bands(scene)
    assert sharpest(lines.paper) < 0.6 * sharpest(lines.descent)
    assert polyline_length(lines.paper) <= polyline_length(lines.descent)
    rows, columns = np.floor(lines.paper[:, ::-1]).astype(int).T
    assert np.isfinite(lines.found.logs[rows, columns]).all()


def test_the_logarithm_between_cell_centres_is_that_of_the_interpolated_field() -> None:
    found = log_field(laplace_problem(np.ones((9, 9), np.bool_), (4, 6)))
    v = np.exp(found.logs)
    x, y = 2.9, 3.7
    a, b = x - 2.5, y - 3.5
    expected = (1 - b) * ((1 - a) * v[3, 2] + a * v[3, 3]) + b * ((1 - a) * v[4, 2] + a * v[4, 3])
    assert log_between(found.logs, x, y) == pytest.approx(math.log(expected))
    assert log_between(found.logs, -0.1, 3.0) == -math.inf
