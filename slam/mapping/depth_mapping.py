"""The depth camera's part of a map: selection of depth images, the chair's tilt at each, and their key scans."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter, deque
from dataclasses import dataclass, field

from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.geometry import wrap_angle
from waychair.maps.depth.depth_scan import DepthScan, DepthSettings, depth_scan, frame_problem
from waychair.maps.grid.occupancy import OccupancySettings
from waychair.maps.layers.session_grid import SessionDepth
from waychair.slam.mapping.mapper import Mapper
from waychair.slam.odometry.tilt import Tilt
from waychair.types import FloatArray, OccupancyGrid, Pose2, Pose3, RgbdFrame

USES = ("on", "off", "only")
"""Depth images together with the lidar, not at all, or instead of the lidar."""

PLAIN = ("pictures", "kept", "near")
"""Counts of good depth images; the name of every other count is a reason for leaving images out."""

_KEY_DISTANCE = 0.15  # m; distance after which an image is kept
_KEY_ANGLE = math.radians(8)  # rad; turn after which an image is kept
_KEY_TIME_S = 2.0  # s; time after which an image is kept
_IMAGES_PER_KEY = 4  # latest images that are kept on each key scan
_MAX_GAP_S = 0.5  # s; greatest time between the scans before and after an image
_WAITING = 32  # greatest number of depth images that wait for the scan after them


@dataclass(frozen=True, slots=True)
class DepthMappingSettings(Settings):
    """The use of depth images, and the camera's mount."""

    use: str = setting(
        "on", "", "use of depth images: on: together with the lidar; off: not at all; only: instead of the lidar"
    )
    mount: tuple[float, ...] = setting(
        (),
        "m, rad",
        "mount of the depth camera on the base as X,Y,Z,YAW,PITCH, pitch down positive; empty: as recorded",
    )
    view: DepthSettings = field(default_factory=DepthSettings)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.use not in USES:
            raise ConfigError(f"use = '{self.use}' is unknown: take {', '.join(USES[:-1])} or {USES[-1]}")
        if len(self.mount) not in (0, 5):
            raise ConfigError(f"mount = {list(self.mount)} must be X,Y,Z,YAW,PITCH, five numbers in metres and radians")


class DepthMapping:
    """Takes depth images in order of time and keeps some of them, anchored to key scans, for the grid.

    `counts`: images that were kept, near to a kept one, or left out, by reason.
    """

    def __init__(
        self,
        settings: DepthMappingSettings,
        base_from_camera: Pose3,
        front: float,
        occupancy: OccupancySettings | None = None,
    ) -> None:
        """`front` is the distance from the axle to the chair's front [m]."""
        self.settings = settings
        self.counts: Counter[str] = Counter()
        self._mount, self._front = base_from_camera, front
        self.assembly = SessionDepth(occupancy)
        self._tilts: list[Tilt] = []
        self._waiting: deque[RgbdFrame] = deque()
        self._latest_ns: int | None = None
        self._kept: tuple[int, Pose2] | None = None  # stamp and pose of the latest kept image
        self._on_node: dict[int, list[int]] = {}
        self._number = 0

    def note_tilt(self, tilt: Tilt | None) -> None:
        """Take in the chair's tilt, in order of time; None if it is unknown."""
        if tilt is not None and (not self._tilts or tilt.stamp_ns > self._tilts[-1].stamp_ns):
            self._tilts.append(tilt)

    def see(self, picture: RgbdFrame) -> None:
        """Take in a depth image; it is placed after the scan that follows it."""
        self.counts["pictures"] += 1
        if self._latest_ns is not None and picture.stamp_ns <= self._latest_ns:
            self.counts["pictures not later than the one before"] += 1
            return
        self._latest_ns = picture.stamp_ns
        problem = frame_problem(picture, self.settings.view)
        if problem is not None:
            self.counts[problem] += 1
            return
        if len(self._waiting) == _WAITING:
            self._waiting.popleft()
            self.counts[_NO_SCAN] += 1
        self._waiting.append(picture)

    def follow(self, mapper: Mapper, *, ended: bool = False) -> None:
        """Place the waiting images up to the latest scan; with `ended`, all of them."""
        while self._waiting and mapper.frames:
            picture = self._waiting[0]
            if picture.stamp_ns > mapper.frames[-1].stamp_ns and not ended:
                return
            self._waiting.popleft()
            found = mapper.pose_at(picture.stamp_ns, _MAX_GAP_S)
            if found is None:
                self.counts[_NO_SCAN] += 1
            elif self._is_near(picture.stamp_ns, found[1]):
                self.counts["near"] += 1
            else:
                self._keep(mapper, picture, *found)

    def scan(self, picture: RgbdFrame) -> DepthScan:
        """Return a depth image's scan, levelled by the tilt at its stamp."""
        level_from_base = self.tilt_at(picture.stamp_ns).level_from_base()
        return depth_scan(picture, self._mount, level_from_base, self._front, self.settings.view)

    def tilt_at(self, stamp_ns: int) -> Tilt:
        """Return the tilt at a stamp, interpolated linearly; level where no tilt is known."""
        after = bisect_left(self._tilts, stamp_ns, key=lambda tilt: tilt.stamp_ns)
        if after == 0 or after == len(self._tilts):
            return self._tilts[min(after, len(self._tilts) - 1)] if self._tilts else Tilt(stamp_ns)
        low, high = self._tilts[after - 1 : after + 1]
        part = (stamp_ns - low.stamp_ns) / (high.stamp_ns - low.stamp_ns)
        return Tilt(stamp_ns, low.roll + part * (high.roll - low.roll), low.pitch + part * (high.pitch - low.pitch))

    def grids(self) -> tuple[OccupancyGrid, OccupancyGrid]:
        """Return the grids of obstacles and of drop-offs as drawn so far."""
        return self.assembly.grids()

    def _is_near(self, stamp_ns: int, pose: Pose2) -> bool:
        if self._kept is None:
            return False
        before_ns, before = self._kept
        away, turned = math.hypot(pose.x - before.x, pose.y - before.y), abs(wrap_angle(pose.theta - before.theta))
        return away < _KEY_DISTANCE and turned < _KEY_ANGLE and stamp_ns - before_ns < _KEY_TIME_S * 1e9

    def _keep(self, mapper: Mapper, picture: RgbdFrame, node: int, pose: Pose2) -> None:
        """Anchor an image to a node, in place of the oldest if the node has enough."""
        self.counts["kept"] += 1
        self._kept = picture.stamp_ns, pose
        self.anchor(self.scan(picture), node, (mapper.keys.pose(node).inverse() @ pose).array())

    def kept_images(self) -> list[tuple[int, DepthScan, int, FloatArray]]:
        """Return the kept images, oldest first on each key scan: session, depth scan, key scan, and pose from there."""
        told = (self.assembly.attached(number) for numbers in self._on_node.values() for number in numbers)
        return [(session, scan, node, places[0]) for session, scan, node, places in told]

    def anchor(self, scan: DepthScan, node: int, place: FloatArray) -> None:
        """Anchor a depth scan to a key scan, at a pose (3,) [m, m, rad] from there; drop the oldest one if too many."""
        self.assembly.add(self._number, scan, node, place, place)
        on_node = self._on_node.setdefault(node, [])
        on_node.append(self._number)
        self._number += 1
        if len(on_node) > _IMAGES_PER_KEY:
            self.assembly.drop(on_node.pop(0))


_NO_SCAN = "pictures without a scan before and after them"
