"""The mapper as a node: where the chair is on a map, which is given or which it makes on the way.

| takes | |
|---|---|
| scan, odom | what it matches, and where dead reckoning had the chair meanwhile |
| initialpose | where the rider says that the chair is |

| sends | |
|---|---|
| map | when it changes; those who come late get it, too |
| /tf | odom in map, often, so that nobody waits for it |
| localisation, amcl_pose | where each scan was taken, and how far that can be trusted |

Services: `map_server/load_map`, `map_saver/save_map` (nav2_msgs). With a map it localises: where the chair stood when the
node last ran, where `start` says, or from nowhere. Without one, or with `mapping`, it maps.
"""

from __future__ import annotations

import json
import math
import sys
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from waychair.config import Settings, setting
from waychair.errors import ConfigError, OutputError, WaychairError
from waychair.files import write_json
from waychair.geometry import in_space
from waychair.maps.depth_layer import load_depth_layer, scanned_part
from waychair.maps.map_files import load_map, save_map
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.known_chair import known_chair
from waychair.ros.messages.chair import localisation
from waychair.ros.messages.maps import occupancy_grid
from waychair.ros.messages.motion import (
    pose_with_covariance,
    read_odometry,
    read_pose_with_covariance,
    transform,
)
from waychair.ros.messages.reports import Level, Report
from waychair.ros.messages.sensors import read_scan
from waychair.ros.node import ChairNode, run_node
from waychair.ros_messages import MAP_FRAME, ODOM_FRAME
from waychair.runtime.live_mapping import LiveMapping, LiveMappingSettings
from waychair.runtime.odometry_track import OdometryTrack
from waychair.slam.localiser import Localisation, LocalisationState, Localiser, LocaliserSettings
from waychair.types import Odometry, Pose2, Scan, SensorFrame

_ALIVE_HZ = 25.0
_MAP_HZ = 0.5
_REMEMBER_HZ = 1.0


@dataclass(frozen=True, slots=True)
class MapperNodeSettings(Settings):
    """Which map, or how one is made."""

    map_folder: str = setting("", "", "the map to localise on; empty: one is made")
    mapping: bool = setting(False, "", "make a map although one is given")
    calibration: str = setting("", "", "the chair's file; empty: a simulated chair's")
    chair: str = setting("A", "", "the simulated chair, where there is no file")
    start: str = setting("", "", "X,Y,YAW in map [m, m, rad] where the chair stands; empty: see `remember`")
    remember: str = setting("", "", "file in which the pose is kept from one run to the next; empty: it is not")
    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)
    live: LiveMappingSettings = field(default_factory=LiveMappingSettings)


class MapperNode(ChairNode[MapperNodeSettings]):
    """A `Localiser` or a `LiveMapping`, and what it needs of the odometry."""

    def __init__(self) -> None:
        super().__init__("mapper", MapperNodeSettings)
        s = self.settings
        calibration = known_chair(s.calibration, s.chair)
        self._calibration, self._body = calibration, calibration.body
        self._track = OdometryTrack()
        self._since: deque[Odometry] = deque(maxlen=500)  # odometry since the last frame
        self._waiting: deque[Scan] = deque(maxlen=5)
        self._found: tuple[int, Localisation] | None = None
        self._send_map, self._send_pose = self.publisher(topics.MAP), self.publisher(topics.POSE)
        self._send_transform, self._send_found = self.publisher(topics.TF), self.publisher(topics.LOCALISATION)
        self._localiser: Localiser | None = None
        self._mapping: LiveMapping | None = None
        if s.map_folder and not s.mapping:
            self._use(Path(s.map_folder), self._first_pose())
        else:
            self._mapping = LiveMapping(s.live, self._body.base_from_laser, self._body)
            self.every(_MAP_HZ, self._publish_growing_map)
        self.listen(topics.ODOMETRY, read_odometry, self._move)
        self.listen(topics.SCAN, read_scan, self._see)
        self.listen(
            topics.INITIAL_POSE, read_pose_with_covariance, lambda given: self._set_pose(given[0]), needed=False
        )
        self.create_service(interface_type("nav2_msgs/srv/LoadMap"), "map_server/load_map", self._load)
        self.create_service(interface_type("nav2_msgs/srv/SaveMap"), "map_saver/save_map", self._save)
        self.every(_ALIVE_HZ, self._repeat)
        self.every(_REMEMBER_HZ, self._remember)

    def reports(self) -> Iterable[Report]:
        """Whether the chair knows where it is."""
        if self._found is None:
            yield Report("localisation", Level.STALE, "no scan has come yet with odometry to it")
            return
        found = self._found[1]
        levels = {LocalisationState.OK: Level.OK, LocalisationState.DEGRADED: Level.WARN}
        pose = found.map_from_base
        values = (
            ("state", found.state.value),
            ("health", f"{found.health:.3f}"),
            ("pose", f"{pose.x:.3f}, {pose.y:.3f}, {pose.theta:.4f}"),
        )
        message = "" if found.state is LocalisationState.OK else f"the chair's place on the map is {found.state.value}"
        yield Report("localisation", levels.get(found.state, Level.ERROR), message, values)

    def _use(self, folder: Path, start: Pose2 | None) -> None:
        """Localise on a saved map.

        Raises:
            MapError: it cannot be read.
        """
        grid = load_map(folder)
        scanned = scanned_part(grid, load_depth_layer(folder, grid))
        self._grid = grid
        self._localiser = Localiser(scanned, self._body.base_from_laser, start, self.settings.localiser)
        self._mapping = None
        self._send_map(occupancy_grid(self.now_ns(), grid))

    def _first_pose(self) -> Pose2 | None:
        """Where the chair stands: as it is told, or as it was when this node ran last; None: unknown.

        Raises:
            ConfigError: the start is no pose.
        """
        s = self.settings
        if s.start:
            return pose_from_text(s.start)
        path = Path(s.remember)
        if not s.remember or not path.exists():
            return None
        try:
            known = json.loads(path.read_text(encoding="utf-8"))
            if known["map"] != str(Path(s.map_folder).resolve()):
                return None
            return Pose2(*(float(value) for value in known["pose"]))
        except (OSError, ValueError, KeyError, TypeError):
            self.get_logger().warning(f"{path} holds no pose: the chair looks for itself")
            return None

    def _remember(self) -> None:
        """Keep where the chair is, while it knows."""
        s = self.settings
        if not s.remember or self._localiser is None or self._found is None:
            return
        found = self._found[1]
        if found.state is LocalisationState.LOST:
            return
        pose = found.map_from_base
        try:
            write_json(
                Path(s.remember), {"map": str(Path(s.map_folder).resolve()), "pose": [pose.x, pose.y, pose.theta]}
            )
        except OutputError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=60.0)

    def _set_pose(self, pose: Pose2) -> None:
        """The rider's word."""
        if self._localiser is None:
            self.get_logger().warning("a map is being made: there is no pose to set on it")
            return
        self._localiser.restart(pose)

    def _move(self, odometry: Odometry) -> None:
        self._track.take(odometry)
        self._since.append(odometry)
        while self._waiting and self._waiting[0].stamp_ns <= odometry.stamp_ns:
            self._place(self._waiting.popleft())

    def _see(self, scan: Scan) -> None:
        """A scan is placed once the odometry has reached it."""
        self._waiting.append(scan)
        if self._track.odom_from_base(scan.stamp_ns) is not None:
            self._place(self._waiting.pop())

    def _place(self, raw: Scan) -> None:
        odom_from_base = self._track.odom_from_base(raw.stamp_ns)
        if odom_from_base is None:
            return
        scan = self._calibration.seen(raw)
        if self._localiser is not None:
            self._publish(scan.stamp_ns, self._localiser.process(scan, odom_from_base, self._track.twist))
            return
        mapping = self._mapping
        assert mapping is not None
        since, self._since = tuple(self._since), deque(maxlen=500)
        frame = SensorFrame(scan.stamp_ns, scan=scan, wheels=since)

        def placed(pose: Pose2) -> None:
            map_from_odom = pose @ odom_from_base.inverse()
            self._publish(scan.stamp_ns, Localisation(pose, map_from_odom, 1.0, LocalisationState.OK, 1.0))

        self.worker.submit(lambda: mapping.process(frame), placed)

    def _publish(self, stamp_ns: int, found: Localisation) -> None:
        self._found = stamp_ns, found
        self._send_found(localisation(stamp_ns, found))
        self._send_pose(pose_with_covariance(stamp_ns, found.map_from_base, found.covariance))

    def _repeat(self) -> None:
        """Show that this node lives, and keep the transform fresh."""
        if self._found is None:
            return
        stamp_ns, found = self._found
        self._send_found(localisation(stamp_ns, found))
        self._send_transform(transform(self.now_ns(), MAP_FRAME, ODOM_FRAME, in_space(found.map_from_odom)))

    def _publish_growing_map(self) -> None:
        mapping = self._mapping
        if mapping is not None and self._found is not None:
            self.worker.submit(mapping.grid, lambda grid: self._send_map(occupancy_grid(self.now_ns(), grid)))

    def _load(self, request: Any, response: Any) -> Any:
        """nav2_msgs/srv/LoadMap; the URL is a map folder's or its map.yaml's."""
        try:
            self._use(Path(request.map_url.removeprefix("file://")), None)
            response.result = response.RESULT_SUCCESS
        except WaychairError as error:
            self.get_logger().error(str(error))
            response.result = response.RESULT_INVALID_MAP_DATA
        return response

    def _save(self, request: Any, response: Any) -> Any:
        """nav2_msgs/srv/SaveMap, into the folder that the URL names."""
        try:
            grid = self._grid if self._mapping is None else self._mapping.grid()
            save_map(Path(request.map_url.removeprefix("file://")), grid)
            response.result = True
        except WaychairError as error:
            self.get_logger().error(str(error))
            response.result = False
        return response


def pose_from_text(text: str) -> Pose2:
    """Of X,Y,YAW or X,Y.

    Raises:
        ConfigError: it is no pose.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise ConfigError(f"'{text}' is no pose: give X,Y,YAW in metres and radians")
    return Pose2(*numbers)


def main(arguments: Sequence[str] | None = None) -> int:
    """The node's process."""
    return run_node(MapperNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
