"""What the memory is made of: nodes, and links between them. A node is what was seen and never changes.

What the memory thinks of a node (its weight, its age, where it is kept, what it is linked to) is in `skeleton.py`.
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


class Kept(enum.IntEnum):
    """Where a node is: in exactly one of these."""

    GONE = 0
    """Merged into another one, reduced, or dropped."""
    STM = 1
    WM = 2
    LTM = 3
    LOST = 4
    """Asleep, and its record on disk cannot be read: its pose and links are all that is left."""


class LinkKind(enum.IntEnum):
    """What a link is to the memory. Ways in time: NEIGHBOUR and MERGED; the rest are ways over loops."""

    NEIGHBOUR = 1
    """To the node before."""
    MERGED = 2
    """A neighbour's link, led past a node that is gone."""
    GLOBAL = 3
    """A loop found by appearance."""
    SPACE = 4
    """A loop found because both were near; the Bayes filter ignores it."""


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
        """The same the other way round."""
        return Link(self.j, self.i, self.kind, self.i_from_j.inverse(), carried(self.information, self.i_from_j))

    def from_node(self, node: int) -> Link:
        """The link as that of its end `node`: its i is `node`."""
        return self if self.i == node else self.reversed()

    def then(self, further: Link, kind: LinkKind) -> Link:
        """From this link's i over its j, which is the other's i, to the other's j; the two errors are independent."""
        before = np.linalg.inv(carried(self.information, further.i_from_j.inverse()))
        information = np.linalg.inv(before + np.linalg.inv(further.information))
        return Link(self.i, further.j, kind, self.i_from_j @ further.i_from_j, information)


def carried(information: FloatArray, a_from_b: Pose2) -> FloatArray:
    """Information (3, 3) of a small motion given in b, of the same motion seen from a, rigidly joined to b.

    With T = a_from_b a motion Exp(e) of b is T Exp(e) T^-1 = Exp(Ad(T) e) of a (Sola et al., A micro Lie theory, 2018).
    """
    c, s = math.cos(a_from_b.theta), math.sin(a_from_b.theta)
    back = np.linalg.inv(np.array([[c, -s, a_from_b.y], [s, c, -a_from_b.x], [0.0, 0.0, 1.0]]))
    return back.T @ information @ back


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a node tells of the grid: a scan, and where its laser was from the node at its first and last beam."""

    scan: Scan
    node_from_first: Pose2
    node_from_last: Pose2


def _no_words() -> WordIds:
    return np.empty(0, np.int32)


def _no_points() -> Float32Array:
    return np.empty((0, 3), np.float32)


@dataclass(frozen=True, slots=True)
class Node:
    """One place at one time, as it was seen.

    The K key points: words (K,) int32, their words in the dictionary (0 or less: none), pixels (K, 2) f32 [px], points
    (K, 3) f32 [m] in the camera's optical frame (nan without depth), descriptors (K, 32) u8 or (K, 128) f32. `surface`
    (N, 2) f32 [m] is the scan in the base frame. The memory gives `id` and `map_id` when the node is added.
    """

    stamp_ns: int
    odom_from_base: Pose2
    words: WordIds = field(default_factory=_no_words)
    pixels: Float32Array = field(default_factory=lambda: np.empty((0, 2), np.float32))
    points: Float32Array = field(default_factory=_no_points)
    descriptors: Bytes | Float32Array = field(default_factory=lambda: np.empty((0, 32), np.uint8))
    surface: Float32Array = field(default_factory=lambda: np.empty((0, 2), np.float32))
    evidence: Evidence | None = None
    id: int = 0
    map_id: int = 0

    @property
    def is_bad(self) -> bool:
        """Whether nothing in it has a word: its appearance says nothing (a "bad signature" of RTAB-Map)."""
        return not bool((self.words > 0).any())


def pack_evidence(evidence: Evidence | None) -> bytes:
    """As bytes; none for None."""
    if evidence is None:
        return b""
    scan, first, last = evidence.scan, evidence.node_from_first, evidence.node_from_last
    numbers = [scan.angle_min, scan.angle_step, scan.time_step, scan.range_min, scan.range_max]
    poses = [first.x, first.y, first.theta, last.x, last.y, last.theta]
    return pack([np.array([scan.stamp_ns], np.int64), np.array([*numbers, *poses]), scan.ranges])


def unpack_evidence(data: bytes) -> Evidence | None:
    """What `pack_evidence` made of it."""
    if not data:
        return None
    stamp, numbers, ranges = unpack(data)
    angle_min, angle_step, time_step, low, high, *poses = numbers.tolist()
    scan = Scan(int(stamp[0]), ranges, angle_min, angle_step, time_step, low, high)
    return Evidence(scan, Pose2(*poses[:3]), Pose2(*poses[3:]))


def pack_features(node: Node) -> bytes:
    """Words, pixels, points, descriptors and surface as bytes."""
    return pack([node.words, node.pixels, node.points, node.descriptors, node.surface])


def pack(arrays: Sequence[NDArray[Any]]) -> bytes:
    """Arrays of numbers, compressed; nothing in it can be more than numbers."""
    header = json.dumps([[array.dtype.str, list(array.shape)] for array in arrays]).encode()
    body = b"".join([_SEAL.pack(len(header)), header, *(np.ascontiguousarray(array).tobytes() for array in arrays)])
    return zlib.compress(body, 1)


def unpack(data: bytes) -> list[NDArray[Any]]:
    """What `pack` was given.

    Raises:
        ValueError: it is something else.
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
    """The bytes with their checksum (CRC-32) in front, which also holds the number they belong to."""
    return _SEAL.pack(zlib.crc32(body, number & 0xFFFFFFFF)) + body


def unseal(number: int, data: bytes) -> bytes:
    """The bytes without their checksum.

    Raises:
        ValueError: they have changed, or belong to another number.
    """
    body = data[_SEAL.size :]
    if data[: _SEAL.size] != _SEAL.pack(zlib.crc32(body, number & 0xFFFFFFFF)):
        raise ValueError("its checksum does not agree")
    return body
