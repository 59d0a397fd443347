"""The mapper node: it localises the chair on a given map, or makes a map.

| takes | |
|---|---|
| scan, odom | scans to match, and dead reckoning |
| imu/data | while mapping: turn rate and tilt |
| initialpose | the chair's pose, from the rider |

| sends | |
|---|---|
| map | on change; latched |
| /tf | map -> odom, at 25 Hz, so that nobody waits for it |
| localisation, amcl_pose | the pose of each scan, and its reliability |
| floor | the map in use and its storey, which all nodes follow; latched |

Services: `map_server/load_map`, `map_saver/save_map` (nav2_msgs), `reinitialize_global_localization` (std_srvs/Empty),
`set_floor` (waychair_msgs), and `amcl/get_state` (lifecycle_msgs) for scripts that wait for Nav2's localiser. `load_map` and
`set_floor` change the map of all nodes, with its places and zones.

With a map it localises, starting from the pose saved by its last run, else by global localisation. Without a map it makes
one, the same as `waychair map` from a bag of the same drive.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.task import Future

from waychair.calibration.chair_body import ChairBody
from waychair.errors import ConfigError, MapError, MapNotFound, OutputError, WaychairError
from waychair.geometry import in_space
from waychair.maps.folders.depth_layer import load_depth_layer, scanned_part
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.offline.map_folders import copy_map
from waychair.recordings.bags.ros_messages import MAP_FRAME, ODOM_FRAME
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.chair import localisation
from waychair.ros.messages.maps import occupancy_grid
from waychair.ros.messages.motion import (
    pose_with_covariance,
    read_odometry,
    read_pose,
    read_pose_with_covariance,
    transform,
)
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.messages.sensors import read_imu, read_scan
from waychair.ros.messages.wire import native, plain
from waychair.ros.node_settings.mapper import MapperNodeSettings
from waychair.ros.nodes.inputs import CLOCK_ERROR_NS
from waychair.ros.nodes.node import ChairNode, offer_get_state, run_node
from waychair.ros.nodes.parts.floor_keeper import FloorKeeper
from waychair.ros.nodes.parts.known_chair import known_chair
from waychair.ros.nodes.parts.refusals import Refusals
from waychair.ros.topics import RosTopic
from waychair.runtime.last_pose import remember_pose, remembered_pose
from waychair.slam.localising.localiser import (
    Localisation,
    LocalisationState,
    Localiser,
    prepared_map,
)
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.slam.odometry.odometry_track import OdometryTrack
from waychair.types import Odometry, Pose2, Scan

if TYPE_CHECKING:
    from waychair.ros.nodes.parts.map_builder import MapBuilder

_HEARTBEAT_HZ = 25.0
_MAP_HZ = 0.5
_PATIENCE_S = 2.0
_SAVE_POSE_HZ = 4.0
_MOVED = 0.05  # m and rad; smaller changes of the pose are not saved
_ANYWHERE = np.diag([1e4, 1e4, math.pi**2])  # m2, m2, rad2: covariance of an unknown pose


class MapperNode(ChairNode[MapperNodeSettings]):
    """A node with a `Localiser` or a `MapBuilder`."""

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        super().__init__("mapper", MapperNodeSettings, arguments=arguments)
        s = self.settings
        calibration = known_chair(s.calibration, s.chair)
        self._calibration = calibration
        self._track = OdometryTrack()
        self._waiting: deque[Scan] = deque(maxlen=5)
        self._localisation: tuple[int, Localisation] | None = None
        self._floor = FloorKeeper(self, s.pose_file)
        self._refusals = Refusals("initial pose", self.get_logger().error)
        self._saved_pose: Pose2 | None = None
        self._send_map, self._send_pose = self.publisher(topics.MAP), self.publisher(topics.POSE)
        self._send_transform, self._send_localisation = self.publisher(topics.TF), self.publisher(topics.LOCALISATION)
        self._localiser: Localiser | None = None
        self._builder: MapBuilder | None = None
        if s.map_folder:
            folder, certain = self._floor.first(Path(s.map_folder))
            pose = self._first_pose(folder)
            self._localise_on(folder, pose, certain=certain and not self._floor.in_a_lift(folder, pose))
        else:
            self._builder = self._begin_map()
        odometry, scan = topics.ODOMETRY, topics.SCAN
        if self._builder is not None:
            odometry, scan = _lossless(odometry), _lossless(scan)
        with_true_stamp = calibration.with_true_stamp
        self.listen(odometry, lambda message: with_true_stamp(read_odometry(message)), self._take_odometry)
        self.listen(scan, lambda message: with_true_stamp(read_scan(message, s.scan_frame)), self._take_scan)
        self.listen(
            topics.INITIAL_POSE,
            read_pose_with_covariance,
            lambda given: self._set_pose(given[0]),
            self._refuse_pose,
            needed=False,
        )
        self.create_service(interface_type("nav2_msgs/srv/LoadMap"), "map_server/load_map", self._load)
        self.create_service(interface_type("waychair_msgs/srv/SetFloor"), "set_floor", self._set_floor)
        self.listen(topics.LAYOUT, lambda message: message, lambda message: self._reload_map(), needed=False)
        self.create_service(
            interface_type("std_srvs/srv/Empty"), "reinitialize_global_localization", self._global_localisation
        )
        offer_get_state("amcl", self, lambda: self._localisation is not None)
        own = MutuallyExclusiveCallbackGroup()  # so that other callbacks run while a map is saved
        self.create_service(
            interface_type("nav2_msgs/srv/SaveMap"), "map_saver/save_map", self._save, callback_group=own
        )
        self.every(_HEARTBEAT_HZ, self._repeat)
        self.every(_SAVE_POSE_HZ, self._save_pose)

    @property
    def _body(self) -> ChairBody:
        return self._calibration.body

    def _begin_map(self) -> MapBuilder:
        """Begin a map, like `waychair map` from a bag of the same drive."""
        from waychair.ros.nodes.parts.map_builder import MapBuilder  # late, since localisation does not need it
        from waychair.slam.mapping.mapper_warm_up import warm_up

        warm_up()
        s = self.settings
        if s.save_folder:
            self.at_end(self._finish_map)  # runs after the end of the worker, which is started later
        builder = MapBuilder(
            self.worker, lambda: LiveMapping(s.live, self._body.base_from_laser, self._body), self._publish
        )
        self.listen(
            _lossless(topics.IMU), lambda message: read_imu(message, s.imu_frame), builder.add_imu, needed=False
        )
        self.every(_MAP_HZ, self._publish_map)
        return builder

    def reports(self) -> Iterable[Report]:
        """Report the localisation's state, and whether mapping keeps up."""
        yield self._refusals.report()
        if self._builder is not None:
            yield self._builder.report()
        if self._localisation is None:
            yield Report("localisation", DiagnosticLevel.STALE, "no scan with odometry has arrived yet")
            return
        found = self._localisation[1]
        levels = {LocalisationState.OK: DiagnosticLevel.OK, LocalisationState.DEGRADED: DiagnosticLevel.WARN}
        pose = found.map_from_base
        values = (
            ("state", found.state.value),
            ("health", f"{found.health:.3f}"),
            ("pose", f"{pose.x:.3f}, {pose.y:.3f}, {pose.theta:.4f}"),
        )
        message = "" if found.state is LocalisationState.OK else f"the localisation is {found.state.value}"
        yield Report("localisation", levels.get(found.state, DiagnosticLevel.ERROR), message, values)

    def _localise_on(self, folder: Path, start: Pose2 | None, *, certain: bool = True) -> None:
        """Localise on a saved map, and tell all nodes to use it.

        Raises:
            MapError: the map cannot be read.
        """
        grid = load_map(folder, self.get_logger().warning)
        scanned = scanned_part(grid, load_depth_layer(folder, grid))
        self._folder, self._grid = folder, grid
        self._localiser = Localiser(scanned, self._body.base_from_laser, start, self.settings.localiser)
        self._localisation, self._saved_pose = None, start  # the ones before belong to another map
        if start is not None:
            self._keep_pose(start)  # before the floor: a mapper that is killed now begins again where the chair is
        self._floor.take(folder, certain=certain)
        self._send_grid()

    def _send_grid(self) -> None:
        self._send_map(occupancy_grid(self.now_ns(), self._grid, loaded_ns=self._floor.revision))

    def _first_pose(self, folder: Path) -> Pose2 | None:
        """Return the pose of this node's last run; None: unknown."""
        s = self.settings
        try:
            return remembered_pose(Path(s.pose_file), folder) if s.pose_file else None
        except ConfigError as error:
            self.get_logger().warning(f"{error}; until then the chair localises itself globally")
            return None

    def _save_pose(self) -> None:
        """Save the chair's pose unless it is lost."""
        if self._localiser is None or self._localisation is None:
            return
        found = self._localisation[1]
        if found.state is LocalisationState.LOST:
            return
        pose, before = found.map_from_base, self._saved_pose
        if before is not None and max(map(abs, (before.inverse() @ pose).array())) < _MOVED:
            return
        self._saved_pose = pose
        self._keep_pose(pose)

    def _keep_pose(self, pose: Pose2) -> None:
        if not self.settings.pose_file:
            return
        try:
            remember_pose(Path(self.settings.pose_file), self._folder, pose)
        except OutputError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=60.0)

    def _set_pose(self, pose: Pose2) -> None:
        """Restart the localiser at a pose given by the rider."""
        if self._localiser is None:
            self._refuse_pose("a map is being made, which knows the chair's pose: save it first")
            return
        cell = cells_from_points(self._grid, np.array([[pose.x, pose.y]]))
        if not inside(self._grid, cell)[0]:
            self._refuse_pose(f"{pose.x:.2f}, {pose.y:.2f} lies outside the map: give a pose on it")
            return
        self._refusals.accepted()
        self._localiser.restart(pose)

    def _refuse_pose(self, reason: str) -> None:
        """Answer an initial pose that cannot be used, in the log, on /diagnostics and in the localisation."""
        self._refusals.refused(f"an initial pose was refused: {reason}")

    def _global_localisation(self, request: Any, response: Any) -> Any:
        """Start global localisation, as the service of Nav2's localiser does."""
        if self._localiser is not None:
            self._localiser.restart(None)
        return response

    def _reload_map(self) -> None:
        """Reload the map, of which parts may have been erased."""
        localiser = self._localiser
        if localiser is None:
            return
        try:
            grid = load_map(self._folder, lambda _: None)
            if np.array_equal(grid.cells, self._grid.cells):
                return
            scanned = scanned_part(grid, load_depth_layer(self._folder, grid))
        except WaychairError as error:
            self.get_logger().error(f"{error}; the map stays unchanged")
            return
        self._grid = grid
        self._send_grid()
        self.worker.submit(lambda: prepared_map(scanned, self.settings.localiser), localiser.replace_map)

    def _take_odometry(self, odometry: Odometry) -> None:
        restarted = self._track.take(odometry)
        if self._builder is not None:
            self._builder.add_odometry(odometry, restarted)
            return
        if restarted:
            self._restart_localiser()
        self._localise_waiting(odometry.stamp_ns)

    def _take_scan(self, scan: Scan) -> None:
        """Localise a scan once the odometry has reached its stamp and earlier scans are done."""
        if self._builder is not None:
            self._builder.add_scan(self._calibration.masked(scan))
            return
        if abs(self.now_ns() - scan.stamp_ns) > CLOCK_ERROR_NS:
            return  # another clock: its transforms would be useless; the input reports it, and the chair does not drive
        if self._waiting and scan.stamp_ns <= self._waiting[-1].stamp_ns:
            self._waiting.clear()  # the clock was set back
        self._waiting.append(scan)
        if self._track.odom_from_base(scan.stamp_ns) is not None:
            self._localise_waiting(scan.stamp_ns)

    def _localise_waiting(self, until_ns: int) -> None:
        while self._waiting and self._waiting[0].stamp_ns <= until_ns:
            self._localise(self._waiting.popleft())

    def _restart_localiser(self) -> None:
        """Restart the localiser at the last pose, because the odometry restarted; on a map just taken, at its first one."""
        found = None if self._localisation is None else self._localisation[1]
        pose = self._saved_pose if found is None else None if found.lost else found.map_from_base
        if self._localiser is None or pose is None:
            return
        self.get_logger().warning("the odometry restarted: localisation restarts at the last pose")
        self._localiser.restart(pose)

    def _localise(self, raw: Scan) -> None:
        odom_from_base = self._track.odom_from_base(raw.stamp_ns)
        if odom_from_base is None or self._localiser is None:
            return
        scan = self._calibration.masked(raw)
        self._publish(scan.stamp_ns, self._localiser.process(scan, odom_from_base, self._track.twist))

    def _publish(self, stamp_ns: int, found: Localisation) -> None:
        self._localisation = stamp_ns, found
        self._send_localisation(localisation(stamp_ns, found, self._refusals.last, self._floor.revision))
        known = found.covariance is not None and found.state is not LocalisationState.LOST
        covariance = found.covariance if known else _ANYWHERE
        self._send_pose(pose_with_covariance(stamp_ns, found.map_from_base, covariance))

    def _repeat(self) -> None:
        """Repeat the localisation as a heartbeat, and keep the transform fresh."""
        if self._localisation is None:
            return
        stamp_ns, found = self._localisation
        self._send_localisation(localisation(stamp_ns, found, self._refusals.last, self._floor.revision))
        self._send_transform(transform(self.now_ns(), MAP_FRAME, ODOM_FRAME, in_space(found.map_from_odom)))

    def _publish_map(self) -> None:
        if self._builder is not None:
            self._builder.send_grid(lambda grid: self._send_map(occupancy_grid(self.now_ns(), grid)))

    def _load(self, request: Any, response: Any) -> Any:
        """Serve nav2_msgs/srv/LoadMap; the URL is that of a map folder or its map.yaml."""
        if self._builder is not None:
            self.get_logger().error("a map is being made: save it, then restart the chair with the other map")
            response.result = response.RESULT_UNDEFINED_FAILURE
            return response
        try:
            self._localise_on(Path(request.map_url.removeprefix("file://")), None)
        except WaychairError as error:
            self.get_logger().error(str(error))
            missing = isinstance(error, MapNotFound)
            response.result = response.RESULT_MAP_DOES_NOT_EXIST if missing else response.RESULT_INVALID_MAP_DATA
            return response
        response.map = native(occupancy_grid(self.now_ns(), self._grid))
        response.result = response.RESULT_SUCCESS
        return response

    def _set_floor(self, request: Any, response: Any) -> Any:
        """Serve waychair_msgs/srv/SetFloor."""
        try:
            if self._builder is not None:
                raise MapError("a map is being made: save it, then restart the chair with the other map")
            if request.map_url:
                start = read_pose(plain(request.map_from_base)) if request.placed else None
                self._localise_on(Path(request.map_url.removeprefix("file://")), start, certain=request.certain)
            else:
                self._floor.doubt(certain=request.certain)
        except WaychairError as error:
            self.get_logger().error(str(error))
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, f"the map is that of {self._folder}"
        response.revision = self._floor.revision
        return response

    async def _save(self, request: Any, response: Any) -> Any:
        """Serve nav2_msgs/srv/SaveMap: save this node's map with all its files to the folder that the URL names.

        Topic, format, mode and thresholds of the request are ignored.
        """
        folder = Path(request.map_url.removeprefix("file://"))
        saved: Any = Future()
        if self._builder is not None:
            self._builder.save(folder, saved.set_result)
        else:
            self.worker.submit(lambda: self._copy_map(folder), saved.set_result)
        trouble = await saved
        if trouble:
            self.get_logger().error(trouble)
        response.result = not trouble
        return response

    def _copy_map(self, folder: Path) -> str:
        """Copy the map's files to a folder; return an error sentence, or ''."""
        try:
            copy_map(self._folder, folder)
        except WaychairError as error:
            return str(error)
        return ""

    def _finish_map(self) -> None:
        """Save the map that was being made, at the node's end."""
        if self._builder is not None:
            trouble = self._builder.finish(Path(self.settings.save_folder))
            if trouble:
                self.get_logger().error(trouble)


def _lossless(topic: RosTopic) -> RosTopic:
    """Return the topic with a queue that loses nothing while this process is busy for `_PATIENCE_S`."""
    return replace(topic, qos=replace(topic.qos, depth=round(_PATIENCE_S * topic.rate_hz)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(MapperNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
