"""The lidar: beams against a plain reference, the sweep, surfaces, legs, and REP-117's codes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import ChairBody
from waychair.errors import ConfigError
from waychair.geometry import interpolate
from waychair.simulation.scene.scene import PersonBehaviour, PersonState, Reflection, Slice
from waychair.simulation.sensors import lidar as lidar_module
from waychair.simulation.sensors.lidar import MOST_MIRRORS, Lidar, LidarOptics, LidarSettings, cast_sweep
from waychair.simulation.sensors.rays import NO_CIRCLES, Scenery, scenery_from_slice
from waychair.types import Float32Array, FloatArray, Pose2, Scan

CLEAN = LidarSettings(sigma=0.0, faults=False)
AHEAD = dataclasses.replace(CLEAN, beams=3, field_of_view=0.2)
"""Three beams, the middle one straight ahead."""

AT_BASE = ChairBody(laser_x=0.0)
DIFFUSE, DARK, GLASS, MIRROR = Reflection


def _scenery(*walls: tuple[float, float, float, float, Reflection]) -> Scenery:
    return scenery_from_slice(
        Slice(
            np.array([wall[:4] for wall in walls], np.float64).reshape(-1, 4),
            np.array([wall[4] for wall in walls], np.int64),
        )
    )


def _room(size: float = 10.0) -> Scenery:
    corners = [(0.0, 0.0), (size, 0.0), (size, size), (0.0, size)]
    return _scenery(*((*corners[i - 1], *corners[i], DIFFUSE) for i in range(4)))


def _lidar(settings: LidarSettings, seed: int = 0, body: ChairBody = AT_BASE) -> Lidar:
    return Lidar(settings, body, np.random.default_rng(seed))


def _ahead(scenery: Scenery, settings: LidarSettings = AHEAD, pose: Pose2 | None = None) -> float:
    """The range straight ahead."""
    return float(_lidar(settings).scan_at_rest(scenery, pose or Pose2(), 0).ranges[1])


# Beams


def _plain_beam(scenery: Scenery, circles: FloatArray, x: float, y: float, angle: float, optics: LidarOptics) -> float:
    """One beam, by a search of every segment and circle on each straight part of its path."""
    start, ray, way, mirrors, last = np.array([x, y]), np.array([math.cos(angle), math.sin(angle)]), 0.0, 0, -1
    while way <= optics.reach:
        hits: list[tuple[float, int]] = []
        for i, (x0, y0, x1, y1) in enumerate(scenery.segments.tolist()):
            distance, part = np.linalg.solve([[ray[0], x0 - x1], [ray[1], y0 - y1]], [x0 - start[0], y0 - start[1]])
            if 0.0 <= part <= 1.0 and distance >= 0.0 and i != last:
                hits.append((distance, i))
        for cx, cy, radius in circles.tolist():
            to_centre = np.array([cx, cy]) - start
            nearest = np.hypot(*(to_centre - (to_centre @ ray) * ray))
            if np.hypot(*to_centre) <= radius:
                hits.append((0.0, -1))
            elif nearest <= radius and to_centre @ ray > 0:
                hits.append((to_centre @ ray - math.sqrt(radius**2 - nearest**2), -1))
        if not hits:
            return math.inf
        distance, last = min(hits)
        start, way = start + distance * ray, way + distance
        if last < 0:
            break
        along = scenery.segments[last, 2:] - scenery.segments[last, :2]
        along /= np.hypot(*along)
        normal = np.array([-along[1], along[0]])
        kind, cosine = scenery.reflections[last], abs(ray @ normal)
        if kind == MIRROR:
            mirrors, ray = mirrors + 1, ray - 2.0 * (ray @ normal) * normal
            if mirrors > MOST_MIRRORS:
                return math.inf
        elif kind == DARK and way > optics.dark_reach * math.sqrt(cosine):
            return math.inf
        elif kind != GLASS or cosine >= optics.straight:
            break
    return way if way <= optics.reach else math.inf


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(1.0, 15.0), st.floats(0.5, 5.0), st.floats(0.0, 0.6))
def test_beams_equal_a_plain_reference(seed: int, reach: float, dark_reach: float, glass_angle: float) -> None:
    rng = np.random.default_rng(seed)  # random places: at an end, hit or miss are both right
    begins = rng.uniform(-5.0, 5.0, (12, 2))
    scenery = scenery_from_slice(
        Slice(np.hstack([begins, begins + rng.uniform(-3, 3, (12, 2))]), rng.integers(0, 4, 12))
    )
    circles = rng.uniform((-5.0, -5.0, 0.05), (5.0, 5.0, 0.5), (3, 3))
    (x, y), angles = rng.uniform(-5.0, 5.0, 2).tolist(), rng.uniform(-math.pi, math.pi, 24)
    optics = LidarOptics(reach, dark_reach, math.cos(glass_angle))
    ranges = cast_sweep(
        scenery, circles, circles, np.zeros(1), np.array([[x, y, 0.0]]), np.zeros(3), angles, np.zeros(24), optics
    )
    expected = [_plain_beam(scenery, circles, x, y, float(angle), optics) for angle in angles]
    np.testing.assert_allclose(ranges, expected, atol=1e-6)


def test_a_scan_covers_its_field_of_view_from_edge_to_edge() -> None:
    scan = _lidar(CLEAN).scan_at_rest(_room(), Pose2(5.0, 5.0, 0.0), 7)
    assert scan.stamp_ns == 7
    assert scan.ranges.dtype == np.float32
    assert scan.ranges.shape == (720,)
    assert scan.angles()[[0, -1]] == pytest.approx(np.radians([-135.0, 135.0]))


def test_a_scan_is_taken_from_the_mount_of_the_laser() -> None:
    settings = dataclasses.replace(CLEAN, beams=3, field_of_view=math.pi)
    mounted = ChairBody(laser_x=0.6, laser_y=0.1, laser_theta=math.pi / 2)
    scan = _lidar(settings, body=mounted).scan_at_rest(_room(), Pose2(5.0, 4.0, 0.0), 0)
    # The laser is at (5.6, 4.1) and looks to +y; its first beam points at +x, its last at -x.
    assert scan.ranges == pytest.approx([10.0 - 5.6, 10.0 - 4.1, 5.6], abs=1e-5)


# The sweep


def _drive(now_ns: int) -> Pose2:
    """A chair that drives straight and turns, across the cut of its heading at pi."""
    seconds = now_ns * 1e-9
    return Pose2(4.0 + 0.8 * seconds, 5.0 - 0.3 * seconds, math.remainder(3.1 + 1.2 * seconds, math.tau))


def test_every_beam_starts_at_the_pose_of_the_chair_at_its_time() -> None:
    lidar = _lidar(CLEAN, body=ChairBody())
    times_ns = np.arange(100, 190, 10) * 1_000_000
    poses = np.array([_drive(int(time)).array() for time in times_ns])
    scan = lidar.scan(_room(), times_ns, poses, 105_000_000)
    assert scan.stamp_ns == 105_000_000
    assert scan.time_step * 719 == pytest.approx(0.075)
    for i in (0, 1, 200, 360, 500, 718, 719):
        at_ns = 105_000_000 + i * scan.time_step * 1e9
        k = min(int((at_ns - times_ns[0]) // 10_000_000), len(poses) - 2)
        pose = interpolate(Pose2(*poses[k]), Pose2(*poses[k + 1]), (at_ns - times_ns[k]) / 10_000_000)
        still = lidar.scan_at_rest(_room(), pose, 0)
        assert scan.ranges[i] == pytest.approx(still.ranges[i], abs=1e-5)


def test_beams_before_the_first_pose_and_after_the_last_start_from_those() -> None:
    lidar, poses = _lidar(CLEAN), np.array([[3.0, 3.0, 0.1], [6.0, 4.0, 0.2]])
    scan = lidar.scan(_room(), np.array([30_000_000, 40_000_000]), poses, 0)
    first, last = (lidar.scan_at_rest(_room(), Pose2(*pose), 0).ranges for pose in poses)
    assert scan.ranges[:280] == pytest.approx(first[:280], abs=1e-5)
    assert scan.ranges[390:] == pytest.approx(last[390:], abs=1e-5)


def _scans(settings: LidarSettings, step_ms: int, until_ms: int) -> list[tuple[int, Scan]]:
    """Return scans of a drive, each with the time of its arrival [ms]."""
    lidar = _lidar(settings)
    scans = (
        (ms, lidar.step(_room(), _drive(ms * 1_000_000), (), ms * 1_000_000)) for ms in range(0, until_ms, step_ms)
    )
    return [(ms, scan) for ms, scan in scans if scan is not None]


@pytest.mark.parametrize(("sweep_s", "delay_ms"), [(0.0, 0), (0.075, 75), (0.08, 80), (0.1, 100)])
def test_a_scan_has_the_time_of_its_first_beam_and_arrives_with_its_last(sweep_s: float, delay_ms: int) -> None:
    scans = _scans(dataclasses.replace(CLEAN, sweep_s=sweep_s), step_ms=5, until_ms=1005)
    assert [scan.stamp_ns for _, scan in scans][:10] == [k * 100_000_000 for k in range(10)]
    assert [ms for ms, _ in scans][:10] == [k * 100 + delay_ms for k in range(10)]


def test_a_scan_arrives_at_the_first_step_after_its_last_beam() -> None:
    assert [ms for ms, _ in _scans(CLEAN, step_ms=10, until_ms=300)] == [80, 180, 280]


def test_scans_of_a_drive_do_not_depend_on_its_steps() -> None:
    fine, coarse = (_scans(CLEAN, step_ms, 200)[1][1] for step_ms in (1, 5))
    assert fine.ranges == pytest.approx(coarse.ranges, abs=1e-4)


def test_a_sweep_that_takes_longer_than_a_period_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"sweep_s = 0\.06 is impossible: at 20 Hz a sweep has 0\.05 s"):
        LidarSettings(rate_hz=20.0, sweep_s=0.06)


# Surfaces


def _wall(
    x: float, kind: Reflection, lean: float = 0.0, half: float = 3.0
) -> tuple[float, float, float, float, Reflection]:
    """A wall across the x axis, its normal `lean` [rad] off the axis."""
    dx, dy = half * math.sin(lean), half * math.cos(lean)
    return x + dx, -dy, x - dx, dy, kind


@pytest.mark.parametrize(
    ("degrees", "distance", "seen"), [(0, 3.9, True), (0, 4.1, False), (60, 2.7, True), (60, 2.9, False)]
)
def test_a_dark_surface_is_lost_beyond_a_few_metres_and_nearer_at_oblique_angles(
    degrees: float, distance: float, seen: bool
) -> None:
    scenery = _scenery(_wall(distance, DARK, math.radians(degrees)), _wall(8.0, DIFFUSE))
    assert _ahead(scenery) == pytest.approx(distance if seen else math.inf)


@pytest.mark.parametrize(("degrees", "expected"), [(0.0, 2.0), (2.9, 2.0), (3.1, 5.0), (45.0, 5.0)])
def test_glass_is_seen_only_at_nearly_normal_incidence(degrees: float, expected: float) -> None:
    pane = _wall(2.0, GLASS, math.radians(degrees)), _wall(2.01, GLASS, math.radians(degrees))
    assert _ahead(_scenery(*pane, _wall(5.0, DIFFUSE))) == pytest.approx(expected)


def test_touching_panes_do_not_stop_a_beam() -> None:
    panes = [_wall(2.0, GLASS, 0.5) for _ in range(3)]
    assert _ahead(_scenery(*panes, _wall(5.0, DIFFUSE))) == pytest.approx(5.0)


def test_nothing_behind_glass_reads_plus_infinity() -> None:
    assert _ahead(_scenery(_wall(2.0, GLASS, 0.5))) == math.inf


def test_a_mirror_shows_the_room_as_a_continuation_behind_it() -> None:
    mirror = _wall(3.0, MIRROR, math.pi / 4)  # sends a beam along x on along +-y
    scenery = _scenery(mirror, (-9.0, 4.0, 9.0, 4.0, DIFFUSE), (-9.0, -4.0, 9.0, -4.0, DIFFUSE))
    assert _ahead(scenery) == pytest.approx(7.0)
    facing = _scenery(_wall(3.0, MIRROR), _wall(-2.0, DIFFUSE))
    assert _ahead(facing) == pytest.approx(3.0 + 5.0)


def test_between_two_mirrors_a_beam_is_lost() -> None:
    assert _ahead(_scenery(_wall(1.0, MIRROR), _wall(-1.0, MIRROR))) == math.inf


def test_the_path_over_a_mirror_counts_for_the_range() -> None:
    scenery = _scenery(_wall(3.0, MIRROR), _wall(-2.0, DIFFUSE))
    for range_max, seen in ((8.01, True), (7.99, False)):
        assert math.isfinite(_ahead(scenery, dataclasses.replace(AHEAD, range_max=range_max))) == seen


# Legs


def _people(*behaviours: PersonBehaviour, x: float = 3.0) -> list[PersonState]:
    return [
        PersonState(Pose2(5.0 + x, 5.0 - 1.5 * k, math.pi), 1.0, 0.0, 0.25, behaviour)
        for k, behaviour in enumerate(behaviours)
    ]


def _clusters(ranges: Float32Array, empty: Float32Array) -> int:
    """Stretches of beams that end nearer than in the empty room."""
    nearer = ranges < empty - 0.05
    return int((np.diff(nearer.astype(int), prepend=0) == 1).sum())


@pytest.mark.parametrize(("behaviour", "count"), [(PersonBehaviour.PATH, 2), (PersonBehaviour.BOUNCE, 1)])
def test_a_walker_is_two_legs_to_the_lidar_and_a_mover_one_disc(behaviour: PersonBehaviour, count: int) -> None:
    lidar, pose = _lidar(dataclasses.replace(CLEAN, sweep_s=0.0)), Pose2(5.0, 5.0, 0.0)
    empty = lidar.scan_at_rest(_room(), pose, 0).ranges
    scan = lidar.step(_room(), pose, _people(behaviour), 0)
    assert scan is not None
    assert _clusters(scan.ranges, empty) == count


def test_people_move_during_a_sweep() -> None:
    begin, end = np.array([[8.0, 4.9, 0.05]]), np.array([[8.0, 5.1, 0.05]])
    lidar, pose = _lidar(CLEAN), np.array([[5.0, 5.0, 0.0]])
    ranges = lidar.scan(_room(), np.array([0]), pose, 0, begin, end).ranges
    # The middle beams leave half-way through the sweep, when the disc is straight ahead.
    assert ranges[359:361] == pytest.approx(2.95, abs=1e-3)


def test_the_riders_own_legs_hide_the_view_behind_them() -> None:
    body = ChairBody()
    seen = (
        _lidar(dataclasses.replace(CLEAN, legs=True), body=body).scan_at_rest(_room(), Pose2(5.0, 5.0, 0.4), 0).ranges
    )
    free = _lidar(CLEAN, body=body).scan_at_rest(_room(), Pose2(5.0, 5.0, 0.4), 0).ranges
    hidden = seen < free
    assert 0.1 < hidden.mean() < 0.5
    assert (seen[hidden] > 0.05).all()
    assert (seen[hidden] < 0.3).all()
    assert hidden[::-1] == pytest.approx(hidden)  # one leg to each side
    assert not hidden[240:480].any()  # the view ahead is free
    assert _clusters(seen, free) == 4


# Codes and faults


def test_beyond_the_range_the_reading_is_plus_infinity_and_too_close_minus_infinity() -> None:
    far = _lidar(dataclasses.replace(CLEAN, range_max=3.0)).scan_at_rest(_room(), Pose2(5.0, 5.0, 0.0), 0)
    assert (far.ranges == math.inf).all()
    assert _ahead(_room(), pose=Pose2(9.96, 5.0, 0.0)) == -math.inf
    assert _ahead(_room(), pose=Pose2(9.94, 5.0, 0.0)) == pytest.approx(0.06, abs=1e-6)
    inside_somebody = np.array([[5.0, 5.0, 0.2]])
    blind = _lidar(CLEAN).scan_at_rest(_room(), Pose2(5.0, 5.0, 0.0), 0, inside_somebody)
    assert (blind.ranges == -math.inf).all()


@pytest.mark.parametrize(("size", "sigma"), [(2.0, 0.0305), (24.0, 0.036)])
def test_noise_grows_with_the_range_and_drop_outs_have_their_stated_share(
    size: float, sigma: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lidar_module, "DROP_OUT", 0.1)
    monkeypatch.setattr(lidar_module, "MIXED", 0.0)
    settings = dataclasses.replace(CLEAN, sigma=0.03, faults=True, field_of_view=0.1)
    noisy, pose = _lidar(settings), Pose2(size / 2, size / 2, 0.0)
    scans = np.array([noisy.scan_at_rest(_room(size), pose, 0).ranges for _ in range(50)])
    truth = _lidar(dataclasses.replace(CLEAN, field_of_view=0.1)).scan_at_rest(_room(size), pose, 0).ranges
    assert np.isnan(scans).mean() == pytest.approx(0.1, abs=0.01)
    assert np.nanstd(scans - truth) == pytest.approx(sigma, rel=0.03)
    assert np.nanmean(scans - truth) == pytest.approx(0.0, abs=0.001)


def test_some_beams_on_an_edge_give_mixed_pixels_and_no_others_do(monkeypatch: pytest.MonkeyPatch) -> None:
    scenery = _scenery(_wall(2.0, DIFFUSE, half=0.3), _wall(6.0, DIFFUSE, half=6.0))
    for name, value in (("MIXED", 0.5), ("DROP_OUT", 0.0), ("SIGMA_PER_METRE", 0.0)):
        monkeypatch.setattr(lidar_module, name, value)
    settings = dataclasses.replace(CLEAN, faults=True, field_of_view=1.0)
    lidar = _lidar(settings)
    truth = _lidar(dataclasses.replace(settings, faults=False)).scan_at_rest(scenery, Pose2(), 0).ranges
    scans = np.array([lidar.scan_at_rest(scenery, Pose2(), 0).ranges for _ in range(400)])
    moved = np.abs(scans - truth) > 1e-6
    edges = np.nonzero(np.abs(np.diff(truth)) > 1.0)[0]
    assert len(edges) == 2
    assert set(np.nonzero(moved.any(axis=0))[0]) == set(edges)
    assert moved[:, edges].mean() == pytest.approx(0.5, abs=0.05)
    between = scans[:, edges]
    assert (between >= truth.min() - 1e-6).all()
    assert (between <= truth.max() + 1e-6).all()
    assert between.std() > 0.5


def test_the_random_stream_does_not_depend_on_the_scene() -> None:
    first, second = _lidar(LidarSettings()), _lidar(LidarSettings())
    first.scan_at_rest(_room(), Pose2(5.0, 5.0, 0.0), 0)
    second.scan_at_rest(_scenery(), Pose2(-900.0, 5.0, 0.0), 0, np.array([[-900.0, 6.0, 0.3]]))
    np.testing.assert_array_equal(
        first.scan_at_rest(_room(), Pose2(5.0, 5.0, 0.0), 1, NO_CIRCLES).ranges,
        second.scan_at_rest(_room(), Pose2(5.0, 5.0, 0.0), 1, NO_CIRCLES).ranges,
    )


def test_a_chair_without_a_lidar_gets_no_scan() -> None:
    lidar = _lidar(LidarSettings(rate_hz=0.0))
    assert [lidar.step(_room(), Pose2(5.0, 5.0), (), ms * 1_000_000) for ms in range(300)] == [None] * 300
