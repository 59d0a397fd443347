"""A small sample of `evaluation.figures.mapping.lifelong`: three sessions in the clinic with moving furniture."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from evaluation.scenes.maps.lifelong import MOVED, PIECES, Lifelong, LifelongSession, drive_sessions

from waychair.geometry import transform_points
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import cells_from_points, occupied
from waychair.types import Pose2


@pytest.fixture(scope="module")
def days() -> list[LifelongSession]:
    return list(drive_sessions("small_clinic", 3, seed=3, share=0.4))


@pytest.mark.nightly
def test_some_pieces_move_from_day_to_day_and_the_same_seed_moves_the_same_ones(days: list[LifelongSession]) -> None:
    for before, after in pairwise(days):
        assert len(after.pieces) == PIECES
        assert len(set(before.pieces) - set(after.pieces)) == MOVED
    again = next(drive_sessions("small_clinic", 1, seed=3, share=0.4))
    assert again.pieces == days[0].pieces
    np.testing.assert_array_equal(again.truth.poses, days[0].truth.poses)


@pytest.mark.nightly
def test_after_three_days_the_map_is_small_and_right_without_the_moved_pieces(
    days: list[LifelongSession], tmp_path: Path
) -> None:
    life = Lifelong(tmp_path / "map")
    for day in days:
        life.add(day)
    figures = life.figures()
    assert figures["growth"] <= 1.3
    assert figures["ate_m_worst"] < 0.05
    assert figures["cells_of_what_was_moved"] > 30, "there were nodes to forget"
    assert figures["ghost_share"] <= 0.1
    assert figures["health_ok_worst"] >= 0.85, "a third of the furniture of a small building has moved"
    assert standing(life, days[-1]) >= 0.5


def standing(life: Lifelong, day: LifelongSession) -> float:
    """Return the share of the present pieces that the map shows."""
    grid, origin = load_map(life.folder), Pose2(*life.sessions[0].truth.poses[0].tolist())
    shown = 0
    for piece in day.pieces:
        steps = np.linspace(-0.6, 0.6, 25)
        around = np.array(piece.centre) + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        cells = cells_from_points(grid, transform_points(origin.inverse(), around))
        cells = cells[((cells >= 0) & (cells < grid.cells.shape)).all(axis=1)]
        shown += bool(occupied(grid)[tuple(cells.T)].any())
    return shown / len(day.pieces)
