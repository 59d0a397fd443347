"""The node nearest to a pose by driving."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import NoPath, PlanningError
from waychair.maps.building.hgraph import Arc, HGraph, Node, NodeKind, NodeRef, Storey, SubMap
from waychair.planning.building.pose_ends import nearest_node
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.types import OccupancyGrid, Pose2


def two_rooms(gap: bool) -> tuple[HGraph, Costmap]:
    """Return a storey of 8 x 6 m with a wall at x = 4 m, open for y above 4 m if there is a gap, and a node on each side."""
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[: 40 if gap else 60, 40] = 100
    nodes = {"a": Node("a", NodeKind.CROSS, 1.0, 3.0), "b": Node("b", NodeKind.CROSS, 4.8, 1.0)}
    submap = SubMap("g", storey="g", nodes=nodes, arcs=(Arc("a", "b"),))
    return HGraph("House", (Storey("g"),), {"": SubMap(""), "g": submap}), costmap_from_grid(
        OccupancyGrid(cells, 0.1), CHAIR_A
    )


def test_the_nearest_node_is_not_the_one_behind_the_wall() -> None:
    hgraph, costmap = two_rooms(gap=True)
    ref, cost = nearest_node(hgraph, "g", Pose2(3.0, 1.0), costmap)
    assert ref == NodeRef("g", "a")
    assert 2.6 < cost < 6.0


def test_a_node_behind_a_closed_wall_is_never_chosen_and_a_pose_shut_in_is_told() -> None:
    hgraph, costmap = two_rooms(gap=False)
    assert nearest_node(hgraph, "g", Pose2(7.0, 5.0), costmap)[0] == NodeRef("g", "b")
    only_a = HGraph(
        "House",
        hgraph.storeys,
        {"": SubMap(""), "g": SubMap("g", storey="g", nodes={"a": hgraph.submaps["g"].nodes["a"]})},
    )
    with pytest.raises(NoPath, match=r"no node of the graph can be reached from \(7.00, 5.00\) on storey 'g'"):
        nearest_node(only_a, "g", Pose2(7.0, 5.0), costmap)
    with pytest.raises(PlanningError, match="storey '2' has no node"):
        nearest_node(hgraph, "2", Pose2(7.0, 5.0), costmap)
