"""Anchors: `anchors.yaml` beside `map.yaml` ties every drawn point to a node of the map's graph.

When further drives bend a map, its nodes (`graph.g2o`) move, and the rooms with them. Each saved point keeps the number
of the node nearest to it, its pose in that node's frame, and its pose in map at that time. If somebody has changed the
pose in the point's own file by hand since then, the changed pose counts and the anchor does not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from waychair.errors import MapError
from waychair.files import is_file, read_text, write_text
from waychair.types import FloatArray, Pose2
from waychair.yaml_files import load_yaml

ANCHORS_YAML = "anchors.yaml"
GRAPH = "graph.g2o"

_SAME = 1e-6
"""Two poses that differ by less than this [m], [rad] are the same saved pose."""


@dataclass(frozen=True, slots=True)
class Anchor:
    """A node's number, a point's pose in map when it was saved, and its pose in the node's frame."""

    node: int
    map_pose: Pose2
    node_pose: Pose2


@dataclass(frozen=True, slots=True)
class Anchors:
    """Anchors of all points by kind (`places`, ...) and name, and the nodes' present poses (N, 3) [m, m, rad].

    The anchors of one thing are in the order of its points.
    """

    by_kind: Mapping[str, Mapping[str, Sequence[Anchor]]] = field(default_factory=dict)
    nodes: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    def follow(self, kind: str, name: str, poses: Sequence[Pose2]) -> list[Pose2]:
        """Return the points of a thing moved with their nodes; a pose edited since it was saved stays as given."""
        anchors = self.by_kind.get(kind, {}).get(name, ())
        if len(anchors) != len(poses):
            return list(poses)
        return [self._followed(anchor, pose) for anchor, pose in zip(anchors, poses, strict=True)]

    def _followed(self, anchor: Anchor, pose: Pose2) -> Pose2:
        change = anchor.map_pose.inverse() @ pose
        if max(abs(change.x), abs(change.y), abs(change.theta)) > _SAME or anchor.node >= len(self.nodes):
            return pose
        return Pose2(*self.nodes[anchor.node].tolist()) @ anchor.node_pose


def load_anchors(folder: Path) -> Anchors:
    """Return the anchors of a map's folder, empty where nothing was anchored.

    Raises:
        MapError: the file is damaged, or the graph.
    """
    path = folder / ANCHORS_YAML
    if not is_file(path, MapError):
        return Anchors()
    values = load_yaml(path, MapError) or {}
    try:
        held = {
            kind: {str(name): tuple(_anchor(row) for row in rows) for name, rows in things.items()}
            for kind, things in values.items()
        }
    except (ValueError, TypeError, AttributeError) as error:
        raise MapError(f"{path} is damaged: it must hold lists of anchors by kind and name; delete it") from error
    return Anchors(held, load_nodes(folder))


def anchors_text(folder: Path, by_kind: Mapping[str, Mapping[str, Sequence[Pose2]]]) -> str | None:
    """Return the text of `anchors.yaml` with all things of some kinds anchored, by name, on the map's present nodes.

    Return None for a map without nodes. Write the text after the file of the things themselves.

    Raises:
        MapError: the file is damaged, or the graph.
    """
    known = load_anchors(folder)
    nodes = load_nodes(folder)
    if not len(nodes):
        return None
    values = {
        other: {name: [_values(anchor) for anchor in anchors] for name, anchors in held.items()}
        for other, held in known.by_kind.items()
    }
    for kind, things in by_kind.items():
        values[kind] = {name: [_values(_nearest(nodes, pose)) for pose in poses] for name, poses in things.items()}
    return yaml.safe_dump(values, sort_keys=False, default_flow_style=None, allow_unicode=True, width=10_000)


def write_anchored(path: Path, text: str, kind: str, things: Mapping[str, Sequence[Pose2]]) -> None:
    """Write the file of all things of a kind, and their anchors beside it.

    Raises:
        MapError: the anchors are damaged, or the graph.
        OutputError: the folder cannot be made or written to.
    """
    anchors = anchors_text(path.parent, {kind: things})
    write_text(path, text)
    if anchors is not None:
        write_text(path.with_name(ANCHORS_YAML), anchors)


def load_nodes(folder: Path) -> FloatArray:
    """Return the poses (N, 3) [m, m, rad] of the nodes of a map's graph, by their numbers; none without a graph.

    Raises:
        MapError: the graph is damaged.
    """
    path = folder / GRAPH
    if not is_file(path, MapError):
        return np.empty((0, 3))
    lines = read_text(path, MapError).splitlines()
    try:
        rows = [line.split() for line in lines if line.startswith("VERTEX_SE2 ")]
        poses = np.array([[float(value) for value in row[2:5]] for row in rows]).reshape(-1, 3)
        numbers = [int(row[1]) for row in rows]
    except (ValueError, IndexError) as error:
        raise MapError(f"{path} is damaged: a node has no number or no pose; map the recording again") from error
    if numbers != list(range(len(numbers))) or not np.isfinite(poses).all():
        raise MapError(f"{path} is damaged: its nodes must be numbered from 0 on and finite; map the recording again")
    return poses


def _nearest(nodes: FloatArray, pose: Pose2) -> Anchor:
    node = int(np.argmin(np.hypot(*(nodes[:, :2] - (pose.x, pose.y)).T)))
    return Anchor(node, pose, Pose2(*nodes[node].tolist()).inverse() @ pose)


def _values(anchor: Anchor) -> list[float]:
    there, here = anchor.map_pose, anchor.node_pose
    return [anchor.node, there.x, there.y, there.theta, here.x, here.y, here.theta]


def _anchor(row: Sequence[float]) -> Anchor:
    node, *values = row
    if len(values) != 6 or not all(map(math.isfinite, values)) or int(node) != node or node < 0:
        raise ValueError(f"{row} is not an anchor")
    return Anchor(int(node), Pose2(*values[:3]), Pose2(*values[3:]))
