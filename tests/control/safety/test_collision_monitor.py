"""The collision monitor: contact on an arc as in small steps, zones that scale the speed, and a lidar that is not
trusted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, CHAIR_A_MID, CHAIR_B, ChairBody
from waychair.calibration.fits.self_mask import SelfMask
from waychair.calibration.fits.stopping import StopTable
from waychair.control.safety.arc_clearance import (
    SLOWING,
    SLOWING_ALPHA,
    MonitorSettings,
    contact_times,
    margins,
    slow_share,
    stop_seconds,
)
from waychair.control.safety.collision_monitor import (
    MAPPED_MS,
    Monitor,
    MonitorVerdict,
    is_silent,
    permitted_share,
    points_now,
    slim_beams,
    stale_stop,
    valid_beams,
)
from waychair.control.safety.stops import STOPS
from waychair.errors import ConfigError
from waychair.geometry import arc, transform_points
from waychair.planning.body.clearance import (
    CRAWL_SPEED,
    MONITORED_AHEAD_AT_CRAWL,
    MONITORED_AHEAD_AT_FULL_SPEED,
    MONITORED_AT_CRAWL,
    MONITORED_AT_FULL_SPEED,
)
from waychair.planning.body.personal_space import GIVE_WAY_S
from waychair.types import FloatArray, Scan, Twist

MS = 1_000_000
S = MonitorSettings()
LEGS = S.legs
BEAMS = 721
VIEW = math.radians(270.0)


def scan_of(points: FloatArray, body: ChairBody = CHAIR_A, stamp_ns: int = 0, seed: int = 0) -> Scan:
    """A scan of discs of 5 cm at points (N, 2) in base, within walls 8 m round the laser; a millimetre of noise."""
    angles = np.linspace(-VIEW / 2, VIEW / 2, BEAMS)
    ranges = np.full(BEAMS, 8.0)
    for x, y in transform_points(body.base_from_laser.inverse(), points.reshape(-1, 2)).tolist():
        away, off = math.hypot(x, y), np.abs(np.angle(np.exp(1j * (angles - math.atan2(y, x)))))
        hit = off < math.asin(min(1.0, 0.05 / away))
        ranges[hit] = np.minimum(
            ranges[hit], away * np.cos(off[hit]) - np.sqrt(0.05**2 - (away * np.sin(off[hit])) ** 2)
        )
    ranges += np.random.default_rng(seed).normal(0.0, 0.001, BEAMS)
    return Scan(stamp_ns, ranges.astype(np.float32), -VIEW / 2, VIEW / (BEAMS - 1), 0.0, 0.05, 25.0)


def judged(points: FloatArray, command: Twist, body: ChairBody = CHAIR_A) -> MonitorVerdict:
    """Return the verdict on a command at rest in a scene."""
    monitor = Monitor(body)
    monitor.see(scan_of(points, body))
    return monitor.judge(command, Twist(), 50 * MS)


def contacts(points: FloatArray, command: Twist, body: ChairBody) -> FloatArray:
    """Return contact times of points of which none are legs."""
    return contact_times(points, np.zeros(len(points), np.bool_), command, body, LEGS)


def driven(points: FloatArray, command: Twist, body: ChairBody, horizon: float) -> FloatArray:
    """Return the time at which each point is inside the zone, by driving the arc in steps of 2 ms."""
    beside, ahead = margins(command, body)
    front = body.front + beside + (ahead if command.v > 0 else 0.0)
    rear = body.rear + beside + (ahead if command.v < 0 else 0.0)
    times = np.full(len(points), np.inf)
    for t in np.arange(0.0, horizon, 0.002):
        x, y = transform_points(arc(command.v * t, command.omega * t).inverse(), points).T
        inside = (x <= front) & (x >= -rear) & (np.abs(y) <= body.width / 2 + beside)
        times = np.where(inside & np.isinf(times), t, times)
    return times


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B, CHAIR_A_MID], ids=lambda body: body.chair_id)
def test_contact_times_agree_with_driving_the_arc_in_small_steps(body: ChairBody) -> None:
    rng = np.random.default_rng(7)
    for command in (
        Twist(0.8, 0.0),
        Twist(-0.2, 0.0),
        Twist(0.4, 0.5),
        Twist(0.3, -0.8),
        Twist(-0.2, 0.3),
        Twist(0, 0.6),
    ):
        points = rng.uniform(-2.5, 2.5, (300, 2))
        outside = np.max(np.abs(points - ((body.front - body.rear) / 2, 0)) - (body.length / 2, body.width / 2), axis=1)
        points = points[outside > MONITORED_AHEAD_AT_FULL_SPEED + MONITORED_AT_FULL_SPEED + 0.011]
        exact = contacts(points, command, body)
        stepped = driven(points, command, body, 3.0)
        reached = exact < 2.99
        assert (reached == np.isfinite(stepped))[np.abs(exact - 2.995) > 0.01].all()
        both = reached & np.isfinite(stepped)
        assert np.abs(exact[both] - stepped[both]).max(initial=0.0) <= 0.0021


@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(0.1, 1.0))
def test_at_a_lower_speed_the_same_arc_touches_the_same_points_later(v: float, omega: float, share: float) -> None:
    points = np.random.default_rng(3).uniform(-2.0, 2.0, (60, 2))
    none = np.zeros(len(points), np.bool_)
    full = contact_times(points, none, Twist(v, omega), CHAIR_A, LEGS, pace=share)
    slow = contact_times(points, none, Twist(share * v, share * omega), CHAIR_A, LEGS)
    known = np.isfinite(full) & (full < 20.0) & (full > 0.0) & (slow > 0.0)
    if abs(v) > 0.01 and abs(omega) > 0.01:
        assert slow[known] * share == pytest.approx(full[known], rel=1e-6, abs=1e-6)


def test_a_chair_may_drive_through_a_doorway_with_five_centimetres_on_each_side() -> None:
    jambs = np.array([[x, side * 0.35] for x in np.linspace(0.2, 1.2, 60) for side in (-1.0, 1.0)])
    assert not np.isfinite(contacts(jambs, Twist(0.3, 0.0), CHAIR_A)).any()
    assert np.isfinite(contacts(jambs, Twist(0.3, 0.3), CHAIR_A)).any()


def test_a_point_within_the_zone_counts_only_when_it_comes_nearer() -> None:
    beside = np.array([[0.3, CHAIR_A.width / 2 + 0.01]] * 3)
    assert not np.isfinite(contacts(beside, Twist(0.4, 0.0), CHAIR_A)).any()
    assert np.isfinite(contacts(beside, Twist(0.4, 0.3), CHAIR_A)).all()
    before = np.array([[CHAIR_A.front + 0.04, 0.0]] * 3)
    assert not np.isfinite(contacts(before, Twist(-0.8, 0.0), CHAIR_A)).any()
    assert contacts(before, Twist(0.8, 0.0), CHAIR_A).tolist() == [0.0] * 3


def test_margins_grow_with_the_speed_of_the_fastest_part_of_the_chair() -> None:
    assert margins(Twist(0.3, 0.0), CHAIR_A) == (MONITORED_AT_CRAWL, MONITORED_AHEAD_AT_CRAWL)
    assert margins(Twist(-0.8, 0.0), CHAIR_A) == pytest.approx((MONITORED_AT_FULL_SPEED, MONITORED_AHEAD_AT_FULL_SPEED))
    assert margins(Twist(2.0, 0.0), CHAIR_A) == (MONITORED_AT_FULL_SPEED, MONITORED_AHEAD_AT_FULL_SPEED)
    speeds = [margins(Twist(v, 0.0), CHAIR_A) for v in np.linspace(0.0, 1.0, 21)]
    assert speeds == sorted(speeds)
    turning = Twist(0.0, 0.55 / CHAIR_A.circumscribed_radius)
    assert margins(turning, CHAIR_A) == pytest.approx(margins(Twist(0.55, 0.0), CHAIR_A))
    assert margins(Twist(0.8, 0.0), CHAIR_A, pace=0.25) == (MONITORED_AT_CRAWL, MONITORED_AHEAD_AT_CRAWL)


@pytest.mark.parametrize("beside", [0.005, 0.02, 0.035])
def test_a_point_within_the_margin_of_a_fast_drive_slows_it_until_the_margin_is_free(beside: float) -> None:
    wall = np.linspace(0.8, 1.6, 33)  # of discs of 5 cm, too long for a leg
    jambs = np.array([[x, side * (CHAIR_A.width / 2 + 0.05 + beside)] for x in wall for side in (-1.0, 1.0)])
    asked = Twist(0.8, 0.0)
    verdict = judged(jambs, asked)
    assert verdict.stop == ""
    assert 0.0 < verdict.share < 1.0
    slower = Twist(verdict.share * asked.v, 0.0)
    assert margins(slower, CHAIR_A)[0] <= beside + 0.002
    assert judged(jambs, slower).share == 1.0


def test_the_chair_keeps_more_distance_from_people_than_from_walls_and_does_not_creep_up_to_them() -> None:
    for distance in (0.10, 0.30):
        before = np.array([[CHAIR_A.front + distance, 0.0]])
        legs = np.ones(1, np.bool_)
        assert contact_times(before, legs, Twist(0.02, 0.0), CHAIR_A, LEGS).tolist() == [0.0]
        assert contact_times(before, ~legs, Twist(0.02, 0.0), CHAIR_A, LEGS).item() > 1.0
        assert contact_times(before, legs, Twist(-0.2, 0.0), CHAIR_A, LEGS).item() == math.inf
    passing = np.array([[CHAIR_A.front + 0.6, 0.45], [0.3, 0.45]])  # ahead and to the side; beside the chair
    legs = np.ones(2, np.bool_)
    assert np.isfinite(contact_times(passing, legs, Twist(0.5, 0.0), CHAIR_A, LEGS)).tolist() == [True, False]


def test_the_chair_gives_way_to_a_person_beside_its_way_and_crawls_past_one_who_stays() -> None:
    monitor, command = Monitor(CHAIR_A), Twist(0.6, 0.0)
    beside_the_way = np.array([[CHAIR_A.front + 0.7, CHAIR_A.width / 2 + 0.30]])

    def shares(begin_s: float, end_s: float, points: FloatArray, measured: Twist) -> list[float]:
        """Of every tick."""
        found = []
        for k in range(round(begin_s * 20), round(end_s * 20)):
            monitor.see(scan_of(points, stamp_ns=k * 50 * MS, seed=k))
            verdict = monitor.judge(command, measured, k * 50 * MS)
            assert (verdict.stop == "obstacle") == (verdict.share == 0.0)
            found.append(verdict.share)
        return found

    assert set(shares(0.0, 2.0, beside_the_way, Twist(0.05, 0.0))) == {0.0}  # it has not come to rest yet
    assert set(shares(2.0, 3.5, beside_the_way, Twist())) == {0.0}
    passing = shares(3.5, 5.0, beside_the_way, Twist(0.1, 0.0))
    assert 0.0 < min(passing) <= max(passing) <= CRAWL_SPEED / command.v + 1e-9
    assert set(shares(5.0, 6.5, np.empty((0, 2)), Twist(0.1, 0.0))) == {1.0}
    assert set(shares(6.5, 7.0, beside_the_way, Twist())) == {0.0}  # the chair gives way to the next one too


def test_the_chair_never_drives_into_a_person_who_stands_in_the_way_however_long_it_waits() -> None:
    monitor, ahead = Monitor(CHAIR_A), np.array([[CHAIR_A.front + 0.25, 0.1]])
    for k in range(200):
        monitor.see(scan_of(ahead, stamp_ns=k * 50 * MS, seed=k))
        assert monitor.judge(Twist(0.2, 0.0), Twist(), k * 50 * MS).stop == "obstacle"


def test_a_later_person_is_given_way_for_as_long_as_the_first_one() -> None:
    legs, crawl = np.array([[CHAIR_A.front + 0.45, 0.0]]), Twist(0.1, 0.0)
    monitor = Monitor(CHAIR_A)

    def permitted(points: FloatArray, begun: float, lasting: float) -> list[bool]:
        found = []
        for k in range(round(20 * begun), round(20 * (begun + lasting))):
            monitor.see(scan_of(points, stamp_ns=50 * k * MS, seed=k))
            found.append(monitor.judge(crawl, Twist(), 50 * k * MS).share > 0.0)
        return found

    assert not any(permitted(legs, 1.0, 0.2))
    assert all(permitted(np.empty((0, 2)), 1.2, 10.0))
    passes = permitted(legs, 11.2, 3.0)
    assert passes.index(True) == pytest.approx(20 * GIVE_WAY_S, abs=1)
    assert all(passes[passes.index(True) :])


@pytest.mark.parametrize("nearer", [{"beside_after": 0.5}, {"ahead_after": 0.6}])
def test_a_larger_distance_after_giving_way_is_refused(nearer: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="_after"):
        replace(LEGS, **nearer)


def test_a_point_well_within_the_outline_counts_as_touched_unless_the_chair_stands() -> None:
    inside = np.array([[0.3, 0.0]])
    for command in (Twist(0.1, 0.0), Twist(-0.1, 0.0), Twist(0.0, 0.1)):
        assert contacts(inside, command, CHAIR_A).tolist() == [0.0]
    assert contacts(inside, Twist(), CHAIR_A).tolist() == [math.inf]


def test_the_zones_grow_with_the_speed() -> None:
    stops, slows = [], []
    for v in (0.2, 0.4, 0.8):
        distances = np.arange(0.3, 3.0, 0.02)
        verdicts = [judged(np.array([[CHAIR_A.front + d, 0.0]]), Twist(v, 0.0)) for d in distances]
        stops.append(max((d for d, found in zip(distances, verdicts, strict=True) if found.stop), default=0.0))
        slows.append(max((d for d, found in zip(distances, verdicts, strict=True) if found.share < 1.0), default=0.0))
    assert stops == sorted(stops)
    assert slows == sorted(slows)
    assert all(stop < slow for stop, slow in zip(stops, slows, strict=True))
    assert stops[-1] >= LEGS.ahead + 0.8 * S.reaction_s + 0.8**2 / (2 * S.emergency)


@given(st.floats(0.05, 0.8), st.floats(-0.8, 0.8), st.floats(0.0, 10.0))
def test_at_the_permitted_share_of_speed_a_comfortable_stop_ends_before_the_contact(
    v: float, omega: float, contact: float
) -> None:
    k = slow_share(contact, Twist(v, omega), S)
    half = 0.5 * max(v / SLOWING, abs(omega) / SLOWING_ALPHA)
    assert 0.0 <= k <= 1.0
    assert k * S.reaction_s + k * k * half <= contact + 1e-9
    if k < 1.0:
        assert k * S.reaction_s + k * k * half == pytest.approx(contact, abs=1e-9)


def test_a_thing_beside_a_straight_arc_is_in_the_way_of_a_turn() -> None:
    beside = np.array([[1.3, 0.9]])
    assert judged(beside, Twist(0.5, 0.0)).contact_s > 10.0  # the wall behind it
    assert judged(beside, Twist(0.5, 0.5)).contact_s < 2.0


BESIDE_CORNER = np.array([[0.55, CHAIR_A.width / 2 + 0.15], [0.65, CHAIR_A.width / 2 + 0.15]])
"""Return legs of a person beside the front corner; shoulders reach 0.2 m beyond."""


@pytest.mark.parametrize("omega", [0.5, 0.1])
def test_a_corner_does_not_swing_under_the_shoulders_of_a_person_beside_the_chair(omega: float) -> None:
    assert judged(BESIDE_CORNER, Twist(0.0, omega)).stop == "obstacle"
    assert judged(BESIDE_CORNER, Twist(0.3, 0.0)).share == 1.0
    assert judged(BESIDE_CORNER, Twist(0.0, -omega)).share == 1.0
    assert judged(BESIDE_CORNER + np.array([0.0, 0.35]), Twist(0.0, omega)).share == 1.0


def test_a_chair_turns_beside_furniture_as_beside_a_wall() -> None:
    monitor = Monitor(CHAIR_A)
    monitor.see(scan_of(BESIDE_CORNER))
    near = Twist(0.0, 0.1)
    assert monitor.judge(near, Twist(), 50 * MS).stop == "obstacle"
    monitor.note_mapped_legs(BESIDE_CORNER, 0)
    assert monitor.judge(near, Twist(), 50 * MS).share == 1.0


def test_a_few_points_are_noise_and_not_a_thing() -> None:
    monitor = Monitor(CHAIR_A)
    scan = scan_of(np.empty((0, 2)))
    ranges = scan.ranges.copy()
    ranges[359:361] = 0.35
    monitor.see(replace(scan, ranges=ranges))
    assert monitor.judge(Twist(0.5, 0.0), Twist(), 0).stop == ""
    ranges[359:362] = 0.35
    monitor.see(replace(scan, ranges=ranges.copy()))
    assert monitor.judge(Twist(0.5, 0.0), Twist(), 0).stop == "obstacle"


def test_free_standing_legs_are_distinguished_from_a_wall_and_from_its_edge() -> None:
    scan = scan_of(np.array([[2.0, 0.1], [2.0, -0.1]]))
    slim = slim_beams(scan, np.zeros(BEAMS, np.bool_))
    assert 8 <= slim.sum() < 60
    assert (scan.ranges[slim] < 2.0).all()
    assert not slim_beams(scan_of(np.empty((0, 2))), np.zeros(BEAMS, np.bool_)).any()
    ranges = np.full(BEAMS, 3.0, np.float32)
    ranges[:355], ranges[366:] = 1.0, 1.2  # a strip of wall seen through a gap
    assert not slim_beams(replace(scan, ranges=ranges), np.zeros(BEAMS, np.bool_)).any()


def test_legs_before_open_space_are_distinguished_from_a_wall() -> None:
    scan = scan_of(np.array([[2.0, 0.1], [2.0, -0.1]]))
    slim = slim_beams(scan, np.zeros(BEAMS, np.bool_))
    beyond = scan.ranges > 7.0
    for where in (beyond, beyond & (np.arange(BEAMS) > BEAMS // 2)):
        ranges = np.where(where, np.float32(math.inf), scan.ranges)
        ranges[:40] = 0.6  # a wall nearer than the legs, far aside
        open_hall = slim_beams(replace(scan, ranges=ranges), np.zeros(BEAMS, np.bool_))
        np.testing.assert_array_equal(open_hall[40:], slim[40:])


def furnished(slim: FloatArray) -> MonitorVerdict:
    """Return the verdict on a crawl towards legs 0.25 m ahead and a little aside; slim furniture is given at time 0."""
    monitor = Monitor(CHAIR_A)
    monitor.see(scan_of(np.array([LEG])))
    monitor.note_mapped_legs(slim, 0)
    return monitor.judge(Twist(0.1, 0.0), Twist(), 50 * MS)


LEG = (CHAIR_A.front + 0.25, CHAIR_A.width / 2 + 0.10)
NOTHING = np.empty((0, 2))


def test_known_slim_furniture_gets_no_personal_space() -> None:
    assert furnished(NOTHING).stop == "obstacle"
    assert furnished(np.array([LEG])).share == 1.0


@pytest.mark.parametrize(("off", "is_furniture"), [(0.04, True), (0.16, False)])
def test_legs_beside_the_place_of_furniture_are_those_of_a_person(off: float, is_furniture: bool) -> None:
    slim = np.array([[LEG[0], LEG[1] + off]])
    assert (furnished(slim).stop == "") == is_furniture


@pytest.mark.parametrize(("age_ms", "is_furniture"), [(MAPPED_MS, True), (MAPPED_MS + 1, False)])
def test_old_furniture_is_forgotten(age_ms: int, is_furniture: bool) -> None:
    monitor = Monitor(CHAIR_A)
    monitor.see(scan_of(np.array([LEG]), stamp_ns=age_ms * MS))
    monitor.note_mapped_legs(np.array([LEG]), 0)
    assert (monitor.judge(Twist(0.1, 0.0), Twist(), age_ms * MS).stop == "") == is_furniture


def test_known_furniture_is_moved_with_the_odometry() -> None:
    monitor, turning = Monitor(CHAIR_A), Twist(0.0, 1.0)
    there = transform_points(arc(0.0, 0.25).inverse(), np.array([LEG]))
    monitor.see(scan_of(there, stamp_ns=250 * MS))
    monitor.note_mapped_legs(np.array([LEG]), 0)
    seen_turned = monitor.judge(Twist(0.1, 0.0), turning, 250 * MS)
    monitor.note_mapped_legs(NOTHING, 0)
    assert seen_turned.share > monitor.judge(Twist(0.1, 0.0), turning, 250 * MS).share


def test_the_chair_stops_before_furniture_too() -> None:
    ahead = np.array([[CHAIR_A.front + 0.02, 0.0]])
    monitor = Monitor(CHAIR_A)
    monitor.see(scan_of(ahead + np.array([0.05, 0.0])))  # its near side is at the given middle
    monitor.note_mapped_legs(ahead, 0)
    assert monitor.judge(Twist(0.3, 0.0), Twist(), 50 * MS).stop == "obstacle"


def test_a_scan_is_corrected_by_the_motion_since_each_of_its_beams() -> None:
    body = CHAIR_A
    still = scan_of(np.array([[2.0, 0.3]]))
    for twist in (Twist(0.8, 0.0), Twist(0.4, 0.6), Twist(0.0, -0.5)):
        for time_step in (0.0, 1e-4):
            scan = replace(still, time_step=time_step)
            told = valid_beams(scan, np.zeros(BEAMS, np.bool_))
            points = points_now(scan, told, body, twist, 200 * MS)
            at_scan = points_now(scan, told, body, Twist(), 200 * MS)
            for i in (0, 360, 720):
                since = arc(twist.v * (0.2 - i * time_step), twist.omega * (0.2 - i * time_step))
                assert points[i] == pytest.approx(transform_points(since.inverse(), at_scan[i : i + 1])[0], abs=1e-9)


def test_a_moving_chair_accounts_for_its_motion_since_the_scan() -> None:
    monitor = Monitor(CHAIR_A)
    monitor.see(scan_of(np.array([[CHAIR_A.front + LEGS.ahead + 0.62, 0.0]])))
    assert monitor.judge(Twist(0.8, 0.0), Twist(0.8, 0.0), 0).stop == ""
    assert monitor.judge(Twist(0.8, 0.0), Twist(0.8, 0.0), 250 * MS).stop == "obstacle"


def test_masked_parts_of_the_chair_are_no_obstacle() -> None:
    legs = np.array([[0.68, 0.1], [0.68, -0.1]])
    seen = Monitor(CHAIR_A)
    seen.see(scan_of(legs))
    assert seen.judge(Twist(0.3, 0.0), Twist(), 0).stop == "obstacle"
    mask = SelfMask((-1.4,), (1.4,), (0.2,))
    masked = Monitor(CHAIR_A, mask=mask)
    masked.see(scan_of(legs))
    assert masked.judge(Twist(0.3, 0.0), Twist(), 0).stop == ""


def test_measured_stops_that_are_longer_than_assumed_count() -> None:
    table = StopTable(speeds=(0.4, 0.8), distances=(0.5, 1.4), turn_rate=0.8, turn_angle=0.9, delay_s=0.3)
    assert stop_seconds(Twist(0.8, 0.0), S, table) == pytest.approx(1.4 / 0.8)
    assert stop_seconds(Twist(0.0, 0.8), S, table) == pytest.approx(0.9 / 0.8)
    assert stop_seconds(Twist(1.6, 0.0), S, table) == pytest.approx(2 * 1.4 / 0.8)  # beyond the measured speeds
    apart = replace(table, ways=(0.3, 0.9))
    assert stop_seconds(Twist(0.8, 0.0), S, apart) == pytest.approx(1.4 / 0.8)
    assert stop_seconds(Twist(0.8, 0.0), S, apart, apart=True) == pytest.approx(0.9 / 0.8)
    assert stop_seconds(Twist(0.1, 0.8), S, apart, apart=True) == pytest.approx(0.9 / 0.8)  # the turn's own stop
    assert stop_seconds(Twist(0.8, 0.0), S, table, apart=True) == pytest.approx(1.4 / 0.8)
    short = StopTable(speeds=(0.4, 0.8), distances=(0.01, 0.02), turn_rate=0.8, turn_angle=0.01, delay_s=0.0)
    assert stop_seconds(Twist(0.8, 0.0), S, short) == stop_seconds(Twist(0.8, 0.0), S)


@pytest.mark.parametrize(
    ("verdict_age", "scan_age", "stop_id"),
    [
        (150, 300, ""),
        (151, 300, "monitor_silent"),
        (150, 301, "lidar_late"),
        (-101, 0, "monitor_silent"),
        (0, None, "lidar_late"),
    ],
)
def test_a_speed_passes_only_with_a_fresh_verdict_on_a_fresh_scan(
    verdict_age: int, scan_age: int | None, stop_id: str
) -> None:
    now = 10**10
    verdict = MonitorVerdict(now - verdict_age * MS, None if scan_age is None else now - scan_age * MS, Twist(), 1.0)
    assert stale_stop(verdict, now) == stop_id
    assert stale_stop(None, now) == "monitor_silent"
    assert stop_id == "" or stop_id in STOPS


def test_a_monitor_is_silent_after_half_a_second_without_a_verdict() -> None:
    verdict = MonitorVerdict(0, 0, Twist(), 1.0)
    assert not is_silent(verdict, 500 * MS)
    assert is_silent(verdict, 501 * MS)
    assert is_silent(None, 0)


@pytest.mark.parametrize(
    ("command", "passes"),
    [
        (Twist(0.5, 0.2), True),
        (Twist(0.58, 0.2), True),
        (Twist(0.0, 0.0), True),
        (Twist(0.61, 0.2), False),
        (Twist(-0.11, 0.2), False),
        (Twist(0.5, 0.41), False),
        (Twist(0.5, -0.21), False),
    ],
)
def test_a_command_without_a_verdict_does_not_pass(command: Twist, passes: bool) -> None:
    verdict = MonitorVerdict(0, 0, Twist(0.5, 0.2), 0.7)
    assert permitted_share(command, verdict) == (0.7 if passes else 0.0)


def test_f11_a_scan_older_than_300_ms_gives_no_verdict() -> None:
    monitor = Monitor(CHAIR_A)
    assert monitor.judge(Twist(0.1, 0.0), Twist(), 0).stop == "lidar_late"
    monitor.see(scan_of(np.empty((0, 2))))
    assert monitor.judge(Twist(0.1, 0.0), Twist(), 300 * MS).stop == ""
    assert monitor.judge(Twist(0.1, 0.0), Twist(), 301 * MS).stop == "lidar_late"


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_f5_a_command_or_motion_that_is_not_a_number_is_refused(bad: float) -> None:
    monitor = Monitor(CHAIR_A)
    monitor.see(scan_of(np.empty((0, 2))))
    assert monitor.judge(Twist(bad, 0.0), Twist(), 0).share == 0.0
    assert monitor.judge(Twist(0.1, 0.0), Twist(0.0, bad), 0).share == 0.0
