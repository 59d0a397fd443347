"""Shortcuts through a multi-point turn: fewer drives where there is room, and no less room than was planned."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.body.clearance import PLANNED
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.flowing_line import NO_ZONES
from waychair.planning.route.shortcuts import shortened
from waychair.planning.route.way_pieces import Ground, Piece
from waychair.planning.window.motion_limits import DwaSettings
from waychair.resumable import finished
from waychair.types import FloatArray, OccupancyGrid


def corridor(width: float) -> Ground:
    """Return a corridor of this width [m], 8 m long, with its middle on y = 2."""
    cells = np.full((160, 320), 100, np.int8)
    half = round(width / 2 / 0.025)
    cells[80 - half : 80 + half, 4:-4] = 0
    return Ground(costmap_from_grid(OccupancyGrid(cells, 0.025), CHAIR_A), DwaSettings(), NO_ZONES, None)


def along(x: tuple[float, ...], y: float, heading: float = 0.0) -> FloatArray:
    """Return poses (N, 3) every 5 cm from one x to the next, at a heading."""
    parts = [np.linspace(a, b, round(abs(b - a) / 0.05) + 1) for a, b in pairwise(x)]
    places = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    return np.column_stack([places, np.full(len(places), y), np.full(len(places), heading)])


def drives(ground: Ground, poses: FloatArray) -> list[Piece]:
    return finished(shortened(ground, poses))


def test_a_drive_that_goes_to_and_fro_becomes_one_drive() -> None:
    (only,) = drives(corridor(1.6), along((2.0, 3.0, 2.6, 4.0), 2.0))
    assert not only.backwards
    np.testing.assert_allclose(only.poses[[0, -1]], [[2.0, 2.0, 0.0], [4.0, 2.0, 0.0]], atol=1e-6)


def test_a_chair_that_can_turn_right_round_near_its_start_does_so_instead_of_turning_in_parts() -> None:
    """Two multi-point turns of 1.6 rad each in a wide corridor, where one turn on the spot does."""
    ahead, aside, away = along((3.0, 3.6), 2.0), along((3.6, 3.6), 2.0, 1.6), along((3.6, 1.0), 2.0, math.pi)
    pieces = drives(corridor(2.6), np.concatenate([ahead, aside, away]))
    assert len(pieces) == 1
    np.testing.assert_allclose(pieces[0].poses[-1], [1.0, 2.0, math.pi], atol=1e-6)


def test_two_small_turns_on_the_spot_become_a_bend() -> None:
    slanted = along((3.0, 4.0), 2.0)
    slanted[:, 1] += 0.1 * (slanted[:, 0] - 3.0)
    slanted[:, 2] = math.atan(0.1)
    turned = np.concatenate([along((2.0, 3.0), 2.0), slanted, along((4.0, 5.0), 2.1)])
    assert len(drives(corridor(2.0), turned)) == 1


def test_a_way_backwards_stays_one_and_a_turn_alone_is_kept() -> None:
    (back,) = drives(corridor(1.6), along((3.0, 2.2), 2.0))
    assert back.backwards
    turn = np.array([[3.0, 2.0, 0.0], [3.0, 2.0, 0.3]])
    (alone,) = drives(corridor(2.0), turn)
    np.testing.assert_allclose(alone.poses, turn[1:])


@pytest.mark.parametrize("width", [0.70, 0.80, 1.20])
def test_a_shortcut_has_the_planned_clearance_or_that_of_the_way(width: float) -> None:
    pieces = drives(corridor(width), along((2.0, 3.0, 2.5, 4.0), 2.0))
    assert min(piece.rooms.min() for piece in pieces) >= min(PLANNED, (width - 0.6) / 2 - 0.02)
    assert sum(piece.seconds for piece in pieces) < 12.0
