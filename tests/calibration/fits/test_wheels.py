"""Wheels: known radii and track are found from a square; unsuitable squares are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.fits.wheels import wheels_from_drive
from waychair.errors import CalibrationError, ThinData
from waychair.types import FloatArray, IntArray

TICKS = 4096


def _driven(
    moves: list[tuple[float, float]], left: float, right: float, track: float, start: int = 0
) -> tuple[IntArray, FloatArray]:
    """Counts (N, 2), wrapping, and poses (N, 3) of arcs (way, turn), each in eight stretches."""
    x, y, theta, angles = 0.0, 0.0, 0.3, np.zeros(2)
    poses, counts = [(x, y, theta)], [angles]
    for way, turn in moves:
        for _ in range(8):
            s, w = way / 8, turn / 8
            angles = angles + np.array([(s - 0.5 * w * track) / left, (s + 0.5 * w * track) / right])
            chord = s * np.sinc(0.5 * w / math.pi)
            x, y, theta = x + chord * math.cos(theta + 0.5 * w), y + chord * math.sin(theta + 0.5 * w), theta + w
            poses.append((x, y, math.remainder(theta, math.tau)))
            counts.append(angles)
    ticks = np.round(np.array(counts) / math.tau * TICKS).astype(np.int64) + start
    return (ticks + 2**31) % 2**32 - 2**31, np.array(poses)


def _square(side: float, direction: float) -> list[tuple[float, float]]:
    return [(side, 0.0), (0.0, direction * math.pi / 2)] * 4


BOTH = _square(3.0, 1.0) + _square(3.0, -1.0)


@given(st.floats(0.1, 0.3), st.floats(-0.01, 0.01), st.floats(0.4, 0.7), st.sampled_from([0, 2**31 - 500, -(2**31)]))
def test_known_radii_and_track_are_found(radius: float, difference: float, track: float, start: int) -> None:
    left, right = radius * (1.0 + difference), radius * (1.0 - difference)
    found = wheels_from_drive(*_driven(BOTH, left, right, track, start), TICKS)
    assert found.left_radius == pytest.approx(left, rel=5e-4)
    assert found.right_radius == pytest.approx(right, rel=5e-4)
    assert found.track == pytest.approx(track, rel=5e-4)


def test_arcs_and_a_spin_suffice() -> None:
    moves = [(4.0, 2.0), (-2.0, 1.0), (0.0, 6.0), (3.0, -3.0), (0.0, -6.0)]
    found = wheels_from_drive(*_driven(moves, 0.166, 0.165, 0.545), TICKS)
    assert (found.left_radius, found.right_radius, found.track) == pytest.approx((0.166, 0.165, 0.545), rel=5e-4)
    assert found.radius == pytest.approx(0.1655, rel=5e-4)


def test_noise_of_the_poses_averages_out() -> None:
    ticks, poses = _driven(BOTH * 4, 0.166, 0.164, 0.55)
    noisy = poses + np.random.default_rng(0).normal(0.0, (0.005, 0.005, 0.003), poses.shape)
    found = wheels_from_drive(ticks, noisy, TICKS)
    assert (found.left_radius, found.right_radius) == pytest.approx((0.166, 0.164), rel=3e-3)
    assert found.track == pytest.approx(0.55, rel=5e-3)
    assert 0.003 < found.rms_m < 0.015


def test_a_square_in_one_direction_only_is_refused() -> None:
    for direction in (1.0, -1.0):
        with pytest.raises(ThinData, match="both ways"):
            wheels_from_drive(*_driven(_square(3.0, direction) * 2, 0.165, 0.165, 0.54), TICKS)


def test_a_spin_alone_has_no_distance_and_is_refused() -> None:
    with pytest.raises(ThinData, match="too short"):
        wheels_from_drive(*_driven([(0.0, 7.0), (0.0, -7.0)], 0.165, 0.165, 0.54), TICKS)


def test_swapped_or_reversed_encoders_are_refused() -> None:
    ticks, poses = _driven(BOTH, 0.165, 0.165, 0.54)
    for wrong in (ticks[:, ::-1], -ticks, ticks * (1, -1)):
        with pytest.raises(CalibrationError, match="no wheels"):
            wheels_from_drive(wrong, poses, TICKS)
