"""Place recognition: features -> words -> likelihood -> belief -> loop hypothesis, over nodes identified by id.

The memory decides which nodes are in short-term memory (seen, not compared), in working memory (places) or asleep. Call
`see` for a new node, `enter` when it leaves the short-term memory, `leave` when it goes to sleep and `wake` when it is
called back. `recognise_pictures` runs a plain sequence of pictures without any limit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from waychair.slam.camera.feature_matching import Support, epipolar_support
from waychair.slam.camera.features import ImageFeatures, features_of_image, gray_image
from waychair.slam.camera.hamming_index import Int32Array
from waychair.slam.words.bayes_filter import BayesFilter, Links, best_place
from waychair.slam.words.likelihood import normalised, tf_idf
from waychair.slam.words.recognition_settings import RecognitionSettings
from waychair.slam.words.vocabulary import NO_WORD, IncrementalVocabulary, SleepingWords, Vocabulary
from waychair.types import Bytes, FloatArray, IntArray

MIN_FEATURES = 50
"""A view with fewer features gets no words and no update (in place of RTAB-Map's Kp/BadSignRatio)."""

STANDS_OUT = 4.0
"""Standard deviations above the mean likelihood from which a single view proposes a place to geometry. The views of the
second lap of RTAB-Map's sample photographs, in random order, reach 4.2 or more; 38 of 39 propose the right place, and
geometry refuses the other."""

SHORT_TERM = 10
"""The newest nodes of a sequence of pictures, which are not compared (RTAB-Map's Mem/STMSize)."""


@dataclass(frozen=True, slots=True)
class Recognition:
    """The result for one view.

    `places` (M,) ids; `likelihood` (M,) before and `posterior` (1 + M,) after the filter, the virtual place first.
    `hypothesis` is the most probable place, `value` is 1 - P(virtual), `closure` is the accepted place, else None with
    the `reason`. `proposed` is the place that this view alone resembles far more than all others, if it is not the
    closure: geometry may try it.
    """

    node: int
    places: IntArray
    likelihood: FloatArray
    posterior: FloatArray
    hypothesis: int | None = None
    value: float = 0.0
    closure: int | None = None
    reason: str = ""
    proposed: int | None = None

    @property
    def candidates(self) -> tuple[int, ...]:
        """The places that geometry should try, the closure by the belief first."""
        return tuple(place for place in (self.closure, self.proposed) if place is not None)


class PlaceRecognition:
    """Words, inverted index and belief of the nodes that are awake."""

    def __init__(self, settings: RecognitionSettings | None = None, vocabulary: Vocabulary | None = None) -> None:
        self.settings = settings or RecognitionSettings()
        binary = self.settings.features.binary
        self.vocabulary = vocabulary or IncrementalVocabulary(binary=binary)
        self.belief = BayesFilter()
        self._places: dict[int, None] = {}  # in the order in which they entered

    def see(self, node: int, features: ImageFeatures) -> Int32Array:
        """Return the words (N,) of a new node's features; all `NO_WORD` if there are too few features."""
        if len(features) < MIN_FEATURES:
            return self._without_words(node, len(features))
        return self.vocabulary.words_of(node, features.descriptors)

    def enter(self, node: int) -> None:
        """Make a node that was seen or woken a place."""
        self._places[node] = None

    def leave(self, node: int) -> SleepingWords:
        """Put a node to sleep, place or not; return the words that no other node shows, to be stored."""
        self._places.pop(node, None)
        self.vocabulary.forget(node)
        return self.vocabulary.drop_unused()

    def wake(self, node: int, words: Int32Array, asleep: SleepingWords) -> Int32Array:
        """Make a waking node a place again; return its words (N,). `asleep` holds `vocabulary.missing(words)`."""
        self.enter(node)
        return self.vocabulary.recall(node, words, asleep)

    def recognise(
        self,
        node: int,
        neighbours: Links,
        twins: Links | None = None,
        verify: Callable[[int], Support] | None = None,
    ) -> Recognition:
        """Compare a node that was seen with all places.

        Args:
            node: its id.
            neighbours: links in time between awake nodes.
            twins: links of accepted loop closures.
            verify: geometric check of a place against this view; None: appearance alone decides.
        """
        places = np.fromiter(self._places, np.int64, len(self._places))
        likelihood = tf_idf(self.vocabulary.index, node, places)
        if len(places) == 0 or len(self.vocabulary.index.slots_of(node)) == 0:
            reason = "no places yet" if len(places) == 0 else "too few features"
            return Recognition(node, places, likelihood, np.ones(1), reason=reason)
        posterior = self.belief.update(places, normalised(likelihood), neighbours, twins)
        best = best_place(places, posterior)
        assert best is not None
        hypothesis, value = best
        reason, alike = self._doubt(len(places), value), _standing_out(places, likelihood)
        if not reason and verify is not None:
            support = verify(hypothesis)
            if not support.enough:
                reason = f"{support.inliers} of {support.matches} matches fit one camera motion"
        closure = None if reason else hypothesis
        if closure is None and verify is not None and alike is not None and verify(alike).enough:
            closure, reason = alike, ""
        return Recognition(
            node=node,
            places=places,
            likelihood=likelihood,
            posterior=posterior,
            hypothesis=hypothesis,
            value=value,
            closure=closure,
            reason=reason,
            proposed=None if alike == closure else alike,
        )

    def likeliest(self, features: ImageFeatures, most: int) -> list[int]:
        """Return the awake nodes most similar to a view by words alone, best first, the newest nodes included.

        For a lost chair: the earlier belief does not count, and the view is not added.
        """
        index = self.vocabulary.index
        nodes = np.array(list(index.nodes), np.int64)
        if len(features) < MIN_FEATURES or len(nodes) == 0:
            return []
        scores = index.scores(self.vocabulary.known(features.descriptors), nodes)
        best = np.argsort(-scores, kind="stable")[:most]
        return [int(nodes[k]) for k in best if scores[k] > 0.0]

    def _doubt(self, places: int, value: float) -> str:
        """Return why a hypothesis is not accepted; '' if it is."""
        if places < 2:
            return "only one place"
        if value < self.settings.accept:
            return f"the probability {value:.2f} of a known place is less than {self.settings.accept:g}"
        return ""

    def _without_words(self, node: int, count: int) -> Int32Array:
        words = np.full(count, NO_WORD, np.int32)
        return self.vocabulary.recall(node, words, self.vocabulary.no_words())


def _standing_out(places: IntArray, likelihood: FloatArray) -> int | None:
    """Return the place whose likelihood alone stands out from those of all places (M,), or None.

    One of fewer than 18 places cannot be four standard deviations above their mean.
    """
    best = int(np.argmax(likelihood))
    above = float(likelihood[best] - likelihood.mean())
    return int(places[best]) if 0.0 < STANDS_OUT * float(likelihood.std()) <= above else None


def recognise_pictures(
    images: Iterable[Bytes],
    settings: RecognitionSettings | None = None,
    vocabulary: Vocabulary | None = None,
    short_term: int = SHORT_TERM,
) -> Iterator[Recognition]:
    """Yield the recognition of each picture (H, W) or (H, W, 3), in the order of their taking, numbered from 1.

    Every picture is a node linked to the previous one; the newest `short_term` are not compared. A hypothesis is
    accepted if the epipolar check confirms it; the filter then treats its two nodes as one place.
    """
    settings = settings or RecognitionSettings()
    recognition = PlaceRecognition(settings, vocabulary)
    seen: dict[int, ImageFeatures] = {}
    recent: deque[int] = deque()
    neighbours: dict[int, list[int]] = {}
    twins: dict[int, list[int]] = {}
    for node, image in enumerate(images, start=1):
        features = seen[node] = features_of_image(gray_image(image), settings.features)
        recognition.see(node, features)
        neighbours[node] = [node - 1] if node > 1 else []
        if node > 1:
            neighbours[node - 1].append(node)
        recent.append(node)
        if len(recent) > short_term:
            recognition.enter(recent.popleft())

        def verify(place: int, features: ImageFeatures = features) -> Support:
            return epipolar_support(features, seen[place])

        result = recognition.recognise(node, neighbours, twins, verify)
        if result.closure is not None:
            twins.setdefault(node, []).append(result.closure)
            twins.setdefault(result.closure, []).append(node)
        yield result
