"""The cells with today's sensors: the gathered view, free space by the swept outline, and bad inputs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, sonar_mounts
from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.commands import FreeKind, signal_words
from waychair.control.behaviours.default import SECTORS, default_network
from waychair.control.behaviours.doorway import DoorwayJambs, OdometryPose
from waychair.control.behaviours.runtime import Innervation, Runtime
from waychair.control.behaviours.view.door_cells import DoorSeen, DoorsSeen
from waychair.control.behaviours.view.local_view import Beams, Fans, LocalView, MapPart, Thing, ViewMemory, gather_views
from waychair.control.behaviours.view.sensor_cells import EchoMemory, check_echoes, echo_fans, lidar_fans, smoothed
from waychair.control.behaviours.view.sensor_parts import map_part, people_fans
from waychair.control.behaviours.view.swept_sectors import free_orientations
from waychair.types import Float32Array, FloatArray, OccupancyGrid, Pose2, Scan, SonarReadings

TICK_NS, NONE = 50_000_000, np.empty((0, 2))
HERE = OdometryPose(0.0, 0.0, 0.0)


def free(*points: tuple[float, float], margin: float = 0.0, unseen: FloatArray = NONE) -> list[int]:
    """Return the free sectors round chair A."""
    at = np.array(points, np.float64).reshape(-1, 2)
    return np.nonzero(free_orientations(at, np.full(len(at), margin), unseen, CHAIR_A, SECTORS))[0].tolist()


def test_an_empty_place_is_free_all_round() -> None:
    assert free() == list(range(SECTORS))


def test_a_wall_ahead_blocks_the_orientations_that_run_into_it() -> None:
    wall = [(1.2, y) for y in np.arange(-2.0, 2.01, 0.05)]  # 0.45 m before the chair's front end
    found = free(*wall)
    assert 0 not in found
    assert {1, 15}.isdisjoint(found)
    assert {4, 8, 12} <= set(found)


def test_a_chair_between_two_walls_can_drive_ahead_and_back_and_nowhere_else() -> None:
    walls = [(x, side) for x in np.arange(-2.0, 2.01, 0.05) for side in (-0.4, 0.4)]
    assert free(*walls) == [0, 8]
    assert free(*walls, (-0.6, 0.0)) == [0]
    assert free(*walls, (1.0, 0.0)) == [8]


def test_an_orientation_behind_is_reached_on_the_side_that_is_free() -> None:
    assert {4, 12} <= set(free((0.35, 0.5)))  # the pole stands in the left turn, so left is reached by the right
    both = free((0.35, 0.5), (0.35, -0.5))
    assert {4, 12}.isdisjoint(both)


def test_a_thing_just_beyond_the_end_of_the_drive_is_no_obstacle_and_one_before_it_is() -> None:
    end = CHAIR_A.front + 0.8
    assert 0 in free((end + 0.001, 0.0))
    assert 0 not in free((end - 0.001, 0.0))
    assert 0 not in free((end + 0.001, 0.0), margin=0.02)


def test_ground_that_nobody_saw_is_not_free() -> None:
    assert 0 not in free(unseen=np.array([[1.2, 0.1]]))
    assert 8 not in free(unseen=np.array([[-0.8, 0.1]]))


def test_a_chair_that_stands_nearer_than_the_margin_can_still_leave() -> None:
    beside = [(x, 0.31) for x in np.arange(-1.0, 2.0, 0.05)]
    assert 0 in free(*beside, margin=0.02)


# The view ----------------------------------------------------------------------------------------------------------


def scan_of(ranges: float | FloatArray, beams: int = 720, at_ns: int = 0) -> Scan:
    values = np.broadcast_to(np.asarray(ranges, np.float32), beams).copy()
    half = math.radians(135.0)
    return Scan(at_ns, values, -half, 2 * half / (beams - 1), range_max=20.0)


def seen_free(view: LocalView, x: float, y: float) -> bool:
    gaps = np.hypot(*(view.unseen_places() - (x, y)).T)
    return bool(gaps.min(initial=9.0) > 0.04)


def gathered(
    now_ns: int, memory: ViewMemory, at: OdometryPose = HERE, **parts: Any
) -> tuple[LocalView | None, ViewMemory]:
    names = ("lidar", "depth", "drop_offs", "echoes", "people", "line", "surroundings")
    given = {name: parts.get(name) for name in names}
    return gather_views(Reading(at, now_ns), **given, constants=CHAIR_A, dynamic=memory, now_ns=now_ns)


def lidar_part(now_ns: int, ranges: float | FloatArray = 2.0) -> Reading[Fans]:
    fans = lidar_fans(scan_of(ranges, at_ns=now_ns), None, CHAIR_A)
    assert fans is not None
    return Reading(fans, now_ns)


def test_ground_before_a_hit_is_free_ground_behind_it_and_behind_the_chair_is_not() -> None:
    view, _ = gathered(0, ViewMemory(), lidar=lidar_part(0))
    assert view is not None
    assert seen_free(view, 2.0, 0.3)
    assert not seen_free(view, -1.0, 0.0)
    assert seen_free(view, 0.0, 0.0)  # under the chair
    near = view.metres()
    assert np.hypot(near[:, 0] - CHAIR_A.laser_x, near[:, 1]) == pytest.approx(2.0, abs=0.002)


def test_ground_seen_before_stays_free_while_the_chair_drives_on_and_is_forgotten_later() -> None:
    _, memory = gathered(0, ViewMemory(), lidar=lidar_part(0))
    on = OdometryPose(1.5, 0.0, 0.0)
    at_ns = 3_000_000_000
    view, later = gathered(at_ns, memory, on, lidar=lidar_part(at_ns))
    assert view is not None
    assert seen_free(view, -1.0, 0.5)
    last_ns = 16_000_000_000
    old, _ = gathered(last_ns, later, on, lidar=lidar_part(last_ns))
    assert old is not None
    assert not seen_free(old, -1.0, 0.5)


def points32(*points: tuple[float, float]) -> Float32Array:
    return np.array(points, np.float32)


def test_what_lidar_cannot_see_is_not_cleared_by_it() -> None:
    table = Fans((Beams(np.array([0.4, 0.2]), points32((1.2, 0.0)), np.array([True]), 0.01),))
    edge = Fans((Beams(np.array([0.4, 0.2]), points32((1.0, 0.5)), np.array([True]), 0.01, int(Thing.DROP_OFF)),))
    view, memory = gathered(0, ViewMemory(), depth=Reading(table, 0), drop_offs=Reading(edge, 0))
    view, _ = gathered(TICK_NS, memory, lidar=lidar_part(TICK_NS))
    assert view is not None
    assert max(view.margins().tolist()) == 0.15
    assert np.hypot(*(view.metres() - (1.2, 0.0)).T).min() < 0.002


def sonars(first: float, now_ns: int) -> SonarReadings:
    return SonarReadings(now_ns, np.array([first] + 7 * [math.inf], np.float32))


def heard(readings: SonarReadings, memory: EchoMemory, at: OdometryPose = HERE) -> tuple[Fans, EchoMemory]:
    checked, after = check_echoes(readings, at, memory)
    return echo_fans(checked, CHAIR_A), after


def test_an_echo_that_lidar_explains_is_its_thing_and_one_that_it_does_not_stays_an_obstacle() -> None:
    for ranges, kept in ((0.7, False), (3.0, True)):  # lidar sees a thing in the sonar's arc, or through glass
        _, memory = gathered(0, ViewMemory(), lidar=lidar_part(0, ranges))
        fans, _ = heard(sonars(0.6, TICK_NS), EchoMemory())
        view, _ = gathered(TICK_NS, memory, echoes=Reading(fans, TICK_NS))
        assert view is not None
        glass = view.metres()[np.abs(view.metres()[:, 0] - 1.35) < 0.03]
        assert bool(len(glass[np.abs(glass[:, 1] - 0.15) < 0.1])) == kept


def test_an_echo_alone_clears_no_ground_and_a_stuck_sonar_tells_nothing() -> None:
    fans, memory = heard(sonars(2.0, 0), EchoMemory())
    assert [fan.clears for fan in fans.fans] == [False] * 8
    fans, memory = heard(sonars(2.05, 1), memory)
    assert [fan.clears for fan in fans.fans] == [True] * 8
    moved = OdometryPose(0.31, 0.0, 0.0)
    fans, memory = heard(sonars(2.05, 2), memory, moved)
    assert len(fans.fans) == 7
    fans, _ = heard(SonarReadings(3, np.full(8, math.nan, np.float32)), memory, moved)
    assert fans.fans == ()
    assert len(sonar_mounts(CHAIR_A)) == 8


def test_a_map_tells_of_walls_that_no_sensor_sees_and_never_of_free_ground() -> None:
    cells = np.zeros((120, 120), np.int8)
    cells[:, :20] = 100
    part = MapPart(cells, 0.05, -3.0, -3.0, 0.0)
    assert gathered(0, ViewMemory(), surroundings=part)[0] is None
    view, _ = gathered(0, ViewMemory(), lidar=lidar_part(0), surroundings=part)
    assert view is not None
    assert not seen_free(view, -1.0, 0.0)
    behind = view.metres()[view.metres()[:, 0] < -1.5]
    assert np.unique(behind[np.abs(behind[:, 1]) < 2.0, 0]) == pytest.approx([-2.975, -2.025], abs=0.001)  # its faces


def test_a_wall_of_the_map_that_the_lidar_shows_is_where_the_lidar_shows_it() -> None:
    cells = np.zeros((120, 120), np.int8)
    cells[:, 100] = 100  # a wall 2 m ahead, on a map that is 7 cm wrong
    part = MapPart(cells, 0.05, -3.0 + 0.045, -3.0, 0.0)
    angles = scan_of(1.0).angles()
    with np.errstate(divide="ignore", invalid="ignore"):
        wall = np.where(np.abs(angles) < 1.0, (2.0 - CHAIR_A.laser_x) / np.cos(angles), 9.0)
    view, _ = gathered(0, ViewMemory(), lidar=lidar_part(0, wall), surroundings=part)
    assert view is not None
    ahead = view.metres()[np.abs(view.metres()[:, 1]) < 1.0]
    assert np.abs(ahead[:, 0] - 2.0).max() < 0.002


def test_a_fine_map_is_told_in_cells_of_the_view_and_none_off_the_map() -> None:
    fine = OccupancyGrid(np.zeros((1200, 1200), np.int8), 0.005, Pose2(-3.0, -3.0))
    fine.cells[:, 801] = 100  # a pane of 5 mm, 1.005 m ahead
    part = map_part(fine, Pose2(), Pose2(0.5, 0.0, 0.0))
    assert part is not None
    assert (part.resolution, part.cells.max()) == (pytest.approx(0.05), 100)
    rows, cols = np.nonzero(part.cells == 100)
    assert len(set(rows.tolist())) == part.cells.shape[0]
    assert part.x + (cols[0] + 0.5) * part.resolution == pytest.approx(1.5 + 0.0075, abs=0.026)
    assert map_part(fine, Pose2(9.0, 0.0, 0.0), Pose2()) is None


def test_people_are_where_they_are_now_and_leave_no_trail() -> None:
    memory = ViewMemory()
    for k, x in enumerate((1.5, 1.0)):
        person = people_fans(np.array([[x, 0.8]]))
        at_ns = k * TICK_NS
        view, memory = gathered(at_ns, memory, lidar=lidar_part(at_ns, 3.0), people=Reading(person, at_ns))
    assert view is not None
    shown = view.metres()[view.classes == Thing.PERSON]
    assert shown.mean(axis=0) == pytest.approx((1.0, 0.8), abs=0.02)
    gone = 10 * TICK_NS
    view, _ = gathered(gone, memory, lidar=lidar_part(gone, 3.0), people=Reading(people_fans(np.empty((0, 2))), gone))
    assert view is not None
    assert not (view.classes == Thing.PERSON).any()


def test_a_beam_frees_ground_only_from_where_it_meets_the_floor() -> None:
    table = Beams(np.zeros(2), points32((2.0, 0.0)), np.array([False]), 0.02, near=np.array([1.2]))
    view, _ = gathered(0, ViewMemory(), depth=Reading(Fans((table,)), 0))
    assert view is not None
    assert seen_free(view, 1.625, 0.025)
    assert not seen_free(view, 1.025, 0.025)


def test_a_measurement_lies_where_the_chair_was_when_it_was_taken() -> None:
    early = gathered(0, ViewMemory())[1]
    fans = Fans((Beams(np.zeros(2), points32((2.0, 0.0)), np.array([True]), 0.02),), at_ns=TICK_NS)
    moved = OdometryPose(0.2, 0.0, 0.0)
    view, _ = gathered(2 * TICK_NS, early, moved, depth=Reading(fans, 2 * TICK_NS))
    assert view is not None
    assert view.metres()[0] == pytest.approx((1.9, 0.0), abs=0.002)


# The network -------------------------------------------------------------------------------------------------------


class Rider:
    """The default network, ticked at 20 Hz."""

    def __init__(self) -> None:
        self.runtime, self.tick = Runtime(default_network()), 0

    def step(self, **heard: Any) -> Innervation:
        self.tick += 1
        given = {name.replace("_", " "): value for name, value in heard.items()}
        now_ns = self.tick * TICK_NS
        given |= {name: replace(given[name], stamp_ns=now_ns) for name in ("lidar", "sonars") if name in given}
        return self.runtime.innervate(now_ns, {"odometry": HERE, **given})


def command(done: Innervation) -> tuple[FreeKind, int]:
    found = done.ports["Free-space finding"].eo.command
    return found.kind, len(found.orientations)


def test_a_moving_chair_s_lidar_shows_a_wall_where_it_stands() -> None:
    speed, sweep, wall = 1.0, 0.075, 3.0
    scan = scan_of(math.inf)
    angles = scan.angle_min + scan.angle_step * np.arange(720)
    seconds = np.linspace(0.0, sweep, 720)
    ahead = np.abs(angles) < 1.0
    ranges = np.full(720, np.inf)
    ranges[ahead] = ((wall - CHAIR_A.base_from_laser.x - speed * seconds) / np.cos(angles))[ahead]
    moving = replace(scan, ranges=ranges.astype(np.float32), time_step=sweep / 719)
    fans = lidar_fans(moving, OdometryPose(0.0, 0.0, 0.0, v=speed), CHAIR_A)
    assert fans is not None
    assert fans.at_ns is not None
    (beams,) = fans.fans
    seen_at = beams.ends[beams.hits, 0] + speed * fans.at_ns * 1e-9
    assert len(seen_at) > 200
    assert np.abs(seen_at - wall).max() < 0.004


def view_of(memory: ViewMemory, at_ns: int, hits: bool, *points: tuple[float, float]) -> tuple[LocalView, ViewMemory]:
    """Return the view after a part whose beams from base end at the points."""
    beams = Beams(np.zeros(2), points32(*points), np.full(len(points), hits), math.radians(0.1))
    view, later = gathered(at_ns, memory, lidar=Reading(Fans((beams,)), at_ns))
    assert view is not None
    return view, later


def shows(view: LocalView, x: float, y: float) -> bool:
    return bool((np.hypot(*(view.metres() - (x, y)).T) < 0.003).any())


def test_a_post_narrower_than_a_cell_is_shown_with_both_edges_and_its_nearest_place() -> None:
    view, _ = view_of(ViewMemory(), TICK_NS, True, (1.33, -0.048), (1.31, -0.024), (1.33, -0.003))
    assert all(shows(view, *each) for each in ((1.33, -0.048), (1.31, -0.024), (1.33, -0.003)))


def test_a_beam_past_the_middle_of_a_cell_does_not_clear_a_hit_in_its_corner() -> None:
    _, memory = view_of(ViewMemory(), TICK_NS, True, (1.303, 0.003))
    past, memory = view_of(memory, 2 * TICK_NS, False, (2.65, 0.05))
    assert shows(past, 1.303, 0.003)
    gone, _ = view_of(memory, 3 * TICK_NS, False, (2.65, 0.05), (2.65, 0.006))
    assert not shows(gone, 1.303, 0.003)


def test_an_edge_seen_before_stays_when_a_later_part_sees_the_rest_of_its_cell_alone() -> None:
    _, memory = view_of(ViewMemory(), TICK_NS, True, (1.31, 0.003), (1.31, 0.045))
    view, _ = view_of(memory, 2 * TICK_NS, True, (1.31, 0.045))
    assert shows(view, 1.31, 0.003)


def test_noise_is_averaged_along_a_wall_and_never_across_an_edge() -> None:
    noisy = np.full(9, 2.0, np.float32) + np.float32(0.01) * np.array([1, -1, 1, -1, 1, -1, 1, -1, 1], np.float32)
    assert np.abs(smoothed(noisy)[2:-2] - 2.0).max() < 0.003
    post = np.array([3.0, 3.0, 3.0, 1.0, 1.0, 3.0, 3.0, 3.0, np.nan], np.float32)
    np.testing.assert_array_equal(smoothed(post), post)


def test_without_sensors_and_without_odometry_nothing_is_free() -> None:
    rider = Rider()
    assert command(rider.step()) == (FreeKind.NULL, 0)
    words = signal_words(rider.step().ports["encode_packet"].eo)
    assert words == "stop the chair: no sensor that looks round the chair is heard yet, so nothing is free"
    runtime = Runtime(default_network())
    assert command(runtime.innervate(TICK_NS, {"lidar": scan_of(3.0)})) == (FreeKind.NULL, 0)


def test_a_blind_lidar_frees_nothing_and_what_it_saw_counts_for_half_a_second() -> None:
    rider = Rider()
    kind, count = command(rider.step(lidar=scan_of(3.0)))
    assert kind is FreeKind.LIST
    assert count >= 1  # the ground beside the chair was not seen yet, so it cannot turn far
    for _ in range(10):
        command(rider.step(lidar=scan_of(np.nan)))
    assert command(rider.step(lidar=scan_of(np.nan)))[0] is FreeKind.NULL


@pytest.mark.parametrize("ranges", [np.nan, np.inf, -np.inf])
def test_a_scan_without_ranges_makes_nothing_free(ranges: float) -> None:
    assert lidar_fans(scan_of(ranges), None, CHAIR_B) is None


def test_a_pose_that_jumps_ends_the_memory() -> None:
    _, memory = gathered(0, ViewMemory(), lidar=lidar_part(0))
    for x, kept in ((0.9, True), (1.2, False)):  # 3 m/s for 0.3 s, and farther
        at_ns = 300_000_000
        view, _ = gathered(at_ns, memory, OdometryPose(x, 0.0, 0.0), lidar=lidar_part(at_ns))
        assert view is not None
        assert seen_free(view, -0.5, 0.5) == kept


def seen(x: float, width: float, number: int = 0, clear: float | None = None, is_open: bool = True) -> DoorSeen:
    door = DoorwayJambs(x, width / 2, x, -width / 2)
    return DoorSeen(number, door, width - 0.02 if clear is None else clear, is_open)


def test_a_doorway_that_was_seen_leads_the_rider_to_its_pivotal_zone() -> None:
    rider = Rider()
    done = rider.step(lidar=scan_of(6.0), doorways=DoorsSeen((seen(3.0, 0.9),)), door_wanted=True)
    assert done.ports["Door validation"].eo.valid
    assert signal_words(done.ports["encode_packet"].eo) == "go forward"


@pytest.mark.parametrize(
    ("door", "verdict"),
    [
        (seen(3.0, 0.63), "refuted"),  # the chair's 0.60 m and 4 cm
        (seen(3.0, 0.9, is_open=False), "refuted"),
        (seen(3.0, 0.9, clear=0.55), "refuted"),  # a leaf stands in it
        (seen(3.0, 0.9, clear=0.0), "looking"),  # nothing near saw it yet
    ],
)
def test_a_doorway_that_is_not_surely_wide_enough_is_not_offered(door: DoorSeen, verdict: str) -> None:
    done = Rider().step(lidar=scan_of(6.0), doorways=DoorsSeen((door,)), door_wanted=True)
    assert done.ports["Door validation"].eo.state.value == verdict
    assert done.ports["Path planner"].eo is None


def test_one_doorway_is_kept_until_it_is_passed_and_then_the_next_one_is_chosen() -> None:
    rider, chosen = Rider(), []
    for k in range(40):
        near, far = 2.0 - 0.1 * k, 4.5 - 0.1 * k
        doors = DoorsSeen((seen(near, 0.9, number=7), seen(far, 0.9, number=8)))
        at = OdometryPose(0.1 * k, 0.0, 0.0)
        done = rider.step(lidar=scan_of(6.0), doorways=doors, door_wanted=True, odometry=at)
        chosen.append(done.ports["Doorway detection"].eo.number)
    passed = chosen.index(8)
    assert chosen == [7] * passed + [8] * (40 - passed)
    assert 2.0 - 0.1 * passed == pytest.approx(-CHAIR_A.rear - 0.3, abs=0.11)


def test_a_doorway_is_held_in_place_while_the_chair_drives_and_forgotten_after_three_refutations() -> None:
    rider = Rider()
    rider.step(lidar=scan_of(6.0), doorways=DoorsSeen((seen(3.0, 0.9),)), door_wanted=True)
    for k in range(1, 11):  # nothing is told of doorways meanwhile
        done = rider.step(lidar=scan_of(6.0), odometry=OdometryPose(0.1 * k, 0.0, 0.0))
    assert done.ports["Object tracker"].eo.door.middle == pytest.approx((2.0, 0.0))
    for _ in range(3):
        shut = DoorsSeen((seen(2.0, 0.9, is_open=False),))
        done = rider.step(lidar=scan_of(6.0), doorways=shut, odometry=OdometryPose(1.0, 0.0, 0.0))
    assert done.ports["Object tracker"].eo is None
