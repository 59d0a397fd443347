"""Place recognition: matches and their geometry, added and removed nodes, a sequence of pictures, real photographs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.slam.camera.feature_matching import Support, distances_between, epipolar_support, mutual_matches
from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.slam.camera.features import ImageFeatures, features_of_image, no_features
from waychair.slam.camera.hamming_index import Int32Array
from waychair.slam.words.place_recognition import PlaceRecognition, recognise_pictures
from waychair.slam.words.recognition_settings import RecognitionSettings
from waychair.slam.words.vocabulary import NO_WORD, FixedVocabulary
from waychair.slam.words.vocabulary_training import TrainingSettings, train
from waychair.types import Bytes, Float32Array


def place(seed: int, shift: int = 0) -> Bytes:
    """A picture of a place: blocks at several distances; near ones move more with the camera."""
    rng = np.random.default_rng(seed)
    image = np.full((240, 320), 128, np.uint8)
    for layer in range(1, 5):
        for _ in range(45):
            x, y = rng.integers(-20, 320), rng.integers(0, 220)
            w, h = rng.integers(6, 12 + 8 * layer, 2)
            grey = rng.integers(0, 256)
            left = max(0, x + shift * layer)
            image[y : y + h, left : max(0, x + shift * layer + w)] = grey
    noise = np.random.default_rng(seed + 1000 * shift).normal(0, 2, image.shape)
    return (image + noise).clip(0, 255).astype(np.uint8)


def enlarged(image: Bytes, factor: float) -> Bytes:
    """The middle of a picture, as a camera so many times as near sees it."""
    height, width = image.shape
    h, w = round(height / factor), round(width / factor)
    top, left = (height - h) // 2, (width - w) // 2
    return np.asarray(cv2.resize(image[top : top + h, left : left + w], (width, height), interpolation=cv2.INTER_CUBIC))


def seen(image: Bytes) -> ImageFeatures:
    return features_of_image(image, RecognitionSettings().features)


def matches_reference(table: Float32Array, ratio: float) -> list[tuple[int, int]]:
    """Mutual row and column minima, each clearly below the second."""
    pairs = []
    for i in range(table.shape[0]):
        j = int(table[i].argmin())
        row, column = np.sort(table[i]), np.sort(table[:, j])
        second_row = row[1] if len(row) > 1 else np.inf
        second_column = column[1] if len(column) > 1 else np.inf
        if int(table[:, j].argmin()) == i and row[0] <= ratio * second_row and column[0] <= ratio * second_column:
            pairs.append((i, j))
    return pairs


@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.integers(1, 8))
def test_matches_are_mutual_nearest_neighbours_and_clear_from_both_sides(seed: int, rows: int, columns: int) -> None:
    table = np.random.default_rng(seed).permutation(rows * columns).reshape(rows, columns).astype(np.float32) + 1
    assert [tuple(pair) for pair in mutual_matches(table, 0.8).tolist()] == matches_reference(table, np.float32(0.8))


def test_without_features_there_are_no_matches() -> None:
    none = no_features(FeatureSettings())
    some = seen(place(1))
    for a, b in ((none, some), (some, none), (none, none)):
        assert len(mutual_matches(distances_between(a.descriptors, b.descriptors), 0.8)) == 0
        assert epipolar_support(a, b) == Support(0, 0, False)


def test_a_moved_camera_gives_one_motion_and_another_place_gives_none() -> None:
    here = seen(place(1))
    again = epipolar_support(here, seen(place(1, shift=3)))
    assert again.enough
    assert again.inliers > 40
    for other in range(2, 8):
        assert not epipolar_support(here, seen(place(other))).enough


def test_matches_without_a_common_motion_are_not_enough() -> None:
    here = seen(place(1))
    shuffled = replace(here, pixels=np.random.default_rng(0).permutation(here.pixels))
    support = epipolar_support(here, shuffled)
    assert support.matches > 100
    assert not support.enough


def test_two_laps_through_the_same_places_close_loops_on_the_right_ones() -> None:
    images = [place(k, shift) for shift in (0, 2) for k in range(20)]
    results = list(recognise_pictures(images, short_term=5))
    closures = {r.node: r.closure for r in results if r.closure is not None}
    assert all(node - closure == 20 for node, closure in closures.items())
    assert len(closures) >= 18
    for result in results:
        if len(result.posterior) > 1:
            assert result.posterior.sum() == pytest.approx(1.0)
        assert result.closure is None or result.reason == ""
        assert result.closure is not None or result.reason != ""


def test_bare_black_and_overexposed_pictures_give_no_place_and_change_no_belief() -> None:
    images = [place(k, shift) for shift in (0, 2) for k in range(12)]
    blanks = [np.full((240, 320), level, np.uint8) for level in (0, 90, 255)]
    results = list(recognise_pictures(images[:16] + blanks + images[16:], short_term=5))
    for result in results[16:19]:
        assert result.closure is None
        assert result.reason == "too few features"
    after = results[19]
    assert after.closure == 5
    assert not any(r.hypothesis in (17, 18, 19) for r in results)


def test_a_single_view_proposes_a_place_to_geometry_where_the_belief_expects_another() -> None:
    """A carried chair: every view of the second lap is at a random place, so that no belief can build up."""
    images = [place(k) for k in range(24)]
    again = np.random.default_rng(4).permutation(24)[:12].tolist()
    unsure = RecognitionSettings(accept=1.0)  # the belief alone accepts nothing
    results = list(recognise_pictures([*images, *(place(k, 2) for k in again)], unsure, short_term=4))
    lag = {r.node: r.closure for r in results if r.closure is not None}
    assert all(again[node - 25] == closure - 1 for node, closure in lag.items() if node > 24)
    assert all(node > 24 for node in lag)
    assert len(lag) >= 8


def test_a_hypothesis_that_contradicts_the_geometry_is_refused_with_the_reason() -> None:
    recognition = PlaceRecognition(RecognitionSettings(accept=0.0))
    for node in range(1, 6):
        recognition.see(node, seen(place(node)))
        recognition.enter(node)
    recognition.see(6, seen(place(2, shift=1)))
    denied = recognition.recognise(6, {}, verify=lambda place: Support(20, 9, False))
    assert denied.hypothesis == 2
    assert denied.closure is None
    assert denied.reason == "9 of 20 matches fit one camera motion"


def test_a_closure_needs_a_probability_above_the_threshold() -> None:
    def closure(settings: RecognitionSettings) -> tuple[int | None, str]:
        recognition = PlaceRecognition(settings)
        for node in range(1, 6):
            recognition.see(node, seen(place(node)))
            recognition.enter(node)
        for node, view in ((6, place(2, shift=1)), (7, place(40)), (8, place(41))):
            recognition.see(node, seen(view))
            result = recognition.recognise(node, {})
        return result.closure, result.reason

    assert closure(RecognitionSettings(accept=0.0))[0] is not None
    assert "less than 1" in closure(RecognitionSettings(accept=1.0))[1]


def test_a_single_place_never_closes_a_loop() -> None:
    recognition = PlaceRecognition(RecognitionSettings(accept=0.0))
    recognition.see(1, seen(place(1)))
    assert recognition.recognise(1, {}).reason == "no places yet"
    recognition.enter(1)
    recognition.see(2, seen(place(1)))
    assert recognition.recognise(2, {}).reason == "only one place"


def test_a_sleeping_place_is_not_found_and_is_found_again_when_it_wakes() -> None:
    recognition = PlaceRecognition(RecognitionSettings(accept=0.0))
    words: dict[int, Int32Array] = {}
    for node in range(1, 8):
        words[node] = recognition.see(node, seen(place(node)))
        recognition.enter(node)
    asleep = recognition.leave(3)
    assert 3 not in recognition.belief.places
    assert len(asleep) > 100
    recognition.see(8, seen(place(3, shift=1)))
    without = recognition.recognise(8, {})
    assert without.hypothesis != 3
    assert without.likelihood.max() < 0.02
    recognition.leave(8)
    np.testing.assert_array_equal(recognition.wake(3, words[3], asleep), words[3])
    recognition.see(9, seen(place(3, shift=1)))
    again = recognition.recognise(9, {})
    assert again.places[again.likelihood.argmax()] == 3
    assert 0.0 < again.posterior[1 + again.likelihood.argmax()] < again.posterior[0]  # it starts at zero
    recognition.see(10, seen(place(3, shift=1)))
    assert recognition.recognise(10, {}).hypothesis == 3


def test_a_view_with_too_few_features_has_no_words() -> None:
    recognition = PlaceRecognition()
    few = seen(place(1)).take(np.arange(49))
    assert (recognition.see(1, few) == NO_WORD).all()
    assert len(recognition.vocabulary) == 0
    recognition.leave(1)


@pytest.mark.parametrize("detector", ["gftt_orb", pytest.param("sift", marks=pytest.mark.nightly)])
def test_other_features_and_a_fixed_vocabulary_find_places_too(detector: str) -> None:
    features = FeatureSettings(detector=detector, max_features=150)
    settings = RecognitionSettings(accept=0.02, features=features)  # so few places never look very different
    images = [place(k, shift) for shift in (0, 2) for k in range(7)]
    described = [features_of_image(image, features).descriptors for image in images[:7]]
    fixed = FixedVocabulary(train(np.concatenate(described), TrainingSettings(words=300), rounds=3))
    for vocabulary in (None, fixed):
        lags = [
            r.node - r.closure for r in recognise_pictures(images, settings, vocabulary, 3) if r.closure is not None
        ]
        assert len(lags) >= 5
        assert set(lags) == {7}


def test_real_photographs_of_the_second_lap_close_loops_on_the_first(data_dir: Path) -> None:
    """A part of the acceptance figure `places`: ten pictures of the first lap, and the same ten places again."""
    folder = data_dir / "places_rtabmap" / "images"
    chosen = [*range(1, 24), *range(41, 62)]
    images = [cv2.imread(str(folder / f"{i}.jpg"), cv2.IMREAD_GRAYSCALE) for i in chosen]
    results = list(recognise_pictures(images))
    closures = [(chosen[r.node - 1], chosen[r.closure - 1]) for r in results if r.closure is not None]
    assert all(39 <= later - earlier <= 43 for later, earlier in closures)
    assert len(closures) >= 18
    assert 46 not in dict(closures)  # a bare wall, which looks like that of picture 19


def test_real_photographs_are_known_again_from_half_the_distance(data_dir: Path) -> None:
    """The same ten places, seen as if the camera had gone twice as near."""
    folder = data_dir / "places_rtabmap" / "images"
    images = [cv2.imread(str(folder / f"{i}.jpg"), cv2.IMREAD_GRAYSCALE) for i in range(1, 18)]
    results = list(recognise_pictures([*images, *(enlarged(image, 2.0) for image in images)]))
    closures = {r.node: r.closure for r in results if r.closure is not None}
    assert all(abs(node - 17 - closure) <= 2 for node, closure in closures.items())  # along a corridor
    assert len(closures) >= 15
