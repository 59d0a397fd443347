"""The belief over places: a probability, equal to a filter with the whole matrix, also as places are added and
removed."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.slam.words.bayes_filter import PREDICTION, VIRTUAL, VIRTUAL_STAYS, BayesFilter, best_place
from waychair.types import FloatArray, IntArray

Graph = Mapping[int, Sequence[int]]


def chain(nodes: Sequence[int]) -> dict[int, list[int]]:
    """Each linked to the one before and after."""
    links: dict[int, list[int]] = {node: [] for node in nodes}
    for a, b in pairwise(nodes):
        links[a].append(b)
        links[b].append(a)
    return links


def distances_reference(start: int, neighbours: Graph, twins: Graph, most: int) -> dict[int, int]:
    """0-1 breadth-first search: a twin is at distance zero, a neighbour one further."""
    found, queue = {start: 0}, deque([start])
    while queue:
        node = queue.popleft()
        for other in twins.get(node, ()):
            if found.get(other, most + 1) > found[node]:
                found[other] = found[node]
                queue.appendleft(other)
        for other in neighbours.get(node, ()):
            if found[node] < most and found.get(other, most + 1) > found[node] + 1:
                found[other] = found[node] + 1
                queue.append(other)
    return found


def transition_reference(places: IntArray, neighbours: Graph, twins: Graph, shares: Sequence[float]) -> FloatArray:
    """The whole matrix, column by column as the model is described."""
    count = len(places)
    matrix = np.zeros((count + 1, count + 1))
    matrix[0, 0] = VIRTUAL_STAYS
    matrix[1:, 0] = (1 - VIRTUAL_STAYS) / count
    for j, place in enumerate(places.tolist()):
        near = distances_reference(place, neighbours, twins, len(shares) - 2)
        column = np.array([shares[1 + near[other]] if other in near else 0.0 for other in places.tolist()])
        column[j] += max(0.0, sum(shares[1:]) - column.sum())
        spare = max(0.0, 1.0 - sum(shares))
        if spare > 1e-9 and (column == 0).any():
            column[column == 0] = spare / (column == 0).sum()
        column *= (1 - shares[0]) / column.sum()
        column[column < min(shares) * (1 - 1e-9)] = 0.0
        matrix[0, j + 1], matrix[1:, j + 1] = shares[0], column
    return matrix


def test_along_a_path_the_belief_moves_to_the_neighbours_as_in_the_model() -> None:
    places = np.arange(1, 60)
    belief = BayesFilter()
    belief.update(places, np.ones(60), chain(range(1, 60)))
    matrix = belief.transition(places)
    np.testing.assert_allclose(matrix, transition_reference(places, chain(range(1, 60)), {}, PREDICTION), atol=1e-15)
    middle = matrix[1:, 30]  # from place 30: both neighbours get the share of one link
    assert middle[28] == middle[30]
    assert middle[30] / middle[29] == pytest.approx(0.30 / 0.36)
    np.testing.assert_allclose(matrix.sum(axis=0), 1.0, atol=1e-9)


@pytest.mark.parametrize("prediction", [(0.1, 0.36, 0.3, 0.1), (0.2, 0.5), PREDICTION])
@given(seed=st.integers(0, 2**32 - 1))
def test_the_incremental_filter_equals_one_with_the_whole_matrix(prediction: tuple[float, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    belief = BayesFilter(prediction)
    awake, neighbours, twins = [0], {0: []}, {}
    expected: dict[int, float] | None = None
    for node in range(1, 14):
        neighbours[node] = [node - 1]
        neighbours.setdefault(node - 1, []).append(node)
        awake.append(node)
        if node > 4 and rng.random() < 0.5:
            a, b = (int(v) for v in rng.choice(node, 2, replace=False))
            twins.setdefault(a, []).append(b)
            twins.setdefault(b, []).append(a)
        if len(awake) > 3 and rng.random() < 0.5:
            awake.remove(int(rng.choice(awake[:-2])))
        known = {other: [n for n in links if n in awake] for other, links in neighbours.items() if other in awake}
        alike = {other: list(links) for other, links in twins.items() if other in awake}
        places = rng.permutation(np.array(awake[:-1]))  # the newest is in short-term memory
        likelihood = rng.uniform(0.5, 3.0, len(places) + 1)
        posterior = belief.update(places, likelihood, known, alike)
        if expected is None:
            prior = np.ones(len(places) + 1)
        else:
            before = np.array([expected.get(int(place), 0.0) for place in (VIRTUAL, *places)])
            prior = transition_reference(places, known, alike, prediction) @ before
        reference = likelihood * prior / (likelihood * prior).sum()
        np.testing.assert_allclose(posterior, reference, atol=1e-12)
        assert posterior.sum() == pytest.approx(1.0)
        expected = dict(zip([VIRTUAL, *places.tolist()], posterior.tolist(), strict=True))
        assert belief.probability(VIRTUAL) == posterior[0]
        assert set(belief.places.tolist()) == set(places.tolist())


def test_a_repeated_similar_view_raises_the_belief_and_later_loses_it() -> None:
    places, links = np.arange(1, 31), chain(range(1, 31))
    belief = BayesFilter()
    blank = np.ones(31)
    blank[0] = 2.0
    assert belief.update(places, blank, links)[0] > 0.05
    values = []
    for at in range(5, 12):
        likelihood = np.ones(31)
        likelihood[0], likelihood[at] = 1.3, 8.0
        posterior = belief.update(places, likelihood, links)
        values.append(1.0 - posterior[0])
        best = best_place(places, posterior)
    assert best is not None
    assert best[0] == 11
    assert min(values) > 0.7
    for _ in range(12):
        posterior = belief.update(places, np.concatenate([[4.0], np.ones(30)]), links)
    assert posterior[0] > 0.5


def test_new_places_start_at_zero_and_removed_ones_lose_their_belief() -> None:
    belief = BayesFilter()
    far = {1: [], 2: [], 3: []}
    belief.update(np.array([1, 2]), np.array([1.0, 1.0, 8.0]), far)
    posterior = belief.update(np.array([1, 3]), np.ones(3), far)
    assert posterior[2] == pytest.approx(posterior[0] * 0.05 / 0.9, rel=0.2)  # only the share of a new place
    assert posterior.sum() == pytest.approx(1.0)


def test_without_places_only_the_virtual_place_is_left() -> None:
    belief = BayesFilter()
    np.testing.assert_array_equal(belief.update(np.empty(0, np.int64), np.ones(1), {}), [1.0])
    assert best_place(np.empty(0, np.int64), np.ones(1)) is None


def test_of_equally_probable_places_the_newest_is_the_hypothesis() -> None:
    assert best_place(np.array([9, 4, 12, 7]), np.array([0.2, 0.3, 0.1, 0.3, 0.3])) == (12, 0.8)
    assert best_place(np.array([12, 4]), np.array([0.2, 0.1, 0.7])) == (4, 0.8)
