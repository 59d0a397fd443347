"""A drive of two laps round a circle with loops between them, and graphs that are fed node by node."""

from __future__ import annotations

import numpy as np

from waychair.geometry import compose
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.pose_graph import PoseGraph
from waychair.types import FloatArray, Pose2


def rmse(poses: FloatArray, truth: FloatArray) -> float:
    return float(np.sqrt(((poses - truth)[:, :2] ** 2).sum(axis=1).mean()))


def measured(truth: FloatArray, i: int, j: int, kind: EdgeKind, off: Pose2 | None = None) -> Edge:
    relative = Pose2(*truth[i].tolist()).inverse() @ Pose2(*truth[j].tolist()) @ (off or Pose2())
    return Edge(i, j, relative, np.diag([1e4, 1e4, 1e4]), kind)


def grown(edges: tuple[Edge, ...] | list[Edge], start: FloatArray) -> PoseGraph:
    """A graph fed node by node, each node placed by its first edge."""
    graph = PoseGraph()
    graph.add(start[:1], [])
    for node in range(1, len(start)):
        new = [edge for edge in edges if max(edge.i, edge.j) == node]
        new.sort(key=lambda edge: edge.kind is EdgeKind.LOOP)
        graph.add(compose(graph.poses[node - 1], new[0].i_from_j.array())[None], new)
        graph.update()
    return graph


def laps() -> tuple[FloatArray, list[Edge]]:
    """True poses of two laps round a circle and their odometry with small errors, with loops between the laps."""
    angles = np.linspace(0, 4 * np.pi, 80, endpoint=False)
    truth = np.column_stack([5 * np.cos(angles), 5 * np.sin(angles), np.remainder(angles + np.pi / 2, 2 * np.pi)])
    edges = [measured(truth, k, k + 1, EdgeKind.MATCH, Pose2(0.003, 0, 0.004)) for k in range(79)]
    edges += [measured(truth, k, k + 40, EdgeKind.LOOP) for k in range(0, 40, 4)]
    return truth, edges
