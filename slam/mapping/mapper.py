"""The mapper (graph SLAM): it tracks the chair by scan matching, adds key scans to a pose graph, and closes loops."""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import compose, interpolate
from waychair.slam.graph.graph_optimisation import Edge, EdgeKind
from waychair.slam.graph.information import (
    match_information,
    odometry_information,
    rotated_information,
    unknown_information,
)
from waychair.slam.mapping.attached_frames import AttachedFrame, AttachedFrames
from waychair.slam.mapping.carried import SLIP_CLAIMED, SUSPICIOUS, CarryJudge, OpenTear, agrees_with_odometry
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.mapping.loop_candidates import MIN_LOOP_PATH, LoopSettings
from waychair.slam.mapping.loop_closure import LoopCloser, LoopRejection
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.slam.mapping.open_tears import RECENT_KEYS, OpenTears, Ruling
from waychair.slam.mapping.tracking import TrackedFrame, TrackingState, odometry_of, twist_of
from waychair.slam.scan.reference_surfaces import ScanReference
from waychair.slam.scan.scan_matching import MatchSettings, Window, match, refine
from waychair.slam.scan.scan_points import MIN_POINTS, ScanPoints, scan_points
from waychair.types import Pose2, SensorFrame, Trajectory

LOCAL_REACH = 12.0
"""Half side [m] of the reference round the chair."""

_COVER_DISTANCE, _COVER_ANGLE = 0.3, math.radians(15)  # m, rad; a key scan this near covers a view
_COVER_PATH = 1.5  # m; longest path along the edges to a covering key scan
_COVERED_SCANS = 3  # latest scans that are kept for the grid beside each key scan that covers them
CERTAIN_PATH = 3.0  # m; key scans this near along the edges are matched against, too
_MOST_CERTAIN = 150  # of these, the nearest along the edges; a chair that stays in one room for days has thousands
_CERTAIN_STEPS, _LATEST = 6.0, 10  # or within so many mean steps between the latest key scans, if these are far apart
_SEARCH_DISTANCE, _SEARCH_ANGLE = 0.3, 0.35  # m, rad; half window round the odometry
_MATCHED_SHARE = 0.4  # share of that window if the scan was already aligned
_GOOD_RESPONSE = 0.7  # a match with a lower response is searched again where the odometry may have slipped
_MIN_INLIERS = 0.3  # a match with a smaller share of points on surfaces is not used
_GUESS_DOUBT = 100.0  # without odometry, a motion that is continued has so much less information
_DOUBTS = 2  # scans in a row that contradict the key scans before a tear is declared
_TRACK_INLIERS = 0.5  # between full matches, a scan with a smaller share of points on surfaces leaves the odometry
_UNSEEN = 10  # scans in a row; fewer that do not show the motion along a corridor matter little
_TRACK_POINTS = 360  # points of a scan that are aligned between full matches
_TRACK_REACH = 0.12  # m; largest error of the odometry since the last scan
_TRACK_FARTHEST = 0.3  # m; a scan that is aligned farther from the odometry's pose has slid along a corridor
_FASTEST, _LEAST_STEP_S = 5.0, 0.3  # m/s, s; odometry that is faster for longer is no motion of a chair
_STANDING_STAMP_S = 1.0  # s; assumed between two stamps that do not advance, which tell no speed


@dataclass(frozen=True, slots=True)
class MapperSettings(Settings):
    """How densely key scans are placed, how scans are matched, and where loops are searched."""

    key_distance: float = setting(
        0.2, "m", "distance driven between key scans; larger: mapping takes less memory and time and is less accurate",
        low=0.0, high=5.0,
    )  # fmt: skip
    key_angle: float = setting(
        math.radians(10), "rad",
        "turn between key scans; larger: mapping takes less memory and time and is less accurate",
        low=0.0, high=math.pi,
    )  # fmt: skip
    matching: MatchSettings = field(default_factory=MatchSettings)
    loops: LoopSettings = field(default_factory=LoopSettings)


class Mapper:
    """Graph SLAM over key scans: `process` the frames in the order of the recording, then take the `result`.

    Every frame is aligned with the surfaces of the key scans round it; every 0.2 m or 10 degrees a full match follows.
    A frame becomes a key scan only where no earlier key scan covers its view, so the graph grows with the building and
    not with the time spent in it; nor does the work with each frame, which asks for the nearest key scans.
    """

    def __init__(self, settings: MapperSettings, base_from_laser: Pose2) -> None:
        self.settings = settings
        self.base_from_laser = base_from_laser
        self.keys = KeyGraph()
        self.frames = AttachedFrames()
        self.key_frames: list[int] = []
        self.covered_frames: list[list[int]] = []  # of each key scan: the latest frames that it covers
        self.earlier_frames = 0  # frames below this number belong to earlier drives
        self.counts: Counter[str] = Counter()
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._recent_keys: list[int] = []  # latest key scans visited; new frames are attached to the last one
        self._reference: ScanReference | None = None
        self._state = TrackingState()
        self._judge = CarryJudge(settings.matching, LOCAL_REACH, base_from_laser)
        self._tears = OpenTears(self._judge)
        self._closer = LoopCloser(settings.loops, settings.matching, LOCAL_REACH, base_from_laser, self._judge)

    def process(self, frame: SensorFrame) -> Pose2:
        """Return `map_from_base` at the stamp of the frame's scan."""
        last_from_base = self._motion_by_odometry(frame)  # motion by odometry
        scan = self._points(frame)
        here_from_base = self._track(scan, last_from_base)  # corrected by the scan
        if self._is_match_due(here_from_base):
            edge = self._match(scan, here_from_base)  # full match, every few steps
            if self._is_first_doubt(edge):
                self._attach_frame(frame, here_from_base)  # the next scan has a say, too
            elif not self._is_covered(frame, edge):
                self._add(frame, scan, edge)  # a view that no key scan covers
                if not self._judge_tears():  # the chair may have been carried
                    self._close_loops()  # may be a revisited place
        else:
            self._attach_frame(frame, here_from_base)
        return self.pose()

    def pose(self) -> Pose2:
        """Return `map_from_base` of the latest frame."""
        last = self.frames[-1]
        return self.keys.pose(last.key) @ last.key_from_base

    @property
    def odometry(self) -> Pose2 | None:
        """`odom_from_base` at the latest frame with odometry."""
        return self._state.odometry

    @property
    def inliers(self) -> float:
        """Share of the latest scan's points on known surfaces; 0 for a scan with too few points, 1 for the first scan."""
        return self._state.inliers

    @property
    def is_matched(self) -> bool:
        """Whether the latest frame's pose comes from its scan, and not from odometry alone."""
        return self._state.unmatched == 0

    @property
    def is_connected(self) -> bool:
        """Whether the graph connects the latest frame with the first; not so while a kidnapped chair has closed no loop."""
        return self.keys.reaches(self._current_key, 1)

    def pose_at(self, stamp_ns: int, gap_s: float) -> tuple[int, Pose2] | None:
        """Return the key scan of the frame nearest to a stamp, and `map_from_base` interpolated at the stamp.

        None without a frame before and after the stamp, or where the two are further apart than `gap_s`.
        """
        first = self.earlier_frames
        after = bisect_left(self.frames, stamp_ns, lo=first, key=lambda frame: frame.stamp_ns)
        if after == len(self.frames) or (after == first and self.frames[first].stamp_ns != stamp_ns):
            return None
        low, high = self.frames[max(after - 1, first)], self.frames[after]
        apart_ns = high.stamp_ns - low.stamp_ns
        if apart_ns > gap_s * 1e9:
            return None
        part = (stamp_ns - low.stamp_ns) / max(apart_ns, 1)
        before, after_it = (self.keys.pose(frame.key) @ frame.key_from_base for frame in (low, high))
        return (low if part < 0.5 else high).key, interpolate(before, after_it, part)

    def close_loop(self, old: int, map_from_base: Pose2) -> Edge | LoopRejection:
        """Close a loop that another sensor has found, if the scans and the rest of the graph agree.

        `map_from_base` is the present pose as measured from the old key scan (see `LoopCloser.verify_recognised`).
        """
        with self._timed("loops"):
            here = self.keys.pose(self._current_key)
            moved = map_from_base @ self.pose().inverse() @ here
            edge = self._closer.verify_recognised(self.keys, self._recent_keys, old, moved)
        if isinstance(edge, Edge):
            self.counts["loops_sighted"] += 1
            self._add_loops([edge])
        return edge

    def for_next_drive(self, renewed: Mapping[int, ScanPoints]) -> Mapper:
        """Return a mapper for another drive through the same building, which may begin anywhere.

        Its first frame is unconnected until a loop is closed, unless `begin_at` gives its pose. `renewed` holds newer
        surfaces of some key scans. Only the frames remain whose scans the grid is drawn from.
        """
        other = Mapper(self.settings, self.base_from_laser)
        other.keys = self.keys.for_next_drive(renewed)
        kept = sorted(self.key_frames + [frame for latest in self.covered_frames for frame in latest])
        number = {frame: k for k, frame in enumerate(kept)}
        other.frames = self.frames.take(kept)
        other.key_frames = [number[frame] for frame in self.key_frames]
        other.covered_frames = [[number[frame] for frame in latest] for latest in self.covered_frames]
        other.earlier_frames = len(kept)
        return other

    def begin_at(self, key: int, key_from_base: Pose2) -> None:
        """Set the start of the drive relative to a key scan of an earlier drive; call it before the first frame."""
        self._set_current_key(key, key_from_base)

    def end_searches(self) -> None:
        """Search for loops to the end, as no further scan goes on with it; a drive that is saved may go on all the same."""
        if self._recent_keys:
            with self._timed("loops"):
                loops = self._closer.last_loops(self.keys, self._recent_keys)
            if loops:
                self._add_loops(loops)

    def result(self) -> MapperResult:
        """Return the map so far, after a final optimisation of its graph."""
        with self._timed("optimisation"):
            self.keys.optimise_fully()
        poses = compose(self.keys.poses[self.frames.keys], self.frames.poses)
        return MapperResult(
            trajectory=Trajectory(self.frames.stamps_ns, poses),
            key_poses=self.keys.poses.copy(),
            key_frames=tuple(self.key_frames),
            scan_frames=tuple(sorted(self.key_frames + [frame for latest in self.covered_frames for frame in latest])),
            edges=self.keys.edges,
            rejected=self.keys.rejected,
            counts={**(self.counts + self._closer.counts), "submaps_never_searched": self._closer.never_searched},
            seconds=dict(self.seconds),
            earlier_frames=self.earlier_frames,
        )

    def _motion_by_odometry(self, frame: SensorFrame) -> Pose2:
        """Return `last_from_base`: the motion since the last frame by odometry, else the last motion again."""
        self.counts["frames"] += 1
        own = odometry_of(frame)
        if own is None:
            return self._state.motion
        before, self._state.odometry = self._state.odometry, own.odom_from_base
        if before is None:
            return Pose2()
        step = before.inverse() @ self._state.odometry
        passed = (frame.stamp_ns - self.frames[-1].stamp_ns) * 1e-9 if len(self.frames) else math.inf
        seconds = max(passed, _LEAST_STEP_S) if passed > 0 else _STANDING_STAMP_S
        if math.hypot(step.x, step.y) <= _FASTEST * seconds:
            return step
        self.counts["odometry_jumps"] += 1  # no motion, as where the odometry begins anew
        return self._state.motion

    def _points(self, frame: SensorFrame) -> ScanPoints:
        assert frame.scan is not None
        with self._timed("points"):
            return scan_points(frame.scan, self.base_from_laser, self.settings.matching.range_max, twist_of(frame))

    def _track(self, scan: ScanPoints, last_from_base: Pose2) -> Pose2:
        """Return the frame's pose relative to its key scan: odometry, aligned with the surfaces."""
        if not self._recent_keys:
            return Pose2()
        with self._timed("tracking"):
            settings, key = self.settings, self.keys.pose(self._current_key)
            last = self._state.last_match if self._is_first_frame else self.frames[-1].key_from_base
            self._state.by_odometry = self._state.by_odometry @ last_from_base
            guess = key @ last @ last_from_base
            if self._state.odometry is not None:
                prior = rotated_information(odometry_information(last_from_base), guess.theta)
                few = scan.thinned(_TRACK_POINTS)
                pose, _, inliers, _ = refine(
                    few,
                    self._local_reference(),
                    start=guess,
                    guess=guess,
                    guess_information=prior,
                    settings=settings.matching,
                    reach=_TRACK_REACH,
                )
            else:
                window = Window(_SEARCH_DISTANCE, _SEARCH_ANGLE)
                found = match(
                    scan,
                    self._local_reference(),
                    guess=guess,
                    guess_information=np.eye(3),
                    window=window,
                    settings=settings.matching,
                )
                pose, inliers = found.pose, found.inliers
                self._state.unseen = self._state.unseen + 1 if found.degenerate else 0
                self.counts["motion_unseen"] += self._state.unseen > _UNSEEN
            if self._state.odometry is not None and math.hypot(pose.x - guess.x, pose.y - guess.y) > _TRACK_FARTHEST:
                inliers = 0.0
            matched = len(scan) >= MIN_POINTS and inliers >= _TRACK_INLIERS
            self._state.inliers = float(inliers) if len(scan) >= MIN_POINTS else 0.0
            self._state.unmatched = 0 if matched else self._state.unmatched + 1
            here_from_base = key.inverse() @ pose if matched else last @ last_from_base
            self._state.motion = last.inverse() @ here_from_base
            if self._state.odometry is None:
                self._state.by_odometry = here_from_base
            self._state.since_match.append(TrackedFrame(self._state.inliers, self._state.by_odometry))
            return here_from_base

    def _is_match_due(self, here_from_base: Pose2) -> bool:
        """Return whether the chair has moved far enough since the last full match."""
        moved = self._state.last_match.inverse() @ here_from_base
        distance, turn = math.hypot(moved.x, moved.y), abs(moved.theta)
        return self._is_first_frame or distance >= self.settings.key_distance or turn >= self.settings.key_angle

    def _match(self, scan: ScanPoints, here_from_base: Pose2) -> Edge | None:
        """Return the edge from the current key scan to the chair: odometry, improved by a scan match where one is good."""
        if not len(self.keys):
            return None
        if not self._recent_keys:  # another drive, with an unknown start
            return Edge(len(self.keys) - 1, len(self.keys), Pose2(), unknown_information(), EdgeKind.UNKNOWN)
        with self._timed("matching"):
            settings, node = self.settings, len(self.keys)
            self._state.slip = None
            if back := self._tears.returned(self.keys, self._recent_keys, scan, here_from_base):
                self._follow(back[0])
                self._state.unmatched = 0  # the frames between were placed by the odometry and stay there
                return back[1]
            here = self._current_key
            guess = self.keys.pose(here) @ here_from_base
            by_odometry = odometry_information(self._state.last_match.inverse() @ self._state.by_odometry)
            prior = rotated_information(by_odometry, guess.theta)
            share = 1.0 if self._state.unmatched else _MATCHED_SHARE
            window = Window(share * _SEARCH_DISTANCE, share * _SEARCH_ANGLE)
            reference = self._local_reference()
            found = match(
                scan, reference, guess=guess, guess_information=prior, window=window, settings=settings.matching
            )
            slipped = False
            if found.response < _GOOD_RESPONSE:  # the odometry slipped, or part of the view is new
                has_odometry = self._state.odometry is not None
                found, slipped = self._judge.less_contradicted(
                    self.keys, self._recent_keys, scan, reference, found, guess, prior, has_odometry
                )
                self.counts["slips"] += slipped
                prior = prior / 100 if slipped else prior
            if len(scan) < MIN_POINTS:
                return Edge(here, node, here_from_base, by_odometry, EdgeKind.ODOMETRY)
            again = self._state.doubted > 0
            doubtful = slipped or again or found.response < _GOOD_RESPONSE
            doubt = self._judge.doubt(self.keys, self._recent_keys, scan, found, guess, again) if doubtful else 0.0
            if doubt > 1.0 and self._tears.can_be_doubted(self._recent_keys):
                return Edge(here, node, here_from_base, unknown_information(), EdgeKind.UNKNOWN)
            if found.inliers < _MIN_INLIERS:
                return Edge(here, node, here_from_base, by_odometry, EdgeKind.ODOMETRY)
            self.counts["matches"] += 1
            information = rotated_information(match_information(found.information) + prior, -found.pose.theta)
            edge = Edge(here, node, self._relative_to(here, found.pose), information, EdgeKind.MATCH)
            if doubt > SUSPICIOUS or math.hypot(found.pose.x - guess.x, found.pose.y - guess.y) > SLIP_CLAIMED:
                before, beyond = tuple(self._recent_keys), self._state.frames_beyond()
                self._state.slip = OpenTear(edge, before, by_odometry, here_from_base, beyond=beyond)
            return edge

    def _is_first_doubt(self, edge: Edge | None) -> bool:
        """Return whether a scan would tear the map after which no other has contradicted the key scans yet."""
        doubted = edge is not None and edge.kind is EdgeKind.UNKNOWN and bool(self._recent_keys)
        self._state.doubted = self._state.doubted + 1 if doubted else 0
        return doubted and self._state.doubted < _DOUBTS

    def _is_covered(self, frame: SensorFrame, edge: Edge | None) -> bool:
        """Attach the frame to an earlier key scan that covers the view from here; return whether there is one."""
        if edge is None or edge.kind is not EdgeKind.MATCH:
            return False
        here = edge.i
        pose = self.keys.pose(here) @ edge.i_from_j
        key = self.keys.covering_key(here, pose, _COVER_PATH, _COVER_DISTANCE, _COVER_ANGLE, MIN_LOOP_PATH)
        if key is None:
            return False
        self.counts["covered"] += 1
        self._distribute_correction(edge.i_from_j)
        self.covered_frames[key] = [*self.covered_frames[key], len(self.frames)][-_COVERED_SCANS:]
        self._set_current_key(key, self._relative_to(key, pose))
        self._attach_frame(frame, self._state.last_match)
        return True

    def _add(self, frame: SensorFrame, scan: ScanPoints, edge: Edge | None) -> None:
        node = self.keys.add(scan, edge)
        if edge is not None and edge.kind is EdgeKind.UNKNOWN:
            self._begin_new_part(node, edge)
        elif edge is not None:
            self._distribute_correction(edge.i_from_j)
            if self._state.slip is not None:
                self._tears.add(self._state.slip)
        if edge is not None:
            self._closer.add_distance(math.hypot(edge.i_from_j.x, edge.i_from_j.y))
        self.counts["key_scans"] += 1
        self.key_frames.append(len(self.frames))
        self.covered_frames.append([])
        self._set_current_key(node, Pose2())
        self._attach_frame(frame, Pose2())

    def _begin_new_part(self, node: int, torn: Edge) -> None:
        """Start an unconnected part of the map at a key scan, and attach the last unmatched frames to it."""
        if self._recent_keys:
            step = self._state.last_match.inverse() @ self._state.by_odometry
            known = odometry_information(step) / (1.0 if self._state.odometry is not None else _GUESS_DOUBT)
            self._follow(self._tears.begin_part(self.keys, self._recent_keys, torn, known))
            self._attach_before(len(self.frames), node, self._state.frames_beyond())
        self._recent_keys = []
        self._closer.begin_part()
        self._state.unmatched = 0

    def _attach_before(self, frame: int, key: int, key_from_base: Sequence[Pose2]) -> None:
        """Attach the frames before this one to a key scan, at these poses."""
        for k, pose in enumerate(key_from_base, frame - len(key_from_base)):
            self.frames[k] = AttachedFrame(self.frames[k].stamp_ns, key, pose)

    def _judge_tears(self) -> bool:
        """Judge open tears and slips by the scans since then; return whether that took long."""
        with self._timed("matching"):
            ruling = self._tears.judged(self.keys, self._recent_keys)
        self._follow(ruling)
        return ruling.took_long

    def _follow(self, ruling: Ruling) -> None:
        """Take over what judgements of tears and slips have changed."""
        self.counts["tears_undone"] += ruling.undone
        if ruling.recent != self._recent_keys:
            self._recent_keys, self._reference = ruling.recent, None
        for slip in ruling.parted:
            self._attach_before(self.key_frames[slip.edge.j], slip.edge.j, slip.beyond)
            self._closer.begin_part()

    def _set_current_key(self, key: int, key_from_base: Pose2) -> None:
        """Attach the frames from now on to this key scan."""
        if not self._recent_keys or key != self._current_key:
            before = [node for node in self._recent_keys if node != key]
            self._recent_keys = [*before, key][-RECENT_KEYS:]
            self._reference = None
        self._state.last_match = self._state.by_odometry = key_from_base
        self._state.since_match.clear()
        self._state.since_match.append(TrackedFrame(self._state.inliers, key_from_base))

    def _attach_frame(self, frame: SensorFrame, here_from_base: Pose2) -> None:
        self.frames.append(AttachedFrame(frame.stamp_ns, self._current_key, here_from_base))

    def _distribute_correction(self, here_from_base: Pose2) -> None:
        """Distribute the correction of a match over the frames before it that only odometry has placed."""
        unmatched, self._state.unmatched = self._state.unmatched, 0
        if unmatched < 2:
            if (slip := self._state.slip) is not None and slip.claims_slip:
                beyond = [here_from_base @ pose for pose in slip.beyond]
                self._attach_before(len(self.frames), self._current_key, beyond)
            return
        reached = self.frames[-1].key_from_base @ self._state.motion
        gap = reached.inverse() @ here_from_base
        for k in range(1, unmatched):
            frame = self.frames[k - unmatched]
            moved = frame.key_from_base @ interpolate(Pose2(), gap, k / unmatched)
            self.frames[k - unmatched] = AttachedFrame(frame.stamp_ns, frame.key, moved)

    @property
    def _current_key(self) -> int:
        return self._recent_keys[-1]

    @property
    def _is_first_frame(self) -> bool:
        """Whether the next frame is the first of the drive."""
        return len(self.frames) == self.earlier_frames

    def _local_reference(self) -> ScanReference:
        """Return the surfaces of the latest key scans round the chair, and of key scans near it along the edges.

        The latter show what the latest scans had behind them when the chair returns with another heading.
        """
        if self._reference is None:
            here = self.keys.poses[self._current_key]
            latest = self.keys.poses[self._recent_keys[-_LATEST:], :2]
            step = float(np.hypot(*np.diff(latest, axis=0).T).sum()) / max(1, len(latest) - 1)
            reach = max(CERTAIN_PATH, _CERTAIN_STEPS * step)
            certain = self.keys.path_lengths(self._current_key, reach, _MOST_CERTAIN)
            members = np.array(sorted({*self._recent_keys, *certain}))
            near = np.hypot(*(self.keys.poses[members, :2] - here[:2]).T) < LOCAL_REACH
            self._reference = self.keys.reference(members[near], here, LOCAL_REACH, self.settings.matching.resolution)
        return self._reference

    def _close_loops(self) -> None:
        """Search for loops at the last key scan, and optimise the graph with those found."""
        with self._timed("loops"):
            loops = self._closer.loops(self.keys, self._recent_keys)
        if loops or self.keys.is_judging:
            self._add_loops(loops)

    def _add_loops(self, loops: Sequence[Edge]) -> None:
        """Add loop edges to the graph and optimise it."""
        with self._timed("optimisation"):
            for loop in loops:
                self.keys.link(loop)
            self.keys.optimise()
            self._undo_false_tears()
            self._reference = None

    def _undo_false_tears(self) -> None:
        """Undo the tears of this drive over which loops have shown the motion that the odometry measured."""
        if not self.keys.is_torn:
            return
        for edge in self.keys.edges:
            torn = edge.kind is EdgeKind.UNKNOWN and self.key_frames[edge.j] > self.earlier_frames
            if torn and (known := agrees_with_odometry(self.keys, edge)) is not None:
                self.counts["tears_undone"] += 1
                self.keys.undo_tear(edge, known)
                self._tears.forget(edge)

    def _relative_to(self, node: int, pose: Pose2) -> Pose2:
        return self.keys.pose(node).inverse() @ pose

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        started = time.process_time()
        yield
        self.seconds[stage] += time.process_time() - started
