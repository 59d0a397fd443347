"""Costmaps in the values that RViz colours."""

from __future__ import annotations

import importlib.util
from math import exp
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.types import OccupancyGrid, Path, Pose2

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("ROS is not installed (no rclpy)", allow_module_level=True)

from waychair.ros import topics
from waychair.ros.messages.motion import read_path
from waychair.ros.nodes.navigator_parts.navigation_display import (
    NavigationDisplay,
    grid_from_costmap,
    grid_from_distances,
)

_AT = Pose2(1.0, -2.0, 0.3)


def hall() -> OccupancyGrid:
    """6 m by 4 m with walls round it, and an unknown corner."""
    cells = np.zeros((80, 120), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    cells[60:79, 100:119] = -1
    return OccupancyGrid(cells, 0.05, _AT)


def test_walls_the_room_beside_them_and_the_middle_have_nav2s_costs() -> None:
    grid = hall()
    shown = grid_from_costmap(costmap_from_grid(grid, CHAIR_A))
    assert (shown.cells[grid.cells == 100] == 100).all()
    assert (shown.cells[1:6, 20] == 99).all(), "the chair is wider than that"
    assert shown.cells[40, 60] == 0
    rising = shown.cells[40:5:-1, 60]
    assert (np.diff(rising.astype(int)) >= 0).all()
    assert 0 < rising[-3] <= 98
    assert (shown.resolution, shown.map_from_grid) == (grid.resolution, _AT)


def test_unknown_cells_stay_unknown_at_any_price() -> None:
    grid = hall()
    shown = grid_from_costmap(costmap_from_grid(grid, CHAIR_A))
    assert (shown.cells[grid.cells == -1] == -1).all()
    assert (shown.cells == -1).sum() == 19 * 19


def test_a_map_without_space_for_the_chair_has_no_costs_between_free_and_occupied() -> None:
    shown = grid_from_costmap(costmap_from_grid(OccupancyGrid(np.full((5, 5), 100, np.int8), 0.05, Pose2()), CHAIR_A))
    assert (shown.cells == 100).all()


def test_cells_near_obstacles_have_the_costs_of_nav2s_inflation() -> None:
    inscribed = min(CHAIR_A.front, CHAIR_A.rear, CHAIR_A.width / 2)
    metres = np.array([[0.0, 0.05, inscribed, inscribed + 0.1, 0.65, 0.75, 4.0]], np.float32)
    shown = grid_from_distances(DistanceField(metres, 0.05, _AT), CHAIR_A)
    falling = [round(98 * exp(-3.0 * (gap - inscribed))) for gap in (inscribed + 0.1, 0.65)]
    assert shown.cells.tolist() == [[100, 99, 99, *falling, 0, 0]]
    assert 98 > falling[0] > falling[1] > 0
    assert (shown.resolution, shown.map_from_grid) == (0.05, _AT)


class Shown:
    """A display, its node's time, and its sent messages by topic."""

    def __init__(self) -> None:
        self.now_ns, self.sent = 10**9, dict[str, list[Any]]()
        node = SimpleNamespace(now_ns=lambda: self.now_ns, publisher=self._publisher, every=lambda rate, call: None)
        self.display = NavigationDisplay(node, CHAIR_A)  # type: ignore[arg-type]

    def _publisher(self, topic: topics.RosTopic) -> Any:
        return self.sent.setdefault(topic.name, []).append

    def tick(self, way: Path | None, active: bool = True, after_s: float = 0.05) -> list[int]:
        """Return the numbers of poses of the plans of a tick."""
        self.now_ns += round(after_s * 1e9)
        before = len(self.sent["plan"])
        arc = None if not active else SimpleNamespace(arc=np.zeros((5, 3)))
        navigation = SimpleNamespace(path=way, choice=arc, driving=active)
        self.display.show(navigation, SimpleNamespace(active=active, people=np.empty((0, 2))), Pose2(), None)  # type: ignore[arg-type]
        return [len(read_path(message).poses) for message in self.sent["plan"][before:]]


def test_a_plan_is_shown_at_once_and_again_to_late_subscribers_and_removed_after_the_drive() -> None:
    shown, way = Shown(), Path(np.zeros((7, 3)))
    assert shown.tick(None, active=False) == []
    assert shown.tick(way) == [7]
    assert shown.tick(way) == []
    assert shown.tick(way, after_s=1.0) == [7]
    assert shown.tick(Path(np.zeros((3, 3)))) == [3]
    assert shown.tick(way, active=False) == [0]
    assert shown.tick(way, active=False, after_s=5.0) == []
    local = shown.sent["local_plan"]
    assert [len(message.poses) for message in local] == [5, 5, 5, 5, 0]
    assert {message.header.frame_id for message in local} == {topics.LOCAL_PLAN.frame} == {"odom"}
