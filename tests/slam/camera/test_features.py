"""Features of images: textured and blank ones, and their points in space."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from waychair.errors import ConfigError, SensorError
from waychair.slam.camera.feature_settings import DETECTORS, FeatureSettings
from waychair.slam.camera.features import extract, features_of_image, patch_angles
from waychair.types import Bytes, Float32Array, RgbdFrame

CAMERA = np.array([[300.0, 0, 160], [0, 310.0, 120], [0, 0, 1]])
NO_DEPTH = np.empty((0, 0), np.float32)


def textured(seed: int = 0) -> Bytes:
    """A grey picture of many overlapping blocks."""
    rng = np.random.default_rng(seed)
    image = np.full((240, 320), 128, np.uint8)
    for _ in range(150):
        x, y = rng.integers(0, 300), rng.integers(0, 220)
        w, h = rng.integers(8, 50, 2)
        image[y : y + h, x : x + w] = rng.integers(0, 256)
    return image


def frame(image: Bytes, depth: Float32Array = NO_DEPTH) -> RgbdFrame:
    return RgbdFrame(0, image, depth, CAMERA)


@pytest.mark.parametrize("detector", DETECTORS)
def test_every_detector_gives_features_of_one_shape_on_a_textured_picture(detector: str) -> None:
    settings = FeatureSettings(detector=detector, max_features=120)
    found = extract(frame(textured()), settings)
    assert 50 < len(found) <= 120
    width, kind = (32, np.uint8) if settings.binary else (128, np.float32)
    assert found.descriptors.shape == (len(found), width)
    assert found.descriptors.dtype == kind
    assert found.pixels.shape == (len(found), 2)
    assert np.isnan(found.points).all()
    assert (np.diff(found.response) <= 0).all()
    assert (found.pixels >= 0).all()
    assert (found.pixels < (320, 240)).all()


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("level", [0, 17, 255])
def test_a_black_a_blank_and_an_overexposed_picture_have_no_features(detector: str, level: int) -> None:
    found = extract(frame(np.full((240, 320), level, np.uint8)), FeatureSettings(detector=detector))
    assert len(found) == 0
    assert found.points.shape == (0, 3)
    assert found.descriptors.shape == (0, 128 if detector == "sift" else 32)


@pytest.mark.parametrize("detector", DETECTORS)
def test_the_noise_of_a_bare_wall_gives_no_feature(detector: str) -> None:
    rng = np.random.default_rng(0)
    wall = (120 + rng.normal(0, 1.5, (240, 320))).clip(0, 255).astype(np.uint8)
    assert len(extract(frame(wall), FeatureSettings(detector=detector))) <= 5


def test_points_lie_on_the_rays_of_their_pixels_at_the_measured_depth() -> None:
    depth = np.tile(np.linspace(1.0, 3.0, 320, dtype=np.float32), (240, 1))
    found = extract(frame(textured(), depth))
    projected = found.points @ CAMERA.T
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], found.pixels, atol=1e-3)
    np.testing.assert_allclose(found.points[:, 2], 1.0 + 2.0 * found.pixels[:, 0] / 319, atol=0.005)


@pytest.mark.parametrize("detector", DETECTORS)
def test_corners_without_depth_are_left_out_unless_no_corner_has_depth(detector: str) -> None:
    depth = np.full((240, 320), np.nan, np.float32)
    depth[:, 160:] = 2.0
    masked = extract(frame(textured(), depth), FeatureSettings(detector=detector))
    assert len(masked) > 0
    assert np.isfinite(masked.points).all()
    assert (features_of_image(textured(), FeatureSettings(detector=detector)).pixels[:, 0] < 150).any()
    unseen = extract(frame(textured(), np.full((240, 320), np.nan, np.float32)), FeatureSettings(detector=detector))
    plain = features_of_image(textured(), FeatureSettings(detector=detector))
    np.testing.assert_array_equal(unseen.pixels, plain.pixels)


def test_the_same_picture_gives_the_same_features() -> None:
    first, second = extract(frame(textured())), extract(frame(textured()))
    np.testing.assert_array_equal(first.descriptors, second.descriptors)
    np.testing.assert_array_equal(first.pixels, second.pixels)


def test_colour_is_read_as_red_green_blue() -> None:
    image = np.zeros((240, 320, 3), np.uint8)
    image[..., 0] = textured()
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    np.testing.assert_array_equal(extract(frame(image)).pixels, extract(frame(gray)).pixels)


def test_rotated_patches_have_rotated_angles_and_the_reference_agrees() -> None:
    image = textured(3)
    pixels = np.array([[60.0, 50.0], [200.0, 120.0], [3.0, 2.0]], np.float32)
    expected = []
    for x, y in pixels.astype(int):
        sum_x = sum_y = 0
        for dy in range(-15, 16):
            for dx in range(-15, 16):
                row, column = y + dy, x + dx
                inside = dx * dx + dy * dy <= 225 and 0 <= row < 240 and 0 <= column < 320
                sum_x += dx * int(image[row, column]) if inside else 0
                sum_y += dy * int(image[row, column]) if inside else 0
        expected.append(math.degrees(math.atan2(sum_y, sum_x)) % 360)
    np.testing.assert_allclose(patch_angles(image, pixels), expected, atol=1e-9)
    turned = np.ascontiguousarray(np.rot90(image))  # a quarter turn to the left: angles of image rows shrink by 90
    there = np.array([[y, 319 - x] for x, y in pixels], np.float32)
    np.testing.assert_allclose(patch_angles(turned, there), (np.array(expected) - 90) % 360, atol=1e-9)


def test_rotated_descriptors_follow_a_rolling_camera_and_upright_ones_do_not() -> None:
    image = textured(5)
    turned = np.ascontiguousarray(np.rot90(image))
    agreement = {}
    for upright in (True, False):
        settings = FeatureSettings(upright=upright, max_features=200)
        a, b = features_of_image(image, settings), features_of_image(turned, settings)
        back = {(319 - round(float(y)), round(float(x))): i for i, (x, y) in enumerate(b.pixels)}
        pairs = [
            (i, back[key]) for i, (x, y) in enumerate(a.pixels) if (key := (round(float(x)), round(float(y)))) in back
        ]
        assert len(pairs) > 50
        bits = [np.unpackbits(a.descriptors[i] ^ b.descriptors[j]).sum() for i, j in pairs]
        agreement[upright] = np.median(bits)
    assert agreement[False] < 20 < agreement[True]


def test_surf_is_refused_by_name_and_an_unknown_detector_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="not in OpenCV 5"):
        FeatureSettings(detector="surf")
    with pytest.raises(ConfigError, match="gftt_orb, orb, sift"):
        FeatureSettings(detector="brisk")


def test_a_picture_of_floats_or_a_depth_of_another_size_is_refused_with_advice() -> None:
    with pytest.raises(SensorError, match="bytes"):
        extract(frame(np.zeros((10, 10, 4), np.uint8)))
    with pytest.raises(SensorError, match="register"):
        extract(frame(textured(), np.ones((120, 160), np.float32)))
