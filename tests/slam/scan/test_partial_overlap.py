"""Loop closure by partial overlap: a small common part proves a place; no overlap, or another place, does not."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tests.slam.conftest import scan_at
from waychair.geometry import pose_from_array, transform_points
from waychair.slam.scan import partial_overlap
from waychair.slam.scan.partial_overlap import PartialOverlap, find_partial_overlap, known_ground
from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_scans
from waychair.slam.scan.scan_matching import MatchSettings, Window, correlative_search
from waychair.slam.scan.scan_points import ScanPoints, ScanStore, scan_points
from waychair.types import BoolArray, FloatArray, Pose2

MATCHING = MatchSettings()
EARLIER = [Pose2(1.0 + 0.2 * k, 1.5, 0.0) for k in range(6)]
"""Looking along the flat's south side; the chair comes back looking at its west side."""
BACK = Pose2(1.8, 1.9, math.pi / 2 + 0.6)

LEAST = partial_overlap.MIN_EVIDENCE


@pytest.fixture(autouse=True)
def little_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """The short-sighted scans of these tests have few points."""
    monkeypatch.setattr(partial_overlap, "MIN_EVIDENCE", 8.0)


def short_sighted(pose: Pose2, seed: int = 0) -> ScanPoints:
    scan = scan_at(pose, noise=0.005, seed=seed)
    return scan_points(dataclasses.replace(scan, range_max=4.0), Pose2(), 20.0)


def map_of(poses: list[Pose2]) -> tuple[ScanStore, FloatArray, ScanReference, BoolArray]:
    store = ScanStore()
    for k, pose in enumerate(poses):
        store.append(short_sighted(pose, k))
    array = np.array([pose.array() for pose in poses])
    reference = reference_from_scans(store, array, range(len(poses)), array[0], 12.0, 0.05, 0.06)
    return store, array, reference, known_ground(store, array, range(len(poses)), Pose2(), reference)


def found_from(guess: Pose2, query: ScanPoints) -> PartialOverlap | None:
    _, _, reference, known = map_of(EARLIER)
    return find_partial_overlap(query, reference, known, guess, Window(0.8, 0.3), MATCHING)


@pytest.mark.parametrize("away", [Pose2(), Pose2(0.5, -0.3, 0.2), Pose2(-0.4, 0.6, -0.25)])
def test_a_place_is_recognised_by_a_small_overlap_of_both_views(away: Pose2) -> None:
    query, guess = short_sighted(BACK, 9), BACK @ away
    found = found_from(guess, query)
    assert found is not None
    gap = BACK.inverse() @ found.pose
    assert math.hypot(gap.x, gap.y) < 0.05
    assert abs(gap.theta) < 0.02
    assert found.points < 0.7 * len(query)
    _, _, reference, _ = map_of(EARLIER)
    whole = correlative_search(query.points, reference, guess, Window(0.8, 0.3))[1]
    assert whole < 0.75 * found.response  # the mean over all points does not show it


def test_known_ground_is_the_area_crossed_by_beams_and_nothing_behind_their_ends() -> None:
    store, poses, reference, known = map_of(EARLIER[:1])
    ends = transform_points(pose_from_array(poses[0]), store[0].points)
    eye = poses[0, :2]
    towards = (ends - eye) / np.hypot(*(ends - eye).T)[:, None]

    def share(points: FloatArray) -> float:
        cols, rows = np.floor((points - reference.origin) / reference.resolution).astype(int).T
        return float(known[rows, cols].mean())

    assert share(ends - 0.3 * towards) > 0.98
    assert share(ends) == 1.0
    assert share(ends + 0.5 * towards) < 0.1
    assert share(np.array([[eye[0] - 0.5, eye[1]]])) == 0.0  # behind the chair


def test_the_found_place_is_the_best_of_a_full_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain numpy over the steps of the search, without bounds."""
    _, _, reference, known = map_of(EARLIER)
    query = short_sighted(BACK, 9).thinned(60)
    likelihood, doubt = reference.bounds[0] / 255.0, round(255 * partial_overlap.NEUTRAL_LIKELIHOOD) / 255.0
    best = 0.0
    far = max(1.0, float(np.quantile(np.hypot(*query.points.T), 0.8)))
    step = math.acos(1 - reference.resolution**2 / (2 * far**2))
    cells, angles = math.ceil(0.3 / 0.05), math.ceil(0.1 / step)
    for a in range(-angles, angles + 1):
        turned = transform_points(Pose2(BACK.x, BACK.y, BACK.theta + a * step), query.points)
        cols, rows = np.floor((turned - reference.origin) / reference.resolution).astype(int).T
        for row in range(-cells, cells + 1):
            for col in range(-cells, cells + 1):
                here = rows + row, cols + col
                best = max(best, float(np.where(known[here], likelihood[here] - doubt, 0.0).sum()))
    for name, value in (("MIN_EVIDENCE", 1.0), ("MAX_AMBIGUITY", 1.0), ("MIN_RESPONSE", 0.0)):
        monkeypatch.setattr(partial_overlap, name, value)
    found = find_partial_overlap(query, reference, known, BACK, Window(0.3, 0.1), MATCHING)
    assert found is not None
    assert found.evidence == pytest.approx(best, abs=1e-6)


def test_a_search_in_pieces_finds_the_same_place() -> None:
    _, _, reference, known = map_of(EARLIER)
    query, guess = short_sighted(BACK, 1), BACK @ Pose2(0.3, -0.2, 0.1)
    whole = find_partial_overlap(query, reference, known, guess, Window(0.8, 0.3), MATCHING)
    pieces = partial_overlap.OverlapSearch(query, reference, known, guess, Window(0.8, 0.3))
    count = 1
    while not pieces.go_on(MATCHING, 20_000):
        count += 1
    assert whole is not None
    assert pieces.found is not None
    assert pieces.found.pose == whole.pose
    assert pieces.found.evidence == whole.evidence
    assert count > 10


def test_views_without_common_ground_prove_nothing() -> None:
    assert found_from(Pose2(1.0, 7.5, math.pi / 2), short_sighted(Pose2(1.0, 7.5, math.pi / 2))) is None


def test_another_place_is_not_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(partial_overlap, "MIN_EVIDENCE", LEAST)
    for pose in (Pose2(10.5, 7.0, 0.3), Pose2(6.0, 7.6, 2.0), Pose2(10.8, 4.0, -1.0)):
        assert found_from(BACK, short_sighted(pose)) is None


def test_a_bare_wall_that_fits_anywhere_along_itself_is_ambiguous(monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.arange(-2.0, 2.0, 0.05)
    wall = ScanPoints(np.stack([x, np.full_like(x, 1.0)], axis=1), np.tile([0.0, -1.0], (len(x), 1)))
    store = ScanStore()
    for _ in range(2):
        store.append(wall)
    poses = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])
    reference = reference_from_scans(store, poses, [0, 1], poses[0], 10.0, 0.05, 0.06)
    known = known_ground(store, poses, [0, 1], Pose2(), reference)
    query = ScanPoints(wall.points[20:60], wall.normals[20:60])
    assert find_partial_overlap(query, reference, known, Pose2(0.7, 0, 0), Window(0.8, 0.2), MATCHING) is None
    monkeypatch.setattr(partial_overlap, "MAX_AMBIGUITY", 1.0)
    assert find_partial_overlap(query, reference, known, Pose2(0.7, 0, 0), Window(0.8, 0.2), MATCHING) is not None


def test_a_query_without_points_has_no_place() -> None:
    assert found_from(BACK, ScanPoints(np.empty((0, 2)), np.empty((0, 2)))) is None
