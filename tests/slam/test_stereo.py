"""Stereo pairs of the simulated camera become depth that is the renderer's own."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.errors import SensorError
from waychair.geometry import in_space
from waychair.simulation.renderer import Renderer, camera_matrix, renderer_problem
from waychair.simulation.world import load_world
from waychair.slam.message_sets import ExactSets
from waychair.slam.stereo import CameraImage, StereoSettings, rgbd_from_stereo
from waychair.types import Bytes, Float32Array, FloatArray, Pose3

BASELINE = 0.12
MATRIX = camera_matrix(640, 480, 1.2)


@pytest.fixture(scope="module")
def views() -> tuple[Bytes, Bytes, Float32Array]:
    """What a left and a right camera see of an office, and the left one's true depth."""
    if problem := renderer_problem():
        pytest.skip(problem)
    world = load_world("second_floor")
    renderer = Renderer(world, MATRIX, 640, 480)
    optical = Pose3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, 0.95]))
    left_pose = in_space(world.start) @ optical
    right_pose = left_pose @ Pose3(np.eye(3), np.array([BASELINE, 0.0, 0.0]))
    left = renderer.render(left_pose, (), 1.0)
    image, depth = left.colour[..., :3].copy(), left.depth.copy()
    right = renderer.render(right_pose, (), 1.0).colour[..., :3].copy()
    return image, right, depth


def test_depth_is_that_of_the_scene(views: tuple[Bytes, Bytes, Float32Array]) -> None:
    left, right, true = views
    frame = rgbd_from_stereo(CameraImage(5, left), CameraImage(5, right), MATRIX, BASELINE)
    in_range = (true > 0.5) & (true < 8.0)
    found = np.isfinite(frame.depth) & in_range
    assert found.sum() > 0.8 * in_range.sum()
    disparity_error = np.abs(1.0 / frame.depth[found] - 1.0 / true[found]) * MATRIX[0, 0] * BASELINE
    assert np.median(disparity_error) < 0.25
    assert (disparity_error < 1.0).mean() > 0.95
    seen = np.arange(640) >= MATRIX[0, 0] * BASELINE / true - 1.0
    assert np.isfinite(frame.depth[~seen & in_range]).mean() < 0.05
    assert frame.stamp_ns == 5
    assert frame.image is left


def test_pictures_the_wrong_way_round_give_no_depth_to_speak_of(views: tuple[Bytes, Bytes, Float32Array]) -> None:
    left, right, true = views
    frame = rgbd_from_stereo(CameraImage(5, right), CameraImage(5, left), MATRIX, BASELINE)
    found = np.isfinite(frame.depth) & np.isfinite(true)
    right_ones = np.abs(frame.depth[found] - true[found]) < 0.05 * true[found]
    assert right_ones.sum() < 0.05 * true.size


def test_a_pair_comes_out_of_an_exact_synchroniser_and_never_with_a_neighbour() -> None:
    pairs = ExactSets[CameraImage](("left", "right"))
    grey = np.zeros((4, 6), np.uint8)
    assert not pairs.add("left", CameraImage(1, grey))
    assert not pairs.add("right", CameraImage(2, grey))
    ((left, right),) = pairs.add("left", CameraImage(2, grey))
    assert left.stamp_ns == right.stamp_ns == 2


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_a_flat_wall_has_its_distance_everywhere(noise: float) -> None:
    """Random texture, shifted by a whole number of pixels: the disparity is known."""
    rng = np.random.default_rng(0)
    matrix: FloatArray = np.array([[400.0, 0.0, 159.5], [0.0, 400.0, 119.5], [0.0, 0.0, 1.0]])
    texture = rng.integers(0, 256, (240, 400)).astype(np.float64)
    seen = [
        np.clip(part + noise * rng.standard_normal(part.shape), 0, 255).astype(np.uint8)
        for part in (texture[:, :320], texture[:, 20:340])
    ]
    depth = rgbd_from_stereo(CameraImage(0, seen[0]), CameraImage(0, seen[1]), matrix, 0.1).depth
    known = depth[:, 24:][np.isfinite(depth[:, 24:])]
    assert len(known) > 0.95 * depth[:, 24:].size
    assert np.median(np.abs(known - 400.0 * 0.1 / 20.0)) < 0.02
    assert np.isfinite(depth[:, :18]).mean() < 0.02  # which the right camera does not see


def test_far_depths_are_dropped() -> None:
    rng = np.random.default_rng(1)
    wall = rng.integers(0, 256, (100, 200)).astype(np.uint8)
    matrix: FloatArray = np.diag([200.0, 200.0, 1.0])
    frame = rgbd_from_stereo(CameraImage(0, wall), CameraImage(0, wall), matrix, 0.1, StereoSettings(depth_max=5.0))
    assert np.isnan(frame.depth).all()


def test_pictures_that_do_not_go_together_are_refused() -> None:
    matrix, grey = np.eye(3), np.zeros((4, 6), np.uint8)
    with pytest.raises(SensorError, match=r"10\.000 ms apart"):
        rgbd_from_stereo(CameraImage(0, grey), CameraImage(10_000_000, grey), matrix, 0.1)
    with pytest.raises(SensorError, match="set both cameras alike"):
        rgbd_from_stereo(CameraImage(0, grey), CameraImage(0, grey[:2]), matrix, 0.1)
    for baseline in (0.0, -0.1, float("nan")):
        with pytest.raises(SensorError, match="baseline"):
            rgbd_from_stereo(CameraImage(0, grey), CameraImage(0, grey), matrix, baseline)
