"""The mapper: one sensor frame in, the pose in the map out, and a graph of key scans that closes its loops."""

from __future__ import annotations

import math
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import compose, interpolate, pose_from_array, rotation, transform_points
from waychair.slam.graph import Edge, EdgeKind, GraphSettings, chi_square, optimise
from waychair.slam.loop_closure import Candidate, LoopSettings, candidates
from waychair.slam.reference import Reference, reference_from_scans
from waychair.slam.scan_matching import MatchSettings, Window, correlative_search, match, refine
from waychair.slam.scan_points import MIN_POINTS, ScanPoints, ScanStore, scan_points
from waychair.types import FloatArray, Odometry, Pose2, SensorFrame, Trajectory, Twist


@dataclass(frozen=True, slots=True)
class MapperSettings(Settings):
    """Key scans, odometry noise and the parts' own settings."""

    key_distance: float = setting(0.2, "m", "distance between key scans", low=0.0, high=5.0)
    key_angle: float = setting(math.radians(10), "rad", "turn between key scans", low=0.0, high=math.pi)
    running_scans: int = setting(40, "", "latest key scans a new one is matched against", low=1, high=1000)
    running_reach: float = setting(12.0, "m", "size of the reference round the chair", low=2.0, high=60.0)
    odometry_distance_noise: float = setting(0.1, "m/m", "standard deviation per metre driven", low=1e-4, high=1.0)
    odometry_angle_noise: float = setting(0.2, "rad/rad", "standard deviation per radian turned", low=1e-4, high=1.0)
    odometry_drift_noise: float = setting(0.05, "rad/m", "heading's standard deviation per metre", low=1e-4, high=1.0)
    match_position_noise: float = setting(0.01, "m", "least standard deviation of a match", low=1e-4, high=1.0)
    match_angle_noise: float = setting(0.004, "rad", "least standard deviation of a match", low=1e-5, high=1.0)
    search_distance: float = setting(0.3, "m", "half window of the search round the odometry", low=0.05, high=5.0)
    search_angle: float = setting(0.35, "rad", "half window of the search round the odometry", low=0.02, high=3.1)
    good_response: float = setting(
        0.7, "", "a match below this is searched for in the window of a slip", low=0.0, high=1.0
    )
    slip_distance: float = setting(1.2, "m", "half window where the odometry may have slipped", low=0.05, high=10.0)
    slip_angle: float = setting(0.6, "rad", "half window where the odometry may have slipped", low=0.02, high=3.1)
    min_inliers: float = setting(0.3, "", "a match with fewer points on surfaces is not used", low=0.0, high=1.0)
    matching: MatchSettings = field(default_factory=MatchSettings)
    loops: LoopSettings = field(default_factory=LoopSettings)
    graph: GraphSettings = field(default_factory=GraphSettings)


@dataclass(frozen=True, slots=True)
class MapperResult:
    """What a recording became.

    `trajectory` has one pose per frame, in the order of the input; key scan k stands at `key_poses[k]` (N, 3) and is
    the scan of frame `key_frames[k]`; `counts` and `seconds` (CPU) by stage are for the report.
    """

    trajectory: Trajectory
    key_poses: FloatArray
    key_frames: tuple[int, ...]
    edges: tuple[Edge, ...]
    counts: dict[str, int]
    seconds: dict[str, float]


class Mapper:
    """Graph SLAM over key scans; feed it frames in the order of the recording, then ask for the `result`."""

    def __init__(self, settings: MapperSettings, base_from_laser: Pose2) -> None:
        self.settings = settings
        self.base_from_laser = base_from_laser
        self.store = ScanStore()
        self.poses = np.empty((0, 3))
        self.edges: list[Edge] = []
        self.counts: Counter[str] = Counter()
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._key_frames: list[int] = []
        self._key_odometry: list[Pose2] = []
        self._frames: list[tuple[int, int, Pose2]] = []  # stamp_ns, key scan, key_from_base by odometry
        self._since_search = math.inf
        self._motion = Pose2()

    def process(self, frame: SensorFrame) -> Pose2:
        """`map_from_base` at the stamp of the frame's scan."""
        assert frame.scan is not None
        odometry = self._reckon(frame)  # where the wheels say the chair is
        key_from_base = self._key_odometry[-1].inverse() @ odometry if self._key_odometry else Pose2()
        if not self._is_key(key_from_base):
            return self._remember(frame, key_from_base)
        scan = self._points(frame)
        edge = self._match(scan, key_from_base)  # where the scan says it is
        self._add(frame, scan, odometry, edge)
        closed = [self._close(candidate) for candidate in self._candidates()]  # has it been here before?
        if any(closed):
            self._optimise()
        return pose_from_array(self.poses[-1])

    def result(self) -> MapperResult:
        """The map so far, its graph optimised once more."""
        self._optimise()
        return MapperResult(
            self._trajectory(),
            self.poses.copy(),
            tuple(self._key_frames),
            tuple(self.edges),
            dict(self.counts),
            dict(self.seconds),
        )

    def _reckon(self, frame: SensorFrame) -> Pose2:
        """`odom_from_base` of the frame: its own odometry, else the last motion repeated and matched."""
        self.counts["frames"] += 1
        own = [reading for reading in frame.wheels if isinstance(reading, Odometry)]
        if own:
            return own[-1].odom_from_base
        if not self._key_odometry:
            return Pose2()
        assert frame.scan is not None
        _, key, key_from_last = self._frames[-1]
        guess = pose_from_array(self.poses[key]) @ key_from_last @ self._motion
        settings = self.settings
        found = match(
            self._points(frame), self._running(guess), guess, np.diag([1.0, 1.0, 1.0]),
            Window(settings.search_distance, settings.search_angle), settings.matching,
        )  # fmt: skip
        pose = found.pose if found.inliers >= settings.min_inliers else guess
        key_from_base = pose_from_array(self.poses[key]).inverse() @ pose
        self._motion = key_from_last.inverse() @ key_from_base
        return self._key_odometry[-1] @ key_from_base

    def _is_key(self, key_from_base: Pose2) -> bool:
        if not self._key_odometry:
            return True
        distance = math.hypot(key_from_base.x, key_from_base.y)
        return distance >= self.settings.key_distance or abs(key_from_base.theta) >= self.settings.key_angle

    def _remember(self, frame: SensorFrame, key_from_base: Pose2) -> Pose2:
        key = len(self.poses) - 1
        self._frames.append((frame.stamp_ns, key, key_from_base))
        return pose_from_array(self.poses[key]) @ key_from_base

    def _points(self, frame: SensorFrame) -> ScanPoints:
        assert frame.scan is not None
        with self._timed("points"):
            return scan_points(frame.scan, self.base_from_laser, self.settings.matching.range_max, twist_of(frame))

    def _running(self, guess: Pose2) -> Reference:
        """The surfaces of the latest key scans round the chair."""
        members = np.arange(max(0, len(self.poses) - self.settings.running_scans), len(self.poses))
        near = np.hypot(*(self.poses[members, :2] - (guess.x, guess.y)).T) < self.settings.running_reach
        matching = self.settings.matching
        return reference_from_scans(
            self.store, self.poses, members[near], guess.array(), self.settings.running_reach, matching.resolution,
            matching.sigma,
        )  # fmt: skip

    def _match(self, scan: ScanPoints, key_from_base: Pose2) -> Edge | None:
        """Edge from the last key scan to the new one: odometry, improved by the match where the scan can tell."""
        if not len(self.poses):
            return None
        with self._timed("matching"):
            settings, node = self.settings, len(self.poses)
            guess = pose_from_array(self.poses[-1]) @ key_from_base
            prior = _turned(self._odometry_information(key_from_base), guess.theta)
            window = Window(settings.search_distance, settings.search_angle)
            reference = self._running(guess)
            found = match(scan, reference, guess, prior, window, settings.matching)
            if found.response < settings.good_response:  # the odometry slipped, or this place is new
                window = Window(settings.slip_distance, settings.slip_angle)
                wide = match(scan, reference, guess, prior / 100, window, settings.matching)
                if wide.response > 1.1 * found.response:
                    found, prior = wide, prior / 100
                    self.counts["slips"] += 1
            if len(scan) < MIN_POINTS or found.inliers < settings.min_inliers:
                own = self._odometry_information(key_from_base)
                return Edge(node - 1, node, key_from_base, own, EdgeKind.ODOMETRY)
            self.counts["matches"] += 1
            information = _turned(self._floored(found.information) + prior, -found.pose.theta)
            return Edge(node - 1, node, self._from_node(node - 1, found.pose), information, EdgeKind.MATCH)

    def _add(self, frame: SensorFrame, scan: ScanPoints, odometry: Pose2, edge: Edge | None) -> None:
        pose = Pose2()
        if edge is not None:
            pose = pose_from_array(self.poses[-1]) @ edge.i_from_j
            self.edges.append(edge)
            self._since_search += math.hypot(edge.i_from_j.x, edge.i_from_j.y)
        self.poses = np.concatenate([self.poses, pose.array()[None]])
        self.store.append(scan)
        self._key_frames.append(len(self._frames))
        self._key_odometry.append(odometry)
        self._frames.append((frame.stamp_ns, len(self.poses) - 1, Pose2()))
        self.counts["key_scans"] += 1

    def _candidates(self) -> tuple[Candidate, ...]:
        if self._since_search < self.settings.loops.spacing or len(self.poses) < 2:
            return ()
        self._since_search = 0.0
        with self._timed("loops"):
            recent = len(self.poses) - self.settings.running_scans
            return candidates(self.poses, self.edges, recent, self.settings.loops)

    def _close(self, candidate: Candidate) -> bool:
        """Whether the latest key scans, taken together, fit the candidate's surfaces at one pose only."""
        with self._timed("loops"):
            self.counts["loops_tried"] += 1
            loops, matching, node = self.settings.loops, self.settings.matching, len(self.poses) - 1
            guess = pose_from_array(self.poses[-1])
            query = self._query(guess)
            reach = candidate.window + loops.chain_reach + self.settings.running_reach
            reference = reference_from_scans(
                self.store, self.poses, candidate.members, self.poses[candidate.nearest], reach,
                matching.resolution, matching.sigma,
            )  # fmt: skip
            window = Window(candidate.window, candidate.angle)
            coarse, response = correlative_search(
                query.points, reference, guess, window, matching, floor=loops.min_response
            )
            if response < loops.min_response:
                return False
            floor = loops.max_ambiguity * response
            if correlative_search(query.points, reference, guess, window, matching, floor=floor, taken=coarse)[1] > 0:
                self.counts["loops_ambiguous"] += 1
                return False
            pose, information, inliers, _ = refine(query, reference, coarse, coarse, np.zeros((3, 3)), matching)
            if inliers < loops.min_inliers:
                self.counts["loops_rejected"] += 1
                return False
            information = _turned(self._floored(information), -pose.theta)
            self.edges.append(
                Edge(candidate.nearest, node, self._from_node(candidate.nearest, pose), information, EdgeKind.LOOP)
            )
            self.counts["loops_closed"] += 1
            return True

    def _query(self, base: Pose2) -> ScanPoints:
        """The latest key scans in the frame of the last one, thinned to one point per reference cell."""
        points, normals = [], []
        for node in range(max(0, len(self.poses) - self.settings.loops.query_scans), len(self.poses)):
            base_from_node = base.inverse() @ pose_from_array(self.poses[node])
            scan = self.store[node]
            points.append(transform_points(base_from_node, scan.points))
            normals.append(scan.normals @ rotation(base_from_node.theta).T)
        every, facing = np.concatenate(points), np.concatenate(normals)
        _, first = np.unique(np.floor(every / 0.1).astype(np.int64), axis=0, return_index=True)
        return ScanPoints(np.ascontiguousarray(every[first]), np.ascontiguousarray(facing[first]))

    def _optimise(self) -> None:
        """Spreads the loops over the graph; a loop that the rest of the graph contradicts is taken out again."""
        if all(edge.kind is not EdgeKind.LOOP for edge in self.edges):
            return
        with self._timed("optimisation"):
            self.counts["optimisations"] += 1
            limit = self.settings.loops.max_chi_square
            poses = optimise(self.poses, self.edges, self.settings.graph)
            refuted = (chi_square(poses, self.edges) > limit).tolist()
            sound = [
                edge for edge, bad in zip(self.edges, refuted, strict=True) if not bad or edge.kind is not EdgeKind.LOOP
            ]
            if len(sound) < len(self.edges):
                self.counts["loops_refuted"] += len(self.edges) - len(sound)
                self.edges = sound
                poses = optimise(self.poses, self.edges, self.settings.graph)
            self.poses = poses

    def _from_node(self, node: int, pose: Pose2) -> Pose2:
        return pose_from_array(self.poses[node]).inverse() @ pose

    def _odometry_information(self, motion: Pose2) -> FloatArray:
        """(3, 3) information of a motion by the wheels, in its own frame."""
        distance, turn = math.hypot(motion.x, motion.y), abs(motion.theta)
        s = self.settings
        along = 0.01 + s.odometry_distance_noise * distance
        angle = 0.005 + s.odometry_angle_noise * turn + s.odometry_drift_noise * distance
        return np.diag([along**-2, along**-2, angle**-2])

    def _floored(self, information: FloatArray) -> FloatArray:
        """Information of a match that is never better than the settings' least noise."""
        s = self.settings
        floor = np.diag([s.match_position_noise**2, s.match_position_noise**2, s.match_angle_noise**2])
        return np.linalg.inv(np.linalg.inv(information + 1e-6 * np.eye(3)) + floor)

    def _trajectory(self) -> Trajectory:
        """Poses of all frames: by odometry from their key scan, the gap to the next key scan shared out evenly."""
        stamps = np.array([stamp for stamp, _, _ in self._frames], np.int64)
        keys = np.array([key for _, key, _ in self._frames], np.int64)
        by_odometry = np.array([pose.array() for _, _, pose in self._frames])
        poses = compose(self.poses[keys], by_odometry)
        for key in range(len(self.poses) - 1):
            low, high = self._key_frames[key], self._key_frames[key + 1]
            if high - low < 2:
                continue
            reached = pose_from_array(self.poses[key]) @ (
                self._key_odometry[key].inverse() @ self._key_odometry[key + 1]
            )
            gap = reached.inverse() @ pose_from_array(self.poses[key + 1])
            for frame in range(low + 1, high):
                share = interpolate(Pose2(), gap, (frame - low) / (high - low))
                poses[frame] = (pose_from_array(poses[frame]) @ share).array()
        return Trajectory(stamps, poses)

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        started = time.process_time()
        yield
        self.seconds[stage] += time.process_time() - started


def twist_of(frame: SensorFrame) -> Twist | None:
    """Twist of the base at the frame's stamp by its own odometry, if it has any."""
    own = [reading for reading in frame.wheels if isinstance(reading, Odometry)]
    return own[-1].twist if own else None


def _turned(information: FloatArray, theta: float) -> FloatArray:
    """Information (3, 3) of a pose in a frame turned by -theta against the one it is given in."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(theta)
    result: FloatArray = turn @ information @ turn.T
    return result
