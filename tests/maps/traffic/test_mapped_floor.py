"""The traffic graph of a mapped floor."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.errors import TrafficError
from waychair.geometry import evenly_spaced
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.traffic.mapped_floor import mapped_floor_graph, skeleton
from waychair.maps.traffic.well_formed import pieces, well_formed
from waychair.types import OccupancyGrid, Place, Pose2

CELL = 0.05


def floor(width: float, height: float, *boxes: tuple[float, float, float, float]) -> OccupancyGrid:
    """A grid that is free in some boxes x0, y0, x1, y1 [m] and solid elsewhere."""
    cells = np.full((round(height / CELL), round(width / CELL)), 100, dtype=np.int8)
    for x0, y0, x1, y1 in boxes:
        cells[round(y0 / CELL) : round(y1 / CELL), round(x0 / CELL) : round(x1 / CELL)] = 0
    return OccupancyGrid(cells, CELL)


T = floor(14.0, 9.0, (0.5, 7.0, 13.5, 8.2), (6.1, 0.5, 7.9, 8.2))
"""A corridor of 1.2 m from x 0.5 to 13.5, and one of 1.8 m that ends in its middle."""


def test_the_lines_of_a_t_are_three_arms_with_their_widths() -> None:
    graph = mapped_floor_graph(T)
    degrees = sorted(len(graph.moves[node.name]) for node in graph.nodes)
    assert degrees.count(3) == 1
    assert degrees.count(1) == 3
    assert max(section.length for section in graph.sections) <= 8.0
    (middle,) = (node for node in graph.nodes if len(graph.moves[node.name]) == 3)
    assert (middle.x, middle.y) == pytest.approx((7.0, 7.5), abs=0.4)
    for section in graph.sections:
        nodes = graph.node[section.start], graph.node[section.end]
        upright = abs(nodes[0].x - nodes[1].x) < 1.0 and min(node.y for node in nodes) < 5.0
        assert section.width == pytest.approx(1.8 if upright else 1.2, abs=0.25)
        assert section.lanes == (2 if upright else 1)
    total = sum(section.length for section in graph.sections)
    assert total == pytest.approx(11.8 + 5.8, abs=1.5)  # the lines end half a width before the walls


def test_a_ring_stays_a_ring_and_a_door_decides_the_lanes() -> None:
    ring = floor(12.0, 12.0, (1.0, 1.0, 11.0, 11.0))
    ring.cells[round(3.0 / CELL) : round(9.0 / CELL), round(3.0 / CELL) : round(9.0 / CELL)] = 100
    graph = mapped_floor_graph(ring)
    assert len(graph.sections) == len(graph.nodes) >= 3
    assert {section.lanes for section in graph.sections} == {2}
    ring.cells[round(1.0 / CELL) : round(2.1 / CELL), round(6.0 / CELL) : round(6.2 / CELL)] = 100  # a door of 0.9 m
    lanes = [section.lanes for section in mapped_floor_graph(ring).sections]
    assert lanes.count(1) == 1


def test_places_at_the_ends_of_corridors_shut_nobody_off_and_one_where_they_meet_does() -> None:
    places = [Place("west", Pose2(1.2, 7.6)), Place("middle", Pose2(7.0, 7.6)), Place("south", Pose2(7.0, 1.2))]
    graph = mapped_floor_graph(T, places)
    assert [refuge.name for refuge in graph.refuges] == ["west", "middle", "south"]
    assert len(pieces(graph)) == 1
    (found,) = well_formed(graph)
    assert found.refuge == "middle"
    assert well_formed(mapped_floor_graph(T, places[::2])) == ()


@pytest.mark.parametrize(
    ("width", "off", "shut"), [(1.2, 0.0, True), (1.2, 0.2, True), (2.4, 0.0, False), (1.6, 0.4, False)]
)
def test_a_place_on_which_a_chair_leaves_nobody_room_to_pass_shuts_the_corridor(
    width: float, off: float, shut: bool
) -> None:
    cells = np.full((100, 400), 100, np.int8)
    half = round(width / 0.1)
    cells[50 - half : 50 + half, 10:390] = 0
    places = [Place("desk", Pose2(10.0, 2.5 + off)), *(Place(f"end {x}", Pose2(x, 2.5)) for x in (2.0, 18.0))]
    found = well_formed(mapped_floor_graph(OccupancyGrid(cells, 0.05), places))
    assert [each.refuge for each in found] == ["desk"] * shut


def l_floor() -> OccupancyGrid:
    """A corridor of 1.2 m that turns left at a right angle, and becomes 2.4 m wide."""
    return floor(10.0, 10.0, (1.0, 1.0, 9.0, 2.2), (7.8, 1.0, 9.0, 4.0), (7.2, 4.0, 9.6, 9.0))


def test_a_section_follows_the_bend_of_its_corridor_and_knows_how_wide_it_is_there() -> None:
    grid = l_floor()
    graph = mapped_floor_graph(grid)
    bent = max(graph.sections, key=lambda section: len(section.points))
    way = np.array(graph.way(bent.name))
    assert np.hypot(*(way[:, :2] - (8.4, 1.6)).T).min() < 0.5  # round the corner
    assert bent.length == pytest.approx(np.hypot(*np.diff(way[:, :2], axis=0).T).sum())
    for section in graph.sections:
        line = evenly_spaced(np.array(graph.way(section.name))[:, :2], 0.05)
        cells = cells_from_points(grid, line)
        assert (grid.cells[cells[:, 0], cells[:, 1]] == 0).all()
    widths = [np.interp(6.0, *np.array(graph.way(each.name))[:, 1:].T) for each in graph.sections]
    assert max(widths) == pytest.approx(2.4, abs=0.25)
    assert bent.width == pytest.approx(1.2, abs=0.2)


def test_a_place_hangs_on_the_lines_in_its_own_room_and_not_on_a_nearer_one_behind_the_wall() -> None:
    grid = floor(12.0, 8.0, (1.0, 1.0, 11.0, 2.2), (1.0, 2.5, 5.0, 7.0), (4.0, 2.0, 4.9, 2.6))
    graph = mapped_floor_graph(grid, [Place("desk", Pose2(1.7, 3.0))])
    (stub,) = (section for section in graph.sections if "at desk" in (section.start, section.end))
    assert graph.node[stub.other("at desk")].y > 2.5


def test_a_floor_without_room_and_a_place_elsewhere_are_refused() -> None:
    with pytest.raises(TrafficError, match="no room for a chair"):
        mapped_floor_graph(floor(5.0, 5.0, (1.0, 1.0, 4.0, 1.5)))
    with pytest.raises(TrafficError, match="place far is more than"):
        mapped_floor_graph(T, [Place("far", Pose2(40.0, 7.6))])


def test_a_skeleton_is_one_cell_wide_and_in_the_middle() -> None:
    mask = np.zeros((21, 60), dtype=bool)
    mask[5:16, 5:55] = True
    thin = skeleton(mask)
    assert thin[:, 30].sum() == 1
    assert thin[9:12, 30].any()
    assert not (thin & ~mask).any()


@pytest.mark.parametrize("width", [0.5, 0.7, 0.75, 0.8, 0.85, 0.9, 1.0])
def test_a_corridor_at_the_limit_is_a_section_or_no_room_but_never_one_that_is_too_narrow(width: float) -> None:
    grid = floor(8.0, 3.0, (1.0, 1.0, 7.0, 1.0 + width))
    if width < 0.7:
        with pytest.raises(TrafficError, match="no room for a chair"):
            mapped_floor_graph(grid)
    elif width >= 0.85:
        assert mapped_floor_graph(grid).sections[0].width >= 0.7
