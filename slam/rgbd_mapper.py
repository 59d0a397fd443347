"""A map of colour and depth alone: visual odometry, loops among its key frames, and every frame's pose at the end."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from waychair.config import Settings, setting
from waychair.slam.depth_icp import IcpSettings, refine_by_depth
from waychair.slam.features import Features
from waychair.slam.registration import angle_between, register
from waychair.slam.spatial_graph import SpatialEdge, SpatialSettings, solve_spatial
from waychair.slam.visual_map import DEPTH_STEP, VisualMap
from waychair.slam.visual_odometry import OdometrySettings, Tracked, VisualOdometry
from waychair.types import FloatArray, Pose3, RgbdFrame, Trajectory3

_TORN = np.diag([1.0] * 3 + [25.0] * 3)  # covariance [rad^2], [m^2] of a motion that nothing has seen

_MANY = 100  # landmarks shared by two key frames whose relative pose is known as well as any


@dataclass(frozen=True, slots=True)
class RgbdMapperSettings(Settings):
    """When a loop is looked for and believed, and the parts' own settings."""

    loop_gap: int = setting(10, "", "latest key frames that make no loop", low=1, high=10_000)
    loop_shared: int = setting(10, "", "nor those that share so many landmarks with the new one", low=1, high=10_000)
    loop_every: int = setting(2, "", "key frames from one search for loops to the next", low=1, high=100)
    loop_rest: int = setting(6, "", "key frames after a closed loop in which none is looked for", low=0, high=1000)
    max_blame: int = setting(
        2, "", "loops that an older edge may contradict before it is itself left out", low=1, high=1000
    )
    loop_inliers: int = setting(60, "", "matches that agree make a loop", low=8, high=1000)
    loop_distance: float = setting(0.03, "m", "a loop that moves less changes nothing", low=0.0, high=10.0)
    loop_angle: float = setting(0.02, "rad", "the same for its turn", low=0.0, high=3.2)
    step_angle: float = setting(0.02, "rad", "standard deviation between neighbouring key frames", low=1e-5, high=1.0)
    step_distance: float = setting(0.02, "m", "the same for the way", low=1e-5, high=1.0)
    neighbours: int = setting(3, "", "key frames each is tied to: those that share most with it", low=1, high=20)
    odometry: OdometrySettings = field(default_factory=OdometrySettings)
    icp: IcpSettings = field(default_factory=IcpSettings)
    graph: SpatialSettings = field(default_factory=SpatialSettings)


class Recall(Protocol):
    """What says which key frames a picture may show again: best first, none of those excluded."""

    def candidates(self, features: Features, excluded: Sequence[int] = (), most: int = 3) -> list[int]: ...


@dataclass(frozen=True, slots=True)
class Loop:
    """Two key frames that show the same place: `i_from_j` with its covariance (6, 6), and how many matches agree."""

    i: int
    j: int
    i_from_j: Pose3
    covariance: FloatArray
    inliers: int


@dataclass(frozen=True, slots=True)
class RgbdMap:
    """What the pictures became: the pose of the optical frame at each frame whose place is known, in the optical frame
    of the first; `pieces` (N,) numbers the stretches between which nothing has seen the motion; states counts what
    became of the frames."""

    trajectory: Trajectory3
    pieces: tuple[int, ...]
    key_poses: tuple[Pose3, ...]
    loops: tuple[Loop, ...]
    rejected: tuple[str, ...]
    states: dict[str, int]
    counts: dict[str, int]
    seconds: dict[str, float]


@dataclass(frozen=True, slots=True)
class _Hung:
    """A frame hangs on a key frame and moves with it."""

    stamp_ns: int
    key: int
    key_from_camera: Pose3


class RgbdMapper:
    """Feed it frames in their order, then ask for the `result`.

    `recall` may be replaced by anything with `candidates`; by default the odometry's own vote is asked.
    """

    def __init__(self, settings: RgbdMapperSettings | None = None, recall: Recall | None = None) -> None:
        self.settings = settings or RgbdMapperSettings()
        self.odometry = VisualOdometry(self.settings.odometry)
        self._recall = recall
        self.loops: list[Loop] = []
        self.rejected: list[str] = []
        self.states: Counter[str] = Counter()
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._frames: list[_Hung] = []
        self._ties: list[list[tuple[int, int]]] = []  # of each key frame: earlier ones that share most with it
        self.refused_icp = 0  # loops that depth could not refine
        self._blamed: Counter[tuple[int, int]] = Counter()  # edges that contradicted a loop
        self._closed_at = -self.settings.loop_rest  # key frame that closed the last loop
        self._confirmed = 0

    def process(self, frame: RgbdFrame) -> Tracked:
        """Where the frame was taken, and what became of it."""
        with self._timed("odometry"):
            tracked = self.odometry.process(frame)
        self.states[tracked.state.value] += 1
        if tracked.key is not None:
            self._ties.append(self._tied(tracked))
            with self._timed("loops"):
                self._close_loops(tracked.key)
        if tracked.camera_from_map is not None:
            self._hang(frame.stamp_ns, tracked)
        return tracked

    def result(self) -> RgbdMap:
        """The map so far."""
        stamps = np.array([frame.stamp_ns for frame in self._frames], np.int64)
        keys = self.map.key_frames if self.odometry.map is not None else []
        poses = [keys[hung.key].camera_from_map.inverse() @ hung.key_from_camera for hung in self._frames]
        trajectory = Trajectory3(
            stamps,
            np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3),
            np.array([pose.translation for pose in poses]).reshape(-1, 3),
        )
        counts = {
            "key_frames": len(keys),
            "landmarks": int(self.map.alive.sum()) if keys else 0,
            "loops": len(self.loops),
            "confirmed": self._confirmed,
            "rejected_loops": len(self.rejected),
            "loops_without_icp": self.refused_icp,
        }
        return RgbdMap(
            trajectory,
            tuple(keys[hung.key].piece for hung in self._frames),
            tuple(key.camera_from_map.inverse() for key in keys),
            tuple(self.loops),
            tuple(self.rejected),
            dict(self.states),
            counts,
            dict(self.seconds),
        )

    @property
    def map(self) -> VisualMap:
        """Key frames and landmarks; there is one from the first frame with depth on."""
        assert self.odometry.map is not None
        return self.odometry.map

    def _hang(self, stamp_ns: int, tracked: Tracked) -> None:
        """The frame beside the latest key frame of its piece."""
        keys = self.map.key_frames
        key = max(number for number, own in enumerate(keys) if own.piece == self.odometry.piece)
        camera_from_map = keys[key].camera_from_map if tracked.key == key else tracked.camera_from_map
        assert camera_from_map is not None
        self._frames.append(_Hung(stamp_ns, key, keys[key].camera_from_map @ camera_from_map.inverse()))

    def _tied(self, tracked: Tracked) -> list[tuple[int, int]]:
        """Earlier key frames and how many landmarks they share with a new one."""
        shared = self.map.sharing(tracked.landmarks)[: tracked.key]
        best = np.argsort(-shared, kind="stable")[: self.settings.neighbours].tolist()
        return [(key, int(shared[key])) for key in best if shared[key] >= self.settings.loop_shared]

    def _close_loops(self, key: int) -> None:
        """Key frames that look like the newest but share no landmarks with it: is it the same place?"""
        settings, own = self.settings, self.map.key_frames[key]
        if key % settings.loop_every or key - self._closed_at < settings.loop_rest:
            return
        shared = self.map.sharing(own.landmarks)
        near = set(range(key - settings.loop_gap, key + 1))
        near.update(np.flatnonzero(shared >= settings.loop_shared).tolist())
        recall: Recall = self._recall or self.odometry.recall
        for candidate in recall.candidates(own.features, sorted(near)):
            there = self.map.key_frames[candidate]
            found = register(there.features, own.features, self.map.camera, settings.odometry.registration)
            if found.old_from_new is None or found.inliers < settings.loop_inliers:
                continue
            coarse = self.map.camera / DEPTH_STEP
            by_depth = refine_by_depth(there.depth, own.depth, coarse, found.old_from_new, settings.icp)
            self.refused_icp += by_depth.refusal is not None
            loop = Loop(candidate, key, by_depth.old_from_new, found.covariance, found.inliers)
            if self._is_known(loop):
                self._confirmed += 1
            elif self._close(loop):
                break

    def _is_known(self, loop: Loop) -> bool:
        """Whether the map says already what a loop says."""
        a, b = self.map.key_frames[loop.i], self.map.key_frames[loop.j]
        now = a.camera_from_map @ b.camera_from_map.inverse()
        near = float(np.linalg.norm(now.translation - loop.i_from_j.translation)) <= self.settings.loop_distance
        return a.piece == b.piece and near and angle_between(now, loop.i_from_j) <= self.settings.loop_angle

    def _close(self, loop: Loop) -> bool:
        """Takes a loop in, if the rest of the map can be bent to it; then what both ends see becomes one."""
        i, j = loop.i, loop.j
        keys = self.map.key_frames
        poses = [key.camera_from_map.inverse() for key in keys]
        edges = self._edges([*self.loops, loop])
        if keys[i].piece != keys[j].piece:  # nothing is known of how the two lie, so begin where the loop puts the new
            moved = poses[i] @ loop.i_from_j @ poses[j].inverse()
            poses = [
                moved @ pose if key.piece == keys[j].piece else pose for key, pose in zip(keys, poses, strict=True)
            ]
        solution = solve_spatial(poses, edges, self.settings.graph)
        worst = edges[int(np.argmax(solution.errors))]
        if solution.errors.max() > self.settings.graph.max_error:
            self.rejected.append(f"loop {i}-{j}: edge {worst.i}-{worst.j} contradicts it")
            self._blamed[worst.i, worst.j] += 1
            return False
        self.loops.append(loop)
        self._closed_at = j
        self.map.move(solution.poses)
        self.map.join(keys[j].piece, keys[i].piece)
        self.odometry.resettle(keys[i].piece)
        return True

    def _edges(self, loops: Sequence[Loop]) -> list[SpatialEdge]:
        """How the key frames lie to those they share landmarks with, as the map has it; where the motion was not seen,
        next to nothing; and the loops. What contradicted too many loops is left out (as RTAB-Map's repair does)."""
        settings, keys = self.settings, self.map.key_frames
        step = np.diag([settings.step_angle**2] * 3 + [settings.step_distance**2] * 3)
        edges = []
        blamed = {pair for pair, times in self._blamed.items() if times >= settings.max_blame}
        for j, every in enumerate(self._ties):
            ties = [(i, shared) for i, shared in every if (i, j) not in blamed]
            for i, shared in ties or ([(j - 1, 0)] if j else []):
                i_from_j = keys[i].camera_from_map @ keys[j].camera_from_map.inverse()
                doubt = max(1.0, _MANY / shared) if shared else 1.0  # the fewer landmarks two share, the less is known
                edges.append(SpatialEdge(i, j, i_from_j, doubt**2 * step if ties else _TORN))
        kept = [loop for loop in loops if (loop.i, loop.j) not in blamed]
        return [*edges, *(SpatialEdge(loop.i, loop.j, loop.i_from_j, loop.covariance) for loop in kept)]

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        started = time.process_time()
        yield
        self.seconds[stage] += time.process_time() - started
