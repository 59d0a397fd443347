"""The RGB-D mapper, from colour and depth alone: visual odometry, loop closures among key frames, all frames' poses."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.config import Settings
from waychair.slam.camera.depth_icp import refine_by_depth
from waychair.slam.camera.picture_registration import Registration, angle_between, register
from waychair.slam.camera.tracked_picture import PictureOutcome, TrackedPicture
from waychair.slam.camera.visual_map import DEPTH_STEP, VisualMap
from waychair.slam.camera.visual_odometry import VisualOdometry, VisualOdometrySettings
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import LinkKind
from waychair.slam.rgbd.key_places import KeyPlaces, planar_information, planar_poses
from waychair.slam.rgbd.spatial_graph import MAX_ERROR, SpatialEdge, solve_spatial
from waychair.slam.words.recognition_settings import RecognitionSettings
from waychair.types import FloatArray, Pose3, RgbdFrame, Trajectory3

_UNOBSERVED = np.diag([1.0] * 3 + [25.0] * 3)  # covariance [rad^2], [m^2] of an unobserved motion

_LOOP_SHARED = 10  # key frames that share this many landmarks need no loop
_MAX_BLAME = 2  # contradicted loops after which an older edge is left out
LOOP_INLIERS = 60
"""Least number of matches that agree for a loop by features alone."""

_DEPTH_LOOP_INLIERS = 25  # that suffices where the depth of both views confirms the pose: views from near and far

_LOOP_DISTANCE, _LOOP_ANGLE = 0.03, 0.02  # [m], [rad] a loop that moves less changes nothing
_LOOP_SHARE = 0.9  # least share of the matches that agree after ICP
_STEP_ANGLE, _STEP_DISTANCE = 0.02, 0.02  # [rad], [m] standard deviations between neighbouring key frames
_NEIGHBOURS = 3  # key frames that each one is linked to: those with most shared landmarks
NEAR_DISTANCE = 1.0
"""A link to an earlier place of at most this length [m] is a return of the camera."""

_MANY = 100  # shared landmarks of two key frames beyond which their relative pose gets no better


@dataclass(frozen=True, slots=True)
class RgbdMapperSettings(Settings):
    """The settings of the parts."""

    odometry: VisualOdometrySettings = field(default_factory=VisualOdometrySettings)
    places: RecognitionSettings = field(default_factory=RecognitionSettings)
    memory: MemorySettings = field(default_factory=MemorySettings)


@dataclass(frozen=True, slots=True)
class VisualLoop:
    """A loop between two key frames of one place: `i_from_j`, its covariance (6, 6), and its number of inliers."""

    i: int
    j: int
    i_from_j: Pose3
    covariance: FloatArray
    inliers: int


@dataclass(frozen=True, slots=True)
class RgbdMap:
    """The result of the mapper.

    `trajectory`: poses of the optical frame, for each located frame, in the optical frame of the first. `pieces` (N,):
    the piece of each frame; the motion between two pieces is unobserved. `states` counts the outcomes of frames.
    """

    trajectory: Trajectory3
    pieces: tuple[int, ...]
    key_poses: tuple[Pose3, ...]
    loops: tuple[VisualLoop, ...]
    rejected: tuple[str, ...]
    states: dict[str, int]
    counts: dict[str, int]
    seconds: dict[str, float]


@dataclass(frozen=True, slots=True)
class _AttachedFrame:
    """A frame attached to a key frame, with which it moves."""

    stamp_ns: int
    key: int
    key_from_camera: Pose3


class RgbdMapper:
    """Pass frames to `process` in order, then call `finish`, then `result`.

    Every key frame is a place of `places`, whose Bayes filter proposes an earlier one that it shows again.
    """

    def __init__(self, settings: RgbdMapperSettings | None = None, memory: NodeMemory | None = None) -> None:
        """Begin with a new memory, by default in RAM."""
        self.settings = settings or RgbdMapperSettings()
        words = replace(self.settings.places, features=self.settings.odometry.features)
        self.places = KeyPlaces(words, memory or NodeMemory(self.settings.memory))
        self.odometry = VisualOdometry(self.settings.odometry, self.places.likeliest)
        self.loops: list[VisualLoop] = []
        self.rejected: list[str] = []
        self.states: Counter[str] = Counter()
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._frames: list[_AttachedFrame] = []
        self._shared_with: list[list[tuple[int, int]]] = []  # by key frame: earlier ones that share most with it
        self.refused_icp = 0  # loops that ICP could not refine
        self._blamed: Counter[tuple[int, int]] = Counter()  # edges that contradicted a loop
        self._proposed = self._confirmed = 0

    def process(self, frame: RgbdFrame) -> TrackedPicture:
        """Process a frame; return its pose and outcome."""
        with self._timed("odometry"):
            tracked = self.odometry.process(frame)
        self.states[tracked.state.value] += 1
        if tracked.key is not None:
            self._shared_with.append(self._most_shared(tracked))
            if tracked.key:  # the first is made again once the second picture shows the camera's motion
                with self._timed("loops"):
                    self._include(tracked.key, tracked.state is PictureOutcome.STARTED)
        if tracked.camera_from_map is not None:
            self._attach(frame.stamp_ns, tracked)
        return tracked

    def finish(self) -> None:
        """Complete the memory after the last frame, and write it to disk."""
        if self.odometry.map is not None:
            if not len(self.places):
                self._include(0, True)
            self.places.finish(planar_poses(self.map.key_frames))

    def result(self) -> RgbdMap:
        """Return the map so far."""
        stamps = np.array([frame.stamp_ns for frame in self._frames], np.int64)
        keys = self.map.key_frames if self.odometry.map is not None else []
        poses = [keys[attached.key].camera_from_map.inverse() @ attached.key_from_camera for attached in self._frames]
        trajectory = Trajectory3(
            stamps,
            np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3),
            np.array([pose.translation for pose in poses]).reshape(-1, 3),
        )
        counts = {
            "key_frames": len(keys),
            "landmarks": int(self.map.alive.sum()) if keys else 0,
            "proposed": self._proposed,
            "loops": len(self.loops),
            "confirmed": self._confirmed,
            "rejected_loops": len(self.rejected),
            "loops_without_icp": self.refused_icp,
        }
        return RgbdMap(
            trajectory=trajectory,
            pieces=tuple(keys[attached.key].piece for attached in self._frames),
            key_poses=tuple(key.camera_from_map.inverse() for key in keys),
            loops=tuple(self.loops),
            rejected=tuple(self.rejected),
            states=dict(self.states),
            counts=counts,
            seconds=dict(self.seconds),
        )

    @property
    def map(self) -> VisualMap:
        """The key frames and landmarks; there is a map from the first frame with depth on."""
        assert self.odometry.map is not None
        return self.odometry.map

    def _attach(self, stamp_ns: int, tracked: TrackedPicture) -> None:
        """Attach a frame to the latest key frame of its piece."""
        keys = self.map.key_frames
        key = max(number for number, own in enumerate(keys) if own.piece == self.odometry.piece)
        camera_from_map = keys[key].camera_from_map if tracked.key == key else tracked.camera_from_map
        assert camera_from_map is not None
        self._frames.append(_AttachedFrame(stamp_ns, key, keys[key].camera_from_map @ camera_from_map.inverse()))

    def _most_shared(self, tracked: TrackedPicture) -> list[tuple[int, int]]:
        """Return the earlier key frames that share most landmarks with a new one, and how many."""
        shared = self.map.sharing(tracked.landmarks)[: tracked.key]
        best = np.argsort(-shared, kind="stable")[:_NEIGHBOURS].tolist()
        return [(key, int(shared[key])) for key in best if shared[key] >= _LOOP_SHARED]

    def _include(self, newest: int, unconnected: bool) -> None:
        """Make the newest key frame a place, and close a loop if an earlier one shows the same place."""
        candidates: list[int] = []
        keys = self.map.key_frames
        for key in range(len(self.places), newest + 1):
            if unconnected and key:
                self.places.start_map()
            step = self._step(dict(self._shared_with[key]).get(key - 1, 0))
            spent_s = self.odometry.features.spent_s if key == newest else 0.0
            candidates = self.places.add(keys[key], planar_information(step), planar_poses(keys[: key + 1]), spent_s)
        any(self._check_place(old, newest) for old in candidates)  # up to the first that fits

    def _check_place(self, old: int, new: int) -> bool:
        """Link two key frames, by the map if they share landmarks, else by a new loop; return whether it is done."""
        self._proposed += 1
        keys = self.map.key_frames
        if self.map.sharing(keys[new].landmarks)[old] >= _LOOP_SHARED:
            return self._confirm(old, new)
        camera, there, here = self.map.camera, keys[old], keys[new]
        found = register(there.sized, here.sized, camera)
        refined = self._refined(found, old, new) if found.inliers >= _DEPTH_LOOP_INLIERS else None
        if found.old_from_new is None or (refined is None and found.inliers < LOOP_INLIERS):
            why = "too few features agree" if found.refusal is None else found.refusal.value
            self.places.refuse(old, new, why)
            return False
        self.refused_icp += refined is None
        loop = VisualLoop(old, new, refined or found.old_from_new, found.covariance, found.inliers)
        if self._is_known(loop):
            return self._confirm(old, new)
        return self._close_loop(loop)

    def _confirm(self, old: int, new: int) -> bool:
        """Link two places whose relative pose the map already has right."""
        keys = self.map.key_frames
        old_from_new = keys[old].camera_from_map @ keys[new].camera_from_map.inverse()
        self.places.link(old, new, LinkKind.GLOBAL, old_from_new, planar_information(self._step(_MANY)))
        self._confirmed += 1
        return True

    def _refined(self, found: Registration, old: int, new: int) -> Pose3 | None:
        """Return `old_from_new` refined by ICP; None without a pose or if the features do not agree with ICP.

        A rolling shutter bends the depth of a turning camera; the features are corrected for it.
        """
        if found.old_from_new is None:
            return None
        keys, camera = self.map.key_frames, self.map.camera
        fit = refine_by_depth(keys[old].depth, keys[new].depth, camera / DEPTH_STEP, found.old_from_new)
        agrees = fit.refusal is None and found.inlier_share(fit.old_from_new, camera) >= _LOOP_SHARE
        return fit.old_from_new if agrees else None

    def _is_known(self, loop: VisualLoop) -> bool:
        """Return whether the map already has the relative pose of a loop."""
        a, b = self.map.key_frames[loop.i], self.map.key_frames[loop.j]
        now = a.camera_from_map @ b.camera_from_map.inverse()
        near = float(np.linalg.norm(now.translation - loop.i_from_j.translation)) <= _LOOP_DISTANCE
        return a.piece == b.piece and near and angle_between(now, loop.i_from_j) <= _LOOP_ANGLE

    def _close_loop(self, loop: VisualLoop) -> bool:
        """Add a loop if the map can be bent to it, and join landmarks of both ends; return whether it was added."""
        i, j = loop.i, loop.j
        keys = self.map.key_frames
        poses = [key.camera_from_map.inverse() for key in keys]
        edges = self._edges([*self.loops, loop])
        if keys[i].piece != keys[j].piece:  # their relative pose is unknown: begin with the loop's
            moved = poses[i] @ loop.i_from_j @ poses[j].inverse()
            poses = [
                moved @ pose if key.piece == keys[j].piece else pose for key, pose in zip(keys, poses, strict=True)
            ]
        solution = solve_spatial(poses, edges)
        worst = edges[int(np.argmax(solution.errors))]
        if solution.errors.max() > MAX_ERROR:
            self.rejected.append(f"loop {i}-{j}: edge {worst.i}-{worst.j} contradicts it")
            self.places.refuse(i, j, "the rest of the graph contradicts it")
            self._blamed[worst.i, worst.j] += 1
            return False
        self.loops.append(loop)
        self.map.move(solution.poses)
        self.map.join(keys[j].piece, keys[i].piece)
        self.odometry.relocate_newest(keys[i].piece)
        self.places.move_key_frames(planar_poses(keys))
        self.places.link(i, j, LinkKind.GLOBAL, loop.i_from_j, planar_information(loop.covariance))
        return True

    def _edges(self, loops: Sequence[VisualLoop]) -> list[SpatialEdge]:
        """Return the edges of the graph: between key frames that share landmarks, across unobserved motion, and loops.

        Edges that contradicted too many loops are left out (as in RTAB-Map's repair).
        """
        keys = self.map.key_frames
        edges = []
        blamed = {pair for pair, times in self._blamed.items() if times >= _MAX_BLAME}
        for j, every in enumerate(self._shared_with):
            ties = [(i, shared) for i, shared in every if (i, j) not in blamed]
            for i, shared in ties or ([(j - 1, 0)] if j else []):
                i_from_j = keys[i].camera_from_map @ keys[j].camera_from_map.inverse()
                edges.append(SpatialEdge(i, j, i_from_j, self._step(shared)))
        kept = [loop for loop in loops if (loop.i, loop.j) not in blamed]
        return [*edges, *(SpatialEdge(loop.i, loop.j, loop.i_from_j, loop.covariance, True) for loop in kept)]

    def _step(self, shared: int) -> FloatArray:
        """Return the covariance (6, 6) between two key frames by their number of shared landmarks: more with fewer."""
        if not shared:
            return _UNOBSERVED
        doubt = max(1.0, _MANY / shared)
        return doubt**2 * np.diag([_STEP_ANGLE**2] * 3 + [_STEP_DISTANCE**2] * 3)

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        started = time.process_time()
        yield
        self.seconds[stage] += time.process_time() - started
