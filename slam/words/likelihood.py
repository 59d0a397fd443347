"""Likelihood of the places in working memory for a view: tf-idf scores, normalised for the Bayes filter.

As in RTAB-Map (Angeli et al. 2008; Labbe and Michaud 2013, equation 5), with its counts: N is the number of nodes in
short-term and working memory, including the current one.
"""

from __future__ import annotations

import numpy as np

from waychair.slam.words.inverted_index import InvertedIndex
from waychair.types import FloatArray, IntArray

_LEAST_SPREAD = 1e-4


def tf_idf(index: InvertedIndex, node: int, places: IntArray) -> FloatArray:
    """Return the likelihood (M,) of places (M,) for the view of a node.

    It is the sum over the view's distinct words w of n_wi * log10(N / N_w) / n_i, with n_wi occurrences of w in place
    i, n_i words in place i, and N_w nodes that contain w.
    """
    slots = index.slots_of(node)
    if len(slots) == 0 or len(places) == 0:
        return np.zeros(len(places))
    return index.scores(slots, places)


def normalised(likelihood: FloatArray) -> FloatArray:
    """Return the likelihoods (1 + M,) for the filter: first the virtual place ("none of these"), then the places.

    Let m and s be the mean and the standard deviation of the non-zero likelihoods (M,). A place above m + s gets
    (L - s) / m, every other place 1, which is neutral. The virtual place gets m / s + 1, which is large when no place
    stands out.
    """
    result = np.ones(len(likelihood) + 1)
    some = likelihood[likelihood > 0]
    mean = float(some.mean()) if len(some) else 0.0
    spread = float(some.std(ddof=1)) if len(some) > 1 else 0.0
    if spread <= _LEAST_SPREAD:
        result[0] = 2.0
        if mean == 0.0:
            return result
    else:
        result[0] = mean / spread + 1.0
    outstanding = likelihood > mean + spread
    result[1:][outstanding] = (likelihood[outstanding] - (spread - _LEAST_SPREAD)) / mean
    return result
