"""The sparse factors of the normal equations against dense algebra, on chains with loops and on graphs without any order."""

import numpy as np
import pytest

from waychair.slam.graph.block_cholesky import BlockCholesky, structure_of
from waychair.types import IntArray


def pairs_of(kind: str, count: int, seed: int) -> tuple[IntArray, IntArray]:
    """Return the pairs of nodes that a graph's edges join, some of them twice and some the other way round."""
    rng = np.random.default_rng(seed)
    if kind == "chain":
        i = np.arange(count - 1)
        return i, i + 1
    ends = rng.integers(0, count, (3 * count, 2))
    ends = ends[ends[:, 0] != ends[:, 1]]
    if kind == "loops":
        ends = np.concatenate([np.stack([np.arange(count - 1), np.arange(1, count)], axis=1), ends[: count // 4]])
    return ends[:, 0], ends[:, 1]


@pytest.mark.parametrize("kind", ["chain", "loops", "dense"])
@pytest.mark.parametrize("count", [1, 2, 7, 60])
def test_solutions_are_those_of_dense_algebra(kind: str, count: int) -> None:
    rng = np.random.default_rng(count)
    i, j = pairs_of(kind, count, count)
    structure = structure_of(i, j, count)
    slots = structure.slots(i, j)
    diagonal, below = np.tile(np.eye(3), (count, 1, 1)), np.zeros((len(structure.rows), 3, 3))
    whole = np.eye(3 * count)
    for a, b, slot in zip(i.tolist(), j.tolist(), slots.tolist(), strict=True):
        jacobian = rng.normal(size=(3, 6))
        block = jacobian.T @ jacobian
        rows = np.r_[3 * a : 3 * a + 3, 3 * b : 3 * b + 3]
        whole[np.ix_(rows, rows)] += block
        diagonal[a] += block[:3, :3]
        diagonal[b] += block[3:, 3:]
        below[slot] += block[3:, :3] if structure.position[b] > structure.position[a] else block[:3, 3:]
    right = rng.normal(size=(count, 3, 2))
    solved = BlockCholesky(structure, diagonal, below).solve(right)
    expected = np.linalg.solve(whole, right.reshape(3 * count, 2)).reshape(count, 3, 2)
    assert solved == pytest.approx(expected, abs=1e-9)


def test_a_known_order_goes_on_for_a_graph_that_has_grown() -> None:
    rng, count, before = np.random.default_rng(5), 60, 45
    i, j = pairs_of("loops", count, 5)
    inside = (i < before) & (j < before)
    known = structure_of(i[inside], j[inside], before).order
    structure = structure_of(i, j, count, known)
    assert structure.order.tolist() == [*known.tolist(), *range(before, count)]
    diagonal, below = np.tile(20.0 * np.eye(3), (count, 1, 1)), np.zeros((len(structure.rows), 3, 3))
    whole = 20.0 * np.eye(3 * count)
    for a, b, slot in zip(i.tolist(), j.tolist(), structure.slots(i, j).tolist(), strict=True):
        block = rng.normal(size=(3, 3))
        whole[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += block
        whole[3 * b : 3 * b + 3, 3 * a : 3 * a + 3] += block.T
        below[slot] += block.T if structure.position[b] > structure.position[a] else block
    right = rng.normal(size=(count, 3, 1))
    solved = BlockCholesky(structure, diagonal, below).solve(right)
    assert solved == pytest.approx(np.linalg.solve(whole, right.reshape(-1, 1)).reshape(count, 3, 1), abs=1e-9)


def test_a_chain_with_few_loops_fills_hardly_any_block() -> None:
    i, j = pairs_of("chain", 2000, 0)
    assert len(structure_of(i, j, 2000).rows) == 1999
    i, j = np.concatenate([i, np.arange(0, 900, 10)]), np.concatenate([j, np.arange(1999, 1099, -10)])
    assert len(structure_of(i, j, 2000).rows) < 4000


def test_pairs_with_a_number_below_zero_have_no_block() -> None:
    structure = structure_of(np.array([-1, 0]), np.array([0, 1]), 2)
    assert structure.slots(np.array([-1, 0, 1]), np.array([0, 1, 0])).tolist() == [-1, 0, 0]


def test_a_matrix_that_is_not_positive_definite_is_refused() -> None:
    structure = structure_of(np.array([0]), np.array([1]), 2)
    with pytest.raises(np.linalg.LinAlgError):
        BlockCholesky(structure, np.tile(np.eye(3), (2, 1, 1)), 2.0 * np.eye(3)[None])
