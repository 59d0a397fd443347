"""Loading everything that a mapper may need only in the middle of a drive, so that no scan waits for it.

Kernels are loaded from numba's cache, or compiled, and libraries imported, at their first use: without this, the first loop
in doubt costs a quarter of a second, and on a new computer ten.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.slam.graph.graph_optimisation import Edge, EdgeKind
from waychair.slam.mapping.carried import CarryJudge
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.mapping.loop_candidates import graph_distances
from waychair.slam.scan.partial_overlap import find_partial_overlap, known_ground
from waychair.slam.scan.scan_matching import MatchSettings, Window, match
from waychair.slam.scan.scan_points import scan_points
from waychair.slam.scan.submap_search import SubmapPyramids, global_candidates
from waychair.types import Pose2, Scan, Twist

_REACH, _BEAMS, _KEY_SCANS = 6.0, 181, 24  # m; of a scan; round a ring


def warm_up() -> None:
    """Match, search and judge once in a small square room, by every kernel that a mapper has."""
    mount, matching = Pose2(0.1), MatchSettings()
    bearings = np.linspace(-math.pi, math.pi, _BEAMS)
    ranges = 2.0 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    step = float(bearings[1] - bearings[0])
    scan = Scan(0, ranges.astype(np.float32), -math.pi, step, time_step=1e-4, range_max=30.0)
    seen = scan_points(scan, mount, 30.0, Twist(0.1, 0.0))
    keys, exact = KeyGraph(), 1e4 * np.eye(3)
    around = Pose2(0.3, 0.0, math.tau / _KEY_SCANS)
    keys.add(seen, None)
    for node in range(1, _KEY_SCANS):
        keys.add(seen, Edge(node - 1, node, around, exact, EdgeKind.MATCH))
    keys.link(Edge(0, _KEY_SCANS - 1, around.inverse(), exact, EdgeKind.LOOP))
    for node in range(4):  # false loops: they are judged
        keys.link(Edge(node, node + 12, Pose2(float(node), 5.0), exact, EdgeKind.LOOP))
    keys.optimise()
    for node in (10, 11):  # true ones: the solution goes on, the second time in a known order
        keys.link(Edge(1, node, keys.pose(1).inverse() @ keys.pose(node), exact, EdgeKind.LOOP))
        keys.optimise()
    keys.optimise_fully()
    graph_distances(keys.poses, keys.edge_arrays, 0)
    nodes = list(range(_KEY_SCANS))
    reference = keys.reference(nodes, keys.poses[0], _REACH, matching.resolution)
    match(seen, reference, Pose2(), np.eye(3), Window(0.3, 0.1), matching)
    known = known_ground(keys.store, keys.poses, nodes[::6], mount, reference)
    find_partial_overlap(seen, reference, known=known, guess=Pose2(), window=Window(0.3, 0.1), matching=matching)
    members = {0: np.array(nodes, np.int64)}
    global_candidates(keys.store, keys.poses, members, seen.points, SubmapPyramids())
    CarryJudge(matching, _REACH, mount).embedded(keys, nodes[:2], nodes[2:4], Pose2())
