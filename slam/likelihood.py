"""How much a view looks like the places in working memory: tf-idf, and its normalisation for the Bayes filter.

As in RTAB-Map (Angeli et al. 2008; Labbe and Michaud 2013, equation 5), whose counts are kept: N is the number of nodes
in short-term and working memory, the current one among them.
"""

from __future__ import annotations

import numpy as np

from waychair.slam.inverted_index import InvertedIndex
from waychair.types import FloatArray, IntArray

_LEAST_SPREAD = 1e-4


def tf_idf(index: InvertedIndex, node: int, places: IntArray) -> FloatArray:
    """(M,) likelihood of places (M,) for the view of a node.

    The sum over the view's distinct words w of n_wi * log10(N / N_w) / n_i: n_wi occurrences of w in place i, n_i all
    words of i, N_w nodes that show w.
    """
    slots = index.slots_of(node)
    if len(slots) == 0 or len(places) == 0:
        return np.zeros(len(places))
    return index.scores(slots, places)


def normalised(likelihood: FloatArray) -> FloatArray:
    """(1 + M,) for the filter: first the virtual place ("none of these"), then the places.

    With m and s the mean and the standard deviation of the likelihoods (M,) that are not 0: a place that stands out,
    above m + s, gets (L - s) / m; every other 1, which changes nothing; the virtual place m / s + 1, much when no place
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
