"""The sonars: their mounts, their echoes, and REP-117's codes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody, sonar_mounts
from waychair.errors import ConfigError
from waychair.simulation.scene.scene import PersonBehaviour, PersonState, Reflection, Slice
from waychair.simulation.sensors import sonar as sonar_module
from waychair.simulation.sensors.rays import Scenery, scenery_from_slice
from waychair.simulation.sensors.sonar import SRF08, Sonars, SonarSettings, first_echoes
from waychair.types import Float32Array, FloatArray, Pose2

CLEAN = SonarSettings()


@pytest.fixture(autouse=True, scope="module")
def _without_noise() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sonar_module, "SIGMA", 0.0)
        patch.setattr(sonar_module, "CROSS_TALK", 0.0)
        yield


def _scenery(*walls: tuple[float, float, float, float], kind: Reflection = Reflection.DIFFUSE) -> Scenery:
    return scenery_from_slice(Slice(np.array(walls, np.float64).reshape(-1, 4), np.full(len(walls), kind, np.int64)))


def _read(
    scenery: Scenery, settings: SonarSettings = CLEAN, pose: Pose2 | None = None, people: tuple[PersonState, ...] = ()
) -> Float32Array:
    return Sonars(settings, CHAIR_A, np.random.default_rng(0)).read(scenery, pose or Pose2(), people, 0).ranges


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_eight_sonars_are_on_the_outline_and_look_outwards(body: ChairBody) -> None:
    sonars = sonar_mounts(body)
    assert len(sonars) == 8
    for sonar in sonars:
        ahead = sonar @ Pose2(0.001, 0.0, 0.0)
        inside = [
            -body.rear <= pose.x <= body.front and abs(pose.y) <= body.width / 2
            for pose in (sonar @ Pose2(-0.001, 0.0, 0.0), ahead)
        ]
        assert inside == [True, False]
    looks = [round(math.degrees(sonar.theta)) for sonar in sonars]
    assert looks == [0, 90, 90, 180, 180, -90, -90, 0]


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_the_sonars_are_counted_to_the_left_and_right_mirrors_left(body: ChairBody) -> None:
    sonars = sonar_mounts(body)
    bearings = [math.atan2(s.y, s.x - (body.front - body.rear) / 2) % math.tau for s in sonars]
    assert bearings == sorted(bearings)
    for left, right in zip(sonars, reversed(sonars), strict=True):
        assert (left.x, left.y) == pytest.approx((right.x, -right.y))


def test_in_a_room_each_pair_measures_the_distance_to_its_wall() -> None:
    room = _scenery((2.0, -9.0, 2.0, 9.0), (-2.0, -9.0, -2.0, 9.0), (-9.0, 1.0, 9.0, 1.0), (-9.0, -1.5, 9.0, -1.5))
    ahead, left, behind, right = 2.0 - 0.75, 1.0 - 0.3, 2.0 - 0.25, 1.5 - 0.3
    assert _read(room) == pytest.approx([ahead, left, left, behind, behind, right, right, ahead])


@pytest.mark.parametrize("kind", Reflection)
def test_glass_mirrors_and_black_leather_reflect_sound_like_walls(kind: Reflection) -> None:
    assert _read(_scenery((2.0, -9.0, 2.0, 9.0), kind=kind))[0] == pytest.approx(1.25)


def test_the_nearest_point_in_the_cone_counts_and_not_the_one_on_the_axis() -> None:
    lean = math.radians(10.0)  # the foot of the perpendicular is within 15 deg of the axis
    middle = np.array([2.0, 0.15])
    along = 9.0 * np.array([-math.sin(lean), math.cos(lean)])
    wall = _scenery((*(middle - along), *(middle + along)))
    assert _read(wall)[0] == pytest.approx(1.25 * math.cos(lean), abs=1e-5)


@pytest.mark.parametrize(("degrees", "heard"), [(0, True), (60, True), (74, True), (76, False), (85, False)])
def test_a_face_that_no_ray_of_the_cone_meets_within_60_degrees_gives_no_echo(degrees: int, heard: bool) -> None:
    lean = math.radians(degrees)
    along = 9.0 * np.array([-math.sin(lean), math.cos(lean)])
    middle = np.array([1.5, 0.15])
    assert math.isfinite(_read(_scenery((*(middle - along), *(middle + along))))[0]) == heard


def test_a_face_without_an_echo_still_hides_the_space_behind_it() -> None:
    lean, narrow = math.radians(75.0), dataclasses.replace(CLEAN, half_cone=math.radians(5.0))
    along = 9.0 * np.array([-math.sin(lean), math.cos(lean)])
    middle = np.array([1.5, 0.15])
    screen = (*(middle - along), *(middle + along))
    behind = (2.5, -9.0, 2.5, 9.0)
    assert _read(_scenery(behind), narrow)[0] == pytest.approx(1.75)
    assert _read(_scenery(screen, behind), narrow)[0] == math.inf


def test_a_person_gives_an_echo_at_the_radius_of_its_body() -> None:
    person = PersonState(Pose2(2.0, 0.15), 1.0, 0.3, 0.25, PersonBehaviour.PATH)
    ranges = _read(_scenery(), people=(person,))
    assert ranges[0] == pytest.approx(2.0 - 0.25 - 0.75, abs=1e-3)
    assert np.isfinite(ranges[[0, 7]]).all()
    assert (ranges[1:7] == math.inf).all()


def test_the_leg_of_a_chair_gives_an_echo_at_three_metres_anywhere_in_the_cone() -> None:
    for bearing in np.radians(np.linspace(-14.5, 14.5, 59)):
        x, y = 0.75 + 3.0 * math.cos(bearing), 0.15 + 3.0 * math.sin(bearing)
        leg = np.array([[x, y, 0.015]])
        sonar = np.array([sonar_mounts(CHAIR_A)[0].array()])
        fan = np.linspace(-CLEAN.half_cone, CLEAN.half_cone, 61)
        assert first_echoes(_scenery(), leg, sonar, fan, 0.5, 4.0)[0] == pytest.approx(2.985, abs=0.01)


def _plain_echo(
    segments: FloatArray, circles: FloatArray, sonar: FloatArray, fan: FloatArray, straight: float, reach: float
) -> float:
    """Each ray of the cone against each segment and each circle."""
    best = math.inf
    for angle in sonar[2] + fan:
        ray, hits = np.array([math.cos(angle), math.sin(angle)]), []
        for x0, y0, x1, y1 in segments.tolist():
            distance, part = np.linalg.solve([[ray[0], x0 - x1], [ray[1], y0 - y1]], [x0 - sonar[0], y0 - sonar[1]])
            if 0.0 <= part <= 1.0 and distance >= 0.0:
                normal = np.array([y0 - y1, x1 - x0]) / math.hypot(x1 - x0, y1 - y0)
                hits.append((distance, abs(ray @ normal) >= straight))
        for x, y, radius in circles.tolist():
            to_centre = np.array([x, y]) - sonar[:2]
            off = np.hypot(*(to_centre - (to_centre @ ray) * ray))
            if np.hypot(*to_centre) <= radius:
                hits.append((0.0, True))
            elif off <= radius and to_centre @ ray > 0:
                hits.append((to_centre @ ray - math.sqrt(radius**2 - off**2), True))
        distance, echoes = min(hits, default=(math.inf, False))
        if echoes and distance <= reach:
            best = min(best, distance)
    return best


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 1.0), st.floats(1.0, 6.0))
def test_echoes_equal_a_plain_reference(seed: int, straight: float, reach: float) -> None:
    rng = np.random.default_rng(seed)  # random places: at an end, hit or miss are both right
    begins = rng.uniform(-4.0, 4.0, (10, 2))
    segments = np.hstack([begins, begins + rng.uniform(-3.0, 3.0, (10, 2))])
    circles = rng.uniform((-4.0, -4.0, 0.05), (4.0, 4.0, 0.4), (2, 3))
    sonars = rng.uniform((-2.0, -2.0, -math.pi), (2.0, 2.0, math.pi), (3, 3))
    fan = np.linspace(-0.3, 0.3, 9)
    echoes = first_echoes(_scenery(*segments.tolist()), circles, sonars, fan, straight, reach)
    expected = [_plain_echo(segments, circles, sonar, fan, straight, reach) for sonar in sonars]
    np.testing.assert_allclose(echoes, expected, atol=1e-9)


def test_out_of_range_the_reading_is_plus_infinity_and_too_close_minus_infinity() -> None:
    assert (_read(_scenery()) == math.inf).all()
    for gap, expected in ((0.019, -math.inf), (0.021, 0.021), (3.99, 3.99), (4.01, math.inf)):
        x = 0.75 + gap
        assert _read(_scenery((x, -9.0, x, 9.0)))[0] == pytest.approx(expected)


def test_noise_and_cross_talk_have_their_stated_size(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = _scenery((3.0, -9.0, 3.0, 9.0))
    noisy = Sonars(CLEAN, CHAIR_A, np.random.default_rng(1))
    monkeypatch.setattr(sonar_module, "SIGMA", 0.02)
    ranges = np.array([noisy.read(wall, Pose2(), (), k).ranges[0] for k in range(1500)])
    assert ranges.mean() == pytest.approx(2.25, abs=0.002)
    assert ranges.std() == pytest.approx(0.02, rel=0.06)
    monkeypatch.setattr(sonar_module, "SIGMA", 0.0)
    monkeypatch.setattr(sonar_module, "CROSS_TALK", 0.2)
    crossed = Sonars(CLEAN, CHAIR_A, np.random.default_rng(1))
    alone = np.array([crossed.read(_scenery(), Pose2(), (), k).ranges for k in range(500)])
    assert np.isfinite(alone).mean() == pytest.approx(0.2, abs=0.02)
    before_the_wall = np.array([crossed.read(wall, Pose2(), (), k).ranges[0] for k in range(1500)])
    assert before_the_wall.max() == pytest.approx(2.25)
    assert (before_the_wall < 2.24).mean() == pytest.approx(0.2 * 2.25 / 4.0, abs=0.02)


def test_the_random_stream_does_not_depend_on_the_echoes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sonar_module, "SIGMA", 0.01)
    monkeypatch.setattr(sonar_module, "CROSS_TALK", 0.005)
    first, second = (Sonars(SonarSettings(), CHAIR_A, np.random.default_rng(3)) for _ in range(2))
    wall = _scenery((2.0, -9.0, 2.0, 9.0))
    first.read(wall, Pose2(), (), 0)
    second.read(_scenery(), Pose2(50.0, 0.0, 1.0), (), 0)
    np.testing.assert_array_equal(first.read(wall, Pose2(), (), 1).ranges, second.read(wall, Pose2(), (), 1).ranges)


def test_the_layout_of_the_chairs_file_places_six_sonars_across_the_front_and_two_behind() -> None:
    body = dataclasses.replace(CHAIR_B, sonar_layout="paper")
    mounts = sonar_mounts(body)
    assert [round(math.degrees(mount.theta)) for mount in mounts] == [-165, -75, -40, -10, 10, 40, 75, 165]
    ahead = Sonars(SRF08, body, np.random.default_rng(0))
    wall = _scenery((3.0, -9.0, 3.0, 9.0))
    ranges = ahead.read(wall, Pose2(), (), 0).ranges
    assert np.isfinite(ranges).tolist() == [False, True, True, True, True, True, True, False]
    assert ranges[3] == pytest.approx(3.0 - body.front, abs=1e-3)  # its cone of 27.5 degrees holds the perpendicular
    with pytest.raises(ConfigError, match="take ring or paper"):
        dataclasses.replace(CHAIR_B, sonar_layout="star")


def test_an_srf08_hears_from_3_centimetres_to_6_metres_in_a_wider_cone() -> None:
    def heard(away: float, settings: SonarSettings) -> float:
        return float(_read(_scenery((0.75 + away, -9.0, 0.75 + away, 9.0)), settings)[0])

    assert heard(5.9, SRF08) == pytest.approx(5.9)
    assert heard(5.9, CLEAN) == math.inf
    assert (heard(6.1, SRF08), heard(0.025, SRF08)) == (math.inf, -math.inf)
    beside = _scenery((1.65, 0.53, 1.75, 0.45))  # 20 to 25 degrees off the axis of the front left sonar
    assert [math.isfinite(_read(beside, settings)[0]) for settings in (CLEAN, SRF08)] == [False, True]
    with pytest.raises(ConfigError, match="take plain or srf08"):
        SonarSettings(model="hc")
