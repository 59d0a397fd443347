"""Evidence in tiles: what is known of each cell, wherever the grid grows, in memory for the known part alone."""

from __future__ import annotations

import numpy as np

from waychair.maps.grid.evidence_tiles import SIDE, EvidenceTiles


def test_tiles_hold_the_evidence_of_cells_while_the_table_grows_to_all_sides() -> None:
    tiles, rng, told = EvidenceTiles(), np.random.default_rng(4), {}
    for _ in range(60):
        cell = rng.integers(-5000, 5000, 2)
        tiles.hold(cell, cell + 1)
        first = cell // SIDE * SIDE
        col, row = (cell - first).tolist()
        value = int(rng.integers(1, 9))
        tiles.tile(first)[row, col] = told[(*cell.tolist(),)] = value
    found = {}
    for first, evidence in tiles.tiles():
        for row, col in np.argwhere(evidence):
            found[int(first[0] + col), int(first[1] + row)] = int(evidence[row, col])
    assert found == told
    low, high = tiles.extent()
    assert low.tolist() == np.min(list(told), axis=0).tolist()
    assert high.tolist() == (np.max(list(told), axis=0) + 1).tolist()


def test_two_known_places_far_apart_take_two_tiles() -> None:
    tiles = EvidenceTiles()
    tiles.hold(np.array([0, 0]), np.array([20_000, 20_000]))
    for cell in ([5, 5], [19_000, 18_000]):
        tiles.tile(np.array(cell) // SIDE * SIDE)[3, 3] = 1
    assert int(tiles.used[0]) == 2
    assert len(tiles.pool) <= 4
    assert not tiles.pool[0].any()


def test_the_extent_of_nothing_is_empty() -> None:
    tiles = EvidenceTiles()
    low, high = tiles.extent()
    assert low.tolist() == high.tolist()
