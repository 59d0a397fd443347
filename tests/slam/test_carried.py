"""Detection of a kidnapped chair, and the area of its search."""

from __future__ import annotations

import numpy as np
import pytest

from tests.slam.conftest import scan_at
from waychair.geometry import transform_points
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.information import (
    MATCH_POSITION_SIGMA,
    match_information,
    odometry_information,
    rotated_information,
    unknown_information,
)
from waychair.slam.mapping.loop_closure import LoopSettings, candidates, graph_distances, uncertain_submaps
from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_points
from waychair.slam.scan.scan_matching import crossed_share
from waychair.slam.scan.scan_points import scan_points
from waychair.types import Pose2

HERE = Pose2(1.5, 1.5, 0.4)


def seen_from(*poses: Pose2) -> ScanReference:
    scans = [(pose, scan_points(scan_at(pose), Pose2(), 20.0)) for pose in poses]
    points = np.concatenate([transform_points(pose, scan.points) for pose, scan in scans])
    normals = np.concatenate([transform_points(Pose2(0, 0, pose.theta), scan.normals) for pose, scan in scans])
    return reference_from_points(points, normals, 0.05, 0.06)


def test_a_chair_that_stayed_sees_through_no_wall() -> None:
    scan = scan_points(scan_at(HERE, noise=0.01), Pose2(), 20.0)
    assert crossed_share(scan, Pose2(), seen_from(HERE, Pose2(1.8, 1.5, 0.4)), HERE) < 0.05


def test_a_chair_elsewhere_sees_through_walls() -> None:
    scan = scan_points(scan_at(Pose2(10.0, 7.0, 2.5)), Pose2(), 20.0)
    assert crossed_share(scan, Pose2(), seen_from(HERE, Pose2(1.8, 1.5, 0.4)), HERE) > 0.4


def test_people_round_the_chair_hide_walls_but_contradict_none() -> None:
    crowded = scan_at(HERE)
    crowded.ranges[20:160] = np.minimum(crowded.ranges[20:160], 0.8)
    assert crossed_share(scan_points(crowded, Pose2(), 20.0), Pose2(), seen_from(HERE), HERE) < 0.05


def test_an_edge_of_unknown_motion_needs_a_search_of_submaps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("waychair.slam.mapping.loop_closure._SUBMAP_SCANS", 10)
    settings = LoopSettings()
    poses = np.array([[0.2 * k, 0.0, 0.0] for k in range(41)])
    kinds = [EdgeKind.UNKNOWN if k == 29 else EdgeKind.MATCH for k in range(40)]
    edges = [Edge(k, k + 1, Pose2(0.2, 0, 0), unknown_information(), kind) for k, kind in enumerate(kinds)]
    ways = graph_distances(poses, edges, 40)[:35]
    assert candidates(poses, ways, settings) == ()
    assert list(uncertain_submaps(poses, ways, settings)) == [2, 1, 0]  # nearest first


def test_information_falls_with_the_distance_and_rotates_with_the_frame() -> None:
    near, far = odometry_information(Pose2(0.1, 0, 0)), odometry_information(Pose2(2.0, 0, 0.5))
    assert (np.diag(far) < np.diag(near)).all()
    assert (np.diag(unknown_information()) < np.diag(far)).all()
    assert np.sqrt(np.linalg.inv(match_information(1e12 * np.eye(3)))[0, 0]) == pytest.approx(MATCH_POSITION_SIGMA)
    quarter = rotated_information(np.diag([1.0, 2.0, 3.0]), np.pi / 2)
    assert quarter == pytest.approx(np.diag([2.0, 1.0, 3.0]), abs=1e-12)
