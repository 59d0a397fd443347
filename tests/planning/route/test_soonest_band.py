"""Bands that begin the turn at their goal, and ways that turn on the spot beside their start or goal."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import wrap_angle
from waychair.maps.drawn.zones import Rule, Zone
from waychair.planning.body.clearance import PLANNED, PLANNED_TURN
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.flowing_line import NO_ZONES
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.legs import PathLeg
from waychair.planning.route.rooms import can_turn
from waychair.planning.route.soonest_band import soonest_band
from waychair.planning.route.speed_profile import turn_time
from waychair.planning.route.turns_beside import steps_aside
from waychair.planning.route.way_pieces import Ground, Piece
from waychair.planning.window.motion_limits import DwaSettings
from waychair.resumable import finished
from waychair.types import OccupancyGrid, Pose2

LIMITS = DwaSettings()


def hall(*boxes: tuple[float, float, float, float], size: float = 9.0) -> OccupancyGrid:
    """A room with walls round it and boxes (x0, y0, x1, y1) [m] in it."""
    cells = np.zeros((round(size / 0.05),) * 2, np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    for box in boxes:
        x0, y0, x1, y1 = (round(edge / 0.05) for edge in box)
        cells[y0:y1, x0:x1] = 100
    return OccupancyGrid(cells, 0.05)


def ground_on(costmap: Costmap, limits: DwaSettings = LIMITS) -> Ground:
    return Ground(costmap, limits, NO_ZONES, lambda: None)


HALL = costmap_from_grid(hall(), CHAIR_A)
OPEN = ground_on(HALL)
CORRIDOR = ground_on(costmap_from_grid(hall((0.0, 0.0, 9.0, 3.4), (0.0, 5.6, 9.0, 9.0)), CHAIR_A))
"""A dead end, 2.2 m wide: the chair can turn on the spot, and not right round in a bend."""


def band(start: Pose2, goal: Pose2, stands: bool = True) -> Piece:
    line = np.linspace((start.x, start.y), (goal.x, goal.y), 40)
    found = finished(soonest_band(CORRIDOR, line, start, goal, (stands, stands)))
    assert found is not None
    return found


@pytest.mark.parametrize("away", [3.1, -3.1])
def test_a_turn_at_the_goal_is_begun_in_a_bend_where_that_is_sooner(away: float) -> None:
    piece = band(Pose2(2.0, 4.5), Pose2(8.0, 4.5, away))
    begun = math.copysign(1.0, away) * float(piece.poses[-1, 2])
    assert 0.3 < begun < 2.0, "the chair arrives in the middle of the turn, and goes on turning on the spot"
    whole = band(Pose2(2.0, 4.5), Pose2(8.0, 4.5)).seconds + turn_time(away, CHAIR_A, LIMITS)
    assert piece.seconds < whole - 0.5


def test_a_chair_on_the_move_loses_a_stop_by_turning_on_the_spot() -> None:
    start, goal = Pose2(2.0, 4.5, 2.8), Pose2(7.0, 4.5)
    standing, on_the_move = band(start, goal), band(start, goal, stands=False)
    assert standing.turning == pytest.approx(turn_time(2.8, CHAIR_A, LIMITS))
    assert on_the_move.seconds > standing.seconds + 1.0


NOSE = Pose2(8.15, 4.5, 0.0)
"""The chair's front is 5 cm before the wall: its front corners would swing into it."""


def test_a_chair_before_a_wall_steps_back_to_turn() -> None:
    assert not can_turn(HALL, NOSE, math.pi, PLANNED_TURN)
    (step,) = finished(steps_aside(OPEN, NOSE, math.pi))
    assert step.backwards
    assert step.rooms.min() >= PLANNED
    place = Pose2(*step.poses[-1])
    assert can_turn(HALL, place, math.pi, PLANNED_TURN)
    assert math.dist((place.x, place.y), (NOSE.x, NOSE.y)) <= 0.4, "no farther than needed"


def test_a_step_to_the_goal_begins_where_the_chair_can_turn_in_the_heading_it_comes_in() -> None:
    (step,) = finished(steps_aside(OPEN, NOSE, math.pi, arrives=True))
    assert not step.backwards
    assert step.poses[-1].tolist() == pytest.approx(NOSE.array().tolist())
    assert can_turn(HALL, Pose2(*step.poses[0]), math.pi, PLANNED_TURN)


@pytest.mark.parametrize("place", [Pose2(4.5, 4.5), NOSE])
def test_no_step_aside_is_needed_where_the_chair_can_turn_or_need_not(place: Pose2) -> None:
    assert finished(steps_aside(OPEN, place, 0.5)) == []


def test_no_step_leads_backwards_if_the_chair_may_not_or_against_a_one_way_zone() -> None:
    assert finished(steps_aside(ground_on(HALL, DwaSettings(max_reverse=0.0)), NOSE, math.pi)) == []
    zone = Zone("ramp", Rule.ONE_WAY, np.array([[6.0, 3.0], [8.5, 3.0], [8.5, 6.0], [6.0, 6.0]]), 0.0)
    barred = ground_on(costmap_from_grid(hall(), CHAIR_A, zones=(zone,)))
    assert finished(steps_aside(barred, NOSE, math.pi)) == []


def legs_of(costmap: Costmap, start: Pose2, goal: Pose2) -> tuple[PathLeg, ...]:
    planner = GlobalPlanner(goal)
    planner.replan(costmap, start)
    return planner.legs


def test_a_way_from_before_a_wall_backs_turns_and_drives_on() -> None:
    """A bend to the place behind the chair would be a loop of several metres."""
    first, second = legs_of(HALL, NOSE, Pose2(3.0, 4.5, math.pi))
    assert first.backwards
    assert not second.backwards
    assert abs(wrap_angle(float(first.path.poses[-1, 2]) - float(second.path.poses[0, 2]))) < 1e-6
    assert first.path.length() + second.path.length() < 6.5
    assert min(leg.rooms.min() for leg in (first, second) if leg.rooms is not None) >= PLANNED


def test_a_chair_beside_the_axis_of_a_door_backs_to_where_the_straight_through_it_begins() -> None:
    """A wall with a door of 0.8 m; the chair stands 4 cm beside its axis, nearer than the straight begins."""
    costmap = costmap_from_grid(hall((5.0, 0.0, 5.15, 4.1), (5.0, 4.9, 5.15, 9.0)), CHAIR_A)
    legs = legs_of(costmap, Pose2(4.2, 4.54, 0.0), Pose2(8.0, 4.5, 0.0))
    assert [leg.backwards for leg in legs] == [True, False]
    assert sum(leg.path.length() for leg in legs) < 6.0
