"""Pose graphs in space: distance of the spatial back end from the best solution that gtsam finds from a chordal start."""

from __future__ import annotations

import gzip
import math
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.figures.mapping.logs import DATA
from waychair.slam.graph.spatial_least_squares import SpatialEdge, SpatialProblem
from waychair.slam.rgbd.spatial_graph import solve_spatial
from waychair.types import FloatArray, Json, Pose3

_BAR = 1.001  # greatest ratio of the sum of chi-squares to that of the best solution


def spatial_posegraphs(out: Path) -> Json:
    """Sum of chi-squares at most 0.1 % above the best from a chordal start; the start is dead reckoning.

    Two graphs are published recordings and simulations, two are drawn: a torus of 5,000 nodes, and a sphere of great noise.
    """
    graphs: Json = {}
    for name in ("sphere2500", "parking-garage", "torus", "sphere_great_noise"):
        edges, count = _drawn(name) if name.startswith(("torus", "sphere_")) else _read(name)
        problem, start = SpatialProblem(edges), chained(edges, count)
        chordal = problem.chordal_start(start[0], count)
        best = math.inf if chordal is None else float(problem.chi_square(problem.solve(chordal)).sum())
        started = time.process_time()
        solved = solve_spatial(start, edges)
        seconds = time.process_time() - started
        value = float(problem.chi_square(solved.poses).sum())
        graphs[name] = {"chi_square": value, "best": best, "ratio": value / best, "cpu_s": round(seconds, 2)}
    worst = max(graph["ratio"] for graph in graphs.values())
    return {"passed": worst <= _BAR, "bar": _BAR, "worst_ratio": worst, "graphs": graphs}


def chained(edges: Sequence[SpatialEdge], count: int) -> list[Pose3]:
    """Return `count` poses chained along the edges between consecutive nodes."""
    steps = {edge.i: edge.i_from_j for edge in edges if edge.j == edge.i + 1}
    poses = [Pose3(np.eye(3), np.zeros(3))]
    for node in range(count - 1):
        poses.append(poses[-1] @ steps[node])
    return poses


def _read(name: str) -> tuple[list[SpatialEdge], int]:
    """Return the edges and the number of nodes of a published graph; edges between neighbours are odometry."""
    import gtsam

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "graph.g2o"
        path.write_bytes(gzip.decompress((DATA / "posegraphs" / f"{name}.g2o.gz").read_bytes()))
        graph, values = gtsam.readG2o(str(path), True)
    edges = []
    for k in range(graph.size()):
        factor: Any = graph.at(k)  # gtsam has no types for it
        i, j = factor.keys()
        measured = factor.measured()
        pose = Pose3(measured.rotation().matrix(), np.asarray(measured.translation()))
        edges.append(SpatialEdge(i, j, pose, factor.noiseModel().covariance(), loop=j != i + 1))
    return edges, int(values.size())


def _drawn(name: str) -> tuple[list[SpatialEdge], int]:
    """Return the edges and the number of nodes of a spiral on a torus or a sphere, each turn tied to the last."""
    if name == "torus":
        return _tied(_torus(100, 50), 50, 0.05, 0.05)
    return _tied(_sphere(50, 44), 44, 0.1, 0.25)


def _tied(truth: list[Pose3], turn: int, far: float, bent: float) -> tuple[list[SpatialEdge], int]:
    """Return edges with noise of `far` [m] and `bent` [rad] between neighbours along the spiral and across its turns."""
    rng = np.random.default_rng(0)
    pairs = [(k, k + 1) for k in range(len(truth) - 1)] + [(k, k + turn) for k in range(len(truth) - turn)]
    covariance = np.diag([bent**2] * 3 + [far**2] * 3)
    edges = []
    for i, j in pairs:
        noise = Pose3(_turned(bent * rng.normal(size=3)), far * rng.normal(size=3))
        edges.append(SpatialEdge(i, j, truth[i].inverse() @ truth[j] @ noise, covariance, loop=j != i + 1))
    return edges, len(truth)


def _turned(vector: FloatArray) -> FloatArray:
    import gtsam

    rotation: FloatArray = gtsam.Rot3.Expmap(vector).matrix()
    return rotation


def _torus(turns: int, steps: int, large: float = 10.0, small: float = 4.0) -> list[Pose3]:
    """Return poses of a coil round a torus: x along the coil, z away from its core."""
    minor = 2 * np.pi * np.arange(turns * steps) / steps
    major = minor / turns
    out = np.stack([np.cos(major) * np.cos(minor), np.sin(major) * np.cos(minor), np.sin(minor)], axis=1)
    core = np.stack([np.cos(major), np.sin(major), np.zeros_like(major)], axis=1)
    return _along(large * core + small * out, out)


def _sphere(turns: int, steps: int, radius: float = 20.0) -> list[Pose3]:
    """Return poses of a spiral from pole to pole of a sphere: x along the spiral, z outwards."""
    round_ = 2 * np.pi * np.arange(turns * steps) / steps
    down = np.pi * (np.arange(turns * steps) + 1) / (turns * steps + 1)
    out = np.stack([np.sin(down) * np.cos(round_), np.sin(down) * np.sin(round_), np.cos(down)], axis=1)
    return _along(radius * out, out)


def _along(places: FloatArray, out: FloatArray) -> list[Pose3]:
    poses = []
    for place, up, ahead in zip(places, out, np.gradient(places, axis=0), strict=True):
        side = np.cross(up, ahead)
        side /= np.linalg.norm(side)
        poses.append(Pose3(np.stack([np.cross(side, up), side, up], axis=1), place))
    return poses
