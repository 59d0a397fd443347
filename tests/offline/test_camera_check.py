"""A folder whose colour and depth are of two cameras: told, and mapped by the estimate where asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.slam import rgbd_scene
from tests.slam.rgbd_scene import render, sway
from waychair.offline.camera_check import CameraCheck
from waychair.offline.rgbd_mapping import RgbdMappingSettings, map_pictures
from waychair.recordings.recording import InputSettings, read_recording
from waychair.recordings.rgbd_folders import RgbdSettings
from waychair.slam.camera.camera_fit import CameraFit
from waychair.types import FloatArray, Pose3

APART = Pose3(Rotation.from_rotvec([0.0, 0.035, 0.0]).as_matrix(), np.array([0.025, 0.0, 0.0]))
GIVEN = np.array([500.0, 500.0, 319.5, 239.5])


def _check(colour: float = 1.0, apart: Pose3 = APART, fitted: float = 0.2) -> CameraCheck:
    return CameraCheck(CameraFit(colour, 1.0, apart, np.full(8, 0.001), 500.0, 1.0, fitted, 12), GIVEN)


def test_the_sentence_names_what_does_not_fit_and_the_way_on() -> None:
    sentence = _check(1.05).sentences(used=False)[0]
    assert "depth is not registered to colour: the depth sensor lies 25 mm from the colour sensor" in sentence
    assert "turned by 2.0 degrees" in sentence
    assert "the focal length is 525.0 px in colour and 500.0 px in depth, not 500.0" in sentence
    assert sentence.endswith("--register auto uses the estimate")
    assert _check().sentences(used=True)[0].endswith("this is used")
    assert "focal" not in _check().sentences(used=False)[0]


def test_a_camera_that_fits_or_cannot_be_checked_is_not_warned_of() -> None:
    still = Pose3(np.eye(3), np.zeros(3))
    assert _check(1.0, still).sentences(used=False) == []
    assert _check(1.05, fitted=0.99).sentences(used=False) == []
    assert CameraCheck(None, GIVEN).sentences(used=False) == []
    assert "too few" in CameraCheck(None, GIVEN).data(used=False)["turns"]


@pytest.mark.nightly
def test_auto_maps_by_the_estimated_camera(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    poses, errors = sway(60, turn=0.5, way=0.3), {}
    longer: FloatArray = rgbd_scene.CAMERA * (1.05, 1.05, 1.0, 1.0)
    for name in ("rgb", "depth"):
        (tmp_path / name).mkdir()
    for k, pose in enumerate(poses):
        depth = (1000.0 * render(pose).depth).astype(np.uint16)
        cv2.imwrite(str(tmp_path / "depth" / f"{k / 15:.6f}.png"), depth)
        with monkeypatch.context() as patched:
            patched.setattr(rgbd_scene, "CAMERA", longer)
            cv2.imwrite(str(tmp_path / "rgb" / f"{k / 15:.6f}.png"), render(pose @ APART.inverse()).image)
    true = np.array([(pose @ APART.inverse()).translation for pose in poses])
    for register in ("check", "auto"):
        rgbd = RgbdSettings(camera="260,260,159.5,119.5", depth_scale=1000.0, register=register)
        settings = RgbdMappingSettings(input=replace(InputSettings(), rgbd=rgbd))
        mapping = map_pictures(read_recording(tmp_path, settings.input), settings)
        assert any("not registered" in warning for warning in mapping.report["warnings"])
        assert mapping.report["camera"]["estimate_used"] == (register == "auto")
        start = (poses[0] @ APART.inverse()).rotation
        found = mapping.result.trajectory.positions @ start.T + true[0]
        errors[register] = float(np.sqrt(((found - true[: len(found)]) ** 2).sum(axis=1).mean()))
    assert errors["auto"] < 0.5 * errors["check"]
    assert errors["auto"] < 0.02
