"""Place recognition by appearance: loop closures on photographs, and the time per frame with a large vocabulary."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from evaluation.figures.mapping.logs import DATA
from waychair.files import replacing
from waychair.offline.report import new_figure
from waychair.slam.camera import feature_matching as matching
from waychair.slam.camera import features as features_module
from waychair.slam.camera.features import extract, features_of_image, gray_image
from waychair.slam.camera.hamming_index import HammingIndex, assign, hamming_table, packed
from waychair.slam.words import place_recognition
from waychair.slam.words import vocabulary as vocabulary_module
from waychair.slam.words.likelihood import normalised, tf_idf
from waychair.slam.words.place_recognition import PlaceRecognition, Recognition, recognise_pictures
from waychair.slam.words.recognition_settings import RecognitionSettings
from waychair.slam.words.vocabulary import FixedVocabulary, IncrementalVocabulary
from waychair.slam.words.vocabulary_training import train
from waychair.types import Bytes, FloatArray, Json, RgbdFrame

RIGHT_LAGS = frozenset({*range(39, 44), 79, 80})
"""Pictures between two views of one place: a lap has 39 or 40, and the set holds two laps and four pictures."""

WORDS = 600_000
"""Least number of words in the vocabulary of the speed figure."""


def places(out: Path) -> Json:
    """84 photographs of two laps: 43 right closures, all that are possible, and no wrong one.

    The second lap begins with the 41st picture; of its 44 pictures, the 46th shows a bare wall.

    A closure is right if its lag is that of one or two laps (`RIGHT_LAGS`, verified by eye, as no truth is published).
    Every threshold is changed by a fifth in both directions to show its influence.
    """
    cv2.setNumThreads(1)
    images = [_gray(DATA / "places_rtabmap" / "images" / f"{i}.jpg") for i in range(1, 85)]
    settings = RecognitionSettings()
    list(recognise_pictures(images[:12], settings))  # kernels are loaded
    started = time.process_time()
    results = list(recognise_pictures(images, settings))
    seconds = time.process_time() - started
    right, wrong = judged(results)
    _draw(results, out.with_suffix(".png"))
    rooms = [frame.image for frame in _frames()]
    offline = {
        "of_lap_one": _offline(images, images[:40], settings),
        "of_other_rooms": _offline(images, rooms, settings),
    }
    open_ends = {r.node: r.reason for r in results if r.node > 40 and r.closure is None}
    return {
        "passed": right >= 43 and wrong == 0,
        "right": right,
        "wrong": wrong,
        "cpu_ms_per_image": round(1e3 * seconds / len(images), 1),
        "kmeans_dictionary": offline,
        "margins": margins(images, settings),
        "not_closed": open_ends,
    }


def judged(results: list[Recognition] | Iterator[Recognition]) -> tuple[int, int]:
    """Return the numbers of right and wrong closures, by their lag."""
    lags = [result.node - result.closure for result in results if result.closure is not None]
    right = sum(lag in RIGHT_LAGS for lag in lags)
    return right, len(lags) - right


def _offline(images: list[Bytes], training: list[Bytes], settings: RecognitionSettings) -> Json:
    """Run the same pictures with a vocabulary clustered from `training`, as in the paper."""
    descriptors = np.concatenate([features_of_image(image, settings.features).descriptors for image in training])
    vocabulary = FixedVocabulary(train(descriptors))
    results = list(recognise_pictures(images, settings, vocabulary))
    right, wrong = judged(results)
    guesses = [r.node - r.hypothesis for r in results if r.node > 40 and r.hypothesis is not None]
    return {
        "words": len(vocabulary),
        "right": right,
        "wrong": wrong,
        "hypotheses_right": sum(lag in RIGHT_LAGS for lag in guesses),
    }


CONSTANTS = {
    "min_features": (place_recognition, "MIN_FEATURES"),
    "vocabulary.ratio": (vocabulary_module, "NEAREST_RATIO"),
    "features.fast_threshold": (features_module, "FAST_THRESHOLD"),
    "epipolar.ratio": (matching, "_RATIO"),
    "epipolar.tolerance": (matching, "_TOLERANCE"),
    "epipolar.min_inliers": (matching, "_MIN_INLIERS"),
    "epipolar.min_share": (matching, "_MIN_SHARE"),
}
"""Thresholds of the figure `margins` that are constants of modules."""


def margins(images: list[Bytes], settings: RecognitionSettings) -> Json:
    """Right and wrong closures with one threshold moved by a fifth, down and up."""

    def figures(settings: RecognitionSettings, short_term: int = place_recognition.SHORT_TERM) -> list[int]:
        return list(judged(recognise_pictures(images, settings, short_term=short_term)))

    found: Json = {}
    for factor in (0.8, 1.2):
        accept, short_term = moved(settings.accept, factor), round(place_recognition.SHORT_TERM * factor)
        most = round(settings.features.max_features * factor)
        found[f"accept {accept:g}"] = figures(replace(settings, accept=accept))
        found[f"short_term {short_term}"] = figures(settings, short_term)
        features = replace(settings.features, max_features=most)
        found[f"features.max_features {most}"] = figures(replace(settings, features=features))
        for label, (module, name) in CONSTANTS.items():
            value = getattr(module, name)
            setattr(module, name, moved(value, factor))
            try:
                found[f"{label} {getattr(module, name):g}"] = figures(settings)
            finally:
                setattr(module, name, value)
    return found


def moved(value: float, factor: float) -> float:
    """A threshold times a factor: whole numbers stay whole, and shares stay at most 1."""
    return round(value * factor) if isinstance(value, int) else min(value * factor, 1.0 + 9 * (value > 1))


def words_speed(out: Path) -> Json:
    """A frame of 640 x 480 with 600,000 words: median at most 30 ms and p99 at most 70 ms of one core's time.

    The incremental vocabulary is built from mirrored, turned and zoomed copies of the real pictures. The timed frames
    are the pictures themselves: 210 of a hand-held camera over a desk and 50 of a room.
    """
    cv2.setNumThreads(1)
    settings = RecognitionSettings()
    recognition = PlaceRecognition(settings)
    vocabulary = recognition.vocabulary
    neighbours: dict[int, list[int]] = {}
    node = 0
    for image in _copies():
        node = _linked(neighbours, node)
        recognition.see(node, features_of_image(image, settings.features))
        recognition.enter(node)
        if len(vocabulary) >= WORDS:
            break
    words_before = len(vocabulary)
    frames = list(_frames())
    stages: dict[str, list[float]] = {name: [] for name in ("extraction", "words", "likelihood", "filter", "whole")}
    for i, frame in enumerate([frames[0], *frames]):
        node = _linked(neighbours, node)
        times = _timed(recognition, node, frame, neighbours)
        recognition.enter(node)
        if i:  # the first frame adds all places to the filter at once
            for name, seconds in times.items():
                stages[name].append(1e3 * seconds)
    table = {
        name: {"median": round(float(np.median(ms)), 2), "p99": round(float(np.percentile(ms, 99)), 2)}
        for name, ms in stages.items()
    }
    assert isinstance(vocabulary, IncrementalVocabulary)
    whole = table["whole"]
    return {
        "passed": words_before >= WORDS and whole["median"] <= 30.0 and whole["p99"] <= 70.0,
        "words": words_before,
        "places": node,
        "frames": len(frames),
        "cpu_median_ms": whole["median"],
        "cpu_p99_ms": whole["p99"],
        "cpu_ms": table,
        "search": _search_figures(frames, vocabulary, settings),
    }


def _timed(
    recognition: PlaceRecognition, node: int, frame: RgbdFrame, neighbours: dict[int, list[int]]
) -> dict[str, float]:
    """Return the processor time [s] of each stage, in the order of `PlaceRecognition.recognise`."""
    marks = [time.process_time()]
    features = extract(frame, recognition.settings.features)
    marks.append(time.process_time())
    recognition.see(node, features)
    marks.append(time.process_time())
    places = np.arange(1, node, dtype=np.int64)
    likelihood = normalised(tf_idf(recognition.vocabulary.index, node, places))
    marks.append(time.process_time())
    recognition.belief.update(places, likelihood, neighbours)
    marks.append(time.process_time())
    spent = dict(zip(("extraction", "words", "likelihood", "filter"), np.diff(marks).tolist(), strict=True))
    return {**spent, "whole": marks[-1] - marks[0]}


def _search_figures(frames: list[RgbdFrame], vocabulary: IncrementalVocabulary, settings: RecognitionSettings) -> Json:
    """Return the time of 500 queries among all words, and how often the search equals an exact scan."""
    ids = np.arange(1, len(vocabulary) + 1, dtype=np.int32)
    words = packed(vocabulary.descriptors_of(ids))
    index = HammingIndex()
    index.insert(words, ids)
    views = [features_of_image(_turned(gray_image(frame.image), 5.0, 1.1), settings.features) for frame in frames[::20]]
    queries = packed(np.concatenate([view.descriptors for view in views]))
    queries = queries[np.random.default_rng(0).permutation(len(queries))[:2000]]
    times = []
    distances = []
    for start in range(0, len(queries), 500):
        started = time.process_time()
        distances.append(index.nearest(queries[start : start + 500])[1])
        times.append(1e3 * (time.process_time() - started))
    found = np.concatenate(distances).astype(float)
    exact = np.array([np.partition(hamming_table(queries[i : i + 1], words)[0], 1)[:2] for i in range(len(queries))])
    started = time.process_time()
    assign(queries[:100], words)
    scan = 1e3 * (time.process_time() - started) * 5
    ratio = vocabulary_module.NEAREST_RATIO
    old = exact[:, 0] <= ratio * exact[:, 1]
    same = (found[:, 0] <= ratio * found[:, 1]) == old
    return {
        "words": len(words),
        "cells": index.cells,
        "cpu_ms_500_queries": round(float(np.median(times)), 2),
        "cpu_ms_500_queries_exact_scan": round(scan, 1),
        "nearest_found": round(float((found[:, 0] == exact[:, 0]).mean()), 4),
        "nearest_found_of_known_words": round(float((found[:, 0] == exact[:, 0])[old].mean()), 4),
        "same_decision": round(float(same.mean()), 4),
    }


def _linked(neighbours: dict[int, list[int]], last: int) -> int:
    """Append a node after the last one."""
    node = last + 1
    neighbours[node] = [last] if last else []
    if last:
        neighbours[last].append(node)
    return node


def _frames() -> Iterator[RgbdFrame]:
    """Yield the real pictures of 640 x 480 without depth, which would only exclude corners."""
    folders = (("rgbd_tum_fr1_rpy_head", "**/*.jpg"), ("rgbd_tsdf_sample50", "*.color.jpg"))
    for folder, pattern in folders:
        for stamp, path in enumerate(sorted((DATA / folder).glob(pattern))):
            yield RgbdFrame(stamp, _gray(path), np.empty((0, 0), np.float32), np.eye(3))


def _copies() -> Iterator[Bytes]:
    """Yield altered copies of the pictures: mirrored, in quarter turns, turned and zoomed."""
    pictures = [frame.image for frame in _frames()]
    pictures += [_gray(DATA / "places_rtabmap" / "images" / f"{i}.jpg") for i in range(1, 85)]
    for degrees, zoom in ((0.0, 1.0), (10.0, 1.3), (-15.0, 0.75), (25.0, 1.15)):
        for quarters in range(8):
            if quarters == 0:
                continue
            for picture in pictures:
                image = np.rot90(picture[:, ::-1] if quarters >= 4 else picture, quarters % 4)
                yield _turned(np.ascontiguousarray(image), degrees, zoom)


def _turned(image: Bytes, degrees: float, zoom: float) -> Bytes:
    height, width = image.shape
    motion = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, zoom)
    return np.asarray(cv2.warpAffine(image, motion, (width, height), borderMode=cv2.BORDER_REFLECT), np.uint8)


def _gray(path: Path) -> Bytes:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None, path
    return np.asarray(image, np.uint8)


def _draw(results: list[Recognition], path: Path) -> None:
    """Draw the belief over the places at each picture, with the accepted closures."""
    size = len(results)
    belief: FloatArray = np.full((size, size + 1), np.nan)
    for result in results:
        if len(result.places) and len(result.posterior) > 1:
            belief[result.node - 1, 0] = result.posterior[0]
            belief[result.node - 1, result.places] = result.posterior[1:]
    figure, (left, right) = new_figure(13.0, 6.2, columns=2, width_ratios=(1.25, 1.0))
    shown = left.imshow(
        belief, origin="lower", cmap="viridis", vmin=0.0, vmax=0.6, extent=(-0.5, size + 0.5, 0.5, size + 0.5)
    )
    figure.colorbar(shown, ax=left, label="posterior", shrink=0.85)
    right_ones = [r for r in results if r.closure is not None and r.node - r.closure in RIGHT_LAGS]
    wrong_ones = [r for r in results if r.closure is not None and r.node - r.closure not in RIGHT_LAGS]
    for found, colour, name in ((right_ones, "#d55e00", "right"), (wrong_ones, "#cc79a7", "wrong")):
        where = [r.closure for r in found], [r.node for r in found]
        left.scatter(*where, s=34, facecolors="none", edgecolors=colour, label=f"accepted, {name}: {len(found)}")
    left.set(xlabel="place (0: a new place)", ylabel="picture", title="Belief after each picture")
    left.legend(loc="lower right", fontsize=9)
    compared = [r for r in results if len(r.posterior) > 1]
    right.plot([r.node for r in compared], [r.value for r in compared], color="#0072b2", label="1 - P(new place)")
    right.axhline(
        RecognitionSettings().accept, color="black", linewidth=0.8, linestyle="--", label="accepted from here"
    )
    right.scatter([r.node for r in right_ones], [r.value for r in right_ones], s=18, color="#d55e00", label="closure")
    right.set(xlabel="picture", ylabel="value of the hypothesis", ylim=(0, 1), title="Known again")
    right.legend(loc="upper left", fontsize=9)
    with replacing(path) as aside:
        figure.savefig(aside)
