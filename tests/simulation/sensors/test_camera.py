"""The RGB-D camera: kernels against plain references, exposure, noise, features, and the same bytes for a seed."""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import ConfigError
from waychair.geometry import in_space
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.scene.scene import PersonBehaviour, PersonState
from waychair.simulation.sensors.camera import (
    DEPTH_MIN,
    NOISE_STEP,
    CameraSettings,
    RgbdCamera,
    blurred,
    measured_depth,
    noise_by_level,
    noisy_image,
)
from waychair.simulation.sensors.exposure import ADAPTATION, EXPOSURE_MAX, GAIN_MAX, TARGET_GREY
from waychair.simulation.sensors.renderer import Renderer, camera_matrix, renderer_problem
from waychair.types import Bytes, FloatArray, Pose2, RgbdFrame, Twist

if renderer_problem():
    pytest.skip(str(renderer_problem()), allow_module_level=True)

SMALL = CameraSettings(width=320, height=240)
QUIET = CameraSettings(width=320, height=240, noise=0.0)
REST = Twist()


def _renderer(world: World, settings: CameraSettings) -> Renderer:
    matrix = camera_matrix(settings.width, settings.height, settings.field_of_view)
    return Renderer(world, matrix, settings.width, settings.height)


def _camera(renderer: Renderer, settings: CameraSettings, seed: int = 1) -> RgbdCamera:
    return RgbdCamera(settings, CHAIR_A.base_from_camera, np.random.default_rng(seed), renderer)


def _stops(route: FloatArray, step: float) -> list[Pose2]:
    """Poses every `step` [m] along a route, looking ahead."""
    legs = np.diff(route, axis=0)
    lengths = np.hypot(*legs.T)
    ends = np.cumsum(lengths)
    poses = []
    for along in np.arange(0.0, ends[-1], step):
        k = int(np.searchsorted(ends, along, side="right"))
        x, y = route[k] + legs[k] * (1.0 - (ends[k] - along) / lengths[k])
        poses.append(Pose2(x, y, math.atan2(legs[k, 1], legs[k, 0])))
    return poses


@pytest.fixture(scope="module", params=["second_floor", "basement"])
def building(request: pytest.FixtureRequest) -> Iterator[tuple[World, Renderer]]:
    world = load_world(request.param)
    renderer = _renderer(world, CameraSettings())
    yield world, renderer
    renderer.release()


@pytest.fixture(scope="module")
def small() -> Iterator[tuple[World, Renderer]]:
    world = load_world("second_floor")
    renderer = _renderer(world, SMALL)
    yield world, renderer
    renderer.release()


@pytest.mark.nightly
def test_there_are_features_all_along_the_mapping_routes(building: tuple[World, Renderer]) -> None:
    world, renderer = building
    camera, detector = _camera(renderer, CameraSettings()), cv2.ORB_create(1000)
    counts = [
        len(detector.detect(camera.frame((i + 1) * 10**9, in_space(pose), Twist(0.6, 0.0)).image))
        for i, pose in enumerate(_stops(world.route(), 2.0))
    ]
    assert len(counts) > 60
    assert np.median(counts) >= 500
    assert np.quantile(counts, 0.05) >= 250


def _inliers(one: RgbdFrame, two: RgbdFrame) -> tuple[int, FloatArray]:
    """Return the number of features of two frames that agree on one motion of the camera, and its translation [m]
    (depth, then PnP)."""
    orb, matcher = cv2.ORB_create(1000), cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    (keys_one, words_one), (keys_two, words_two) = (orb.detectAndCompute(f.image, None) for f in (one, two))
    matches = matcher.match(words_one, words_two)
    pixels = np.array([keys_one[m.queryIdx].pt for m in matches])
    others = np.array([keys_two[m.trainIdx].pt for m in matches])
    depth = one.depth[np.rint(pixels[:, 1]).astype(int), np.rint(pixels[:, 0]).astype(int)].astype(float)
    known = np.isfinite(depth)
    k = one.camera_matrix
    points = (
        np.column_stack([(pixels - (k[0, 2], k[1, 2])) / (k[0, 0], k[1, 1]), np.ones(len(pixels))]) * depth[:, None]
    )
    cv2.setRNGSeed(1)
    found, _, translation, agreeing = cv2.solvePnPRansac(
        points[known], others[known], k, None, reprojectionError=2.0, iterationsCount=300
    )
    return (len(agreeing), np.ravel(translation)) if found and agreeing is not None else (0, np.zeros(3))


def test_features_of_consecutive_frames_agree_on_the_motion(building: tuple[World, Renderer]) -> None:
    world, renderer = building
    camera = _camera(renderer, CameraSettings())
    for i, pose in enumerate(_stops(world.route(), 25.0)[1:5]):
        ahead = pose @ Pose2(0.25, 0.0, 0.0)
        frames = [
            camera.frame((10 * i + k) * 10**9, in_space(at), Twist(0.0, 0.0)) for k, at in enumerate((pose, ahead))
        ]
        count, translation = _inliers(*frames)
        assert count >= 40
        np.testing.assert_allclose(translation, [0.0, 0.0, -0.25], atol=0.04)


def test_different_places_do_not_match_each_other(building: tuple[World, Renderer]) -> None:
    world, renderer = building
    camera = _camera(renderer, CameraSettings())
    poses = _stops(world.route(), 11.0)[:7]
    frames = [camera.frame((i + 1) * 10**9, in_space(pose), REST) for i, pose in enumerate(poses)]
    counts = [
        _inliers(frames[i], frames[j])[0]
        for i in range(len(frames))
        for j in range(i)
        if math.dist((poses[i].x, poses[i].y), (poses[j].x, poses[j].y)) > 8.0
    ]
    assert len(counts) >= 4
    assert max(counts) < 20


def test_exposure_settles_at_the_wanted_grey_on_both_floors(building: tuple[World, Renderer]) -> None:
    world, renderer = building
    camera = _camera(renderer, CameraSettings())
    frame = camera.frame(0, in_space(world.start), REST)
    assert np.square(frame.image / 255.0).mean() == pytest.approx(TARGET_GREY, rel=0.12)


def test_a_dim_scene_takes_the_longest_exposure_and_gain() -> None:
    exposures = {}
    for name in ("second_floor", "basement"):
        world = load_world(name)
        renderer = _renderer(world, SMALL)
        camera = _camera(renderer, SMALL)
        camera.frame(0, in_space(world.start), REST)
        exposures[name] = (camera.exposure, camera.gain)
        renderer.release()
    assert exposures["second_floor"][1] == 1.0
    assert exposures["basement"][0] == EXPOSURE_MAX
    assert 1.0 < exposures["basement"][1] < GAIN_MAX


def test_exposure_follows_a_change_by_its_time_constant(small: tuple[World, Renderer]) -> None:
    world, renderer = small
    camera = _camera(renderer, QUIET)
    camera.frame(0, in_space(world.start), REST)
    wall = in_space(Pose2(10.5, 3.5, -math.pi / 2))
    before = camera.exposure * camera.gain
    steps = []
    for k in range(1, 41):
        camera.frame(k * 50_000_000, wall, REST)
        steps.append(camera.exposure * camera.gain)
    assert before != pytest.approx(steps[-1], rel=0.02)
    assert steps[-1] == pytest.approx(steps[-2], rel=0.01)
    gone = [math.log(step / before) / math.log(steps[-1] / before) for step in steps]
    assert gone[3] == pytest.approx(1.0 - math.exp(-0.2 / ADAPTATION), abs=0.1)


def test_depth_noise_grows_with_the_square_of_the_distance() -> None:
    for z in (1.0, 2.0, 4.0):
        depth = np.full((240, 320), z, np.float32)
        normal = np.clip(np.rint(np.random.default_rng(3).standard_normal(200_000) / NOISE_STEP), -127, 127)
        measured = measured_depth(
            depth, np.full((240, 320), 255, np.uint8), normal.astype(np.int8), np.zeros(200_000, np.uint16),
            np.tile(np.arange(240) * 320, (2, 1)), 0.3, 8.0, 0.0012, 0.02, 1.0,
        )  # fmt: skip
        assert (measured - z).std() == pytest.approx(0.0012 * z**2, rel=0.02)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_measured_depth_equals_a_plain_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.choice([0.2, 1.0, 1.01, 1.05, 3.0, 9.0, np.inf], (12, 16)).astype(np.float32)
    returns = rng.choice([0, 128, 255], (12, 16)).astype(np.uint8)
    normal = rng.integers(-127, 128, 500).astype(np.int8)
    uniform = rng.integers(0, 1 << 16, 500).astype(np.uint16)
    starts = rng.integers(0, 480, (2, 12))
    measured = measured_depth(depth, returns, normal, uniform, starts, 0.3, 8.0, 0.002, 0.03, 0.9)
    padded = np.pad(depth, 1, mode="edge")
    with np.errstate(invalid="ignore"):
        around = [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
        change = np.max([np.abs(depth - other) for other in around], axis=0)
    rows = np.arange(12)
    chance = np.stack([uniform[starts[1, row] :][:16] for row in rows])
    noise = np.stack([normal[starts[0, row] :][:16] for row in rows])
    kept = (depth >= 0.3) & (depth <= 8.0) & (change <= 0.03 * depth) & (chance < 0.9 * 65536.0 / 255.0 * returns)
    with np.errstate(invalid="ignore"):
        expected = np.where(kept, depth + 0.002 * NOISE_STEP * noise * depth**2, np.nan)
    np.testing.assert_allclose(measured, expected, rtol=1e-5)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_a_noisy_image_equals_a_plain_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    colour = rng.choice([0, 3, 60, 128, 250, 255], (8, 10, 4)).astype(np.uint8)
    sigma = rng.uniform(0.0, 30.0, 256).astype(np.float32)
    normal = rng.integers(-127, 128, 400).astype(np.int8)
    starts = rng.integers(0, 370, 8)
    image = noisy_image(colour, sigma, normal, starts)
    noise = np.stack([normal[start : start + 30] for start in starts]).reshape(8, 10, 3) * NOISE_STEP
    exact = colour[..., :3] + sigma[colour[..., :3]] * noise
    np.testing.assert_allclose(image, np.clip(exact, 0.0, 255.0), atol=0.51)


def test_noise_is_photon_noise_and_grows_with_gain() -> None:
    # of n electrons at white and gain 1, the deviation is sqrt(n); in square roots of light, half of that part
    assert noise_by_level(1.0, read_noise=0.0)[255] == pytest.approx(255.0 / 2.0 / math.sqrt(10_000.0))
    np.testing.assert_allclose(noise_by_level(4.0, 0.0), 2.0 * noise_by_level(1.0, 0.0), rtol=1e-5)
    both = noise_by_level(4.0)
    assert both[10] > both[100] > both[255]


def test_no_depth_on_edges_at_grazing_angles_and_out_of_range(small: tuple[World, Renderer]) -> None:
    world, renderer = small
    camera = _camera(renderer, QUIET)
    frame = camera.frame(0, in_space(world.start), REST)
    found = np.isfinite(frame.depth)
    assert 0.5 < found.mean() < 0.98
    assert frame.depth[found].min() >= DEPTH_MIN
    assert frame.depth[found].max() <= QUIET.depth_max
    near = _camera(renderer, CameraSettings(width=320, height=240, depth_max=2.0))
    assert np.nanmax(near.frame(0, in_space(world.start), REST).depth) < 2.05


@pytest.mark.parametrize(("across", "down", "expected"), [(0.9, 1.0, (1, 1)), (2.4, 0.0, (3, 1)), (5.2, 0.0, (5, 1)), (0.0, 3.0, (1, 3))])  # fmt: skip
def test_blur_spreads_a_point_over_its_path(across: float, down: float, expected: tuple[int, int]) -> None:
    point = np.zeros((21, 21, 4), np.uint8)
    point[10, 10] = 255
    lit = np.argwhere(blurred(point, across, down)[..., 0] > 0)
    assert tuple(np.ptp(lit, axis=0)[::-1] + 1) == expected


def _sharpness(image: Bytes) -> float:
    return float(np.abs(np.diff(image[..., 1].astype(int), axis=1)).mean())


def test_turning_blurs_a_picture_and_standing_does_not(small: tuple[World, Renderer]) -> None:
    world, renderer = small
    pose = in_space(world.start)
    still, turning = (_camera(renderer, QUIET).frame(0, pose, twist) for twist in (Twist(0.0, 0.0), Twist(0.0, 1.5)))
    assert _sharpness(turning.image) < 0.8 * _sharpness(still.image)
    np.testing.assert_array_equal(turning.depth, still.depth)


def test_driving_shakes_the_camera_and_standing_still_does_not(small: tuple[World, Renderer]) -> None:
    world, renderer = small
    camera, pose = _camera(renderer, QUIET), in_space(world.start)
    standing = [camera.frame(k * 10**8, pose, REST).depth for k in range(2)]
    driving = [camera.frame(k * 10**8, pose, Twist(1.0, 0.0)).depth for k in range(2, 4)]
    # some depths are lost by chance; those of both frames are equal only if the camera has not moved
    np.testing.assert_array_equal(*(np.where(np.isnan(standing[0] + standing[1]), 0.0, depth) for depth in standing))
    known = np.isfinite(driving[0] + driving[1])
    assert np.mean(driving[0][known] != driving[1][known]) > 0.9


def test_the_random_stream_does_not_depend_on_the_scene(small: tuple[World, Renderer]) -> None:
    world, renderer = small
    states = []
    for pose in (world.start, Pose2(10.5, 3.5, 0.4)):
        rng = np.random.default_rng(4)
        RgbdCamera(SMALL, CHAIR_A.base_from_camera, rng, renderer).frame(0, in_space(pose), Twist(0.5, 0.2))
        states.append(rng.bit_generator.state)
    assert states[0] == states[1]


def test_frames_have_their_stamps_and_camera_matrix(small: tuple[World, Renderer]) -> None:
    world, renderer = small
    frame = _camera(renderer, SMALL).frame(123, in_space(world.start), REST)
    assert frame.stamp_ns == 123
    assert (frame.image.shape, frame.image.dtype) == ((240, 320, 3), np.dtype(np.uint8))
    assert (frame.depth.shape, frame.depth.dtype) == ((240, 320), np.dtype(np.float32))
    focal = 160.0 / math.tan(SMALL.field_of_view / 2.0)
    np.testing.assert_allclose(frame.camera_matrix, [[focal, 0, 159.5], [0, focal, 119.5], [0, 0, 1]])


def _digest(seed: int) -> str:
    """Return a hash of all bytes of a short drive behind a person."""
    world = load_world("corridor_t")
    renderer = _renderer(world, SMALL)
    camera, digest = _camera(renderer, SMALL, seed), hashlib.sha256()
    for k in range(4):
        pose = world.start @ Pose2(0.1 * k, 0.0, 0.05 * k)
        person = PersonState(pose @ Pose2(2.0, 0.3, 2.0), 1.0, 0.5 * k, 0.25, PersonBehaviour.PATH, 3)
        frame = camera.frame(k * 10**8, in_space(pose), Twist(0.6, 0.3), [person])
        digest.update(frame.image.tobytes() + frame.depth.tobytes())
    renderer.release()
    return digest.hexdigest()


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_bytes_in_another_process() -> None:
    run = f"import runpy; print(runpy.run_path({__file__!r})['_digest'](7))"
    there = subprocess.run([sys.executable, "-c", run], capture_output=True, text=True, check=True).stdout.strip()
    assert there == _digest(7) != _digest(8)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"depth_max": 0.2}, "depth_max = 0.2"),
        ({"rate_hz": -1.0}, "rate_hz = -1"),
        ({"noise": -0.5}, "noise = -0.5"),
    ],
)
def test_impossible_settings_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        CameraSettings(**values)  # type: ignore[arg-type]
