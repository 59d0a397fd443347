"""A map that a node makes on the way: messages in as they come, the chair's place out, all the work beside the executor.

The frames are those that a bag of the same messages holds for `waychair map`, so that both make the same map. Both
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
from waychair.ros.messages.reports import Level, Report
from waychair.ros.worker import Worker
from waychair.runtime.first_motion import rests
from waychair.runtime.live_mapping import LiveMapping
from waychair.runtime.map_folders import refuse_drawn, set_aside
from waychair.runtime.mapping import live_result, save_mapping
from waychair.runtime.sessions import state_of_map
from waychair.slam.localiser import Localisation, LocalisationState
from waychair.slam.mapper import odometry_of
from waychair.slam.synchroniser import Synchroniser, SynchroniserSettings
from waychair.types import ImuSample, OccupancyGrid, Odometry, Pose2, Scan, SensorFrame

MOST_BEHIND = 100
"""Frames that may wait; of the oldest beyond them only the odometry is used."""

_WAIT_S = 1.0  # for odometry and IMU of a scan: a busy computer delivers late
_PARTIAL = 5
"""Frames at the beginning that are left out: topics are found one after the other, and a frame is to hold all that came
since the one before, as in a bag."""

_STEP = 0.05  # m and rad; a correction beyond it is a jump (as a localiser's, which never corrects more at once)
_FASTER = 0.5  # m/s and rad/s by which it may be faster than it was


class GrowingMap:
    """A `LiveMapping` at work in a node's worker, one job at a time."""

    def __init__(
        self, worker: Worker, begin: Callable[[], LiveMapping], placed: Callable[[int, Localisation], None]
    ) -> None:
        """`begin` makes an empty map, anew with each scan until the chair first moves (`first_motion`).

        `placed` is told the stamp [ns] of each scan and where it puts the chair, in the executor's thread.
        """
        self.blind = 0  # frames whose scans were left out, since the computer was too slow
        self._worker, self._begin, self._placed = worker, begin, placed
        self._live, self._rests = begin(), True
        self._synchroniser = Synchroniser(
            (topics.SCAN, topics.ODOMETRY, topics.IMU), SynchroniserSettings(wait_s=_WAIT_S)
        )
        self._frames: deque[SensorFrame] = deque()
        self._jobs: deque[tuple[Callable[[], Any], Callable[[Any], None]]] = deque()
        self._busy = False
        self._left_out = 0  # frames with odometry before the first that is mapped
        self._map_from_odom: Pose2 | None = None
        self._odometry: Odometry | None = None
        self._shift = Pose2()  # of the odometry since it began anew
        self._drawn: tuple[int, int, int] | None = None
        self._folders: set[Path] = set()  # to which it was written; what is drawn there is drawn on it

    def report(self) -> Report:
        """Whether the map keeps up with the chair."""
        behind = len(self._frames)
        late = behind > topics.SCAN.rate_hz
        message = f"{behind} scans wait to be mapped: drive slower, or on a faster computer" if late else ""
        values = (("scans that wait", str(behind)), ("left out", str(self.blind)))
        return Report("mapping", Level.WARN if late else Level.OK, message, values)

    def see(self, scan: Scan) -> None:
        """Take a scan in."""
        self._take(self._synchroniser.add(topics.SCAN, scan))

    def move(self, odometry: Odometry, anew: bool = False) -> None:
        """Take odometry in; one that seems to begin `anew`, and lies where the chair cannot have come to since the one
        before, goes on, for the map, where that one ended."""
        moved = replace(odometry, odom_from_base=self._shift @ odometry.odom_from_base)
        if anew and self._odometry is not None and not _within_reach(self._odometry, moved):
            self._shift = self._odometry.odom_from_base @ odometry.odom_from_base.inverse()
            moved = replace(odometry, odom_from_base=self._odometry.odom_from_base)
        self._odometry = moved
        self._take(self._synchroniser.add(topics.ODOMETRY, moved))

    def feel(self, sample: ImuSample) -> None:
        """Take a sample of the IMU in, in the axes of the base."""
        self._take(self._synchroniser.add(topics.IMU, sample))

    def draw(self, drawn: Callable[[OccupancyGrid], None]) -> None:
        """Have the grid told, if it has changed since it was told last."""
        self._ask(self._changed_grid, lambda grid: None if grid is None else drawn(grid))

    def save(self, folder: Path, saved: Callable[[str], None]) -> None:
        """Have the map so far written to a folder, as `waychair map` does; `saved` is told what went wrong, or ''."""
        self._ask(lambda: self._write(folder), saved)

    def keep(self, folder: Path) -> str:
        """At the node's end, when its worker has ended: map what waits and write it; what went wrong, or ''.

        Another map that somebody has drawn on makes way, under a name of its own.
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

    def _take(self, frames: tuple[SensorFrame, ...]) -> None:
        for frame in frames:
            if self._left_out < _PARTIAL:
                self._left_out += odometry_of(frame) is not None
            else:
                self._frames.append(frame)
        seeing = [k for k, frame in enumerate(self._frames) if frame.scan is not None]
        for k in seeing[: max(0, len(seeing) - MOST_BEHIND)]:
            self._frames[k] = replace(self._frames[k], scan=None)
            self.blind += 1
        self._go_on()

    def _ask(self, job: Callable[[], Any], done: Callable[[Any], None]) -> None:
        self._jobs.append((job, done))
        self._go_on()

    def _go_on(self) -> None:
        """The next job, unless one is at hand; the worker's own queue, which drops what is too much, stays empty."""
        if self._busy or not (self._jobs or self._frames):
            return
        if self._jobs:
            job, done = self._jobs.popleft()
        else:
            frame = self._frames.popleft()
            job, done = lambda: self._map(frame), self._tell
        self._busy = True

        def ended(result: Any) -> None:
            self._busy = False
            done(result)
            self._go_on()

        self._worker.submit(job, ended)

    def _tell(self, found: tuple[int, Localisation] | None) -> None:
        if found is not None:
            self._placed(*found)

    def _map(self, frame: SensorFrame) -> tuple[int, Localisation] | None:
        """In the worker: where a frame's scan puts the chair; None without one.

        What a map's own making can say of its pose: LOST, where the chair was carried and the map is torn there; DEGRADED,
        where the odometry alone has put it. `health` is no more than the share of the scan on known surfaces.
        """
        self._rests = self._rests and rests(frame)
        if self._rests and frame.scan is not None:
            self._live = self._begin()
        pose = self._live.process(frame)
        own = odometry_of(frame)
        if frame.scan is None or own is None:
            return None
        mapper = self._live.mapper
        state = LocalisationState.OK if mapper.is_placed else LocalisationState.DEGRADED
        state = state if mapper.is_whole else LocalisationState.LOST
        before, self._map_from_odom = self._map_from_odom, pose @ own.odom_from_base.inverse()
        moved = Pose2() if before is None else (before @ own.odom_from_base).inverse() @ pose
        jumped = max(abs(moved.x), abs(moved.y), abs(wrap_angle(moved.theta))) > _STEP
        now = self._map_from_odom @ self._shift
        return frame.stamp_ns, Localisation(pose, now, mapper.inliers, state, mapper.inliers, jumped=jumped)

    def _changed_grid(self) -> OccupancyGrid | None:
        mapper = self._live.mapper
        drawn = len(mapper.key_frames), mapper.counts["covered"], self._live.pending
        if not mapper.frames or drawn == self._drawn:
            return None
        self._drawn = drawn
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


def _within_reach(before: Odometry, after: Odometry) -> bool:
    """Whether a chair that speeds up as chairs do may have come from one to the other."""
    seconds = abs(after.stamp_ns - before.stamp_ns) * 1e-9
    step = before.odom_from_base.inverse() @ after.odom_from_base
    way, turn = (abs(before.twist.v) + _FASTER) * seconds, (abs(before.twist.omega) + _FASTER) * seconds
    return math.hypot(step.x, step.y) <= way + _STEP and abs(wrap_angle(step.theta)) <= turn + _STEP
