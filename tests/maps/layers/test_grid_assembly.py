"""The grid follows added, removed and moved scans, and always equals a newly drawn one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import MapError
from waychair.geometry import compose
from waychair.maps.grid import occupancy
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.grid.occupancy import OccupancySettings, build_grid
from waychair.maps.layers.grid_assembly import GridAssembly
from waychair.types import FloatArray, OccupancyGrid, Pose2, Scan

CELLS = OccupancySettings(resolution=0.1)
BEAMS = 72


def scan_from(pose: FloatArray, people: FloatArray) -> Scan:
    """Ranges all round in a room of 10 x 6 m with people of 25 cm radius at (N, 2)."""
    angles = pose[2] + math.tau / BEAMS * np.arange(BEAMS)
    across, along = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        walls = np.minimum(
            np.where(across > 0, 10.0 - pose[0], -pose[0]) / across,
            np.where(along > 0, 6.0 - pose[1], -pose[1]) / along,
        )
    for x, y in people - pose[:2]:
        ahead, aside = across * x + along * y, across * y - along * x
        hit = (ahead > 0) & (np.abs(aside) < 0.25)
        walls = np.where(hit, np.minimum(walls, ahead - np.sqrt(np.maximum(0.25**2 - aside**2, 0.0))), walls)
    return Scan(0, walls.astype(np.float32), 0.0, math.tau / BEAMS, range_max=30.0)


NOBODY = np.empty((0, 2))
POSES = np.array([[1.0 + 0.2 * k, 3.0, 0.1 * k] for k in range(30)])
HERE = Pose2().array()


def rebuilt(nodes: FloatArray, hung: dict[int, tuple[Scan, int, FloatArray, FloatArray]]) -> OccupancyGrid:
    scans = [scan for scan, *_ in hung.values()]
    on = nodes[[node for _, node, _, _ in hung.values()]]
    first, last = (compose(on, np.array([entry[k] for entry in hung.values()])) for k in (2, 3))
    return build_grid(first, scans, CELLS, last)


def assert_same(found: OccupancyGrid, expected: OccupancyGrid) -> None:
    np.testing.assert_array_equal(found.cells, expected.cells)
    assert found.map_from_grid == expected.map_from_grid


def assembled(poses: FloatArray, scans: list[Scan]) -> GridAssembly:
    """One scan on each node, all drawn."""
    assembly = GridAssembly(CELLS)
    for k, scan in enumerate(scans):
        assembly.add(k, scan, k, HERE, HERE)
    assembly.move_nodes(poses, poses[-1, :2])
    while assembly.pending:
        assembly.draw()
    return assembly


ROOM = [scan_from(pose, NOBODY) for pose in POSES]

small = st.floats(-0.4, 0.4)
motions = st.tuples(small, small, small)
steps = st.one_of(
    st.tuples(st.just("add"), st.integers(0, 29), motions, motions),
    st.tuples(st.just("drop"), st.integers(0, 10**6)),
    st.tuples(st.just("bend"), st.integers(0, 10**6)),
    st.tuples(st.just("draw")),
    st.tuples(st.just("settle")),
)


@settings(max_examples=60)
@given(st.lists(steps, min_size=1, max_size=40))
def test_after_any_changes_the_grid_equals_a_newly_drawn_one(script: list[tuple]) -> None:  # type: ignore[type-arg]
    assembly = GridAssembly(CELLS)
    nodes, hung, number = POSES.copy(), dict[int, tuple[Scan, int, FloatArray, FloatArray]](), 0
    assembly.move_nodes(nodes, nodes[0, :2])
    for kind, *what in (*script, ("settle",)):
        if kind == "add":
            hung[number] = ROOM[what[0]], what[0], np.array(what[1]), np.array(what[2])
            assembly.add(number, *hung[number])
            number += 1
        elif kind == "drop" and hung:
            gone = list(hung)[what[0] % len(hung)]
            del hung[gone]
            assembly.drop(gone)
        elif kind == "bend":
            rng = np.random.default_rng(what[0])
            nodes = compose(nodes, rng.normal(0.0, 10.0 ** rng.uniform(-4, 0), (len(nodes), 3)))
            assembly.move_nodes(nodes, nodes[0, :2])
        elif kind == "draw":
            assert assembly.draw(3 * BEAMS) <= 3 * BEAMS + 2 * BEAMS
        elif kind == "settle":
            assembly.settle()
            assert (assembly.pending, len(assembly)) == (0, len(hung))
            if hung:
                assert_same(assembly.grid(), rebuilt(nodes, hung))
            else:
                assert (assembly.grid().cells == -1).all()


def test_a_call_draws_a_limited_number_of_beams_however_much_has_moved() -> None:
    assembly = assembled(POSES, ROOM)
    assembly.move_nodes(compose(POSES, np.array([0.5, 0.5, 0.2])), np.zeros(2))
    assert assembly.pending == len(POSES)
    drawn = []
    while assembly.pending:
        drawn.append(assembly.draw(10 * BEAMS))
    assert max(drawn) == 10 * BEAMS
    assert sum(drawn) == 2 * BEAMS * len(POSES)
    assert assembly.draw(10 * BEAMS) == 0


def test_one_scan_is_drawn_even_with_more_beams_than_the_limit_of_a_call() -> None:
    assembly = GridAssembly(CELLS)
    for k in range(2):
        assembly.add(k, ROOM[k], k, HERE, HERE)
    assembly.move_nodes(POSES, np.zeros(2))
    assert [assembly.draw(1) for _ in range(3)] == [BEAMS, BEAMS, 0]


def test_new_scans_are_drawn_first_and_then_those_near_the_chair() -> None:
    assembly = assembled(POSES, ROOM)
    moved = compose(POSES, np.array([0.0, 0.0, 0.5]))
    moved = np.concatenate([moved, POSES[:1]])
    assembly.add(30, ROOM[0], 30, HERE, HERE)
    assembly.move_nodes(moved, moved[17, :2] - (0.05, 0.0))
    for places in ([30], [17], [17, 16], [17, 16, 18]):
        assembly.draw(2 * BEAMS)
        now = POSES.copy()
        turned = [k for k in places if k < 30]
        now[turned] = moved[turned]
        expected = build_grid(np.concatenate([now, POSES[:1]]), [*ROOM, ROOM[0]], CELLS)
        assert_same(assembly.grid(), expected)


def test_a_correction_within_the_tolerance_moves_nothing_until_the_grid_is_settled() -> None:
    half = 0.5 * CELLS.resolution
    for shift, stays in ((0.9 * half, True), (1.1 * half, False)):
        assembly = assembled(POSES, ROOM)
        before, moved = assembly.grid(), POSES + np.array([shift, 0.0, 0.0])
        assembly.move_nodes(moved, np.zeros(2))
        assert (assembly.pending == 0) == stays
        assembly.draw()
        if stays:
            assert_same(assembly.grid(), before)
        assembly.settle()
        assert_same(assembly.grid(), build_grid(moved, ROOM, CELLS))


def test_a_rotation_is_measured_at_the_end_of_the_longest_beam() -> None:
    scan = Scan(0, np.full(BEAMS, 5.0, np.float32), 0.0, math.tau / BEAMS, range_max=30.0)
    for turn, stays in ((0.009, True), (0.011, False)):
        assembly = assembled(np.zeros((1, 3)), [scan])
        assembly.move_nodes(np.array([[0.0, 0.0, turn]]), np.zeros(2))
        assert (assembly.pending == 0) == stays


def test_a_closure_leaves_no_double_walls() -> None:
    """A room seen twice, the second time 0.5 m off until the loop is closed."""
    drifted = np.concatenate([POSES, POSES + np.array([0.0, 0.5, 0.0])])
    assembly = assembled(drifted, ROOM * 2)
    assert value_at(assembly.grid(), 5.0, 6.55) >= 65
    assembly.move_nodes(np.concatenate([POSES, POSES]), np.zeros(2))
    assembly.settle()
    assert_same(assembly.grid(), build_grid(np.concatenate([POSES, POSES]), ROOM * 2, CELLS))
    assert value_at(assembly.grid(), 5.0, 6.55) == -1


def value_at(grid: OccupancyGrid, x: float, y: float) -> int:
    row, column = cells_from_points(grid, np.array([[x, y]]))[0]
    return int(grid.cells[row, column])


def standing_people(grid: OccupancyGrid) -> int:
    """Occupied cells away from the walls."""
    rows, columns = np.nonzero(grid.cells >= 65)
    x = grid.map_from_grid.x + (columns + 0.5) * grid.resolution
    y = grid.map_from_grid.y + (rows + 0.5) * grid.resolution
    return int(((x > 0.3) & (x < 9.7) & (y > 0.3) & (y < 5.7)).sum())


def test_a_walking_person_leaves_no_trail_and_a_standing_one_is_an_obstacle() -> None:
    walking = [scan_from(pose, np.array([[9.0 - 0.25 * k, 4.5]])) for k, pose in enumerate(POSES)]
    assert standing_people(assembled(POSES, walking).grid()) == 0
    standing = [scan_from(pose, np.array([[5.0, 4.5]])) for pose in POSES]
    assert standing_people(assembled(POSES, standing).grid()) > 5


def test_a_person_in_dropped_scans_is_removed_with_them() -> None:
    standing = [scan_from(pose, np.array([[5.0, 4.5]])) for pose in POSES[:20]]
    assembly = assembled(POSES, [*standing, *ROOM[20:]])
    assert standing_people(assembly.grid()) > 0
    for k in range(20):
        assembly.drop(k)
        assembly.add(100 + k, ROOM[k], k, HERE, HERE)
    while assembly.pending:
        assembly.draw()
    assert standing_people(assembly.grid()) == 0
    assert_same(assembly.grid(), build_grid(POSES, ROOM, CELLS))


def test_unseen_cells_stay_unknown_and_cells_of_removed_scans_become_unknown_again() -> None:
    assembly = GridAssembly(CELLS)
    assert (assembly.grid().cells == -1).all()
    assembly = assembled(POSES, ROOM)
    grid = assembly.grid()
    assert value_at(grid, 5.0, 6.5) == -1, "behind the wall"
    assert (grid.cells[:5] == -1).all(), "in the margin"
    for k in range(len(POSES)):
        assembly.drop(k)
    while assembly.pending:
        assembly.draw()
    assert (assembly.grid().cells == -1).all()


def test_adding_and_removing_scans_does_not_grow_the_memory() -> None:
    assembly = assembled(POSES, ROOM)
    for k in range(500):
        assembly.drop(k)
        assembly.add(30 + k, ROOM[k % 30], k % 30, HERE, HERE)
        assembly.draw()
    assert len(assembly) == 30
    assert len(assembly._scans) == 64
    assembly.settle()
    assert_same(assembly.grid(), build_grid(POSES, ROOM, CELLS))


def test_a_scan_moved_far_away_is_refused_and_drawn_when_it_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(occupancy, "MOST_CELLS", 100_000)
    assembly = GridAssembly(CELLS)
    for k, scan in enumerate(ROOM):
        assembly.add(k, scan, k, HERE, HERE)
    thrown = POSES.copy()
    thrown[3, 0] = 1e6
    assembly.move_nodes(thrown, np.zeros(2))
    with pytest.raises(MapError, match="check the poses for jumps"):
        assembly.settle()
    assembly.move_nodes(POSES, np.zeros(2))
    assembly.settle()
    assert_same(assembly.grid(), build_grid(POSES, ROOM, CELLS))
