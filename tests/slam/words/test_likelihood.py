"""tf-idf by the inverted index against its formula, and the normalisation against its definition."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.slam.memory.rehearsal import similarity
from waychair.slam.words.inverted_index import InvertedIndex
from waychair.slam.words.likelihood import normalised, tf_idf

VIEWS = st.lists(st.lists(st.integers(0, 12), max_size=20), min_size=2, max_size=8)


def tf_idf_reference(views: list[list[int]], place: int) -> float:
    """Sum over the distinct words of the last view of n_wi log10(N / N_w) / n_i."""
    total, counts = 0.0, Counter(views[place])
    for word in set(views[-1]):
        showing = sum(word in view for view in views)
        if counts[word]:
            total += counts[word] * math.log10(len(views) / showing) / len(views[place])
    return total


@given(VIEWS, st.data())
def test_the_likelihood_equals_the_formula_after_any_additions_and_removals(
    views: list[list[int]], data: st.DataObject
) -> None:
    index = InvertedIndex()
    for k, extra in enumerate(data.draw(VIEWS)):
        index.add(100 + k, np.array(extra, np.int32))
    for node, view in enumerate(views):
        index.add(node, np.array(view, np.int32))
    for node in data.draw(st.permutations([n for n in range(100, 110) if n in index])):
        index.remove(node)
    places = np.arange(len(views) - 1)
    expected = [tf_idf_reference(views, place) for place in places]
    np.testing.assert_allclose(tf_idf(index, len(views) - 1, places), expected, atol=1e-12)


@given(VIEWS)
def test_removing_a_node_returns_exactly_the_words_without_any_view(views: list[list[int]]) -> None:
    index = InvertedIndex()
    for node, view in enumerate(views):
        index.add(node, np.array(view, np.int32))
    for node, view in enumerate(views):
        left = {word for other in views[node + 1 :] for word in other}
        assert set(index.remove(node).tolist()) == set(view) - left
    assert len(index) == 0


def test_a_word_in_all_views_has_no_weight() -> None:
    index = InvertedIndex()
    for node in range(3):
        index.add(node, np.array([5, 5, 9 + node], np.int32))
    np.testing.assert_array_equal(tf_idf(index, 2, np.array([0, 1])), [0.0, 0.0])


def test_the_similarity_counts_shared_occurrences_by_the_larger_view() -> None:
    a, b = np.array([1, 1, 1, 2, 3], np.int32), np.array([1, 1, 4, 3], np.int32)
    assert similarity(a, b) == pytest.approx(3 / 5)
    assert similarity(a, b) == similarity(b, a)
    assert similarity(a, np.empty(0, np.int32)) == 0.0
    assert similarity(a, a) == 1.0


def test_only_an_outstanding_place_is_raised_and_the_virtual_place_falls() -> None:
    likelihood = np.array([0.10, 0.12, 0.0, 0.11, 0.50, 0.09])
    some = likelihood[likelihood > 0]
    mean, spread = some.mean(), some.std(ddof=1)
    result = normalised(likelihood)
    assert result[0] == pytest.approx(mean / spread + 1)
    assert result[5] == pytest.approx((0.5 - (spread - 0.0001)) / mean)
    np.testing.assert_array_equal(np.delete(result[1:], 4), 1.0)
    assert result[5] > 1.0


@pytest.mark.parametrize("likelihood", [[], [0.0, 0.0, 0.0], [0.3], [0.0, 0.2], [0.2, 0.2, 0.2]])
def test_without_an_outstanding_place_a_new_place_is_twice_as_likely(likelihood: list[float]) -> None:
    result = normalised(np.array(likelihood))
    assert result[0] == 2.0
    assert (result[1:] >= 1.0 - 1e-3).all()
    assert len(result) == len(likelihood) + 1


@given(st.lists(st.floats(0.0, 1.0), max_size=30))
def test_the_normalised_likelihood_is_positive_and_finite(likelihood: list[float]) -> None:
    result = normalised(np.array(likelihood))
    assert np.isfinite(result).all()
    assert (result > 0).all()
