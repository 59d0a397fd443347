"""Loading the planners' compiled kernels before a chair drives: the first call of each takes many control periods."""

from __future__ import annotations

from functools import cache

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.depth.ground import ground_view
from waychair.planning.body.clearance import CRAMPED
from waychair.planning.body.footprint import footprint, in_cells
from waychair.planning.grid.costmap import LiveCostmap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.grid.smoothing import line_cost
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.leaving_a_wall import leading_out_path
from waychair.planning.route.multi_point_turn import manoeuvre
from waychair.planning.route.speed_profile import fastest_now, next_acceleration
from waychair.planning.seen.glass_gaps import openings
from waychair.planning.seen.obstacle_layer import (
    EMPTY,
    any_nearer,
    sight_from_depth,
    sight_from_points,
    sight_of_drops,
    sight_of_missing_ground,
    updated,
)
from waychair.planning.seen.person_tracks import Track, Tracker
from waychair.planning.window.dwa import choose
from waychair.planning.window.dwa_kernels import fits_after
from waychair.planning.window.motion_limits import CommandedMotion, DwaSettings, towards
from waychair.resumable import finished
from waychair.types import OccupancyGrid, Pose2, RgbdFrame, Twist

_SIDE, _CELL = 6.0, 0.05


@cache
def warm_up() -> None:
    """Plan, replan, observe, turn, leave a wall and choose a command once, in a small room; later calls do nothing.

    Call it before a chair has to keep its 20 Hz; kernels that are not in numba's cache are compiled.
    """
    count = round(_SIDE / _CELL)
    cells = np.zeros((count, count), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    grid = OccupancyGrid(cells, _CELL)
    middle, aside = Pose2(_SIDE / 2, _SIDE / 2, 0.0), Pose2(_SIDE / 2, _SIDE / 3, 1.0)
    far = Pose2(_SIDE - 1.0, 1.0, 1.0)
    costmaps = LiveCostmap(grid, CHAIR_A)
    planner = GlobalPlanner(far)
    planner.replan(costmaps.costmap(), middle)
    planner.replan(costmaps.costmap(np.array([[1.0, 1.0]])), Pose2(middle.x + 3 * _CELL, middle.y, 0.0))
    path = planner.replan(costmaps.costmap(), middle)
    GlobalPlanner(far, check_footprint=False).replan(costmaps.costmap(), middle)
    line, limits = np.array([0.0, 1.0]), DwaSettings()
    next_acceleration(np.zeros(2), line, 0.0, 0.1, 0.0, limits.acceleration, limits.braking, limits.jerk)
    fastest_now(np.zeros(2), line, 0.0, limits.braking, limits.jerk)
    openings(grid, path.poses, _SIDE)
    for barred in (None, np.zeros((count, count), np.uint8)):
        line_cost(costmaps.costmap().prices, 30.0, 30.0, 31.0, 30.0, barred)
    towards(Twist(), Twist(0.1, 0.0), DwaSettings())
    looks = [sight_from_points(0, np.zeros(2), np.array([[end, 0.0]]), np.array([True]), 0.01) for end in (2.0, 3.0)]
    updated(updated(EMPTY, looks[0]), looks[1])
    any_nearer(np.zeros((1, 2)), np.ones((1, 2)), 0.5)
    _look(middle)
    field = fine_field(grid, middle, _SIDE / 2)
    manoeuvre(field, CHAIR_A, middle, aside, polish=0)
    finished(leading_out_path(field, CHAIR_A, Pose2(_SIDE / 2, _CELL + CHAIR_A.width / 2 + CRAMPED / 2, 0.0)))
    Tracker().update(0, np.array([[1.0, 1.0]]))
    person = Track(
        number=0,
        stamp_ns=0,
        seen_ns=0,
        seen=1,
        position=np.array([1.0, 1.0]),
        velocity=np.zeros(2),
        covariance=np.eye(4),
        radius=0.3,
    )
    choose(
        pose=Pose2(middle.x, middle.y, -1.5),
        command=Twist(),
        path=path,
        distances=field,
        body=CHAIR_A,
        settings=DwaSettings(),
        in_position=False,
        motion=CommandedMotion(),
        tracks=(person,),
    )
    fits_after(footprint(CHAIR_A, 0.0, field), in_cells(field, middle), np.zeros((1, 2)), np.zeros(1))


def _look(pose: Pose2) -> None:
    """Let a depth camera see a wall."""
    camera_matrix = np.array([[16.0, 0.0, 8.0], [0.0, 16.0, 8.0], [0.0, 0.0, 1.0]])
    picture = RgbdFrame(0, np.zeros((16, 16), np.uint8), np.ones((16, 16), np.float32), camera_matrix)
    view = ground_view(picture, CHAIR_A.base_from_camera, CHAIR_A.front)
    sight_of_drops(view, pose)
    sight_of_missing_ground(view, pose)
    for layer in CHAIR_A.height_layers():
        sight = sight_from_depth(view, pose, layer, 0.0)
        updated(updated(EMPTY, sight), sight)
