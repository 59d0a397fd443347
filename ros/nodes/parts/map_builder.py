"""Live mapping in a node: it takes messages as they arrive, and reports the chair's pose; the work runs in a worker.

Its frames equal those that `waychair map` reads from a bag of the same messages, so that both make the same map. Both
begin with the last scan before the chair first moves.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from waychair import topics
from waychair.errors import WaychairError
from waychair.geometry import wrap_angle
from waychair.offline.map_folders import refuse_drawn, set_aside
from waychair.offline.mapping import live_result, save_mapping
from waychair.offline.sessions import state_of_map
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.nodes.worker import Worker
from waychair.slam.frames.first_motion import rests
from waychair.slam.frames.frame_synchroniser import Synchroniser, SynchroniserSettings
from waychair.slam.localising.localiser import Localisation, LocalisationState
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.slam.mapping.tracking import odometry_of
from waychair.types import ImuSample, OccupancyGrid, Odometry, Pose2, Scan, SensorFrame

MAX_QUEUED = 100
"""Largest number of queued frames with scans; older frames lose their scan and keep their odometry."""

_WAIT_S = 1.0  # a scan waits so long for its odometry and IMU: a busy computer delivers late
_SKIPPED_FRAMES = 5
"""Frames that are dropped at the start: subscriptions connect one after the other, so early frames lack readings."""

_JUMP = 0.05  # m and rad; a larger correction is reported as a jump, since a localiser never corrects more at once
_MAX_SPEED_CHANGE = 0.5  # m/s and rad/s; largest increase of speed between two readings


class _ContinuousOdometry:
    """Joins odometry that restarts to the odometry before; `shift` is the offset since the last restart."""

    def __init__(self) -> None:
        self.shift = Pose2()
        self._last: Odometry | None = None

    def joined(self, odometry: Odometry, restarted: bool) -> Odometry:
        """Return a reading, shifted; see `MapBuilder.add_odometry`."""
        moved = replace(odometry, odom_from_base=self.shift @ odometry.odom_from_base)
        if restarted and self._last is not None and not _is_reachable(self._last, moved):
            self.shift = self._last.odom_from_base @ odometry.odom_from_base.inverse()
            moved = replace(odometry, odom_from_base=self._last.odom_from_base)
        self._last = moved
        return moved


class MapBuilder:
    """A `LiveMapping` that runs in a node's worker, one job at a time."""

    def __init__(
        self, worker: Worker, begin: Callable[[], LiveMapping], on_pose: Callable[[int, Localisation], None]
    ) -> None:
        """Take a factory of empty maps, called for each scan until the chair first moves (`first_motion`).

        `on_pose` is called in the executor's thread with the stamp [ns] of each scan and the chair's pose.
        """
        self.dropped_scans = 0  # frames whose scans were dropped because the computer was too slow
        self._worker, self._begin, self._on_pose = worker, begin, on_pose
        self._live, self._rests = begin(), True
        self._synchroniser = Synchroniser(
            (topics.SCAN, topics.ODOMETRY, topics.IMU), SynchroniserSettings(wait_s=_WAIT_S)
        )
        self._frames: deque[SensorFrame] = deque()
        self._jobs: deque[tuple[Callable[[], Any], Callable[[Any], None]]] = deque()
        self._busy = False
        self._left_out = 0  # frames with odometry before the first mapped one
        self._map_from_odom: Pose2 | None = None
        self._continuous = _ContinuousOdometry()
        self._sent_revision: tuple[int, int, int] | None = None
        self._folders: set[Path] = set()  # this map was saved there: places and zones drawn there belong to it

    def report(self) -> Report:
        """Return whether mapping keeps up with the chair."""
        behind = len(self._frames)
        late = behind > topics.SCAN.rate_hz
        message = f"{behind} scans wait to be mapped: drive slower, or use a faster computer" if late else ""
        values = (("scans that wait", str(behind)), ("left out", str(self.dropped_scans)))
        return Report("mapping", DiagnosticLevel.WARN if late else DiagnosticLevel.OK, message, values)

    def add_scan(self, scan: Scan) -> None:
        """Take a scan."""
        self._queue_frames(self._synchroniser.add(topics.SCAN, scan))

    def add_odometry(self, odometry: Odometry, restarted: bool = False) -> None:
        """Take an odometry reading.

        If the odometry seems to have restarted (`restarted`) and its pose is out of the chair's reach, it is shifted to
        continue where the last reading ended.
        """
        self._queue_frames(self._synchroniser.add(topics.ODOMETRY, self._continuous.joined(odometry, restarted)))

    def add_imu(self, sample: ImuSample) -> None:
        """Take a sample of the IMU, in the axes of the base."""
        self._queue_frames(self._synchroniser.add(topics.IMU, sample))

    def send_grid(self, send: Callable[[OccupancyGrid], None]) -> None:
        """Call `send` with the grid if it has changed since the last call."""
        self._queue_job(self._grid_if_changed, lambda grid: None if grid is None else send(grid))

    def save(self, folder: Path, saved: Callable[[str], None]) -> None:
        """Save the map so far to a folder, as `waychair map` does; call `saved` with an error sentence, or ''."""
        self._queue_job(lambda: self._write(folder), saved)

    def finish(self, folder: Path) -> str:
        """Map the queued frames and save the map, at the node's end when its worker has ended.

        Another map in the folder that carries drawn places or zones is moved to another name. Returns an error sentence,
        or ''.
        """
        while self._frames:
            self._map(self._frames.popleft())
        if not self._live.mapper.frames:
            return ""
        try:
            if folder.resolve() not in self._folders:
                set_aside(folder)
        except WaychairError as error:
            return str(error)
        return self._write(folder)

    def _queue_frames(self, frames: tuple[SensorFrame, ...]) -> None:
        for frame in frames:
            if self._left_out < _SKIPPED_FRAMES:
                self._left_out += odometry_of(frame) is not None
            else:
                self._frames.append(frame)
        seeing = [k for k, frame in enumerate(self._frames) if frame.scan is not None]
        for k in seeing[: max(0, len(seeing) - MAX_QUEUED)]:
            self._frames[k] = replace(self._frames[k], scan=None)
            self.dropped_scans += 1
        self._start_next()

    def _queue_job(self, job: Callable[[], Any], done: Callable[[Any], None]) -> None:
        self._jobs.append((job, done))
        self._start_next()

    def _start_next(self) -> None:
        """Submit the next job unless one runs; so the worker's own queue, which drops jobs, stays empty."""
        if self._busy or not (self._jobs or self._frames):
            return
        if self._jobs:
            job, done = self._jobs.popleft()
        else:
            frame = self._frames.popleft()
            job, done = lambda: self._map(frame), self._report_pose
        self._busy = True

        def ended(result: Any) -> None:
            self._busy = False
            done(result)
            self._start_next()

        self._worker.submit(job, ended)

    def _report_pose(self, found: tuple[int, Localisation] | None) -> None:
        if found is not None:
            self._on_pose(*found)

    def _map(self, frame: SensorFrame) -> tuple[int, Localisation] | None:
        """Map a frame, in the worker, and return the stamp and the pose of its scan; None without a scan.

        The state is LOST after a kidnapping that has torn the map, and DEGRADED where the pose is from odometry alone.
        `health` is merely the share of the scan on known surfaces.
        """
        self._rests = self._rests and rests(frame)
        if self._rests and frame.scan is not None:
            self._live = self._begin()
        pose = self._live.process(frame)
        own = odometry_of(frame)
        if frame.scan is None or own is None:
            return None
        mapper = self._live.mapper
        state = LocalisationState.OK if mapper.is_matched else LocalisationState.DEGRADED
        state = state if mapper.is_connected else LocalisationState.LOST
        before, self._map_from_odom = self._map_from_odom, pose @ own.odom_from_base.inverse()
        moved = Pose2() if before is None else (before @ own.odom_from_base).inverse() @ pose
        jumped = max(abs(moved.x), abs(moved.y), abs(wrap_angle(moved.theta))) > _JUMP
        now = self._map_from_odom @ self._continuous.shift
        return frame.stamp_ns, Localisation(
            map_from_base=pose,
            map_from_odom=now,
            inliers=mapper.inliers,
            state=state,
            health=mapper.inliers,
            jumped=jumped,
        )

    def _grid_if_changed(self) -> OccupancyGrid | None:
        mapper = self._live.mapper
        revision = len(mapper.key_frames), mapper.counts["covered"], self._live.pending
        if not mapper.frames or revision == self._sent_revision:
            return None
        self._sent_revision = revision
        return self._live.grid()

    def _write(self, folder: Path) -> str:
        try:
            if folder.resolve() not in self._folders:
                refuse_drawn(folder)
            mapping = live_result(self._live, folder, "live, scans /scan, odometry /odom, IMU /imu/data")
            state = state_of_map(self._live, None, "")
            save_mapping(folder, replace(mapping, state=state), self._live.settings)
            self._folders.add(folder.resolve())
        except WaychairError as error:
            return str(error)
        return ""


def _is_reachable(before: Odometry, after: Odometry) -> bool:
    """Return whether a chair with limited acceleration can have moved from one reading to the other."""
    seconds = abs(after.stamp_ns - before.stamp_ns) * 1e-9
    step = before.odom_from_base.inverse() @ after.odom_from_base
    distance, turn = (
        (abs(before.twist.v) + _MAX_SPEED_CHANGE) * seconds,
        (abs(before.twist.omega) + _MAX_SPEED_CHANGE) * seconds,
    )
    return math.hypot(step.x, step.y) <= distance + _JUMP and abs(wrap_angle(step.theta)) <= turn + _JUMP
