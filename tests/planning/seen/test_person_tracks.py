"""People are detected, tracked, and forgotten."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse.csgraph import connected_components

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points
from waychair.planning.body.personal_space import PersonalSpaceSettings
from waychair.planning.seen import person_tracks as tracks_module
from waychair.planning.seen.person_sightings import PEOPLE, ScanAround, clusters, linked_groups, sightings
from waychair.planning.seen.person_tracks import (
    CONFIRMED_AFTER,
    PAUSE_S,
    Track,
    Tracker,
    associate,
    person_may_be_behind,
    personal_space_points,
    predicted,
)
from waychair.simulation.people.people import SimulatedPeople
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan, Slice
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.rays import scenery_from_slice
from waychair.simulation.sensors.silhouettes import legs
from waychair.types import FloatArray, OccupancyGrid, Pose2, Twist

TICK_NS = 100_000_000


def blob(x: float, y: float, count: int = 8) -> FloatArray:
    angles = np.linspace(0, math.tau, count, endpoint=False)
    return np.column_stack([x + 0.12 * np.cos(angles), y + 0.12 * np.sin(angles)])


def test_two_legs_are_one_person_and_a_wall_is_not() -> None:
    wall = np.column_stack([np.linspace(0, 3, 60), np.full(60, 5.0)])
    points = np.concatenate([blob(1.0, 1.0), blob(1.0, 1.35), blob(4.0, 2.0), wall, [[8.0, 8.0]]])
    middles, _ = sightings(points, PEOPLE)
    np.testing.assert_allclose(sorted(middles.tolist()), [[1.0, 1.175], [4.0, 2.0]], atol=0.01)
    assert clusters(np.empty((0, 2)), PEOPLE) == []


@given(
    points=arrays(np.float64, st.tuples(st.integers(0, 40), st.just(2)), elements=st.floats(-2.0, 2.0)),
    link=st.floats(0.01, 1.0),
)
def test_groups_are_the_connected_components_of_the_links(points: FloatArray, link: float) -> None:
    near = ((points[:, None] - points[None]) ** 2).sum(axis=2) <= link * link
    _, labels = connected_components(near, directed=False)
    assert linked_groups(points, link).tolist() == labels.tolist()


def test_a_walker_is_confirmed_after_some_scans_with_its_velocity() -> None:
    tracker = Tracker()
    counts = []
    for k in range(30):
        tracks = tracker.update(k * TICK_NS, blob(0.1 * k, 2.0 - 0.05 * k))
        counts.append(len(tracks))
    assert counts[:CONFIRMED_AFTER] == [0] * (CONFIRMED_AFTER - 1) + [1]
    assert set(counts[CONFIRMED_AFTER:]) == {1}
    np.testing.assert_allclose(tracks[0].velocity, [1.0, -0.5], atol=0.05)
    np.testing.assert_allclose(tracks[0].position, [2.9, 0.55], atol=0.05)


def test_a_person_who_turns_round_is_followed_in_half_the_time_of_constant_velocity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def scans_until_noticed() -> int:
        tracker, x = Tracker(), 0.0
        for k in range(40):
            x += 0.08 if k < 20 else -0.08
            tracks = tracker.update(k * TICK_NS, blob(x, 0.0))
            if k >= 20 and tracks[0].velocity[0] < -0.4:
                return k - 19
        return 20

    assert scans_until_noticed() <= 3
    monkeypatch.setattr(tracks_module, "SUDDEN_GATE", 100.0)
    assert scans_until_noticed() >= 6


def test_a_person_who_walks_steadily_is_followed_as_smoothly_as_by_constant_velocity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(2)
    noise = [0.04 * rng.standard_normal(2) for _ in range(40)]
    speeds = []
    for gate in (tracks_module.SUDDEN_GATE, 100.0):
        monkeypatch.setattr(tracks_module, "SUDDEN_GATE", gate)
        tracker = Tracker()
        tracks = [tracker.update(k * TICK_NS, blob(0.08 * k, 0.0) + noise[k]) for k in range(40)]
        speeds.append(np.std([track.velocity[0] for (track,) in tracks[15:]]))
    assert speeds[0] < 1.5 * speeds[1]


def test_a_briefly_hidden_track_keeps_its_number_and_a_lost_one_is_forgotten() -> None:
    tracker = Tracker()
    nothing = np.empty((0, 2))
    for k in range(20):
        tracks = tracker.update(k * TICK_NS, blob(0.1 * k, 0.0) if k not in (12, 13, 14) else nothing)
    assert [track.number for track in tracks] == [1]
    for k in range(20, 30):
        tracks = tracker.update(k * TICK_NS, nothing)
    assert tracks == ()


def test_two_people_who_pass_each_other_keep_their_numbers() -> None:
    tracker = Tracker()
    for k in range(60):
        tracks = tracker.update(k * TICK_NS, np.concatenate([blob(-3 + 0.1 * k, 0.0), blob(3 - 0.1 * k, 0.9)]))
    velocities = {track.number: float(track.velocity[0]) for track in tracks}
    assert velocities == {1: pytest.approx(1.0, abs=0.1), 2: pytest.approx(-1.0, abs=0.1)}


def test_a_detection_outside_of_every_gate_is_assigned_to_no_track() -> None:
    track = Track(1, 0, 0, 5, np.zeros(2), np.zeros(2), 0.01 * np.eye(4), 0.3)
    assert associate((track,), np.array([[5.0, 0.0]]), PEOPLE.sigma) == {}
    assert associate((track,), np.array([[5.0, 0.0], [0.1, 0.0]]), PEOPLE.sigma) == {0: 1}
    assert associate((), np.array([[5.0, 0.0]]), PEOPLE.sigma) == {}


def test_prediction_equals_constant_velocity_with_white_acceleration() -> None:
    covariance = np.diag([0.04, 0.04, 0.25, 0.25])
    track = Track(1, 0, 0, 5, np.array([1.0, 2.0]), np.array([0.5, -1.0]), covariance, 0.3)
    later = predicted(track, 500_000_000, PEOPLE.acceleration)
    np.testing.assert_allclose(later.position, [1.25, 1.5])
    np.testing.assert_allclose(later.velocity, track.velocity)
    expected = 0.04 + 0.25 * 0.25 + 0.5**4 / 4 * PEOPLE.acceleration**2
    assert later.covariance[0, 0] == pytest.approx(expected)


def test_simulated_people_are_found_in_simulated_scans() -> None:
    """Three people walk to and fro in an empty hall with a standing chair: two swinging legs each."""
    grid = OccupancyGrid(np.zeros((240, 240), np.int8), 0.05)
    ways = [[[3.0, 4.0], [9.0, 4.0]], [[9.0, 6.0], [3.0, 6.5]], [[5.0, 9.0], [7.0, 9.0]]]
    plans = [PersonPlan(PersonBehaviour.PATH, np.array(way), 1.0) for way in ways]
    pose = Pose2(2.0, 6.0)
    people = SimulatedPeople(plans, grid, CHAIR_A, np.random.default_rng(4))
    lidar = Lidar(LidarSettings(rate_hz=10.0, sweep_s=0.0, faults=False), CHAIR_A, np.random.default_rng(5))
    nothing = scenery_from_slice(Slice(np.empty((0, 4)), np.empty(0, np.int64)))
    tracker, errors, seen = Tracker(), [], []
    for k in range(80):
        people.step(TICK_NS, pose, Twist())
        scan = lidar.scan_at_rest(nothing, pose, k * TICK_NS, legs(people.states))
        hit = np.isfinite(scan.ranges)
        ranges, angles = scan.ranges[hit].astype(np.float64), scan.angles()[hit]
        points = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
        at = transform_points(pose @ CHAIR_A.base_from_laser, points)
        assert (cells_from_points(grid, at) >= 0).all()
        tracks = tracker.update(k * TICK_NS, at)
        seen.append(len(tracks))
        for person in people.states:
            away = [math.dist(track.position, (person.pose.x, person.pose.y)) for track in tracks]
            errors.append(min(away, default=math.inf))
    assert np.median(seen[10:]) == 3
    assert np.percentile(errors[60:], 90) < 0.25


def test_a_person_who_pauses_is_still_on_the_way_and_one_who_stays_is_a_standing_person() -> None:
    tracker = Tracker()
    for k in range(20):
        (walker, *_) = tracker.update(k * TICK_NS, blob(0.1 * k, 0.0)) or (None,)
    assert walker is not None
    assert walker.is_walking
    walks = [tracker.update(k * TICK_NS, blob(1.9, 0.0))[0].is_walking for k in range(20, 60)]
    assert walks[: round(PAUSE_S * 10) - 2] == [True] * (round(PAUSE_S * 10) - 2)
    assert not any(walks[30:])
    assert tracker.update(60 * TICK_NS, blob(1.9, 0.0))[0].has_walked


@pytest.mark.parametrize("ahead", [0.02, 0.1, 0.3, 1.0])
def test_the_personal_space_never_contains_the_chair(ahead: float) -> None:
    pose = Pose2(1.0, 2.0, 0.7)
    middle = transform_points(pose, np.array([[CHAIR_A.front + ahead, 0.1]]))[0]
    track = Track(1, 0, 0, 9, middle, np.zeros(2), np.eye(4), 0.3, moved_ns=0)
    room = transform_points(
        pose.inverse(), personal_space_points([track], lambda _: PersonalSpaceSettings().radius, pose, CHAIR_A, 0.06)
    )
    outside = np.maximum(room[:, 0] - CHAIR_A.front, np.abs(room[:, 1]) - CHAIR_A.width / 2)
    assert (outside >= 0.06 - 1e-9).all()
    assert (len(room) > 0) == (ahead > 0.06)
    if ahead > 0.5:
        np.testing.assert_allclose(np.hypot(*(room - (CHAIR_A.front + ahead, 0.1)).T), PersonalSpaceSettings().radius)


def test_a_slow_walker_is_recognised_by_the_distance_made_and_a_still_object_is_not() -> None:
    tracker = Tracker()
    for k in range(50):
        stands, drifts = blob(0.0, 5.0), blob(0.015 * k, 0.0)
        tracks = tracker.update(k * TICK_NS, np.concatenate([stands, drifts]))
    assert [track.has_walked for track in sorted(tracks, key=lambda each: float(each.position[1]))] == [True, False]


def test_a_person_out_of_sight_behind_the_chair_is_kept_until_forgotten() -> None:
    tracker = Tracker()
    for k in range(20):
        tracker.update(k * TICK_NS, blob(0.1 * k - 3.0, 0.0))
    for k in range(20, 90):
        tracker.update(k * TICK_NS, np.empty((0, 2)))
        if k == 40:
            assert person_may_be_behind(tracker.recently_lost, k * TICK_NS, Pose2(), CHAIR_A, 0.4)
            assert not person_may_be_behind(tracker.recently_lost, k * TICK_NS, Pose2(0.0, 0.0, math.pi), CHAIR_A, 0.4)
    assert not tracker.recently_lost


def scan_of(faces: list[tuple[float, float, float, float]], strangers: set[int], x: float, y: float) -> ScanAround:
    """Return what a laser at (x, y) sees of faces from (x, y) to (x, y), with half a degree between its beams."""
    points, found = [], []
    for angle in np.arange(-math.pi / 2, math.pi / 2, math.radians(0.5)):
        along, nearest = np.array([math.cos(angle), math.sin(angle)]), (math.inf, -1)
        for k, face in enumerate(faces):
            begin, side = np.array(face[:2]) - (x, y), np.array(face[2:]) - face[:2]
            meets = np.column_stack([along, -side])
            if abs(np.linalg.det(meets)) > 1e-9:
                way, share = np.linalg.solve(meets, begin)
                if way > 0.0 and 0.0 <= share <= 1.0:
                    nearest = min(nearest, (float(way), k))
        if nearest[1] >= 0:
            found += [len(points)] if nearest[1] in strangers else []
            points.append(np.array([x, y]) + nearest[0] * along)
    return ScanAround(np.array(points), np.array(found, np.int64), np.array([x, y]))


def who_walks(scans: list[ScanAround], hidden: bool = True) -> list[bool]:
    """Return, for each of the scans, whether a track is taken for somebody who walks."""
    tracker = Tracker()
    return [
        any(
            track.has_walked
            for track in tracker.update(k * TICK_NS, scan.points[scan.strangers], scan if hidden else None)
        )
        for k, scan in enumerate(scans)
    ]


def test_the_part_of_a_thing_in_view_behind_a_doorway_does_not_walk_as_the_chair_drives_past() -> None:
    jambs = [(3.0, -3.0, 3.0, -0.3), (3.0, 0.3, 3.0, 3.0)]
    board = (5.0, -2.5, 5.0, 2.5)
    scans = [scan_of([*jambs, board], {2}, 0.0, 0.08 * k - 1.2) for k in range(30)]
    assert any(who_walks(scans, hidden=False)), "its middle moves as fast as the chair"
    assert not any(who_walks(scans))


def test_the_end_of_a_board_that_comes_out_from_behind_a_corner_does_not_walk() -> None:
    corner, board = (2.0, -1.0, 2.0, 0.5), (5.0, 0.7, 5.0, 2.2)
    scans = [scan_of([corner, board], {1}, 0.0, 0.08 * k - 1.6) for k in range(30)]
    assert any(who_walks(scans, hidden=False))
    assert not any(who_walks(scans))


def test_somebody_who_steps_out_from_behind_a_corner_is_recognised_before_the_whole_body_is_in_view() -> None:
    corner, wall = (2.0, -1.0, 2.0, 0.5), (6.0, -9.0, 6.0, 9.0)
    steps = [0.1 * k - 0.6 for k in range(20)]  # from the corner's shadow at 1 m/s
    people = [(3.0, y, 3.0, y + 0.35) for y in steps]
    scans = [scan_of([corner, person, wall], {1}, 0.0, 0.0) for person in people]
    soonest = next(k for k, scan in enumerate(scans) if len(scan.strangers) >= 3)
    assert who_walks(scans).index(True) <= soonest + CONFIRMED_AFTER + 1


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_the_part_in_view_of_a_wall_beside_the_line_of_sight_does_not_walk(
    slope: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall, back = (1.7, 0.05, 3.4, 0.05 + 1.7 * slope), (6.0, -9.0, 6.0, 9.0)
    scans = [scan_of([wall, back], {0}, -0.02 * k, 0.04 * k - 0.8) for k in range(30)]
    assert not any(who_walks(scans))
    monkeypatch.setattr(tracks_module, "has_changed_place", lambda *_: True)
    assert any(who_walks(scans)), "it slides along the wall"


@pytest.mark.parametrize(
    ("begin", "way"), [((3.0, -1.0), (0.0, 1.0)), ((1.5, 0.2), (1.0, 0.0)), ((4.5, 0.2), (-1.0, 0.0))]
)
def test_somebody_who_walks_slowly_in_any_direction_is_recognised_within_a_second(
    begin: tuple[float, float], way: tuple[float, float]
) -> None:
    scans, back = [], (6.0, -9.0, 6.0, 9.0)
    for k in range(11):
        x, y = np.array(begin) + 0.05 * k * np.array(way)
        swing = 0.2 * math.sin(0.2 * k)
        legs_now = [
            (x + side * swing, y + 0.1 * side - 0.06, x + side * swing, y + 0.1 * side + 0.06) for side in (-1, 1)
        ]
        scans.append(replace(scan_of([*legs_now, back], {0, 1}, 0.0, 0.0), free=np.empty((0, 2))))
    assert who_walks(scans)[-1]
    assert not any(who_walks(scans[:5])), "half a step may be the other leg"
