"""Steps on worlds of walls: what they lead past, where they turn, and where there are none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.body.footprint import fits_each
from waychair.planning.grid.costmap import Costmap, LiveCostmap, costmap_from_grid
from waychair.planning.route.legs import DoorPassage
from waychair.planning.steps.clear_ground import SPIN_ROOM, ClearGround
from waychair.planning.steps.door_steps import doors_too_narrow
from waychair.planning.steps.step import NoSteps, StepKind, StepPlan
from waychair.planning.steps.step_planner import StepPlanner
from waychair.simulation.plan.world import load_world
from waychair.types import Goal, OccupancyGrid, Pose2

CELL = 0.02


def two_rooms(width: float, middle: float = 2.5) -> OccupancyGrid:
    """Return two rooms of 4 by 5 m beside each other, with a door of this width in the wall between them."""
    cells = np.zeros((round(5.0 / CELL), round(8.15 / CELL)), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    left, right = round(4.0 / CELL), round(4.15 / CELL)
    cells[:, left:right] = 100
    half = round(width / 2 / CELL)
    row = round(middle / CELL)
    cells[row - half : row + half, left:right] = 0
    return OccupancyGrid(cells, CELL)


def planned(costmap: Costmap, start: Pose2, goal: Pose2) -> StepPlan:
    return StepPlanner(Goal(goal), goal).replan(costmap, start)


def swept_poses(plan: StepPlan) -> np.ndarray:
    """Return poses (N, 3) all along a plan, turns included."""
    poses = []
    for step in plan.steps:
        for share in np.linspace(0.0, 1.0, 60):
            x = step.start.x + share * (step.end.x - step.start.x)
            y = step.start.y + share * (step.end.y - step.start.y)
            poses.append((x, y, step.start.theta + share * step.turn))
    return np.array(poses)


def test_a_step_begins_where_the_last_one_ends() -> None:
    plan = planned(costmap_from_grid(two_rooms(0.9), CHAIR_A), Pose2(1.5, 1.2, 2.0), Pose2(6.5, 2.5, 0.0))
    for before, after in zip(plan.steps, plan.steps[1:], strict=False):
        assert math.hypot(before.end.x - after.start.x, before.end.y - after.start.y) < 1e-6
        assert abs(math.remainder(before.end.theta - after.start.theta, math.tau)) < math.radians(2.6)
    assert plan.steps[-1].kind is StepKind.ARRIVED


@pytest.mark.parametrize(("body", "width"), [(CHAIR_A, 0.8), (CHAIR_A, 0.9), (CHAIR_B, 0.8), (CHAIR_B, 0.9)])
def test_a_door_is_one_step_on_its_axis_from_a_pivot_with_room(body, width) -> None:  # type: ignore[no-untyped-def]
    grid = two_rooms(width)
    plan = planned(costmap_from_grid(grid, body), Pose2(1.3, 3.5, 0.6), Pose2(6.5, 2.5, 0.0))
    doors = [step for step in plan.steps if step.kind is StepKind.DOOR]
    assert len(doors) == 1
    assert abs(doors[0].start.y - 2.5) < 0.03
    assert abs(doors[0].end.y - 2.5) < 0.03
    assert abs(doors[0].start.theta) < math.radians(1.5)
    assert 4.0 - (doors[0].start.x + body.front) == pytest.approx(0.75, abs=0.05)
    assert fits_each(body, 0.0, distance_field(grid), swept_poses(plan)).all()


def test_open_floor_takes_one_leg_and_the_turn_towards_it() -> None:
    cells = np.zeros((300, 400), np.int8)
    plan = planned(costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A), Pose2(2.0, 2.0, 1.5), Pose2(6.0, 3.0, 0.245))
    assert [step.kind for step in plan.steps] == [StepKind.PIVOT, StepKind.STRAIGHT, StepKind.ARRIVED]
    assert plan.length == pytest.approx(math.hypot(4.0, 1.0), abs=0.01)


def test_a_closed_door_sends_the_steps_through_the_other_one() -> None:
    grid = two_rooms(0.9, middle=1.5)
    half, row = round(0.45 / CELL), round(3.8 / CELL)
    grid.cells[row - half : row + half, round(4.0 / CELL) : round(4.15 / CELL)] = 0
    start, goal = Pose2(2.0, 1.5, 0.0), Pose2(6.0, 1.5, 0.0)
    planner = StepPlanner(Goal(goal), goal)
    first = planner.replan(costmap_from_grid(grid, CHAIR_A), start)
    shut = np.array([[4.075, y] for y in np.arange(1.0, 2.0, 0.02)])
    second = planner.replan(costmap_from_grid(grid, CHAIR_A, live_points=shut), start)
    ways = [next(step for step in plan.steps if step.kind is StepKind.DOOR) for plan in (first, second)]
    assert abs(ways[0].start.y - 1.5) < 0.03
    assert abs(ways[1].start.y - 3.8) < 0.03


def test_a_chair_that_cannot_turn_is_led_straight_back_first() -> None:
    cells = np.full((round(4.0 / CELL), round(6.0 / CELL)), 100, np.int8)
    cells[50:150, 50:150] = 0  # a room of 2 m
    cells[80:122, 150:270] = 0  # a dead end 0.84 m wide
    goal = Pose2(2.0, 2.0, math.pi)
    plan = planned(costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A), Pose2(3.3, 2.02, 0.0), goal)
    assert plan.steps[0].kind is StepKind.BACK


def test_where_no_chair_turns_before_a_door_autonomy_is_offered_and_a_door_too_narrow_for_a_hand_is_known() -> None:
    costmap = costmap_from_grid(two_rooms(0.8), CHAIR_B)
    doors = [DoorPassage(Pose2(2.0, 0.0, 0.0), width) for width in (0.8, 0.71)]
    assert doors_too_narrow(doors, CHAIR_B) is doors[1]
    assert doors_too_narrow(doors[:1], CHAIR_B) is None
    with pytest.raises(NoSteps, match="drive there by itself"):
        StepPlanner(Goal("x"), Pose2(6.5, 2.5)).replan(_cluttered(costmap), Pose2(1.3, 2.5))


def _cluttered(costmap: Costmap) -> Costmap:
    """Return the map with posts so near to each other before the door that no chair turns there."""
    posts = np.array([[x, y] for x in (2.2, 2.8, 3.4) for y in (0.8, 1.9, 3.1, 4.2)])
    return costmap_from_grid(costmap.grid, costmap.body, live_points=posts)


def test_a_door_before_a_place_without_room_to_turn_is_reached_from_wherever_the_rider_went() -> None:
    world = load_world("apartment")
    costmap = LiveCostmap(world.grid, CHAIR_A, ()).costmap()
    bath = next(place.pose for place in world.places if place.name == "bath")
    beside = Pose2(4.74, 4.23, math.radians(-59.0))  # where no leg beside the route leads through the bath's door
    plan = planned(costmap, beside, bath)
    assert all(fits_each(CHAIR_A, 0.0, distance_field(world.grid), swept_poses(plan)))
    *_, through, arrived = plan.steps
    assert (through.kind, arrived.kind) == (StepKind.STRAIGHT, StepKind.ARRIVED)
    assert math.hypot(arrived.end.x - bath.x, arrived.end.y - bath.y) < 0.31
    assert through.start.theta == pytest.approx(-math.pi / 2, abs=0.02), "on the door's axis"


def test_a_chair_far_in_a_narrow_dead_end_is_led_straight_back_all_the_way() -> None:
    cells = np.full((round(4.0 / CELL), round(6.0 / CELL)), 100, np.int8)
    cells[50:150, 50:150] = 0  # a room of 2 m
    cells[80:122, 150:290] = 0  # a dead end 0.84 m wide
    goal = Pose2(2.0, 2.0, math.pi)
    plan = planned(costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A), Pose2(4.5, 2.02, 0.0), goal)
    assert plan.steps[0].kind is StepKind.BACK
    assert plan.steps[0].length == pytest.approx(2.4), "the first of the places 0.1 m apart with room to spin"


def _corridor() -> Costmap:
    cells = np.full((round(6.0 / CELL), round(8.0 / CELL)), 100, np.int8)
    cells[104:196, 50:350] = 0  # 1.84 m wide: the chair can spin in the middle only, in a strip of some centimetres
    return costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)


def test_a_chair_a_little_beside_the_places_to_spin_is_led_a_little_back() -> None:
    plan = planned(_corridor(), Pose2(3.0, 3.1, math.pi / 2), Pose2(6.0, 3.0))
    assert plan.steps[0].kind is StepKind.BACK
    assert plan.steps[0].length <= 0.3


def test_a_chair_that_stands_half_a_centimetre_beside_a_wall_is_led_on_along_it() -> None:
    cells = _corridor().grid.cells.copy()
    cells[20:104, 200:350] = 0  # farther ahead the corridor is wider
    costmap = costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)
    start = Pose2(3.0, 2.08 + 0.5 * CHAIR_A.width + 0.005, 0.0)
    assert not fits_each(CHAIR_A, 0.0, costmap.field, start.array()[None])[0]
    plan = planned(costmap, start, Pose2(6.0, 3.0))
    assert plan.steps[0].kind is StepKind.STRAIGHT
    assert plan.steps[0].start.theta == 0.0


@pytest.mark.parametrize(
    "start",
    [
        Pose2(7.33, 4.29, 0.26),  # turned a little, straight on
        Pose2(7.55, 4.01, 2.87),  # a shuffle, and then turned
        Pose2(3.16, 2.45, 2.87),
        Pose2(12.88, 8.55, -2.99),
    ],
)
def test_from_where_a_chair_can_neither_spin_nor_drive_straight_out_it_is_led_by_a_turn_that_is_free(
    start: Pose2,
) -> None:
    world = load_world("small_clinic")
    costmap = LiveCostmap(world.grid, CHAIR_A, ()).costmap()
    reception = next(place.pose for place in world.places if place.name == "reception")
    plan = planned(costmap, start, reception)
    turns = [number for number, step in enumerate(plan.steps) if step.kind is StepKind.PIVOT]
    spins = ClearGround(costmap).spin_room(np.array([[step.start.x, step.start.y] for step in plan.steps]))
    assert spins[turns[0]] < SPIN_ROOM, "the first turn is not one on open ground"
    until = swept_poses(StepPlan(plan.steps[: turns[0] + 2]))
    assert all(fits_each(CHAIR_A, 0.0, distance_field(world.grid), until))


@pytest.mark.parametrize(("start", "goal"), [("kitchen", "bath"), ("bath", "bedroom")])
def test_a_door_whose_pivot_lies_a_hand_s_breadth_ahead_is_reached_without_a_way_back(start: str, goal: str) -> None:
    world = load_world("apartment")
    places = {place.name: place.pose for place in world.places}
    plan = planned(LiveCostmap(world.grid, CHAIR_A, ()).costmap(), places[start], places[goal])
    assert [step.kind for step in plan.steps[:3]] == [StepKind.STRAIGHT, StepKind.PIVOT, StepKind.DOOR]
    assert plan.steps[0].length < 0.25
