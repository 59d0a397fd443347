"""The depth camera's part of a map: which pictures are kept, how the chair leant at each, and where on the graph it hangs."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter, deque
from dataclasses import dataclass, field

from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.geometry import wrap_angle
from waychair.maps.depth_scan import DepthScan, DepthSettings, depth_scan, frame_problem
from waychair.maps.grid_assembly import AssemblySettings
from waychair.maps.occupancy import OccupancySettings
from waychair.maps.session_grid import SessionDepth
from waychair.slam.mapper import Mapper
from waychair.slam.tilt import Tilt
from waychair.types import FloatArray, OccupancyGrid, Pose2, Pose3, RgbdFrame

USES = ("on", "off", "only")
"""Depth images beside the lidar, not at all, or instead of the lidar."""

PLAIN = ("pictures", "kept", "near")
"""Counts of pictures with which nothing was wrong; every other one is a reason."""

_WAITING = 32  # pictures that wait for the scan after them


@dataclass(frozen=True, slots=True)
class DepthMappingSettings(Settings):
    """What is done with depth images where there are any."""

    use: str = setting("on", "", "on: beside the lidar, off: not at all, only: instead of the lidar")
    mount: tuple[float, ...] = setting(
        (), "m, rad", "X,Y,Z,YAW,PITCH of the camera on the base, pitch down; empty: as recorded"
    )
    key_distance: float = setting(0.15, "m", "way after which a picture is kept", low=0.0, high=5.0)
    key_angle: float = setting(math.radians(8), "rad", "turn after which one is", low=0.0, high=math.pi)
    key_time: float = setting(2.0, "s", "time after which one is", low=0.0, high=1e6)
    kept: int = setting(4, "", "latest pictures that are kept on each key scan", low=1, high=100)
    gap: float = setting(0.5, "s", "between the scans before and after a picture, at most", low=0.01, high=10.0)
    view: DepthSettings = field(default_factory=DepthSettings)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.use not in USES:
            raise ConfigError(f"use = '{self.use}' is unknown: take {', '.join(USES[:-1])} or {USES[-1]}")
        if len(self.mount) not in (0, 5):
            raise ConfigError(f"mount = {list(self.mount)} must be X,Y,Z,YAW,PITCH, five numbers in metres and radians")


class DepthMapping:
    """Pictures in their order in time, a little before or after the scans; their cells, wherever the graph bends.

    `counts` says what became of them: kept, near to one that is kept, or why nothing could be done with them.
    """

    def __init__(
        self,
        settings: DepthMappingSettings,
        base_from_camera: Pose3,
        front: float,
        occupancy: OccupancySettings | None = None,
        assembly: AssemblySettings | None = None,
    ) -> None:
        """`front` is how far the chair reaches ahead of its axle [m]."""
        self.settings = settings
        self.counts: Counter[str] = Counter()
        self._mount, self._front = base_from_camera, front
        self.assembly = SessionDepth(occupancy, assembly)
        self._tilts: list[Tilt] = []
        self._waiting: deque[RgbdFrame] = deque()
        self._latest_ns: int | None = None
        self._kept: tuple[int, Pose2] | None = None  # stamp and place of the latest picture that was kept
        self._on_node: dict[int, list[int]] = {}
        self._number = 0

    def lean(self, tilt: Tilt | None) -> None:
        """How the chair leans, in the order of time; None is not known."""
        if tilt is not None and (not self._tilts or tilt.stamp_ns > self._tilts[-1].stamp_ns):
            self._tilts.append(tilt)

    def see(self, picture: RgbdFrame) -> None:
        """A picture; it is placed once the scan after it was."""
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
        """Place the pictures that wait for a scan that has come, or that will never come."""
        while self._waiting and mapper.frames:
            picture = self._waiting[0]
            if picture.stamp_ns > mapper.frames[-1].stamp_ns and not ended:
                return
            self._waiting.popleft()
            found = mapper.placed(picture.stamp_ns, self.settings.gap)
            if found is None:
                self.counts[_NO_SCAN] += 1
            elif self._is_near(picture.stamp_ns, found[1]):
                self.counts["near"] += 1
            else:
                self._keep(mapper, picture, *found)

    def scan(self, picture: RgbdFrame) -> DepthScan:
        """What a picture tells, levelled by the lean at its stamp."""
        level_from_base = self.tilt_at(picture.stamp_ns).level_from_base()
        return depth_scan(picture, self._mount, level_from_base, self._front, self.settings.view)

    def tilt_at(self, stamp_ns: int) -> Tilt:
        """The lean at a stamp, between two that are known in proportion; none where none is known."""
        after = bisect_left(self._tilts, stamp_ns, key=lambda tilt: tilt.stamp_ns)
        if after == 0 or after == len(self._tilts):
            return self._tilts[min(after, len(self._tilts) - 1)] if self._tilts else Tilt(stamp_ns)
        low, high = self._tilts[after - 1 : after + 1]
        part = (stamp_ns - low.stamp_ns) / (high.stamp_ns - low.stamp_ns)
        return Tilt(stamp_ns, low.roll + part * (high.roll - low.roll), low.pitch + part * (high.pitch - low.pitch))

    def grids(self) -> tuple[OccupancyGrid, OccupancyGrid]:
        """What stands or hangs, and where the floor ends, as drawn now."""
        return self.assembly.grids()

    def _is_near(self, stamp_ns: int, pose: Pose2) -> bool:
        if self._kept is None:
            return False
        s, (before_ns, before) = self.settings, self._kept
        away, turned = math.hypot(pose.x - before.x, pose.y - before.y), abs(wrap_angle(pose.theta - before.theta))
        return away < s.key_distance and turned < s.key_angle and stamp_ns - before_ns < s.key_time * 1e9

    def _keep(self, mapper: Mapper, picture: RgbdFrame, node: int, pose: Pose2) -> None:
        """Hang a picture on a node, in the place of the oldest where there are enough."""
        self.counts["kept"] += 1
        self._kept = picture.stamp_ns, pose
        self.hang(self.scan(picture), node, (mapper.keys.pose(node).inverse() @ pose).array())

    def hung(self) -> list[tuple[int, DepthScan, int, FloatArray]]:
        """What is kept, the older first on each key scan: the session of a picture, what it tells, its key scan, and where
        it was from there."""
        told = (self.assembly.hung(number) for numbers in self._on_node.values() for number in numbers)
        return [(session, scan, node, places[0]) for session, scan, node, places in told]

    def hang(self, scan: DepthScan, node: int, place: FloatArray) -> None:
        """What a picture tells, taken at a place (3,) [m, m, rad] from a key scan, replaces the oldest of many there."""
        self.assembly.add(self._number, scan, node, place, place)
        on_node = self._on_node.setdefault(node, [])
        on_node.append(self._number)
        self._number += 1
        if len(on_node) > self.settings.kept:
            self.assembly.drop(on_node.pop(0))


_NO_SCAN = "pictures without a scan before and after them"
