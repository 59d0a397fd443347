"""Wrong mounts are found from the motion alone: synthetic motions, and a real wheelchair's log read with wrong
mounts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from waychair.offline.mapping import MappingSettings, map_recording
from waychair.recordings.recording import InputSettings, read_recording
from waychair.slam.frames.mount_check import check_mount
from waychair.types import FloatArray, Pose2


def seen_with(mount: Pose2, truth: Pose2, motions: FloatArray) -> FloatArray:
    """Motions of the base by scans, when the laser is at `truth` but assumed at `mount`."""
    lasers = [truth.inverse() @ Pose2(*motion) @ truth for motion in motions]
    return np.array([(mount @ laser @ mount.inverse()).array() for laser in lasers])


def motions(seed: int, count: int = 120) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(0.1, 0.4, count), np.zeros(count), rng.uniform(-0.4, 0.4, count)], axis=1)


@pytest.mark.parametrize("truth", [Pose2(0.5, 0.1, 0.0), Pose2(-0.3, 0.2, math.pi), Pose2(0.0, 0.0, 1.2)])
@pytest.mark.parametrize("mount", [Pose2(), Pose2(0.5, 0.1, 0.3), Pose2(0.2, -0.4, -2.0)])
def test_the_true_mount_is_computed_from_motions_with_a_wrong_one(truth: Pose2, mount: Pose2) -> None:
    made = motions(1)
    seen = seen_with(mount, truth, made)
    noise = 0.01 * np.random.default_rng(2).standard_normal(seen.shape)
    noise[::17] += 0.5  # slips
    check = check_mount(made, seen + noise, mount)
    assert check is not None
    np.testing.assert_allclose([check.base_from_laser.x, check.base_from_laser.y], [truth.x, truth.y], atol=0.03)
    assert abs(math.remainder(check.base_from_laser.theta - truth.theta, math.tau)) < 0.02
    assert check.scale == pytest.approx(1.0, abs=0.02)


def test_a_right_mount_gives_no_warning_and_too_little_motion_gives_no_answer() -> None:
    made = motions(3)
    check = check_mount(made, made, Pose2(0.4, 0.0, 0.0))
    assert check is not None
    assert check.lever < 1e-6
    assert abs(check.yaw) < 1e-9
    assert check_mount(made[:5], made[:5], Pose2()) is None
    straight = made * (1.0, 1.0, 0.0)
    along = check_mount(straight, straight, Pose2(0.4, 0.0, 0.0))
    assert along is not None
    assert math.isnan(along.turn_ratio)
    assert along.lever == 0.0


@pytest.mark.parametrize(
    ("mount", "warning"),
    [
        pytest.param("0.78,0,0", "", marks=pytest.mark.nightly),
        pytest.param("0.78,0,3.14159", "in the direction of travel", marks=pytest.mark.nightly),
        ("0.78,0,0.3", "They agree best with --base-from-laser 0.7"),
        pytest.param("0.78,0,0,upside-down", "the scans turn against the odometry", marks=pytest.mark.nightly),
    ],
)
def test_a_wrong_mount_of_the_real_wheelchairs_laser_is_reported(data_dir: Path, mount: str, warning: str) -> None:
    log = read_recording(data_dir / "wheelchair_sena" / "sena_one_loop.clf.gz", InputSettings(mounts=(mount,)))
    warnings = map_recording(log, MappingSettings()).report["warnings"]
    assert len(warnings) == (1 if warning else 0)
    assert warning in " ".join(warnings)
