"""People who walk past, linger or have settled: the treatment of each by the planner, and the waits of the chair."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.people import body, half_view, past
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.bystanders import Bystanders
from waychair.control.drive.local_obstacles import Surroundings, SurroundingsSettings
from waychair.control.journey.lift_site import LiftSite
from waychair.control.safety.arc_clearance import MonitorSettings, stoppable_along
from waychair.control.safety.guard import LEAST_SPEED
from waychair.geometry import transform_points
from waychair.planning.body.personal_space import GIVE_WAY_S, LINGERS_AFTER_S, SETTLED_AFTER_S, PersonalSpaceSettings
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.seen.person_sightings import PEOPLE
from waychair.planning.seen.person_tracks import PAUSE_S
from waychair.types import FloatArray, OccupancyGrid, Pose2, Twist

SCAN_NS = 100_000_000
HERE = Pose2(3.0, 4.0)
SPACE = PersonalSpaceSettings()
HALL = DrawnMap(OccupancyGrid(np.zeros((160, 240), np.int8), 0.05), CHAIR_A)

Way = Callable[[float], tuple[float, float]]
"""The position of a person [m] after a time [s]."""


class Watch:
    """A person seen by a chair ten times a second."""

    def __init__(self, late_ns: int = 0) -> None:
        """The scans are this late."""
        self.late_ns = late_ns
        self.people = Bystanders(CHAIR_A, PEOPLE, SPACE, 0.03)
        self.surroundings = Surroundings(HALL, CHAIR_A, SurroundingsSettings())
        self.scans = 0

    def see(self, way: Way, seconds: float, chair: Callable[[float], Pose2] = lambda _: HERE) -> None:
        """Let more time pass."""
        for _ in range(round(seconds * 10)):
            at, pose = way(self.scans * 0.1), chair(self.scans * 0.1)
            points, free = body(*at), past(pose, *at, half_view(pose, *at), 20.0)
            self.surroundings.see(self.scans * SCAN_NS, pose, points, free)
            stamp_ns = self.scans * SCAN_NS
            self.people.see(stamp_ns + self.late_ns, pose, points, Pose2(), self.surroundings, 0.0, stamp_ns, free)
            self.scans += 1

    @property
    def now_ns(self) -> int:
        """The time of the latest scan."""
        return (self.scans - 1) * SCAN_NS + self.late_ns

    @property
    def expected(self) -> tuple[FloatArray, FloatArray]:
        """Return the position (2,) [m] and velocity (2,) [m/s] that the planner expects of the one person."""
        (track,) = self.people.expected_people(Pose2()).tracks
        return track.position, track.velocity

    @property
    def is_an_obstacle(self) -> bool:
        """Whether the planner has the person as an obstacle, like a thing."""
        return len(self.surroundings.stationary()[0]) > 0


def walks_by(seconds: float) -> tuple[float, float]:
    return 1.0 + 0.8 * seconds, 6.0


def comes_and_stands(seconds: float) -> tuple[float, float]:
    return 5.0, min(1.0 + 0.8 * seconds, 4.0)


def shuffles(seconds: float) -> tuple[float, float]:
    """Walk up to the chair, and then pace 0.3 m to either side of y = 4.2 m, every 3 s."""
    aside = 0.3 * math.sin(math.tau / 3.0 * (seconds - 3.0)) if seconds > 3.0 else 0.0
    return max(7.0 - 0.8 * seconds, 4.6), 4.2 + aside


def test_a_person_who_walks_past_is_predicted_and_is_no_obstacle() -> None:
    watch = Watch()
    watch.see(walks_by, 4.0)
    position, velocity = watch.expected
    np.testing.assert_allclose(velocity, [0.8, 0.0], atol=0.15)
    np.testing.assert_allclose(position, walks_by(3.9), atol=0.1)
    assert not watch.is_an_obstacle
    assert not watch.people.someone_lingers_near(np.array([walks_by(3.9)]), 0.5)


def test_a_standing_person_is_predicted_for_a_while_and_is_then_an_obstacle_like_furniture() -> None:
    watch = Watch()
    watch.see(comes_and_stands, 3.75 + PAUSE_S + 2.0)
    position, velocity = watch.expected
    np.testing.assert_allclose(position, [5.0, 4.0], atol=0.1)
    assert not velocity.any()
    assert not watch.is_an_obstacle
    watch.see(comes_and_stands, SETTLED_AFTER_S)
    assert watch.is_an_obstacle
    assert not watch.people.expected_people(Pose2()).tracks
    assert not watch.people.someone_lingers_near(np.array([[5.0, 4.0]]), 0.5)


def test_a_stopped_person_is_predicted_to_stand_and_a_walking_person_to_walk_on() -> None:
    watch = Watch()
    watch.see(comes_and_stands, 3.0)
    (walking,) = watch.people.predicted(watch.now_ns, HERE)
    assert walking.velocity[1] == pytest.approx(0.8, abs=0.15)
    assert walking.speed_sigma > 0.0
    watch.see(comes_and_stands, 0.75 + PAUSE_S + 1.0)
    (standing,) = watch.people.predicted(watch.now_ns, HERE)
    np.testing.assert_allclose(standing.position, [5.0, 4.0], atol=0.1)
    assert not standing.velocity.any()
    assert standing.speed_sigma == 0.0


@pytest.mark.parametrize("late_ms", [0, 80, 150])
def test_the_prediction_starts_at_the_present_position_however_old_the_scan_is(late_ms: int) -> None:
    """A lidar turns for a tenth of a second, and between two of its scans there is a tick without one."""
    watch = Watch(late_ms * 1_000_000)
    watch.see(walks_by, 2.0)
    for tick_ms in (0, 50):
        (track,) = watch.people.predicted(watch.now_ns + tick_ms * 1_000_000, HERE)
        np.testing.assert_allclose(track.position, walks_by(1.9 + (late_ms + tick_ms) / 1000), atol=0.03)
    np.testing.assert_allclose(watch.expected[0], walks_by(1.9 + late_ms / 1000), atol=0.03)


def test_a_person_who_paces_before_a_standing_chair_is_predicted_at_the_middle_of_the_pacing() -> None:
    watch = Watch()
    watch.see(shuffles, 3.0 + LINGERS_AFTER_S + 1.5)
    for _ in range(30):
        watch.see(shuffles, 0.1)
        position, velocity = watch.expected
        np.testing.assert_allclose(position, [4.6, 4.2], atol=0.25)
        assert abs(position[1] - 4.2) < 0.2  # while the person is up to 0.3 m away from it
        assert not velocity.any()
    assert watch.people.someone_lingers_near(np.array([[4.6, 4.2], [9.0, 9.0]]), 0.3)
    assert not watch.people.someone_lingers_near(np.array([[4.6, 5.0]]), 0.3)
    assert not watch.people.someone_lingers_near(np.empty((0, 2)), 0.3)


def test_nobody_who_walks_can_reach_a_chair_that_stops_outside_their_reach() -> None:
    watch = Watch()
    watch.see(walks_by, 4.0)
    at, speed = np.array(walks_by(3.9)), 0.8
    reach = np.hypot(*(watch.people.in_reach(HERE) - at).T)
    assert 0.3 + 0.5 * speed < reach.min() <= reach.max() < 0.3 + 0.75 * speed
    near = Pose2(*(at - (CHAIR_A.front + 0.3, 0.0)))
    reach = transform_points(near.inverse(), watch.people.in_reach(near))
    assert CHAIR_A.front < reach[:, 0].min(), "nothing within the chair: it may leave"
    solid = np.zeros(len(reach), np.bool_)
    ahead = stoppable_along(reach, solid, Twist(0.3, 0.0), CHAIR_A, MonitorSettings())
    assert ahead * 0.3 < LEAST_SPEED, "a chair in reach comes no nearer"
    assert stoppable_along(reach, solid, Twist(-0.3, 0.0), CHAIR_A, MonitorSettings()) == 1.0
    watch.see(lambda _: (float(at[0]), float(at[1])), PAUSE_S + 2.0)
    assert len(watch.people.in_reach(HERE)) == 0, "the scan shows somebody who stands"


def test_no_person_lingers_for_a_chair_that_moves_on() -> None:
    watch = Watch()

    def chair(seconds: float) -> Pose2:
        return Pose2(0.3 * seconds, 4.0)

    watch.see(lambda s: (1.6 + 0.3 * s, 4.2 + 0.3 * math.sin(math.tau / 3.0 * s)), 9.0, chair)
    assert watch.people.someone_passes_near(chair(8.9))
    assert np.hypot(*watch.expected[1]) > 0.2


@pytest.mark.parametrize(("way", "seconds", "passing"), [(shuffles, 4.0, True), (shuffles, 7.0, False)])
def test_the_chair_waits_for_a_person_who_approaches_but_not_for_one_who_lingers(
    way: Way, seconds: float, passing: bool
) -> None:
    watch = Watch()
    watch.see(way, seconds)
    assert watch.people.someone_walks_near(HERE)
    assert watch.people.someone_passes_near(HERE) is passing


def test_a_person_far_away_neither_passes_nor_lingers() -> None:
    watch = Watch()
    watch.see(lambda s: (9.0, 4.0 + 0.3 * math.sin(math.tau / 3.0 * s)), 8.0)
    assert not watch.people.someone_walks_near(HERE)
    assert not watch.people.someone_passes_near(HERE)
    assert np.hypot(*watch.expected[1]) > 0.0


def test_a_chair_that_has_waited_for_people_keeps_less_distance_beside_them() -> None:
    watch = Watch()
    watch.see(walks_by, 2.0)
    assert watch.people.expected_people(Pose2()).radius == pytest.approx(CHAIR_A.width / 2 + SPACE.radius)
    points = body(*walks_by(2.0))
    now_ns, stood_s = watch.scans * SCAN_NS, GIVE_WAY_S + 0.1
    watch.people.see(now_ns, HERE, points, Pose2(), watch.surroundings, stood_s, now_ns)
    assert watch.people.expected_people(Pose2()).radius == pytest.approx(CHAIR_A.width / 2 + SPACE.squeezed)


def test_somebody_never_seen_to_walk_gets_a_persons_room_where_people_wait() -> None:
    def stands(_: float) -> tuple[float, float]:
        return 5.0, 4.0

    def room(*waiting: tuple[float, float, float]) -> FloatArray:
        watch = Watch()
        watch.people.waiting = waiting
        watch.see(stands, 1.0)
        points = watch.surroundings.unscanned()
        return np.hypot(*(points - (5.0, 4.0)).T)

    assert len(room()) == 0
    assert len(room((8.0, 4.0, 2.5))) == 0
    around = room((6.5, 4.0, 2.0))
    assert len(around) > 0
    assert around.min() == pytest.approx(SPACE.radius, abs=0.06)


def test_a_lifts_waiting_area_holds_its_cabin_and_the_ground_before_its_door() -> None:
    site = LiftSite("A", "g", Pose2(10.0, 5.0, math.pi), 2.2, 2.0, 1.2, 1.1, Pose2())
    x, y, radius = site.waiting
    for ahead, aside in ((-1.1, 1.0), (-1.1, -1.0), (2.4, 1.1), (2.4, -1.1), (2.8, 0.0)):
        spot = site.cabin @ Pose2(ahead, aside)
        assert math.hypot(spot.x - x, spot.y - y) < radius
    assert radius < 3.0
