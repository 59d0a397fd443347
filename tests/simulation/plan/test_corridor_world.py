"""Worlds of corridors for whole chairs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.errors import TrafficError
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.grid.distance_field import distance_field
from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.simulation.plan.corridor_world import corridor_world, outline


@pytest.mark.parametrize("width", [1.2, 1.8])
def test_every_node_lies_in_the_middle_of_a_corridor_of_the_width(width: float) -> None:
    plan = load_corridors("4cross")
    world = corridor_world(plan, width)
    metres = distance_field(world.grid).metres
    for place in world.places:
        row, column = cells_from_points(world.grid, np.array([[place.pose.x, place.pose.y]]))[0]
        assert metres[row, column] >= width / 2 - 0.08
    graph = corridor_graph(plan, width)
    for section in graph.sections:
        a, b = graph.node[section.start], graph.node[section.end]
        middle = np.array([[(a.x + b.x) / 2, (a.y + b.y) / 2]])
        row, column = cells_from_points(world.grid, middle)[0]
        assert metres[row, column] == pytest.approx(width / 2, abs=0.08)


def test_a_corridor_is_closed_all_round() -> None:
    world = corridor_world(load_corridors("fig8"), 1.2)
    walls = sum(math.dist(a, b) for a, b in outline([(0.0, 0.0, 4.0, 1.0), (3.0, 0.0, 4.0, 5.0)]))
    assert walls == 4 + 1 + 3 + 4 + 1 + 5
    assert {place.name for place in world.places} == {"00", "02", "03", "05", "10", "11", "12"}


def test_rooms_open_into_their_corridor() -> None:
    plan = load_corridors("T")
    world = corridor_world(plan, 1.2, rooms=True)
    graph = corridor_graph(plan, 1.2, rooms=True)
    metres = distance_field(world.grid).metres
    for refuge in graph.refuges:
        (move,) = graph.moves[refuge.node]
        ends = [np.array([graph.node[name].x, graph.node[name].y]) for name in (move.start, move.end)]
        way = np.linspace(*ends, 20)
        rows, columns = cells_from_points(world.grid, way).T
        assert metres[rows, columns].min() > 0.35


def test_a_width_without_room_for_a_chair_is_refused() -> None:
    with pytest.raises(TrafficError, match="no room for a chair"):
        corridor_world(load_corridors("T"), 0.5)
