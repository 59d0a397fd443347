"""The pose graph as plain data, its optimisation with gtsam, and g2o text."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.config import Settings, setting
from waychair.files import write_text
from waychair.geometry import compose, invert
from waychair.types import FloatArray, Pose2


class EdgeKind(enum.Enum):
    """Where a relative pose comes from."""

    ODOMETRY = "odometry"
    MATCH = "match"
    LOOP = "loop"


@dataclass(frozen=True, slots=True)
class Edge:
    """Measured pose of node `j` in node `i`, with information (3, 3) of x, y [1/m^2], theta [1/rad^2] in j's frame."""

    i: int
    j: int
    i_from_j: Pose2
    information: FloatArray
    kind: EdgeKind


@dataclass(frozen=True, slots=True)
class GraphSettings(Settings):
    """How the graph is optimised."""

    loop_kernel: float = setting(5.0, "sigma", "width of the Cauchy kernel on loop edges", low=0.1, high=100.0)
    match_kernel: float = setting(2.0, "sigma", "width of the Huber kernel on the other edges", low=0.1, high=100.0)
    max_iterations: int = setting(50, "", "Levenberg-Marquardt steps", low=1, high=1000)


def optimise(poses: FloatArray, edges: Sequence[Edge], settings: GraphSettings) -> FloatArray:
    """Poses (N, 3) that fit the edges best, the first one held where it is.

    Robust kernels keep a false loop from bending the map (Huber on every edge was the largest single gain measured on
    the Freiburg and Intel logs; Cauchy on loops, which may be false altogether). But a narrow kernel also ignores the
    first true loop after a long drift: when the solution contradicts a loop, the problem is solved again with kernels
    that start wide and narrow down (graduated non-convexity), and the solution that contradicts fewer loops stands.
    """
    loops = [edge for edge in edges if edge.kind is EdgeKind.LOOP]
    solved = _solve(poses, edges, settings, 1.0)
    against = _contradicted(solved, loops)
    if against == 0:
        return solved
    graduated = poses
    for width in (1000.0, 10.0, 1.0):
        graduated = _solve(graduated, edges, settings, width)
    return graduated if _contradicted(graduated, loops) < against else solved


def _contradicted(poses: FloatArray, loops: Sequence[Edge]) -> int:
    """Number of loops that the poses contradict (99.9 % of chi-square with 3 degrees of freedom)."""
    return int((chi_square(poses, loops) > 16.3).sum()) if loops else 0


def _solve(poses: FloatArray, edges: Sequence[Edge], settings: GraphSettings, width: float) -> FloatArray:
    """Levenberg-Marquardt from the poses, the loops' kernel `width` times as wide as the settings say."""
    import gtsam

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for index, pose in enumerate(poses):
        values.insert(index, gtsam.Pose2(*pose))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*poses[0]), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    estimators = gtsam.noiseModel.mEstimator
    on_match, on_loop = estimators.Huber.Create(settings.match_kernel), estimators.Cauchy.Create(settings.loop_kernel * width)  # fmt: skip
    for edge in edges:
        noise = gtsam.noiseModel.Gaussian.Information(edge.information)
        robust = gtsam.noiseModel.Robust.Create(on_loop if edge.kind is EdgeKind.LOOP else on_match, noise)
        measured = gtsam.Pose2(edge.i_from_j.x, edge.i_from_j.y, edge.i_from_j.theta)
        graph.add(gtsam.BetweenFactorPose2(edge.i, edge.j, measured, robust))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(settings.max_iterations)
    parameters.setRelativeErrorTol(1e-5)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    return np.array([[p.x(), p.y(), p.theta()] for p in (result.atPose2(k) for k in range(len(poses)))])


def residuals(poses: FloatArray, edges: Sequence[Edge]) -> FloatArray:
    """(E, 3) difference of each edge's measured and present relative pose, in the frame of its node j."""
    first = poses[[edge.i for edge in edges]]
    second = poses[[edge.j for edge in edges]]
    measured = np.array([edge.i_from_j.array() for edge in edges]).reshape(-1, 3)
    return compose(invert(measured), compose(invert(first), second))


def chi_square(poses: FloatArray, edges: Sequence[Edge]) -> FloatArray:
    """(E,) squared Mahalanobis length of the residuals (3 degrees of freedom)."""
    away = residuals(poses, edges)
    information = np.array([edge.information for edge in edges]).reshape(-1, 3, 3)
    result: FloatArray = np.einsum("ei,eij,ej->e", away, information, away)
    return result


def write_g2o(path: Path, poses: FloatArray, edges: Sequence[Edge]) -> None:
    """g2o text: VERTEX_SE2 id x y theta, EDGE_SE2 i j dx dy dtheta and the upper triangle of the information."""
    lines = [f"VERTEX_SE2 {k} {x:.9g} {y:.9g} {theta:.9g}" for k, (x, y, theta) in enumerate(poses)]
    for edge in edges:
        upper = edge.information[np.triu_indices(3)]
        numbers = [edge.i_from_j.x, edge.i_from_j.y, edge.i_from_j.theta, *upper]
        lines.append(f"EDGE_SE2 {edge.i} {edge.j} " + " ".join(f"{value:.9g}" for value in numbers))
    write_text(path, "\n".join(lines) + "\n")
