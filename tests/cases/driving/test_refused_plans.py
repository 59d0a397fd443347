"""A plan that fails names what is truly in the way: a zone, somebody, a shut door, a heading, or a lack of width."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import GoalOccupied, NoPath, PlanningError, StartOccupied
from waychair.maps.drawn.zones import Rule, Zone
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.route.global_planner import GlobalPlanner, check_goal
from waychair.planning.route.path_ends import check_start
from waychair.planning.route.refused_plans import explained
from waychair.resumable import finished
from waychair.types import FloatArray, OccupancyGrid, Pose2

CELL = 0.05
START, GOAL = Pose2(1.5, 1.5, 0.0), Pose2(6.5, 1.5, 0.0)
NOTHING = np.empty((0, 2))


def rooms(gap: float) -> OccupancyGrid:
    """Return two rooms of 4 by 3 m with a gap in the wall between them, at (4, 1.5)."""
    cells = np.zeros((60, 160), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[:, 79:81] = 100
    half = round(gap / 2 / CELL)
    cells[30 - half : 30 + half, 79:81] = 0
    return OccupancyGrid(cells, CELL)


def zone(name: str, rule: Rule, x0: float, x1: float, heading: float = 0.0) -> Zone:
    return Zone(name, rule, np.array([[x0, -1.0], [x1, -1.0], [x1, 4.0], [x0, 4.0]]), heading)


def leg(x: float, y: float, radius: float = 0.06) -> FloatArray:
    turn = np.linspace(0.0, math.tau, 12, endpoint=False)
    return np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])


def refused(
    grid: OccupancyGrid, zones: tuple[Zone, ...] = (), seen: FloatArray = NOTHING, goal: Pose2 = GOAL
) -> PlanningError:
    drawn = DrawnMap(grid, CHAIR_A, zones)
    costmap = drawn.costmap(seen)

    def plan() -> None:
        check_start(costmap, CHAIR_A, START)
        check_goal(costmap, CHAIR_A, goal, START)
        GlobalPlanner(goal).replan(costmap, START)

    with pytest.raises(PlanningError) as caught:
        plan()
    return finished(explained(caught.value, drawn, START, goal, seen))


def test_a_gap_that_is_too_narrow_is_told_with_its_width_and_place() -> None:
    error = refused(rooms(0.5))
    assert isinstance(error, NoPath)
    assert "no path wide enough" in str(error)
    told = re.search(r"about (.*) m wide at \((.*), (.*)\), and the chair needs 0.66 m", str(error))
    assert told is not None
    wide, x, y = (float(part) for part in told.groups())
    assert wide == pytest.approx(0.5, abs=0.1)
    assert math.dist((x, y), (4.0, 1.5)) < 0.4


def test_a_wall_without_any_gap_is_no_lack_of_width() -> None:
    assert "wide" not in str(refused(rooms(0.0)))
    assert "walls on the map" in str(refused(rooms(0.0)))


@pytest.mark.parametrize("rule", [Rule.KEEP_OUT, Rule.ONE_WAY])
def test_a_zone_across_the_only_way_is_told_by_its_name(rule: Rule) -> None:
    others = (zone("slow", Rule.SLOW, 2.0, 3.0, 0.3),)
    error = refused(rooms(1.0), (*others, zone("fire stairs", rule, 2.8, 3.4, math.pi)))
    assert isinstance(error, NoPath)
    kind = "keep-out" if rule is Rule.KEEP_OUT else "one-way"
    assert f"the {kind} zone 'fire stairs' bars every way" in str(error)


def test_a_zone_over_the_goal_or_the_chair_is_told_by_its_name() -> None:
    over_goal = refused(rooms(1.0), (zone("carpet", Rule.KEEP_OUT, 6.0, 7.0),))
    assert isinstance(over_goal, GoalOccupied)
    assert "the keep-out zone 'carpet' covers the goal" in str(over_goal)
    over_start = refused(rooms(1.0), (zone("mat", Rule.KEEP_OUT, 1.0, 1.9),))
    assert isinstance(over_start, StartOccupied)
    assert "the keep-out zone 'mat' lies under the chair" in str(over_start)


def test_somebody_in_the_doorway_is_told_with_the_place() -> None:
    legs = np.concatenate([leg(4.0, 1.42), leg(4.05, 1.62)])
    told = str(refused(rooms(1.0), seen=legs))
    assert told.startswith("somebody (or something as slim) stands in the doorway at (4.0, 1.5)")


def test_a_leaf_across_the_doorway_is_a_door_that_is_shut() -> None:
    leaf = np.column_stack([np.full(40, 4.0), np.linspace(1.15, 1.85, 40)])
    assert str(refused(rooms(1.0), seen=leaf)).startswith("the door is shut at (4.0, 1.5)")


def test_somebody_where_the_goal_is_is_told_and_not_a_lack_of_room() -> None:
    error = refused(rooms(1.0), seen=np.concatenate([leg(6.5, 1.4), leg(6.5, 1.6)]))
    assert isinstance(error, GoalOccupied)
    assert "somebody (or something as slim) stands where the goal is" in str(error)


def test_a_goal_with_a_heading_that_has_no_room_is_told_so() -> None:
    niche = rooms(1.0)
    niche.cells[:22, 110:] = niche.cells[38:, 110:] = 100
    told = str(refused(niche, goal=Pose2(6.7, 1.5, math.pi / 2)))
    assert "heading" in told


@pytest.mark.parametrize("y", [0.12, 0.25, 0.35])
def test_a_place_that_is_proposed_instead_of_a_goal_beside_a_wall_is_accepted_itself(y: float) -> None:
    grid, goal = rooms(1.0), Pose2(6.0, y, 0.0)
    costmap = DrawnMap(grid, CHAIR_A).costmap()
    with pytest.raises(GoalOccupied) as caught:
        check_goal(costmap, CHAIR_A, goal, START)
    told = re.search(r"nearest place with room is \((.*), (.*)\)", str(caught.value))
    assert told is not None
    instead = Pose2(float(told[1]), float(told[2]), goal.theta)
    check_goal(costmap, CHAIR_A, instead, START)
    path = GlobalPlanner(instead).replan(costmap, START)
    assert path.poses[-1] == pytest.approx(instead.array())


def test_no_place_beyond_a_wall_is_proposed() -> None:
    costmap = DrawnMap(rooms(0.0), CHAIR_A).costmap()
    with pytest.raises(GoalOccupied) as caught:
        check_goal(costmap, CHAIR_A, Pose2(4.1, 1.5, 0.0), START)
    told = re.search(r"nearest place with room is \((.*),", str(caught.value))
    assert told is not None
    assert float(told[1]) < 4.0
