"""A laser's line gives the lit points by triangulation, with an error that grows with the square of the distance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.planning.seen.laser_line import FLATTEST, LINE_ERROR, LaserPlane, points_of_line
from waychair.types import FloatArray

CAMERA = np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]])
LEVEL = LaserPlane(np.array([0.0, 1.0, 0.0]), 0.10)
"""A laser 0.10 m below the camera, whose plane is level."""


def _pixels(points: FloatArray) -> FloatArray:
    image = points @ CAMERA.T
    found: FloatArray = image[:, :2] / image[:, 2:]
    return found


def test_points_on_the_plane_come_back_from_their_pixels() -> None:
    turn = math.radians(12.0)
    plane = LaserPlane(np.array([0.1, math.cos(turn), math.sin(turn)]) / math.sqrt(1.01), 0.15)
    x, z = np.linspace(-0.8, 0.8, 9), np.linspace(0.4, 1.6, 9)
    y = (plane.offset - plane.normal[0] * x - plane.normal[2] * z) / plane.normal[1]
    points = np.stack([x, y, z], axis=1)
    keep = np.abs(points / np.linalg.norm(points, axis=1)[:, None] @ plane.normal) > FLATTEST
    assert keep.sum() > 3
    assert points_of_line(_pixels(points), CAMERA, plane).points[keep] == pytest.approx(points[keep], abs=1e-9)


@pytest.mark.parametrize(("away", "most"), [(1.0, 0.01), (2.0, 0.03), (4.0, 0.10)])
def test_the_error_told_is_the_error_of_lines_found_with_noise(away: float, most: float) -> None:
    rng = np.random.default_rng(5)
    pixel = _pixels(np.array([[0.2, 0.10, away]]))
    noisy = pixel + LINE_ERROR * rng.standard_normal((4000, 2))
    found = points_of_line(noisy, CAMERA, LEVEL)
    told = points_of_line(pixel, CAMERA, LEVEL).errors[0]
    real = float(np.std(np.linalg.norm(found.points, axis=1)))
    assert told == pytest.approx(away**2 * LINE_ERROR / 60.0, rel=0.6)
    assert real <= told <= 1.6 * real
    assert told < most


def test_pixels_above_the_horizon_and_lost_ones_give_no_point() -> None:
    found = points_of_line(np.array([[320.0, 100.0], [np.nan, np.nan], [320.0, 239.5]]), CAMERA, LEVEL)
    assert np.isnan(found.points).all()
    assert np.isnan(found.errors).all()
