"""Nodes of the memory and links between them. A node is an observation and never changes.

The changing data of a node (weight, age, memory, links) are in `skeleton.py`.
"""

from __future__ import annotations

import enum
import json
import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from waychair.types import Bytes, Float32Array, FloatArray, Pose2, Scan

WordIds: TypeAlias = NDArray[np.int32]

_SEAL = struct.Struct("<I")


class NodeStatus(enum.IntEnum):
    """The memory that a node is in; each is in exactly one."""

    GONE = 0
    """Merged into another node, reduced, or dropped."""
    STM = 1
    WM = 2
    LTM = 3
    LOST = 4
    """Asleep with an unreadable record on disk: only its pose and links are left."""


class LinkKind(enum.IntEnum):
    """The kind of a link: NEIGHBOUR and MERGED are links in time, the others loops."""

    NEIGHBOUR = 1
    """A link to the previous node."""
    MERGED = 2
    """A neighbour's link, redirected past a removed node."""
    GLOBAL = 3
    """A loop found by appearance."""
    SPACE = 4
    """A loop found by nearness in the map; the Bayes filter ignores it."""


IN_TIME = frozenset({LinkKind.NEIGHBOUR, LinkKind.MERGED})
LOOPS = frozenset({LinkKind.GLOBAL, LinkKind.SPACE})


@dataclass(frozen=True, slots=True)
class Link:
    """Measured pose of node j in node i; information (3, 3) of x, y [1/m^2], theta [1/rad^2] in j's frame."""

    i: int
    j: int
    kind: LinkKind
    i_from_j: Pose2
    information: FloatArray

    def reversed(self) -> Link:
        """Return the link in the other direction."""
        return Link(self.j, self.i, self.kind, self.i_from_j.inverse(), carried(self.information, self.i_from_j))

    def from_node(self, node: int) -> Link:
        """Return the link with its end `node` as i."""
        return self if self.i == node else self.reversed()

    def then(self, further: Link, kind: LinkKind) -> Link:
        """Return the chain of this link and a further one that begins at its j; their errors are independent."""
        before = np.linalg.inv(carried(self.information, further.i_from_j.inverse()))
        information = np.linalg.inv(before + np.linalg.inv(further.information))
        return Link(self.i, further.j, kind, self.i_from_j @ further.i_from_j, information)


def carried(information: FloatArray, a_from_b: Pose2) -> FloatArray:
    """Return the information (3, 3) of a small motion in frame a, given that in frame b, rigidly joined to a.

    With T = a_from_b a motion Exp(e) of b is T Exp(e) T^-1 = Exp(Ad(T) e) of a (Sola et al., A micro Lie theory, 2018).
    """
    c, s = math.cos(a_from_b.theta), math.sin(a_from_b.theta)
    back = np.linalg.inv(np.array([[c, -s, a_from_b.y], [s, c, -a_from_b.x], [0.0, 0.0, 1.0]]))
    return back.T @ information @ back


@dataclass(frozen=True, slots=True)
class NodeScan:
    """A node's scan for the grid, and the laser's poses in the node's frame at its first and last beam."""

    scan: Scan
    node_from_first: Pose2
    node_from_last: Pose2


def _no_words() -> WordIds:
    return np.empty(0, np.int32)


def _no_points() -> Float32Array:
    return np.empty((0, 3), np.float32)


@dataclass(frozen=True, slots=True)
class MemoryNode:
    """One place observed at one time.

    Of K keypoints: words (K,) int32 of the vocabulary (0 or less: none), pixels (K, 2) f32 [px], points
    (K, 3) f32 [m] in the camera's optical frame (nan without depth), descriptors (K, 32) u8 or (K, 128) f32. `surface`
    (N, 2) f32 [m] is the scan in the base frame. The memory sets `id` and `map_id` when it adds the node.
    """

    stamp_ns: int
    odom_from_base: Pose2
    words: WordIds = field(default_factory=_no_words)
    pixels: Float32Array = field(default_factory=lambda: np.empty((0, 2), np.float32))
    points: Float32Array = field(default_factory=_no_points)
    descriptors: Bytes | Float32Array = field(default_factory=lambda: np.empty((0, 32), np.uint8))
    surface: Float32Array = field(default_factory=lambda: np.empty((0, 2), np.float32))
    evidence: NodeScan | None = None
    id: int = 0
    map_id: int = 0

    @property
    def is_bad(self) -> bool:
        """Whether no keypoint has a word, so that places cannot be compared (a "bad signature" of RTAB-Map)."""
        return not bool((self.words > 0).any())


def pack_evidence(evidence: NodeScan | None) -> bytes:
    """Return evidence as bytes, b'' for None."""
    if evidence is None:
        return b""
    scan, first, last = evidence.scan, evidence.node_from_first, evidence.node_from_last
    numbers = [scan.angle_min, scan.angle_step, scan.time_step, scan.range_min, scan.range_max]
    poses = [first.x, first.y, first.theta, last.x, last.y, last.theta]
    return pack([np.array([scan.stamp_ns], np.int64), np.array([*numbers, *poses]), scan.ranges])


def unpack_evidence(data: bytes) -> NodeScan | None:
    """Return the evidence that `pack_evidence` packed."""
    if not data:
        return None
    stamp, numbers, ranges = unpack(data)
    angle_min, angle_step, time_step, low, high, *poses = numbers.tolist()
    scan = Scan(
        stamp_ns=int(stamp[0]),
        ranges=ranges,
        angle_min=angle_min,
        angle_step=angle_step,
        time_step=time_step,
        range_min=low,
        range_max=high,
    )
    return NodeScan(scan, Pose2(*poses[:3]), Pose2(*poses[3:]))


def pack_features(node: MemoryNode) -> bytes:
    """Return a node's words, pixels, points, descriptors and surface as bytes."""
    return pack([node.words, node.pixels, node.points, node.descriptors, node.surface])


def pack(arrays: Sequence[NDArray[Any]]) -> bytes:
    """Return arrays of numbers as compressed bytes, without any code or objects."""
    header = json.dumps([[array.dtype.str, list(array.shape)] for array in arrays]).encode()
    body = b"".join([_SEAL.pack(len(header)), header, *(np.ascontiguousarray(array).tobytes() for array in arrays)])
    return zlib.compress(body, 1)


def unpack(data: bytes) -> list[NDArray[Any]]:
    """Return the arrays that `pack` packed.

    Raises:
        ValueError: the bytes are no packed arrays.
    """
    try:
        body = zlib.decompress(data)
        start = _SEAL.size + _SEAL.unpack_from(body)[0]
        arrays = []
        for code, shape in json.loads(body[_SEAL.size : start]):
            dtype = np.dtype(code)
            if dtype.kind not in "biuf":
                raise ValueError(f"it holds {dtype}")
            count = math.prod(shape)
            arrays.append(np.frombuffer(body, dtype, count, start).reshape(shape))
            start += count * dtype.itemsize
    except (zlib.error, struct.error, TypeError, ValueError) as error:
        raise ValueError(f"these are no packed arrays: {error}") from error
    return arrays


def seal(number: int, body: bytes) -> bytes:
    """Return the bytes with a CRC-32 in front, seeded with the number of their record."""
    return _SEAL.pack(zlib.crc32(body, number & 0xFFFFFFFF)) + body


def unseal(number: int, data: bytes) -> bytes:
    """Return the bytes without their checksum.

    Raises:
        ValueError: the bytes have changed, or belong to another record.
    """
    body = data[_SEAL.size :]
    if data[: _SEAL.size] != _SEAL.pack(zlib.crc32(body, number & 0xFFFFFFFF)):
        raise ValueError("its checksum does not agree")
    return body
