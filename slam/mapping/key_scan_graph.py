"""The key scans of a map: their surface points, their poses, and the edges between them."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from waychair.geometry import rotation, transform_points, wrap_angles
from waychair.slam.graph.edges import EdgeArrays
from waychair.slam.graph.graph_optimisation import Edge, EdgeKind, RejectedLoop
from waychair.slam.graph.information import unknown_information
from waychair.slam.graph.least_squares import connected_parts
from waychair.slam.graph.pose_graph import PoseGraph
from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_scans
from waychair.slam.scan.scan_matching import BEAM_SIGMA
from waychair.slam.scan.scan_points import ScanPoints, ScanStore
from waychair.types import FloatArray, IntArray, Pose2

_CROWD = 4  # key scans; as many cover one view only where a chair stays in one room for hours


class KeyGraph:
    """A pose graph whose node k is key scan k."""

    _known_rejected: tuple[Edge, ...] = ()  # of the class, since older sessions were saved without it

    def __init__(self) -> None:
        self.store = ScanStore()
        self._graph = PoseGraph()
        self._neighbours: list[set[int]] = []
        self.kinds: Counter[EdgeKind] = Counter()
        """Number of accepted edges of each kind."""

    def __len__(self) -> int:
        return len(self.store)

    @property
    def poses(self) -> FloatArray:
        """Poses (N, 3) [m, m, rad] of the base at each key scan, in the map frame."""
        return self._graph.poses

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The accepted edges, which determine the poses."""
        return self._graph.edges

    @property
    def edge_arrays(self) -> EdgeArrays:
        """The accepted edges as arrays; valid until the next change."""
        return self._graph.edge_arrays

    @property
    def rejected(self) -> tuple[RejectedLoop, ...]:
        """The rejected loops, with reasons."""
        return self._graph.rejected

    @property
    def is_torn(self) -> bool:
        """Whether the graph has an edge of unknown motion."""
        return self.kinds[EdgeKind.UNKNOWN] > 0

    def pose(self, node: int) -> Pose2:
        """Return `map_from_base` of a key scan."""
        x, y, theta = self.poses[node].tolist()
        return Pose2(x, y, theta)

    def add(self, scan: ScanPoints, edge: Edge | None) -> int:
        """Add a key scan at the end of its edge (at the origin without an edge); return its node."""
        pose = Pose2() if edge is None else self.pose(edge.i) @ edge.i_from_j
        self._neighbours.append(set())
        self._graph.add(pose.array()[None], [] if edge is None else [edge])
        if edge is not None:
            self._count_edge(edge)
        return self.store.append(scan)

    def link(self, edge: Edge) -> None:
        """Add an edge between two existing key scans; the poses follow at the next `optimise`."""
        self._graph.add(np.empty((0, 3)), [edge])
        self._count_edge(edge)

    def undo_tear(self, tear: Edge, edge: Edge) -> None:
        """Put an edge of known motion in the place of an edge of unknown motion between the same key scans."""
        self._graph.replace(tear, edge)
        self.kinds[tear.kind] -= 1
        self._count_edge(edge)

    def tear(self, edge: Edge, odometry: Pose2) -> bool:
        """Tear the graph at an edge over which the chair was carried against its `odometry`; return whether it is torn.

        Any other edge over the place keeps the graph whole.
        """
        if sum((other.i < edge.j) != (other.j < edge.j) for other in self.edges) > 1:
            return False
        self._graph.replace(edge, Edge(edge.i, edge.j, odometry, unknown_information(), EdgeKind.UNKNOWN))
        self._count_edges()
        return True

    @property
    def is_judging(self) -> bool:
        """Whether loops in doubt are being judged, which every `optimise` goes on with."""
        return self._graph.is_judging

    def optimise(self) -> None:
        """Optimise the poses incrementally for all edges so far, except loops in doubt."""
        self._graph.update()
        self._drop_rejected()

    def optimise_fully(self) -> None:
        """Optimise the whole graph, and check every rejected loop again."""
        self._graph.solve()
        self._drop_rejected()

    def _count_edge(self, edge: Edge) -> None:
        self.kinds[edge.kind] += 1
        if edge.kind is EdgeKind.UNKNOWN:  # the chair did not drive along this edge
            return
        self._neighbours[edge.i].add(edge.j)
        self._neighbours[edge.j].add(edge.i)

    def _drop_rejected(self) -> None:
        """Remove rejected loops from the paths through the graph, and put back those that are accepted again."""
        known = {id(edge): edge for edge in self._known_rejected}
        rejected = {id(loop.edge): loop.edge for loop in self.rejected}
        if rejected.keys() == known.keys():
            return
        self._known_rejected = tuple(rejected.values())
        for name in known.keys() - rejected.keys():
            self._count_edge(known[name])
        arrays = self.edge_arrays
        low, high = np.minimum(arrays.i, arrays.j), np.maximum(arrays.i, arrays.j)
        for name in rejected.keys() - known.keys():
            edge = rejected[name]
            self.kinds[edge.kind] -= 1
            if not ((low == min(edge.i, edge.j)) & (high == max(edge.i, edge.j)) & ~arrays.torn).any():
                self._neighbours[edge.i].discard(edge.j)
                self._neighbours[edge.j].discard(edge.i)

    def _count_edges(self) -> None:
        """Count all accepted edges anew."""
        self._known_rejected = tuple(loop.edge for loop in self.rejected)
        self._neighbours = [set() for _ in self._neighbours]
        self.kinds.clear()
        for edge in self.edges:
            self._count_edge(edge)

    def for_next_drive(self, renewed: Mapping[int, ScanPoints]) -> KeyGraph:
        """Return a copy for another drive: with the present poses, without rejected loops and optimisation history, and
        with the newer surfaces `renewed` of some key scans."""
        graph = KeyGraph()
        for node in range(len(self)):
            graph.store.append(renewed.get(node, self.store[node]))
            graph._neighbours.append(set())
        graph._graph.add(self.poses.copy(), self.edges)
        for edge in self.edges:
            graph._count_edge(edge)
        return graph

    def parts(self) -> IntArray:
        """Return the part (N,) of the map that each key scan belongs to, from 0 on; edges of known motion join those of one part."""
        edges = self.edge_arrays
        return connected_parts(edges.i[~edges.torn], edges.j[~edges.torn], len(self))

    def reaches(self, node: int, before: int) -> bool:
        """Return whether a path along the edges leads from a key scan to one whose number is below `before`."""
        seen, waiting = {node}, [node]
        while waiting:
            here = waiting.pop()
            if here < before:
                return True
            fresh = self._neighbours[here] - seen
            seen |= fresh
            waiting += fresh
        return False

    def reference(
        self, members: Sequence[int] | IntArray, centre: FloatArray, reach: float, resolution: float
    ) -> ScanReference:
        """Return the surfaces of some key scans within `reach` [m] of the centre (2,) [m] in the map frame, in cells of side
        `resolution` [m]."""
        return reference_from_scans(
            self.store, self.poses, members=members, centre=centre, reach=reach, resolution=resolution, sigma=BEAM_SIGMA
        )

    def joined_points(self, members: Sequence[int], base: Pose2, cell: float) -> ScanPoints:
        """Return the joined points of some key scans in the frame of `base`, one point per cell of side `cell` [m]."""
        points, normals = [], []
        for node in members:
            base_from_node = base.inverse() @ self.pose(node)
            scan = self.store[node]
            points.append(transform_points(base_from_node, scan.points))
            normals.append(scan.normals @ rotation(base_from_node.theta).T)
        every, facing = np.concatenate(points), np.concatenate(normals)
        _, first = np.unique(np.floor(every / cell).astype(np.int64), axis=0, return_index=True)
        return ScanPoints(np.ascontiguousarray(every[first]), np.ascontiguousarray(facing[first]))

    def path_lengths(self, node: int, limit: float, most: float = math.inf) -> dict[int, float]:
        """Return the lengths [m] of the shortest paths along the edges, from a key scan to those within `limit` [m], or to the
        `most` nearest of them."""
        poses, best, queue = self.poses, {node: 0.0}, [(0.0, node)]
        settled: dict[int, float] = {}
        while queue and len(settled) < most:
            driven, here = heapq.heappop(queue)
            if here in settled:
                continue
            settled[here] = driven
            x, y = poses.item(here, 0), poses.item(here, 1)
            for there in self._neighbours[here]:
                length = driven + math.hypot(poses.item(there, 0) - x, poses.item(there, 1) - y)
                if length < min(limit, best.get(there, math.inf)):
                    best[there] = length
                    heapq.heappush(queue, (length, there))
        return settled

    def covering_key(
        self, node: int, pose: Pose2, max_path: float, distance: float, angle: float, crowded_path: float
    ) -> int | None:
        """Return the nearest key scan that covers the view from a pose, or None.

        It lies within `distance` [m] and `angle` [rad] of the pose, and within `max_path` [m] of `node` along the edges, so
        that the relative pose of the two is well known. Where a crowd of key scans covers the view within `crowded_path` [m],
        the nearest of these will do: a chair that stays in one room for days would add key scans without end.
        """
        near = self.path_lengths(node, max_path)
        if here := self._covering(np.array(sorted(near)), pose, distance, angle):
            return here[0]
        crowd = self._covering(np.arange(len(self)), pose, distance, angle)
        if len(crowd) < _CROWD:
            return None
        reached = self.path_lengths(node, crowded_path)
        crowd = [key for key in crowd if key in reached]
        return crowd[0] if len(crowd) >= _CROWD else None

    def _covering(self, among: IntArray, pose: Pose2, distance: float, angle: float) -> list[int]:
        """Return those of some key scans (K,) within `distance` [m] and `angle` [rad] of a pose, the nearest first."""
        poses = self.poses[among]
        away = np.hypot(*(poses[:, :2] - (pose.x, pose.y)).T)
        turned = np.abs(wrap_angles(poses[:, 2] - pose.theta))
        cost = np.where((away < distance) & (turned < angle), away / distance + turned / angle, math.inf)
        order = np.argsort(cost, kind="stable")
        return [int(node) for node in among[order[: np.isfinite(cost).sum()]]]
