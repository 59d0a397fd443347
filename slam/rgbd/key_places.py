"""Key frames as places: each becomes a node of the memory, which is compared with earlier ones.

The memory holds planar poses, so a key frame is stored as its projection to the floor (its shadow): a base whose x axis
is the optical axis, y axis left of it, z axis up if the first picture is upright. The visual map holds the full pose.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from waychair.geometry import pose_from_array
from waychair.slam.camera.features import ImageFeatures
from waychair.slam.camera.visual_map import KeyFrame
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.nodes import Link, LinkKind, MemoryNode, NodeStatus
from waychair.slam.memory.place_memory import PictureCost, PlaceMemory
from waychair.slam.words.recognition_settings import RecognitionSettings
from waychair.types import FloatArray, Pose2, Pose3

BASE_FROM_OPTICAL = Pose3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
"""REP-103: an optical frame looks along z, x is right and y down."""

_BESIDE = 3  # key frames within this many numbers of each other show the same place


class KeyPlaces:
    """Call `add` for every key frame, and `move_key_frames` after a change of the map. Key frames have numbers."""

    def __init__(self, settings: RecognitionSettings, memory: NodeMemory) -> None:
        """Begin with an empty memory, which then belongs to these key frames."""
        self.places = PlaceMemory(settings, memory)
        self.memory = memory
        self._node_of: list[int] = []  # by key frame: its own node, or the one that it was merged into
        self._key_of: dict[int, int] = {}

    def __len__(self) -> int:
        """Return the number of key frames."""
        return len(self._node_of)

    def add(self, key: KeyFrame, information: FloatArray, poses: FloatArray, extraction_s: float) -> list[int]:
        """Add a key frame; return earlier key frames that it may show again, by the Bayes filter first, then alone.

        Args:
            key: the key frame.
            information: (3, 3) of the planar motion since the previous key frame.
            poses: (K, 3) shadows of all key frames, the new one last.
            extraction_s: CPU time [s] of its features.
        """
        started, memory, number = time.process_time(), self.memory, len(self._node_of)
        self.places.counts["pictures"] += 1
        memory.move_anchors(poses)
        node, here = self.places.next_id, pose_from_array(poses[-1])
        words, made = self.places.words(key.sized)
        words_s = time.process_time() - started
        before = pose_from_array(poses[-2]) if number else here
        features = key.sized
        added = memory.add(
            node=MemoryNode(
                stamp_ns=key.stamp_ns,
                odom_from_base=here,
                words=words,
                pixels=features.pixels,
                points=features.points,
                descriptors=features.descriptors,
            ),
            information=information,
            anchor=number,
            anchor_from_node=Pose2(),
            motion=before.inverse() @ here,
            new_words=made,
        )
        self.places.apply_change(added.change)
        self._node_of.append(added.id)
        candidates: list[int] = []
        if added.id == node:
            self._key_of[node] = number
            found = self.places.recognise(node)
            self.places.apply_change(memory.retrieve(found.hypothesis, here))
            candidates = [self._key_of[place] for place in found.candidates]
        else:
            self.places.recognition.leave(node)
        spent_s = time.process_time() - started + extraction_s
        self.places.apply_change(memory.transfer(1e3 * spent_s))
        new = 0 if made is None else len(made[0])
        cost = PictureCost(1e3 * extraction_s, 1e3 * words_s, 1e3 * spent_s, int((words > 0).sum()), new)
        self.places.costs.append(cost)
        return candidates

    def start_map(self) -> None:
        """Start a new map: the next key frame has no link to the previous one."""
        self.memory.start_map()

    def likeliest(self, features: ImageFeatures, most: int = 3) -> list[int]:
        """Return the key frames most similar to a picture, best first, at most one per place."""
        chosen: list[int] = []
        for node in self.places.recognition.likeliest(features, most * (2 * _BESIDE + 1)):
            key = self._key_of[node]
            if len(chosen) < most and all(abs(key - other) > _BESIDE for other in chosen):
                chosen.append(key)
        return chosen

    def link(self, old: int, new: int, kind: LinkKind, old_from_new: Pose3, information: FloatArray) -> None:
        """Link two key frames of one place: `old_from_new` of the optical frames, information (3, 3) of its shadow."""
        i, j = self._node_of[old], self._node_of[new]
        if i != j and NodeStatus.GONE not in (self.memory.skeleton.kept(i), self.memory.skeleton.kept(j)):
            self.memory.link(Link(i, j, kind, planar_pose(old_from_new), information))

    def refuse(self, old: int, new: int, reason: str) -> None:
        """Record why two key frames do not show the same place."""
        self.places.refuse(self._node_of[new], self._node_of[old], reason)

    def move_key_frames(self, poses: FloatArray) -> None:
        """Take over new shadows (K, 3) of the key frames."""
        self.memory.move_anchors(poses)

    def finish(self, poses: FloatArray) -> None:
        """Take over the final shadows (K, 3), and write everything to disk."""
        self.memory.move_anchors(poses)
        self.memory.flush()


def planar_pose(map_from_camera: Pose3) -> Pose2:
    """Return the planar pose of an optical frame."""
    return (BASE_FROM_OPTICAL @ map_from_camera @ BASE_FROM_OPTICAL.inverse()).planar()


def planar_poses(keys: Sequence[KeyFrame]) -> FloatArray:
    """Return the planar poses (K, 3) [m, m, rad] of key frames in map."""
    every = [planar_pose(key.camera_from_map.inverse()).array() for key in keys]
    return np.array(every, float).reshape(-1, 3)


def planar_information(covariance: FloatArray) -> FloatArray:
    """Return the information (3, 3) of x, y, yaw of a base from a covariance (6, 6) of its optical frame's motion."""
    turn = BASE_FROM_OPTICAL.rotation
    way, angles = turn @ covariance[3:, 3:] @ turn.T, turn @ covariance[:3, :3] @ turn.T
    inverse: FloatArray = np.linalg.inv(np.block([[way[:2, :2], np.zeros((2, 1))], [np.zeros((1, 2)), angles[2:, 2:]]]))
    return inverse
