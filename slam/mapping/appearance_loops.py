"""Loop closure by appearance in the lidar mapper: pictures become nodes, and recognised places close loops.

About once a second, a picture goes through RTAB-Map's update (Labbe and Michaud 2019). Its features become words and a
node of the short-term memory, attached to a key scan. The Bayes filter updates its belief over the places awake, and
the most likely place is registered by features with depth. The lidar must confirm that registration before it bends the
graph. A place that only looks alike is refused by one of four checks: too few features agree, the scans do not fit,
odometry contradicts it, or the rest of the graph does. Refusals are kept with their reason.

Without pictures, or with blank ones, the lidar's own loop closures still work. They also cover revisits in the opposite
direction, where the camera sees another view.
"""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass

from waychair.errors import SensorError
from waychair.geometry import pose_from_array, rotation, transform_points
from waychair.slam.camera.features import ImageFeatures, extract
from waychair.slam.camera.picture_registration import register
from waychair.slam.camera.reprojection import pinhole
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.information import odometry_information
from waychair.slam.mapping.appearance_settings import AppearanceSettings
from waychair.slam.mapping.loop_candidates import MIN_LOOP_PATH
from waychair.slam.mapping.loop_closure import LoopRejection
from waychair.slam.mapping.mapper import Mapper
from waychair.slam.mapping.place_verification import (
    features_of,
    fit_to_keys,
    motion_of_base,
    nearest_place,
)
from waychair.slam.mapping.tracking import twist_of
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.nodes import LOOPS, Link, LinkKind, MemoryNode, NodeScan, NodeStatus, WordIds, carried
from waychair.slam.memory.place_memory import PictureCost, PlaceMemory
from waychair.slam.memory.rehearsal import RehearsalResult, is_moving
from waychair.slam.scan.scan_points import ScanPoints, scan_points, sweep_motion
from waychair.slam.words.place_recognition import MIN_FEATURES
from waychair.slam.words.vocabulary import Vocabulary
from waychair.types import FloatArray, Pose2, Pose3, RgbdFrame, SensorFrame, Twist

_WAITING = 8  # most pictures that wait for the scan after them
_NO_SCAN = "pictures without a scan before and after them"
AGREE_DISTANCE, AGREE_ANGLE = 0.5, 0.15
"""Largest difference [m], [rad] between map and measurement for two nodes that the map already has side by side."""

MIN_INLIERS = 0.7
"""Least share of a scan's points on the surfaces of the other place."""

NEAR_DISTANCE, NEAR_ANGLE = 1.0, 0.52
"""A node in a known place is linked to an earlier one this near [m], [rad].

RTAB-Map's RGBD/ProximityPathFilteringRadius and RGBD/ProximityAngle (there 45 degrees)."""

_MOVED = 0.01  # [m] least shift of a node's frame by the mapper after which the node is re-attached


@dataclass(frozen=True, slots=True)
class _View:
    """The features of a picture that is waiting for its scan."""

    stamp_ns: int
    features: ImageFeatures
    camera: FloatArray
    extraction_s: float


@dataclass(frozen=True, slots=True)
class _NewNode:
    """A new node: its key scan, its pose in the key scan's frame, its scan in its own frame, its picture."""

    id: int
    key: int
    key_from_node: Pose2
    scan: ScanPoints
    view: _View

    def pose(self, mapper: Mapper) -> Pose2:
        """Return the node's pose in map by the present graph."""
        return mapper.keys.pose(self.key) @ self.key_from_node


class AppearanceLoopClosure:
    """Pass every picture to `see`, and call `follow` after each frame of the mapper.

    `counts` holds the outcomes of pictures, `refused` and `loops` those of recognised places, `costs` the CPU time.
    """

    def __init__(
        self,
        settings: AppearanceSettings,
        base_from_camera: Pose3,
        memory: NodeMemory | None = None,
        vocabulary: Vocabulary | None = None,
    ) -> None:
        """Begin with an empty memory, or with that of earlier sessions.

        The anchors of a memory of earlier sessions are the key scans of the mapper, which continues their map.
        `base_from_camera` is the mount of the optical frame.
        """
        self.settings = settings
        self.places = PlaceMemory(settings.places, memory or NodeMemory(settings.memory), vocabulary)
        self.memory, self.recognition = self.places.memory, self.places.recognition
        self.counts, self.refused, self.costs = self.places.counts, self.places.refused, self.places.costs
        self._mount = base_from_camera
        self._waiting: deque[_View] = deque()
        self._latest_ns: int | None = None
        self._last: int | None = None  # the newest node, on this map
        self._unknown_edges: int | None = None  # edges of unknown motion so far
        self._loops: int | None = None
        self._closed_loops: list[tuple[Edge, Link]] = []
        self._rejected = 0

    @property
    def loops(self) -> tuple[Link, ...]:
        """The loops found by appearance that the memory holds now."""
        return self.places.loops

    def see(self, picture: RgbdFrame) -> None:
        """Take in a picture, in order of time; pictures beyond the detection rate are skipped."""
        if self._latest_ns is not None:
            if picture.stamp_ns <= self._latest_ns:
                self.counts["pictures not later than the one before"] += 1
                return
            if (picture.stamp_ns - self._latest_ns) * 1e-9 < 0.9 / self.settings.detection_rate:
                return
        started = time.process_time()
        try:
            features = extract(picture, self.settings.places.features)
        except SensorError:
            self.counts["pictures that cannot be used"] += 1
            return
        self.take(picture.stamp_ns, features, pinhole(picture.camera_matrix), time.process_time() - started)

    def take(self, stamp_ns: int, features: ImageFeatures, camera: FloatArray, spent_s: float = 0.0) -> None:
        """Take in a picture's extracted features, its camera (4,) from `pinhole`, and the CPU time [s] of extraction.

        Unlike `see`, skip no picture.
        """
        self._latest_ns = stamp_ns
        self.counts["pictures"] += 1
        self.counts["pictures that show too little"] += len(features) < MIN_FEATURES
        if len(self._waiting) == _WAITING:
            self._waiting.popleft()
            self.counts[_NO_SCAN] += 1
        self._waiting.append(_View(stamp_ns, features, camera, spent_s))

    def follow(self, mapper: Mapper, frame: SensorFrame) -> None:
        """Process the waiting pictures up to the mapper's latest frame, which is `frame`."""
        while self._waiting and self._waiting[0].stamp_ns <= mapper.frames[-1].stamp_ns:
            view = self._waiting.popleft()
            placed = mapper.pose_at(view.stamp_ns, self.settings.gap)
            if placed is None:
                self.counts[_NO_SCAN] += 1
                continue
            self.costs.append(self._include(mapper, frame, view, *placed))
        if len(mapper.keys.rejected) != self._rejected:
            self._follow_graph(mapper)

    def finish(self, mapper: Mapper) -> None:
        """Take over the graph after its last optimisation, and write everything to disk."""
        self._follow_graph(mapper)
        self.memory.move_anchors(mapper.keys.poses)
        self.memory.flush()

    def _include(self, mapper: Mapper, frame: SensorFrame, view: _View, key: int, pose: Pose2) -> PictureCost:
        """Run one update for a picture; return its cost."""
        started, memory = time.process_time(), self.memory
        self._start_map_if_unconnected(mapper)
        memory.move_anchors(mapper.keys.poses)
        self._reattach(mapper)
        new_id, before = self.places.next_id, time.process_time()
        words, new_words = self.places.words(view.features)
        words_s = time.process_time() - before
        motion = self._motion(pose)
        here = self._new_node(mapper=mapper, frame=frame, view=view, node=new_id, key=key, pose=pose)
        added = memory.add(
            node=self._node(mapper, frame, view, words, pose),
            information=odometry_information(motion or Pose2()),
            anchor=key,
            anchor_from_node=here.key_from_node,
            motion=motion,
            new_words=new_words,
        )
        self.places.apply_change(added.change)
        if added.id != new_id:  # the chair stands and sees the same view as before
            self.recognition.leave(new_id)
            self._last = added.id
        elif self._recognise(mapper, here) or not self._stands(motion, added.verdict):
            self._last = new_id
        else:
            self.places.apply_change(memory.drop(new_id))
        spent_s = time.process_time() - started + view.extraction_s
        self.places.apply_change(memory.transfer(1e3 * spent_s))
        new = 0 if new_words is None else len(new_words[0])
        return PictureCost(1e3 * view.extraction_s, 1e3 * words_s, 1e3 * spent_s, int((words > 0).sum()), new)

    def _motion(self, pose: Pose2) -> Pose2 | None:
        """Return a pose in map relative to the newest node; None without a node on this map."""
        return None if self._last is None else pose_from_array(self.memory.poses([self._last])[0]).inverse() @ pose

    def _stands(self, motion: Pose2 | None, verdict: RehearsalResult) -> bool:
        return motion is not None and verdict is RehearsalResult.DIFFERENT and not is_moving(motion)

    def _new_node(self, mapper: Mapper, frame: SensorFrame, view: _View, node: int, key: int, pose: Pose2) -> _NewNode:
        """Return the new node with its pose beside its key scan and the scan of the next frame, in the node's frame."""
        assert frame.scan is not None
        node_from_base = pose.inverse() @ mapper.pose()
        seen = scan_points(frame.scan, mapper.base_from_laser, mapper.settings.matching.range_max, twist_of(frame))
        normals = seen.normals @ rotation(node_from_base.theta).T
        scan = ScanPoints(transform_points(node_from_base, seen.points), normals)
        return _NewNode(node, key, mapper.keys.pose(key).inverse() @ pose, scan, view)

    def _node(self, mapper: Mapper, frame: SensorFrame, view: _View, words: WordIds, pose: Pose2) -> MemoryNode:
        assert frame.scan is not None
        scan, twist = frame.scan, twist_of(frame) or Twist()
        node_from_base = pose.inverse() @ mapper.pose()
        first = node_from_base @ mapper.base_from_laser
        last = node_from_base @ sweep_motion(scan, twist) @ mapper.base_from_laser
        features = view.features
        odometry = (mapper.odometry or mapper.pose()) @ node_from_base.inverse()
        return MemoryNode(
            stamp_ns=view.stamp_ns, odom_from_base=odometry, words=words, pixels=features.pixels,
            points=features.points, descriptors=features.descriptors,
            evidence=NodeScan(scan, first, last),
        )  # fmt: skip

    def _recognise(self, mapper: Mapper, here: _NewNode) -> bool:
        """Return whether a loop was closed, or the node was linked to one in a known place."""
        result = self.places.recognise(here.id)
        self.places.apply_change(self.memory.retrieve(result.hypothesis, here.pose(mapper)))
        closed = any(self._close_loop(mapper, here, place) for place in result.candidates)
        return self._link_known_place(mapper, here) or closed

    def _close_loop(self, mapper: Mapper, here: _NewNode, place: int) -> bool:
        """Return whether features, scans and the graph confirm a likely place, and close the loop if so."""
        old = self.memory.node(place)
        found = register(features_of(old), here.view.features, here.view.camera)
        if found.old_from_new is None:
            assert found.refusal is not None
            return self.places.refuse(here.id, place, found.refusal.value)
        old_from_here = motion_of_base(found.old_from_new, self._mount)
        key = int(self.memory.skeleton.rows["anchor"][place])
        map_from_here = mapper.keys.pose(key) @ self.memory.skeleton.anchor_from_node(place) @ old_from_here
        if key in mapper.keys.path_lengths(here.key, MIN_LOOP_PATH):
            return self._confirm(mapper, here, place, key, map_from_here)
        edge = mapper.close_loop(key, map_from_here @ here.pose(mapper).inverse() @ mapper.pose())
        if isinstance(edge, LoopRejection):
            return self.places.refuse(here.id, place, edge.value)
        self.memory.move_anchors(mapper.keys.poses)
        information = carried(edge.information, here.key_from_node.inverse())
        link = self._link(place, here.id, LinkKind.GLOBAL, information)
        self._closed_loops.append((edge, link))
        self._follow_graph(mapper)
        return self.memory.skeleton.linked(place, here.id) is not None

    def _confirm(self, mapper: Mapper, here: _NewNode, place: int, key: int, map_from_here: Pose2) -> bool:
        """Link a place that the map already has beside the node, if picture and scan agree; no edge is needed."""
        gap = here.pose(mapper).inverse() @ map_from_here
        if not self._agrees(gap):
            return self.places.refuse(here.id, place, "the map has the two elsewhere")
        fit = fit_to_keys(mapper, key, here.scan, here.pose(mapper))
        if fit.inliers < MIN_INLIERS:
            return self.places.refuse(here.id, place, LoopRejection.FEW_INLIERS.value)
        self._link(place, here.id, LinkKind.GLOBAL, fit.information)
        return True

    def _link_known_place(self, mapper: Mapper, here: _NewNode) -> bool:
        """Return whether the new node is linked by nearness; after a loop closure, also link the rest of the STM."""
        loops = mapper.keys.kinds[EdgeKind.LOOP]
        closed, self._loops = self._loops is not None and loops > self._loops, loops
        linked = self._link_nearby(mapper, here.id, here.key, here.scan)
        for node in self.memory.stm[:-1] if closed else ():
            seen, key = self.memory.node(node).evidence, int(self.memory.skeleton.rows["anchor"][node])
            if seen is not None and not self.memory.skeleton.links(node, LOOPS):
                scan = scan_points(seen.scan, seen.node_from_first, mapper.settings.matching.range_max)
                self._link_nearby(mapper, node, key, scan)
        return linked

    def _link_nearby(self, mapper: Mapper, node: int, key: int, scan: ScanPoints) -> bool:
        """Link a node to the nearest one of an earlier visit if its scan fits the surfaces there; return whether so."""
        memory = self.memory
        around = mapper.keys.path_lengths(key, MIN_LOOP_PATH)
        place = nearest_place(memory, around, node, NEAR_DISTANCE, NEAR_ANGLE)
        if place is None or memory.skeleton.linked(place, node) is not None:
            return False
        pose = pose_from_array(memory.poses([node])[0])
        fit = fit_to_keys(mapper, int(memory.skeleton.rows["anchor"][place]), scan, pose)
        if fit.inliers < MIN_INLIERS or not self._agrees(pose.inverse() @ fit.pose):
            return False
        self._link(place, node, LinkKind.SPACE, fit.information)
        return True

    def _agrees(self, gap: Pose2) -> bool:
        return math.hypot(gap.x, gap.y) <= AGREE_DISTANCE and abs(gap.theta) <= AGREE_ANGLE

    def _link(self, place: int, node: int, kind: LinkKind, information: FloatArray) -> Link:
        """Link two nodes by their present poses in map."""
        a, b = (pose_from_array(pose) for pose in self.memory.poses([place, node]))
        link = Link(place, node, kind, a.inverse() @ b, information)
        self.memory.link(link)
        return link

    def _follow_graph(self, mapper: Mapper) -> None:
        """Unlink loops whose edges the back end has rejected, and link those again that it has restored."""
        self._rejected = len(mapper.keys.rejected)
        believed, memory = {id(edge) for edge in mapper.keys.edges}, self.memory
        for edge, link in self._closed_loops:
            linked = memory.skeleton.linked(link.i, link.j) is not None
            if linked and id(edge) not in believed:
                memory.unlink(link.i, link.j)
                self.places.refuse(link.j, link.i, "the rest of the graph contradicts it")
            gone = NodeStatus.GONE in (memory.skeleton.kept(link.i), memory.skeleton.kept(link.j))
            if not linked and not gone and id(edge) in believed:
                memory.link(link)

    def _start_map_if_unconnected(self, mapper: Mapper) -> None:
        """Start a new map in the memory if the mapper has lost its connection to the earlier frames."""
        unknown = mapper.keys.kinds[EdgeKind.UNKNOWN]
        if self._unknown_edges is not None and unknown > self._unknown_edges and self._last is not None:
            self.memory.start_map()
            self._last = None
        self._unknown_edges = unknown

    def _reattach(self, mapper: Mapper) -> None:
        """Move STM nodes with their frames, which the mapper places by odometry first and by their scan later."""
        for node in self.memory.stm:
            stamp_ns, anchor = int(self.memory.node(node).stamp_ns), int(self.memory.skeleton.rows["anchor"][node])
            placed = mapper.pose_at(stamp_ns, self.settings.gap)
            if placed is None:
                continue
            key, pose = placed
            key_from_node = mapper.keys.pose(key).inverse() @ pose
            moved = self.memory.skeleton.anchor_from_node(node).inverse() @ key_from_node
            if key != anchor or math.hypot(moved.x, moved.y) > _MOVED:
                self.memory.attach(node, key, key_from_node)
