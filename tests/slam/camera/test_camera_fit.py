"""Colour and depth of two cameras: noticed and estimated on turns through a synthetic room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.slam import rgbd_scene
from tests.slam.rgbd_scene import noisy, render, sway
from waychair.slam.camera.camera_fit import CameraFit, fit_camera, registered
from waychair.slam.camera.picture_registration import angle_between
from waychair.types import FloatArray, Pose3, RgbdFrame

COLOUR_FROM_DEPTH = Pose3(Rotation.from_rotvec([0.01, -0.03, 0.012]).as_matrix(), np.array([0.02, -0.004, 0.014]))
FOCAL = 1.05
POSES = sway(50, turn=0.5, way=0.3)


def _other_colour(monkeypatch: pytest.MonkeyPatch, poses: list[Pose3]) -> list[RgbdFrame]:
    """Return what the colour sensor sees, with its own depth, where the depth sensor has these poses."""
    longer: FloatArray = rgbd_scene.CAMERA * (FOCAL, FOCAL, 1.0, 1.0)
    with monkeypatch.context() as patched:
        patched.setattr(rgbd_scene, "CAMERA", longer)
        return [render(pose @ COLOUR_FROM_DEPTH.inverse(), round(k / 15 * 1e9)) for k, pose in enumerate(poses)]


@pytest.fixture(scope="module")
def frames() -> list[RgbdFrame]:
    return [noisy(render(pose, round(k / 15 * 1e9)), k) for k, pose in enumerate(POSES)]


@pytest.mark.sampled(1)
def test_sensors_that_lie_apart_with_another_focal_length_are_noticed_and_estimated(
    frames: list[RgbdFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    colours = _other_colour(monkeypatch, POSES)
    fit = fit_camera(replace(f, image=noisy(c, 7).image) for f, c in zip(frames, colours, strict=True))
    assert fit is not None
    assert (fit.registered, fit.focal_right) == (False, False)
    assert fit.colour_focal == pytest.approx(FOCAL, rel=0.01)
    assert fit.depth_focal == pytest.approx(1.0, rel=0.01)
    assert fit.colour_from_depth.translation == pytest.approx(COLOUR_FROM_DEPTH.translation, abs=0.005)
    assert angle_between(fit.colour_from_depth, COLOUR_FROM_DEPTH) < np.radians(0.3)


def test_a_camera_that_is_told_right_is_not_doubted(frames: list[RgbdFrame]) -> None:
    fit = fit_camera(frames)
    assert fit is not None
    assert (fit.registered, fit.focal_right) == (True, True)


def test_a_camera_that_does_not_turn_is_not_judged(frames: list[RgbdFrame]) -> None:
    assert fit_camera([frames[0]] * 20) is None
    assert fit_camera([]) is None
    dark = replace(frames[0], image=np.zeros_like(frames[0].image), depth=np.full_like(frames[0].depth, np.nan))
    assert fit_camera([dark] * 20) is None


def test_registered_depth_is_what_the_colour_sensor_sees(
    frames: list[RgbdFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    true = _other_colour(monkeypatch, POSES[:1])[0]
    fit = CameraFit(FOCAL, 1.0, COLOUR_FROM_DEPTH, np.zeros(8), 260.0, 1.0, 0.1, 10)
    found = registered(replace(render(POSES[0]), image=true.image), fit)
    assert found.camera_matrix[0, 0] == pytest.approx(FOCAL * 260.0)
    known = np.isfinite(found.depth)
    assert known.mean() > 0.85
    assert np.median(np.abs(found.depth[known] - true.depth[known])) < 0.005
    assert (np.abs(found.depth[known] - true.depth[known]) < 0.05).mean() > 0.97
