"""g2o text: round trips, missing vertices filled by odometry, and errors for damaged files."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from waychair.errors import GraphError
from waychair.slam.graph.graph_optimisation import Edge, EdgeKind, read_g2o, write_g2o
from waychair.types import Pose2

INFORMATION = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]])
ODD_EDGE = "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"


def test_a_written_graph_is_read_back_unchanged(tmp_path: Path) -> None:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.3], [2.0, 0.5, -3.0]])
    edges = [
        Edge(0, 1, Pose2(1.0, 0.1, 0.3), INFORMATION, EdgeKind.ODOMETRY),
        Edge(1, 2, Pose2(1.0, 0.1, 2.9), INFORMATION, EdgeKind.ODOMETRY),
        Edge(2, 0, Pose2(-2.0, 0.2, -0.1), INFORMATION, EdgeKind.LOOP),
    ]
    write_g2o(tmp_path / "graph.g2o", poses, edges)
    (tmp_path / "graph.g2o.gz").write_bytes(gzip.compress((tmp_path / "graph.g2o").read_bytes()))
    for name in ("graph.g2o", "graph.g2o.gz"):
        read, found = read_g2o(tmp_path / name)
        assert read == pytest.approx(poses)
        assert [(e.i, e.j, e.kind) for e in found] == [(e.i, e.j, e.kind) for e in edges]
        for own, other in zip(found, edges, strict=True):
            assert own.i_from_j.array() == pytest.approx(other.i_from_j.array())
            assert own.information == pytest.approx(INFORMATION)


def test_nodes_without_a_vertex_line_are_placed_by_the_odometry_edges(tmp_path: Path) -> None:
    path = tmp_path / "edges.g2o"
    path.write_text("# only edges\n\n" + "EDGE_SE2 7 9 1 0 1.5707963267948966 1 0 0 1 0 1\n" * 1
                    + "EDGE_SE2 12 9 -1 0 0 1 0 0 1 0 1\nFIX 7\n")  # fmt: skip
    poses, edges = read_g2o(path)
    assert poses == pytest.approx(np.array([[0, 0, 0], [1, 0, np.pi / 2], [1, 1, np.pi / 2]]))
    assert [(e.i, e.j, e.kind) for e in edges] == [(0, 1, EdgeKind.ODOMETRY), (2, 1, EdgeKind.ODOMETRY)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ODD_EDGE + "EDGE_SE2 1 2 1 0\n", "line 2: 2 numbers instead of 9"),
        (ODD_EDGE + "VERTEX_SE2 x 0 0 0\n", "line 2: .*'x'"),
        (ODD_EDGE + "VERTEX_SE2 0 nan 0 0\n", "line 2: .*not finite"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 -1 0 1\n", "line 1: .*positive definite"),
        ("EDGE_SE2 3 3 1 0 0 1 0 0 1 0 1\n", "line 1: .*node 3 to itself"),
        ("EDGE_SE3:QUAT 0 1 1 0 0\n", "line 1: 'EDGE_SE3:QUAT' is not a planar"),
        ("EDGE_SE2\n", "line 1"),
        ("VERTEX_SE2 0 0 0 0\n", "no EDGE_SE2 line"),
        ("", "no EDGE_SE2 line"),
        ("EDGE_SE2 0 2 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n", "node 1 has no VERTEX_SE2 line"),
    ],
)
def test_a_damaged_file_is_named_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.g2o"
    path.write_text(text)
    with pytest.raises(GraphError, match=words):
        read_g2o(path)


def test_a_missing_file_or_one_that_cannot_be_unpacked_is_named(tmp_path: Path) -> None:
    whole = gzip.compress(ODD_EDGE.encode() * 50)
    for name, data in (("cut.g2o.gz", whole[:-12]), ("text.g2o.gz", ODD_EDGE.encode()), ("bytes.g2o", b"\xff\xfe\x00")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(GraphError, match=name):
            read_g2o(tmp_path / name)
    with pytest.raises(GraphError, match="No such file"):
        read_g2o(tmp_path / "missing.g2o")
