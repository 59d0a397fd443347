"""Copies of scans, a lidar that sticks, and beams that see the chair are left out by name."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.recordings.plausibility.findings import Finding
from waychair.recordings.plausibility.own_chair import without_own_chair
from waychair.recordings.plausibility.repeated_scans import without_repeated
from waychair.recordings.plausibility.told_scans import ToldScan
from waychair.types import Odometry, Pose2, Scan, Twist

SECOND = 1_000_000_000
BEAMS = 60


def told(count: int) -> list[ToldScan]:
    """Return scans with noise, five a second."""
    rng = np.random.default_rng(1)
    rows = (3.0 + 0.01 * rng.standard_normal((count, BEAMS))).astype(np.float32)
    return [ToldScan(k * SECOND // 5, row, -math.pi, math.pi, math.tau / BEAMS) for k, row in enumerate(rows)]


def driven(speed: float) -> list[Odometry]:
    """Return odometry that drives ahead for 20 s."""
    return [Odometry(k * SECOND // 10, Pose2(speed * k / 10, 0.0, 0.0), Twist(speed, 0.0)) for k in range(200)]


def test_a_scan_that_is_written_twice_is_used_once() -> None:
    findings: list[Finding] = []
    scans = told(20)
    assert without_repeated("/scan", [scan for scan in scans for _ in range(2)], (), findings) == scans
    assert findings[0].count == 20


@pytest.mark.parametrize(("speed", "gone"), [(0.5, 7), (0.0, 0)])
def test_a_lidar_that_sticks_is_told_by_wheels_that_turn_meanwhile(speed: float, gone: int) -> None:
    scans, findings = told(40), list[Finding]()
    stuck = [replace(scan, ranges=scans[10].ranges) if 10 < k < 18 else scan for k, scan in enumerate(scans)]
    assert len(without_repeated("/scan", stuck, driven(speed), findings)) == 40 - gone
    assert len(findings) == (gone > 0)


def swept(own_m: float, changes: bool) -> list[Scan]:
    """Return scans whose beams 5 to 9 see something near and whose other beams see other things as the chair drives."""
    rng = np.random.default_rng(2)
    rows = 1.0 + (6.0 * rng.random((30, BEAMS)) if changes else 0.01 * rng.standard_normal((30, BEAMS)))
    rows[:, 5:10] = own_m + 0.005 * rng.standard_normal((30, 5))
    return [
        Scan(k * SECOND // 5, row.astype(np.float32), -math.pi, math.tau / BEAMS, range_max=10.0)
        for k, row in enumerate(rows)
    ]


def test_beams_that_see_the_chair_itself_are_left_out_with_their_directions() -> None:
    scans, (found,) = without_own_chair("/scan", swept(0.25, changes=True))
    assert all(
        np.isnan(scan.ranges[5:10]).all() and np.isfinite(np.delete(scan.ranges, range(5, 10))).all() for scan in scans
    )
    assert "5 beams (from -150 to -126 degrees)" in found.text
    assert "calibrate mask" in found.remedy


@pytest.mark.parametrize(("own_m", "changes"), [(1.5, True), (0.25, False)])
def test_a_wall_that_stays_is_no_chair(own_m: float, changes: bool) -> None:
    scans = swept(own_m, changes)
    assert without_own_chair("/scan", scans) == (scans, [])
