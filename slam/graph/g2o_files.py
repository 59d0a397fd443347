"""Read and write pose graphs as g2o text (VERTEX_SE2, EDGE_SE2), plain or gzipped."""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from waychair.errors import GraphError
from waychair.files import write_text
from waychair.geometry import pose_from_array
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.types import FloatArray, IntArray, Pose2

_UPPER = np.triu_indices(3)
_SKIPPED = ("FIX", "PARAMS_SE2OFFSET")  # the fixed node and the sensor offset; both keep their defaults here


def read_g2o(path: Path) -> tuple[FloatArray, tuple[Edge, ...]]:
    """Read poses (N, 3) and edges of a g2o file; a file name that ends in .gz is unpacked.

    Nodes are numbered 0 to N - 1 in the order of their identifiers. An edge between neighbours in that order is
    odometry, every other edge a loop. A node without a VERTEX_SE2 line gets its pose from the odometry edges.

    Raises:
        GraphError: the file is missing, is no gzip or text, has an invalid line (named by its number) or no edge, or a
            node has neither a VERTEX_SE2 line nor an odometry edge.
    """
    vertices: dict[int, FloatArray] = {}
    rows: list[tuple[int, int, Pose2, FloatArray]] = []
    for number, line in enumerate(_lines(path), 1):
        word, *rest = line.split() or ["#"]
        if word.startswith("#") or word in _SKIPPED:
            continue
        try:
            if word == "VERTEX_SE2":
                vertices[int(rest[0])] = _numbers(rest[1:], 3)
            elif word == "EDGE_SE2":
                rows.append(_edge_row(rest))
            else:
                raise ValueError(f"'{word}' is not a planar vertex or edge")
        except (ValueError, IndexError) as error:
            raise GraphError(f"{path}, line {number}: {error}; repair or remove the line") from error
    if not rows:
        raise GraphError(f"{path} holds no EDGE_SE2 line; give a planar pose graph in g2o text")
    names = np.unique([*vertices, *(row[0] for row in rows), *(row[1] for row in rows)])
    edges = tuple(_edge(names, *row) for row in rows)
    return _poses(path, names, vertices, edges), edges


def write_g2o(path: Path, poses: FloatArray, edges: Sequence[Edge]) -> None:
    """Write VERTEX_SE2 id x y theta, and EDGE_SE2 i j dx dy dtheta with the upper triangle of the information."""
    lines = [f"VERTEX_SE2 {k} {x:.9g} {y:.9g} {theta:.9g}" for k, (x, y, theta) in enumerate(poses)]
    for edge in edges:
        numbers = [edge.i_from_j.x, edge.i_from_j.y, edge.i_from_j.theta, *edge.information[_UPPER]]
        lines.append(f"EDGE_SE2 {edge.i} {edge.j} " + " ".join(f"{value:.9g}" for value in numbers))
    write_text(path, "\n".join(lines) + "\n")


def _lines(path: Path) -> list[str]:
    try:
        data = path.read_bytes()
        return (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8").splitlines()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise GraphError(f"cannot read the pose graph {path}: {reason}; give a g2o file") from error


def _numbers(words: list[str], count: int) -> FloatArray:
    if len(words) < count:
        raise ValueError(f"{len(words)} numbers instead of {count}")
    values = np.array([float(word) for word in words[:count]])
    if not np.isfinite(values).all():
        raise ValueError("a value that is not finite")
    return values


def _edge_row(words: list[str]) -> tuple[int, int, Pose2, FloatArray]:
    i, j = int(words[0]), int(words[1])
    if i == j:
        raise ValueError(f"an edge from node {i} to itself")
    values = _numbers(words[2:], 9)
    information = np.zeros((3, 3))
    information[_UPPER] = values[3:]
    information += np.triu(information, 1).T
    if np.linalg.eigvalsh(information)[0] <= 0:
        raise ValueError("an information matrix that is not positive definite")
    return i, j, pose_from_array(values), information


def _edge(names: IntArray, i: int, j: int, i_from_j: Pose2, information: FloatArray) -> Edge:
    first, second = np.searchsorted(names, (i, j)).tolist()
    kind = EdgeKind.ODOMETRY if abs(second - first) == 1 else EdgeKind.LOOP
    wrapped = Pose2() @ i_from_j  # wraps theta to (-pi, pi]
    return Edge(first, second, wrapped, information, kind)


def _poses(path: Path, names: IntArray, vertices: dict[int, FloatArray], edges: Sequence[Edge]) -> FloatArray:
    """Return each vertex's own pose, or, for a node without one, the pose by the odometry edges."""
    forward = {}
    for edge in edges:
        if edge.kind is EdgeKind.ODOMETRY:
            low = min(edge.i, edge.j)
            forward[low] = edge.i_from_j if edge.i == low else edge.i_from_j.inverse()
    poses = [Pose2()]
    for k, name in enumerate(names.tolist()):
        own = vertices.get(name)
        if own is not None:
            pose = Pose2(float(own[0]), float(own[1]), math.remainder(float(own[2]), math.tau))
        elif k == 0:
            pose = Pose2()
        elif k - 1 in forward:
            pose = poses[-1] @ forward[k - 1]
        else:
            raise GraphError(
                f"{path}: node {name} has no VERTEX_SE2 line and no edge from the node before; add one of them"
            )
        poses.append(pose)
    return np.array([pose.array() for pose in poses[1:]])
