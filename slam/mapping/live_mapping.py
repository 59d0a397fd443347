"""Mapper, depth camera and grid as one object: sensor frames in, pose and grid out at any time of a drive."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.config import Settings, setting
from waychair.errors import GridTooLarge, NoScans
from waychair.maps.depth.depth_evidence import merge_sensors
from waychair.maps.folders.depth_layer import depth_layer
from waychair.maps.grid.cells import MOST_CELLS
from waychair.maps.grid.occupancy import EvidenceGrid, OccupancySettings
from waychair.maps.layers.grid_assembly import DepthAssembly, GridAssembly
from waychair.maps.layers.session_grid import SessionGrid
from waychair.slam.mapping.depth_mapping import DepthMapping, DepthMappingSettings
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.slam.mapping.tracking import odometry_of, twist_of
from waychair.slam.odometry.dead_reckoning import DeadReckoning
from waychair.slam.odometry.odometry_model import OdometrySettings
from waychair.slam.scan.scan_points import sweep_motion
from waychair.types import OccupancyGrid, Pose2, Pose3, RgbdFrame, SensorFrame, Twist

T = TypeVar("T")

LARGEST_CELLS = 0.2
"""Side [m] of the largest cells that a site is drawn with by itself; through larger ones no door is seen."""


@dataclass(frozen=True, slots=True)
class LiveMappingSettings(Settings):
    """The settings of mapping, live or from a recording."""

    laser_height: float = setting(
        0.30,
        "m",
        "height of the lidar above the floor; larger: fewer beams meet the floor on a ramp",
        low=0.02,
        high=3.0,
    )
    odometry: OdometrySettings = field(default_factory=OdometrySettings)
    mapper: MapperSettings = field(default_factory=MapperSettings)
    grid: OccupancySettings = field(default_factory=OccupancySettings)
    depth: DepthMappingSettings = field(default_factory=DepthMappingSettings)


class LiveMapping:
    """Maps frame by frame. It reads no clock but the CPU time, for the report, and has no thread.

    Frames with a scan are numbered in order. A caller that has all frames and wants only the final map calls `reckon`
    and `include` for each, then `settle`, which draws every scan once.
    """

    def __init__(
        self,
        settings: LiveMappingSettings,
        base_from_laser: Pose2,
        body: ChairBody = CHAIR_A,
        base_from_camera: Pose3 | None = None,
    ) -> None:
        """`body` gives the encoders' scale; its lidar mount is replaced by `base_from_laser`.

        `base_from_camera`: mount of the depth camera's optical frame; default: the body's.
        """
        self.settings = settings
        self.base_from_laser = base_from_laser
        self.mapper = Mapper(settings.mapper, base_from_laser)
        self.odometry: list[SensorFrame] = []  # odometry at each frame
        self.key_seconds: list[float] = []  # CPU time of each full scan match
        self.seconds: defaultdict[str, float] = defaultdict(float)  # CPU time by stage, without the mapper's own stages
        mount, height = base_from_laser, settings.laser_height
        body = replace(body, laser_x=mount.x, laser_y=mount.y, laser_theta=mount.theta, laser_z=height)
        self._reckoning = DeadReckoning(body, settings.odometry)
        self.cells = settings.grid
        """The settings of the grid, with larger cells than `settings` has where the site is too large for those."""
        self.scans = SessionGrid(settings.grid)
        """The scans that the grid is drawn from, by the numbers of their frames."""
        camera = base_from_camera or body.base_from_camera
        self.depth = DepthMapping(settings.depth, camera, body.front, settings.grid)
        self._covered: list[list[int]] = []  # of each key scan: numbers of its covered frames in the grid

    def process(self, frame: SensorFrame) -> Pose2:
        """Map one frame; return `map_from_base` at the latest scan."""
        reckoned = self.reckon(frame)
        if reckoned.scan is not None:
            self.include(reckoned)
        self.draw()
        return self.pose()

    def reckon(self, frame: SensorFrame) -> SensorFrame:
        """Return a frame with odometry from wheels and IMU, and its scan levelled; call it for every frame in order."""
        with self._timed("odometry"):
            reckoned = self._reckoning.update(frame)
            self.depth.note_tilt(self._reckoning.tilt)
            return reckoned

    def see(self, picture: RgbdFrame) -> None:
        """Take in a depth image, in order of time, without drawing it.

        Its pose lies between the scans before and after it, so it enters the grid after the latter was included.
        """
        with self._timed("depth"):
            self.depth.see(picture)
            self.depth.follow(self.mapper)

    def include(self, frame: SensorFrame) -> Pose2:
        """Match a reckoned frame with a scan, without drawing it; return its `map_from_base`."""
        started, matches = time.process_time(), self.mapper.counts["matches"]
        pose = self.mapper.process(frame)
        if self.mapper.counts["matches"] > matches:
            self.key_seconds.append(time.process_time() - started)
        self._keep_odometry(frame)
        with self._timed("grid"):
            self._follow(frame)
        with self._timed("depth"):
            self.depth.follow(self.mapper)
        with self._timed("grid"):
            self._bend()
        return pose

    def draw(self) -> int:
        """Do one slice of the pending drawing (see `GridAssembly.draw`)."""
        with self._timed("grid"):
            return self._fitted(lambda: self.scans.draw() + self.depth.assembly.draw())

    @property
    def pending(self) -> int:
        """Upper bound on the scans and depth images that are still to be drawn or moved; 0: the grid is up to date."""
        return self.scans.pending + self.depth.assembly.pending

    def pose(self) -> Pose2:
        """Return `map_from_base` at the latest scan; the origin before the first."""
        return self.mapper.pose() if self.mapper.frames else Pose2()

    def grid(self) -> OccupancyGrid:
        """Return the grid of all sensors as drawn so far; all cells unknown before the first scan."""
        return self.layered_grid()[0]

    def layered_grid(self) -> tuple[OccupancyGrid, OccupancyGrid | None]:
        """Return the grid as drawn so far, and the layer of the camera alone (`maps.folders.depth_layer`), None without one."""
        if not len(self.depth.assembly):
            return self.scans.grid(), None
        # without a lidar the scans themselves are made of depth images
        scanned = (EvidenceGrid(self.cells) if self.settings.depth.use == "only" else self.scans).grid()
        grid, drops = merge_sensors(scanned, *self.depth.grids())
        return grid, depth_layer(scanned, grid, drops)

    def settle(self) -> MapperResult:
        """Return the map so far: searches for loops done to their end, the graph optimised, the grid drawn completely.

        Mapping can go on after it.

        Raises:
            NoScans: no frame with a scan has come yet.
        """
        if not self.mapper.frames:
            raise NoScans("there is no map yet, since no laser scan has come: check the lidar's power and topic")
        self.mapper.end_searches()
        result = self.mapper.result()
        self.depth.follow(self.mapper, ended=True)
        with self._timed("grid"):
            self._bend()
            self.draw_all()
        return result

    def draw_all(self) -> None:
        """Do all pending drawing.

        Raises:
            GridTooLarge: the map does not even fit into cells of `LARGEST_CELLS`.
        """

        def drawn() -> None:
            self.scans.settle()
            self.depth.assembly.settle()

        self._fitted(drawn)

    @property
    def size_warning(self) -> str:
        """A sentence about cells that are larger than the settings say, or ''."""
        own, wanted = self.cells.resolution, self.settings.grid.resolution
        if own == wanted:
            return ""
        return (
            f"the map is drawn with cells of {own:g} m, as cells of {wanted:g} m would be more than the {MOST_CELLS} that can be "
            f"planned on: give --resolution {own:g}, or check the poses for jumps if the site is smaller than the map"
        )

    def resume(self, mapper: Mapper, frames: Sequence[SensorFrame]) -> None:
        """Continue a checkpointed mapper that has seen these reckoned frames; call it before the first frame."""
        self.mapper = mapper
        for frame in frames:
            self._keep_odometry(frame)
        self._covered = [list(latest) for latest in mapper.covered_frames]
        for key_frame, latest in zip(mapper.key_frames, self._covered, strict=True):
            for number in (key_frame, *latest):
                self._add_scan(number, frames[number])
        self._bend()

    def continue_map(self, mapper: Mapper, sessions: int) -> None:
        """Continue the map of a number of earlier drives; call it before the first frame.

        The caller then passes their scans to `scans.add` and their depth images to `depth.anchor`.
        """
        self.mapper = mapper
        self._covered = [list(latest) for latest in mapper.covered_frames]
        self.scans.begin(sessions)
        self.depth.assembly.begin(sessions)

    def _fitted(self, draw: Callable[[], T]) -> T:
        """Return the result of `draw`; while the grid is too large, its cells are doubled and it is drawn anew.

        Raises:
            GridTooLarge: it does not even fit into cells of `LARGEST_CELLS`.
        """
        while True:
            try:
                return draw()
            except GridTooLarge:
                cells = replace(self.cells, resolution=2 * self.cells.resolution)
                if cells.resolution > LARGEST_CELLS:
                    raise
                self.cells = cells
                self.scans.draw_anew(lambda: GridAssembly(self.cells))
                self.depth.assembly.draw_anew(lambda: DepthAssembly(self.cells))

    def _follow(self, frame: SensorFrame) -> None:
        """Add the scan that the mapper has just kept to the grid, and drop those that it no longer keeps."""
        number = len(self.mapper.frames) - 1
        if len(self.mapper.key_frames) > len(self._covered):
            self._covered.append([])
            self._add_scan(number, frame)
            return
        key = self.mapper.frames[-1].key
        latest, before = self.mapper.covered_frames[key], self._covered[key]
        if latest and latest[-1] == number:
            self._add_scan(number, frame)
            for old in set(before) - set(latest):
                self.scans.drop(old)
            self._covered[key] = list(latest)

    def _add_scan(self, number: int, frame: SensorFrame) -> None:
        """Add a frame's scan to the grid, anchored to the frame's key scan."""
        assert frame.scan is not None
        hung, twist = self.mapper.frames[number], twist_of(frame) or Twist()
        first = hung.key_from_base @ self.base_from_laser
        last = hung.key_from_base @ sweep_motion(frame.scan, twist) @ self.base_from_laser
        self.scans.add(number, frame.scan, hung.key, first.array(), last.array())

    def _bend(self) -> None:
        here = self.pose()
        for assembly in (self.scans, self.depth.assembly):
            assembly.move_nodes(self.mapper.keys.poses, np.array([here.x, here.y]))

    def _keep_odometry(self, frame: SensorFrame) -> None:
        own = odometry_of(frame)
        self.odometry.append(SensorFrame(frame.stamp_ns, wheels=() if own is None else (own,)))

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        started = time.process_time()
        yield
        self.seconds[stage] += time.process_time() - started
