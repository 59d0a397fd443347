"""Key frames as places: each becomes a node of the memory, is compared with those before, and is found again by words.

The memory thinks in poses on the floor, so a key frame stands there as its shadow: a base whose x axis is the optical
axis, its y axis left of it and its z axis up when the first picture is upright. Where it is in space is the map's
business.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence

import numpy as np

from waychair.geometry import pose_from_array
from waychair.slam.features import Features
from waychair.slam.memory import Memory
from waychair.slam.nodes import Kept, Link, LinkKind, Node
from waychair.slam.place_memory import PictureCost, PlaceMemory
from waychair.slam.place_recognition import RecognitionSettings
from waychair.slam.visual_map import KeyFrame
from waychair.types import FloatArray, Pose2, Pose3

BASE_FROM_OPTICAL = Pose3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
"""REP-103: an optical frame looks along z, x is right and y down."""

_BESIDE = 3  # key frames so near to a chosen one in time show the same place


class KeyPlaces:
    """Tell it of every key frame by `add`, and of the map's bending by `bend`; key frames are told by their number."""

    def __init__(self, settings: RecognitionSettings, memory: Memory) -> None:
        """The memory is empty, and from now on that of these key frames."""
        self.places = PlaceMemory(settings, memory)
        self.memory = memory
        self._node_of: list[int] = []  # of each key frame: its own, or the one it was merged into
        self._key_of: dict[int, int] = {}

    def __len__(self) -> int:
        """Key frames that are known."""
        return len(self._node_of)

    def add(self, key: KeyFrame, information: FloatArray, poses: FloatArray, extraction_s: float) -> int | None:
        """A further key frame; returns the earlier one that it may show again, if what is seen says so.

        Args:
            key: the key frame.
            information: (3, 3) of the way from the one before, on the floor.
            poses: (K, 3) shadows of all key frames, this one the last.
            extraction_s: the CPU that its features took.
        """
        started, memory, number = time.process_time(), self.memory, len(self._node_of)
        self.places.counts["pictures"] += 1
        memory.bend(poses)
        node, here = self.places.next_id, pose_from_array(poses[-1])
        words, made = self.places.words(key.features)
        words_s = time.process_time() - started
        before = pose_from_array(poses[-2]) if number else here
        features = key.features
        added = memory.add(
            Node(key.stamp_ns, here, words, features.pixels, features.points, features.descriptors),
            information,
            number,
            Pose2(),
            motion=before.inverse() @ here,
            new_words=made,
        )
        self.places.obey(added.change)
        self._node_of.append(added.id)
        hypothesis = None
        if added.id == node:
            self._key_of[node] = number
            found = self.places.recognise(node)
            self.places.obey(memory.retrieve(found.hypothesis, here))
            hypothesis = None if found.closure is None else self._key_of[found.closure]
        else:
            self.places.recognition.leave(node)
        spent_s = time.process_time() - started + extraction_s
        self.places.obey(memory.transfer(1e3 * spent_s))
        new = 0 if made is None else len(made[0])
        cost = PictureCost(1e3 * extraction_s, 1e3 * words_s, 1e3 * spent_s, int((words > 0).sum()), new)
        self.places.costs.append(cost)
        return hypothesis

    def start_map(self) -> None:
        """The next key frame has no way to the one before."""
        self.memory.start_map()

    def likeliest(self, features: Features, excluded: Collection[int] = (), most: int = 3) -> list[int]:
        """Key frames that look most like a picture, best first, at most one of each place."""
        out = {self._node_of[key] for key in excluded if key < len(self._node_of)}
        chosen: list[int] = []
        for node in self.places.recognition.likeliest(features, most * (2 * _BESIDE + 1), out):
            key = self._key_of[node]
            if len(chosen) < most and all(abs(key - other) > _BESIDE for other in chosen):
                chosen.append(key)
        return chosen

    def link(self, old: int, new: int, kind: LinkKind, old_from_new: Pose3, information: FloatArray) -> None:
        """Two key frames show the same; `old_from_new` of their optical frames, information (3, 3) of its shadow."""
        i, j = self._node_of[old], self._node_of[new]
        if i != j and Kept.GONE not in (self.memory.skeleton.kept(i), self.memory.skeleton.kept(j)):
            self.memory.link(Link(i, j, kind, shadow(old_from_new), information))

    def refuse(self, old: int, new: int, reason: str) -> None:
        """Why the two do not show the same."""
        self.places.refuse(self._node_of[new], self._node_of[old], reason)

    def bend(self, poses: FloatArray) -> None:
        """The shadows of the key frames are (K, 3) now."""
        self.memory.bend(poses)

    def finish(self, poses: FloatArray) -> None:
        """Everything is where it is, and on the disk."""
        self.memory.bend(poses)
        self.memory.flush()


def shadow(map_from_camera: Pose3) -> Pose2:
    """A pose of the optical frame as one on the floor."""
    return (BASE_FROM_OPTICAL @ map_from_camera @ BASE_FROM_OPTICAL.inverse()).planar()


def shadows(keys: Sequence[KeyFrame]) -> FloatArray:
    """(K, 3) [m, m, rad] of key frames, in map."""
    every = [shadow(key.camera_from_map.inverse()).array() for key in keys]
    return np.array(every, float).reshape(-1, 3)


def on_floor(covariance: FloatArray) -> FloatArray:
    """(3, 3) information of x, y, yaw of a base by a covariance (6, 6) of turn and way of its optical frame."""
    turn = BASE_FROM_OPTICAL.rotation
    way, angles = turn @ covariance[3:, 3:] @ turn.T, turn @ covariance[:3, :3] @ turn.T
    inverse: FloatArray = np.linalg.inv(np.block([[way[:2, :2], np.zeros((2, 1))], [np.zeros((1, 2)), angles[2:, 2:]]]))
    return inverse
