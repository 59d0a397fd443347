"""Gaps between the chair's rectangle and boxes, against the simulator's exact contact and by small moves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from evaluation.best_time.gaps import gaps, is_free, overlaps, surroundings

from waychair.calibration.chair_body import CHAIR_A
from waychair.simulation.scene.contact import clearance, in_contact, solid_from_blocks
from waychair.simulation.scene.scene import Block
from waychair.types import FloatArray, Pose2


def _block(x: float, y: float, theta: float, length: float, width: float) -> Block:
    return Block(Pose2(x, y, theta), length, width, 0.0, 2.0)


def _random_pairs(count: int) -> list[tuple[Block, FloatArray]]:
    rng = np.random.default_rng(3)
    pairs = []
    for _ in range(count):
        x, y, theta = rng.uniform([-1.2, -1.2, -3.0], [1.2, 1.2, 3.0]).tolist()
        block = _block(x, y, theta, rng.uniform(0.1, 2.0), rng.uniform(0.05, 0.8))
        pairs.append((block, np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(-3, 3)])))
    return pairs


@pytest.mark.parametrize(("block", "pose"), _random_pairs(40))
def test_the_least_gap_is_the_distance_and_its_slopes_are_those_of_small_moves(block: Block, pose: FloatArray) -> None:
    solid = solid_from_blocks([block])
    around = surroundings(solid, CHAIR_A)
    assert is_free(around, *pose) == (not in_contact(solid, CHAIR_A, Pose2(*pose)))
    rows = gaps(around, pose[None], 5.0, 16)
    first = rows[0]
    if not is_free(around, *pose):
        assert first[1] <= 0.0
        out = pose + np.array([first[2], first[3], 0.0]) * (1e-6 - first[1])
        assert not in_contact(solid, CHAIR_A, Pose2(*out))
        return
    assert first[1] == pytest.approx(clearance(solid, CHAIR_A, Pose2(*pose)), abs=1e-9)
    if len(rows) > 1 and rows[1, 1] - first[1] < 1e-4:
        return  # two corners are equally near: the least gap has a kink
    step = 1e-6
    for axis in range(3):
        ahead, behind = pose.copy(), pose.copy()
        ahead[axis] += step
        behind[axis] -= step
        slope = (clearance(solid, CHAIR_A, Pose2(*ahead)) - clearance(solid, CHAIR_A, Pose2(*behind))) / (2 * step)
        assert first[2 + axis] == pytest.approx(slope, abs=1e-3)


def test_a_chair_beside_a_long_wall_has_a_row_for_each_of_its_two_corners_there() -> None:
    around = surroundings(solid_from_blocks([_block(0.0, 0.5, 0.0, 20.0, 0.2)]), CHAIR_A)
    rows = gaps(around, np.array([[0.0, 0.0, 0.0]]), 0.2, 8)
    assert rows[:, 1] == pytest.approx([0.1, 0.1])
    assert sorted(rows[:, 4]) == pytest.approx([-CHAIR_A.front, CHAIR_A.rear])


def test_the_shortfall_is_added_up_over_poses() -> None:
    around = surroundings(solid_from_blocks([_block(0.0, 0.5, 0.0, 20.0, 0.2)]), CHAIR_A)
    poses = np.array([[0.0, 0.0, 0.0], [1.0, -0.05, 0.0], [2.0, -1.0, 0.0], [3.0, 0.13, 0.0]])
    assert overlaps(around, poses, 0.2) == pytest.approx(0.1 + 0.05 + 0.0 + 0.23)


def test_boxes_in_many_bins_are_counted_once() -> None:
    blocks = [_block(0.0, 0.5, 0.0, 20.0, 0.2), _block(math.pi, -4.0, 0.3, 0.3, 0.3)]
    around = surroundings(solid_from_blocks(blocks), CHAIR_A)
    assert len(gaps(around, np.array([[0.0, 0.0, 0.0]]), 0.15, 16)) == 2
