"""Drop-offs, glass, people and ride comfort: the figures, and a small sample of `evaluation.figures.driving.hazards`."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from evaluation.scenes.hazards import (
    DROP_OFFS,
    ContactCause,
    Protection,
    closing_speed,
    contact_cause,
    drop_off_ahead,
    glass,
    least_to_drop_off,
    map_of_lidar,
    movers,
    robot_settings,
    run_hazard,
    to_the_restroom,
)
from evaluation.scenes.sudden_person import run_sudden_person
from evaluation.scenes.worst_ride import worst_of
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.drawn.zones import zone_contains
from waychair.maps.grid.cells import cells_from_points, occupied
from waychair.planning.seen.person_tracks import MODELS, Tracker
from waychair.simulation.scene.contact import Contact, ContactKind, clearance, solid_from_blocks
from waychair.simulation.simulator import Simulator
from waychair.trials.ride import STILL, RecordingSimulator, TrueMotion, ride_of
from waychair.types import FloatArray, Pose2

_ORIGIN = Pose2()


def motion_of(v: FloatArray, omega: FloatArray, pose: Pose2 = _ORIGIN) -> TrueMotion:
    """Return the motion of a chair that stays at a pose with twists (T,), sampled every 10 ms."""
    stamps = 10_000_000 * np.arange(len(v), dtype=np.int64)
    poses = np.broadcast_to(pose.array(), (len(v), 3))
    return TrueMotion(stamps, poses, np.column_stack([v, omega]), np.full(len(v), math.inf))


@pytest.mark.parametrize("where", DROP_OFFS)
def test_no_lidar_maps_an_edge_and_every_zone_contains_it_completely(where: str) -> None:
    for seed in range(5):
        hazard = DROP_OFFS[where](Protection.ZONE, seed)
        pit = hazard.world.pits[0]
        middle = np.array([[pit.middle.x, pit.middle.y]])
        cell = tuple(cells_from_points(hazard.grid, middle)[0])
        assert not occupied(hazard.grid)[cell]
        assert occupied(hazard.world.grid)[cell]
        assert zone_contains(hazard.zones[0], middle).all()
        edges = solid_from_blocks((), hazard.world.pits)
        assert clearance(edges, hazard.body, hazard.world.start) > 0.3
        assert all(clearance(edges, hazard.body, goal.pose) > 0.15 for goal in hazard.goals)


def test_glass_is_in_the_world_and_not_on_the_map_that_a_lidar_makes() -> None:
    world = glass(Protection.SONAR, 0).world
    door = cells_from_points(world.grid, np.array([[5.5, 1.5]]))[0]
    assert occupied(world.grid)[tuple(door)]
    assert not occupied(map_of_lidar(world))[tuple(door)]
    wall = cells_from_points(world.grid, np.array([[5.5, 2.6]]))[0]
    assert occupied(map_of_lidar(world))[tuple(wall)]


def test_scenes_depend_on_their_seed_only() -> None:
    for scene in (*DROP_OFFS.values(), glass):
        starts = {scene(Protection.ZONE, seed).world.start for seed in range(10)}
        assert len(starts) == 10
        assert scene(Protection.ZONE, 3).world.start == scene(Protection.ZONE, 3).world.start
    paths = [to_the_restroom(seed).world.people[-1].path[1, 1] for seed in (0, 1, 0)]
    assert paths[0] == paths[2] != paths[1]


@pytest.mark.parametrize("seed", range(10))
def test_movers_stand_in_the_room_apart_from_each_other_and_from_the_start(seed: int) -> None:
    hazard = movers(10, seed)
    points = [person.path[0] for person in hazard.world.people]
    assert len(points) == 10
    assert min(math.dist(a, b) for a, b in itertools.combinations(points, 2)) > 0.3
    assert min(math.dist(point, (hazard.world.start.x, hazard.world.start.y)) for point in points) > 0.6
    assert all(0.2 <= value <= 2.9 for point in points for value in point)


def test_a_disc_that_appears_beside_another_is_known_before_they_separate() -> None:
    hazard = movers(2, 0)
    tracker, radius = Tracker(MODELS[robot_settings().navigator.tracks.movers]), hazard.world.people[0].radius
    angles = np.linspace(-1.2, 1.2, 15)
    arc = 1.0 - radius * np.column_stack([np.cos(angles), np.sin(angles)])
    for k in range(10):
        tracks = tracker.update(k * 100_000_000, arc)
    for k in range(10, 20):
        beside = arc + np.array([0.0, 3.0 * radius])
        tracks = tracker.update(k * 100_000_000, np.concatenate([arc, beside]))
    assert len(tracks) == 2


@pytest.mark.parametrize(
    ("at", "v", "omega", "speed"),
    [
        ((1.2, 0.0), 0.5, 0.0, 0.5),  # ahead of an approaching chair
        ((1.2, 0.0), -0.5, 0.0, -0.5),  # ahead of a reversing chair
        ((0.3, 0.6), 0.5, 0.0, 0.0),  # beside it
        ((-0.6, 0.0), -0.2, 0.0, 0.2),  # behind a reversing chair
        ((0.75, 0.8), 0.0, 0.4, 0.3),  # beside the front of a turning chair: omega times the lever of 0.75 m
    ],
)
def test_the_closing_speed_is_that_of_the_nearest_point_of_the_outline(
    at: tuple[float, float], v: float, omega: float, speed: float
) -> None:
    motion = motion_of(np.full(3, v), np.full(3, omega))
    assert closing_speed(np.array(at), CHAIR_A, motion, 10_000_000) == pytest.approx(speed, abs=1e-12)


@given(st.floats(-math.pi, math.pi), st.floats(0.3, 2.0), st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))
def test_the_closing_speed_does_not_depend_on_the_origin_of_the_map(
    theta: float, ahead: float, v: float, omega: float
) -> None:
    here, moved = Pose2(), Pose2(3.0, -1.0, theta)
    at = moved @ Pose2(CHAIR_A.front + ahead, 0.7)
    found = [
        closing_speed(np.array(point), CHAIR_A, motion_of(np.full(2, v), np.full(2, omega), pose), 0)
        for point, pose in (((CHAIR_A.front + ahead, 0.7), here), ((at.x, at.y), moved))
    ]
    assert found[0] == pytest.approx(found[1], abs=1e-9)


def test_a_person_who_walks_into_a_standing_chair_was_not_hit_by_it() -> None:
    world = drop_off_ahead(Protection.NOTHING, 0).world
    contact = Contact(0, ContactKind.PERSON, 1.0, 0.0, 0.0)
    assert contact_cause(contact, world, CHAIR_A, motion_of(np.zeros(2), np.zeros(2))) is ContactCause.BUMPED
    assert contact_cause(contact, world, CHAIR_A, motion_of(np.full(2, 0.3), np.zeros(2))) is ContactCause.PERSON


def test_contacts_with_edges_glass_and_walls_are_counted_separately() -> None:
    still = motion_of(np.zeros(2), np.zeros(2))
    edge, pane = drop_off_ahead(Protection.NOTHING, 0).world, glass(Protection.NOTHING, 0).world
    pit = edge.pits[0]
    rim = Contact(0, ContactKind.SOLID, pit.middle.x - pit.length / 2, pit.middle.y, 0.5)
    assert contact_cause(rim, edge, CHAIR_A, still) is ContactCause.EDGE
    assert contact_cause(Contact(0, ContactKind.SOLID, 0.05, 1.0, 0.5), edge, CHAIR_A, still) is ContactCause.SOLID
    assert contact_cause(Contact(0, ContactKind.SOLID, 5.45, 1.5, 0.5), pane, CHAIR_A, still) is ContactCause.GLASS


@pytest.mark.nightly
def test_a_chair_that_sees_a_pit_ahead_drives_round_all_of_it() -> None:
    result = run_hazard(drop_off_ahead(Protection.CAMERA, 3), 3)
    assert result.reached, result.reason
    assert not result.contacts
    assert result.drop_off_m > 0.05


@pytest.mark.nightly
def test_a_keep_out_zone_keeps_the_chair_from_an_edge_that_it_would_otherwise_drive_over() -> None:
    kept = run_hazard(drop_off_ahead(Protection.ZONE, 0), 0)
    assert (kept.reached, kept.count(ContactCause.EDGE)) == (True, 0), kept.reason
    assert kept.drop_off_m > 0.05
    fallen = run_hazard(drop_off_ahead(Protection.NOTHING, 0), 0)
    assert fallen.count(ContactCause.EDGE) == 1


@pytest.mark.nightly
def test_a_glass_door_oblique_to_the_sonars_is_heard_in_time() -> None:
    """Regression: driving along the wall and turning into the door, the chair touched the pane at 0.27 m/s."""
    result = run_hazard(glass(Protection.SONAR, 31), 31)
    assert result.reached, result.reason
    assert not result.contacts


@pytest.mark.nightly
def test_a_person_who_appears_too_near_is_hit_after_full_braking_and_one_farther_away_is_not() -> None:
    near, far = run_sudden_person(0.3, 0), run_sudden_person(1.2, 0)
    assert near.speed >= 0.75
    assert far.speed >= 0.75
    assert 0.0 < near.contact_speed < near.speed
    assert near.braking >= 0.8 * near.can_brake
    assert (far.contact_speed, far.nearest_m > 0.1) == (0.0, True)


def test_recording_a_drive_does_not_change_the_messages_of_the_chair() -> None:
    world = drop_off_ahead(Protection.NOTHING, 0).world
    watched, plain = RecordingSimulator(world, CHAIR_A, seed=3), Simulator(world, CHAIR_A, seed=3)
    for simulator in (watched, plain):
        simulator.drive(2.2, 1.7)
    told = [[message.stamp_ns for message in simulator.advance(500_000_000)] for simulator in (watched, plain)]
    assert told[0] == told[1]
    assert watched.truth() == plain.truth()
    motion = watched.motion()
    assert motion.at(watched.now_ns) == (watched.truth(), watched.twist())
    assert least_to_drop_off(world, CHAIR_A, motion) == pytest.approx(
        clearance(solid_from_blocks((), world.pits), CHAIR_A, watched.truth())
    )


def test_the_comfort_figures_of_a_steady_acceleration_and_a_curve_are_exact() -> None:
    seconds = np.arange(0.0, 8.0, 0.01)
    faster = ride_of(motion_of(0.4 * np.clip(seconds - 2.0, 0.0, 2.0), np.zeros(len(seconds))))
    assert faster.speeding_up == pytest.approx(0.4, rel=0.08)  # the filter overshoots a little at a corner
    assert faster.slowing_down < 0.05
    curve = ride_of(motion_of(np.full(len(seconds), 0.8), np.full(len(seconds), 0.5)))
    assert curve.sideways == pytest.approx(0.4, rel=1e-3)
    assert curve.rms == pytest.approx(0.4, rel=1e-3)
    assert curve.jerk < 1e-3


@given(st.floats(0.1, 2.0))
def test_a_faster_ride_is_rougher_by_the_same_factor(factor: float) -> None:
    v = 0.8 * np.sin(np.arange(0.0, 6.0, 0.01)) ** 2 + 0.1
    one, more = (ride_of(motion_of(share * v, np.zeros(len(v)))) for share in (1.0, factor))
    assert more.jerk == pytest.approx(factor * one.jerk)
    assert more.slowing_down == pytest.approx(factor * one.slowing_down)


def test_a_chair_at_rest_has_zero_figures_and_the_worst_of_many_rides_is_the_worst_in_each_figure() -> None:
    assert ride_of(motion_of(np.zeros(500), np.zeros(500))) == STILL
    assert ride_of(motion_of(np.zeros(3), np.zeros(3))) == STILL
    assert worst_of([]) == STILL
    v = 0.5 + 0.2 * np.sin(np.arange(0.0, 6.0, 0.01))
    one, other = ride_of(motion_of(v, 0.0 * v)), ride_of(motion_of(0.0 * v + 0.5, 0.0 * v + 0.6))
    worst = worst_of([one, other])
    assert (worst.jerk, worst.sideways) == (one.jerk, other.sideways)
    assert min(one.rms, other.rms) < worst.rms < max(one.rms, other.rms)
