"""A rider is led where no map leads: by what the lidar shows and how far the chair drives, and never without either."""

from __future__ import annotations

import math
from collections.abc import Iterator
from multiprocessing import get_context

import numpy as np
import pytest

from tests.loaded_kernels import loaded_kernels
from tests.runtime.haptics.guided_rider import DESK, START, TICK_MS, GuidedRider, room
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.safety.guard import Unscanned
from waychair.maps.grid.cells import cells_from_points
from waychair.planning.grid.costmap import Costmap
from waychair.planning.seen.laser_sight import LaserSight
from waychair.runtime.haptics.haptic_guide import BEGUN_ANEW, NO_ODOMETRY, NOT_SEEN
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.haptics.seen_ground import SeenGround
from waychair.runtime.senses.servo_camera_sight import ServoCameraTold
from waychair.types import PanTiltAngles, Place, Pose2, Scan, Twist

AT = Pose2(10.0, -3.0, math.pi / 2)
"""The chair in odom at the start."""

BEHIND_THE_DOOR = Place("the door ahead", AT @ Pose2(4.0, 0.0, 0.0), 0.5, 0.5)
WALL = 2.0
"""m before the lidar."""


def scan(stamp_ns: int, wall: bool = False) -> Scan:
    """A scan of a hall of 4.5 m radius, with or without a wall across the way."""
    angles = np.linspace(-2.3, 2.3, 461)
    ranges = np.full(len(angles), 4.5)
    ahead = np.abs(angles) < 0.5
    ranges[ahead] = np.minimum(ranges[ahead], WALL / np.cos(angles[ahead])) if wall else ranges[ahead]
    return Scan(stamp_ns, ranges.astype(np.float32), float(angles[0]), float(angles[1] - angles[0]), range_max=10.0)


@pytest.fixture
def rider() -> Iterator[GuidedRider]:
    """A rider whose chair has no pose on its map."""
    with GuidedRider() as led:
        led.pose, led.odom_from_base = None, AT
        yield led


def run(rider: GuidedRider, ms: int) -> HapticState:
    """Let time pass with a scan in each tick."""
    for _ in range(ms // TICK_MS):
        assert rider.odom_from_base is not None
        rider.guide.see(scan(rider.now_ms * 1_000_000), None, rider.odom_from_base, rider.twist)
        rider.run(TICK_MS)
    return rider.states[-1]


def test_a_chair_that_is_lost_leads_to_a_place_in_odom(rider: GuidedRider) -> None:
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    state = run(rider, 1000)
    assert (state.goal, state.symbol, state.withheld) == ("the door ahead", "forward", "")
    assert state.step == "straight 4.0 m"
    rider.twist = Twist(0.5, 0.0)
    run(rider, 7700)
    rider.twist = Twist()
    state = run(rider, 1500)
    assert (state.arrived, state.goal) == (True, "")


def test_nobody_is_led_before_the_first_scan_nor_after_the_last(rider: GuidedRider) -> None:
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    state = rider.run(1000)
    assert (state.withheld, state.count) == (NOT_SEEN, 0)
    assert run(rider, 1000).symbol == "forward"
    rider.twist = Twist(0.3, 0.0)
    state = rider.run(1500)
    assert (state.withheld, state.symbol) == (NOT_SEEN, "warning")
    assert state.goal == "the door ahead"  # it goes on with the lidar


def look(stamp_ns: int) -> ServoCameraTold:
    """A look straight ahead by the laser's line, at a wall across the way."""
    aside = np.linspace(-0.8, 0.8, 161)
    camera, points = Pose2(0.4), np.column_stack([np.full(161, 0.4 + WALL), aside, np.full(161, 0.65)])
    angles, columns = PanTiltAngles(stamp_ns, 0.0, 0.0, settled=True), 320.0 - 600.0 * aside / WALL
    sight = LaserSight(angles, camera, points, np.full(161, 0.01), columns, np.full(161, 270.0))
    return ServoCameraTold(None, "", sight, stamp_ns, AT)


def test_a_chair_without_a_lidar_is_led_by_the_lasers_line_round_what_it_shows(rider: GuidedRider) -> None:
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    rider.run(TICK_MS, look(0))
    state = rider.run(1500)  # the servos turn for a while
    assert state.withheld == ""
    assert rider.guide.leader.plan is not None
    assert len(rider.guide.leader.plan.steps) > 2  # round the wall
    rider.twist = Twist(0.3, 0.0)
    state = rider.run(1500)
    assert (state.withheld, state.symbol) == (NOT_SEEN, "warning")


def test_the_line_adds_nothing_to_what_a_lidar_shows(rider: GuidedRider) -> None:
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    for _ in range(20):
        rider.guide.see(scan(rider.now_ms * 1_000_000), None, AT, rider.twist)
        state = rider.run(TICK_MS, look(rider.now_ms * 1_000_000))
    assert (state.step, state.withheld) == ("straight 4.0 m", "")


def test_a_chair_without_odometry_warns_a_rider_who_drives_on(rider: GuidedRider) -> None:
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    run(rider, 1000)
    rider.odom_from_base, rider.twist = None, Twist(0.3, 0.0)
    state = rider.run(1000)
    assert (state.withheld, state.symbol) == (NO_ODOMETRY, "warning")


def test_odometry_that_begins_anew_ends_it(rider: GuidedRider) -> None:
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    run(rider, 1000)
    rider.odom_from_base = Pose2()
    state = run(rider, 100)
    assert (state.goal, state.reason, state.text) == ("", BEGUN_ANEW, f"You are no longer led: {BEGUN_ANEW}.")


def test_another_map_does_not_touch_a_way_by_odometry(rider: GuidedRider) -> None:
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    run(rider, 1000)
    before = rider.guide.leader.plan
    rider.guide.redraw(room(), ())
    assert rider.guide.leader.plan is before


def test_walls_that_were_seen_hold_the_stick_where_no_sensor_looks_any_more(rider: GuidedRider) -> None:
    known = Unscanned()
    assert rider.guide.with_seen(known, AT) is known
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    for k in range(3):
        rider.guide.see(scan(k * 100_000_000, wall=True), None, AT, Twist())
    turned = AT @ Pose2(CHAIR_A.base_from_laser.x + WALL - 1.0, 0.0, math.pi)  # the wall is a metre behind
    behind = rider.guide.with_seen(known, turned).mapped
    assert len(behind) > 20
    assert behind[:, 0] == pytest.approx(-1.0, abs=0.05)


def test_steps_whose_way_turns_out_to_be_shut_are_made_anew(rider: GuidedRider) -> None:
    rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
    run(rider, 1000)
    before = rider.guide.leader.plan
    run(rider, 2000)
    assert rider.guide.leader.plan is before  # it was looked at, and is good still
    for _ in range(40):
        rider.guide.see(scan(rider.now_ms * 1_000_000, wall=True), None, AT, Twist())
        rider.run(TICK_MS)
    after = rider.guide.leader.plan
    assert after is not None
    assert after is not before
    assert len(after.steps) > 2  # round the wall


def solid(costmap: Costmap, x: float, y: float) -> bool:
    """Whether a point [m] in the chair's frame at the start is occupied."""
    ((row, col),) = cells_from_points(costmap.grid, np.array([[(AT @ Pose2(x, y)).x, (AT @ Pose2(x, y)).y]]))
    return bool(costmap.grid.cells[row, col] > 50)


def test_what_was_seen_is_kept_and_what_was_not_is_free() -> None:
    ground = SeenGround(CHAIR_A)
    assert not ground.is_seen
    with pytest.raises(RuntimeError, match="no scan has come yet"):
        ground.ask(BEHIND_THE_DOOR.pose)
    for k in range(3):
        ground.see(scan(k * 100_000_000, wall=True), AT, Twist())
    laser = CHAIR_A.base_from_laser.x
    costmap = ground.ask(AT @ Pose2(12.0, 0.0, 0.0))()
    assert solid(costmap, laser + WALL, 0.0)
    assert not solid(costmap, laser + 1.0, 0.0)
    assert not solid(costmap, laser + WALL + 1.0, 0.0)  # behind the wall
    assert not solid(costmap, 12.0, 0.0)  # the goal lies within the grid


def loaded_while_led() -> set[tuple[str, str, int]]:
    """Return the kernels first loaded while a rider is led by odometry, past a wall that turns up, and then on the map."""
    with GuidedRider() as rider:
        before = loaded_kernels()
        rider.pose, rider.odom_from_base = None, AT
        rider.guide.lead_by_odometry(BEHIND_THE_DOOR)
        run(rider, 1000)
        for _ in range(40):
            rider.guide.see(scan(rider.now_ms * 1_000_000, wall=True), None, AT, Twist())
            rider.run(TICK_MS)
        rider.guide.with_seen(Unscanned(), AT)
        rider.pose = START
        rider.guide.lead(DESK)
        rider.guide.see(scan(rider.now_ms * 1_000_000), START, AT, Twist())
        state = rider.run(1000)
        assert state.step, state
        return loaded_kernels() - before


def test_no_kernel_is_first_loaded_while_a_rider_is_led() -> None:
    with get_context("spawn").Pool(1) as own_process:
        assert own_process.apply(loaded_while_led) == set()
