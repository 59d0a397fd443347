"""The building round the navigator's map: its graph as markers, the action compute_route, and learnt driving times.

A map folder that is a storey of a building needs no further setting. Nothing here drives: routes are answers.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.action import ActionServer
from rclpy.duration import Duration
from rclpy.task import Future

from waychair.calibration.chair_body import ChairBody
from waychair.errors import BuildingError, MessageError, NoPath, PlanningError, WaychairError
from waychair.maps.building.hgraph_files import GENERAL, submap_file
from waychair.maps.building.zone_rules import with_zones
from waychair.maps.drawn.places import PLACES_YAML
from waychair.maps.drawn.zones import ZONES_YAML, load_zones
from waychair.maps.folders.map_files import load_map
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.planning.building.learnt_drives import building_of_map
from waychair.planning.building.pose_ends import nearest_node
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.motion import path, read_pose_stamped
from waychair.ros.messages.routes import graph_markers, require_ids, route, route_path
from waychair.ros.messages.wire import native
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.worker import Worker
from waychair.runtime.drive_times import RecordedDrive
from waychair.runtime.rider.habits import Habits, default_path
from waychair.types import Pose2

UNKNOWN, TF_ERROR, NO_VALID_GRAPH, NO_NODES, NO_VALID_ROUTE = 400, 401, 402, 403, 405
"""Nav2's codes of nav2_msgs/action/ComputeRoute."""

_WAITING = 64
"""Most requests that wait for an answer."""

_WATCH_HZ, _WATCHED = 0.5, 500
"""Rate at which files are looked at, and the most sub-maps whose files are: a look takes a millisecond."""

_RECORD_HZ = 10.0
"""Rate at which a drive is recorded for its times."""


@dataclass(frozen=True, slots=True)
class DriveNow:
    """The present drive: whether the chair drives, whether it has arrived at its goal, and its pose in map if known."""

    drives: bool
    arrived: bool
    pose: Pose2 | None


@dataclass(slots=True)
class _Known:
    """The building of the navigator's map, once it is loaded."""

    folder: Path
    planner: RoutePlanner
    storey: str


@dataclass(frozen=True, slots=True)
class _Answer:
    """The answer to a request: rclpy's result, and whether there is a route."""

    result: Any
    found: bool


class _Refused(WaychairError):
    """A request that cannot be answered, with its code."""

    def __init__(self, code: int, sentence: str) -> None:
        super().__init__(sentence)
        self.code = code


class BuildingRoutes:
    """Serves compute_route and building_graph for the building of a map folder; refuses routes where there is none."""

    def __init__(self, node: ChairNode[Any], folder: Path | None, body: ChairBody, now: Callable[[], DriveNow]) -> None:
        self._node, self._folder, self._body, self._now = node, folder, body, now
        self._type = interface_type("nav2_msgs/action/ComputeRoute")
        self._worker = Worker(node, _WAITING)  # its own: a long answer delays no map, and no answer is dropped
        self._known: _Known | None = None
        self._recorded = RecordedDrive()  # by the steady clock
        self._files: tuple[int, ...] = ()
        self._send_graph = node.publisher(topics.BUILDING_GRAPH)
        server = ActionServer(
            node=node, action_type=self._type, action_name=topics.COMPUTE_ROUTE, execute_callback=self._execute
        )
        node.at_end(self._worker.close)
        node.at_end(server.destroy)
        self._load()
        node.every(_RECORD_HZ, self._record)
        node.every(_WATCH_HZ, self._watch)

    def follow(self, folder: Path) -> None:
        """Answer for the building of another map folder from now on; the drive that was recorded is forgotten."""
        if folder != self._folder:
            self._folder, self._recorded, self._files = folder, RecordedDrive(), ()
            self._load()

    def _load(self) -> None:
        """Load the building again, in the worker, and publish its graph; if it is damaged, the log says so."""
        self._worker.submit(self._loaded, self._take)

    def _watch(self) -> None:
        """Load the building again if somebody has changed its text files, or the places or zones of the map."""
        files = self._known_files()
        if files != self._files:
            if self._files:
                self._load()
            self._files = files

    def _known_files(self) -> tuple[int, ...]:
        """Return the times of the last changes [ns] of the files that routes depend on; of a large building, of some."""
        if self._known is None or self._folder is None:
            return ()
        folder, submaps = self._known.folder, list(self._known.planner.hgraph.submaps)[:_WATCHED]
        drawn = [self._folder / name for name in (PLACES_YAML, ZONES_YAML)]
        files = [folder / GENERAL, *drawn, *(submap_file(folder, submap) for submap in submaps)]
        return tuple(file.stat().st_mtime_ns if file.is_file() else 0 for file in files)

    def _loaded(self) -> _Known | str | None:
        """Return the building of the map folder; None where it is none, a sentence where it is damaged."""
        try:
            found = None if self._folder is None else building_of_map(self._folder)
            if found is None:
                return None
            return _Known(found[0].folder, RoutePlanner(with_zones(found[0]), now_ns=time.time_ns()), found[1])
        except WaychairError as error:
            return str(error)

    def _take(self, known: _Known | str | None) -> None:
        if isinstance(known, str):
            self._node.get_logger().error(f"{known}; there are no routes through the building")
            return
        self._known = known
        if known is not None:
            planner = known.planner
            self._send_graph(graph_markers(self._node.now_ns(), planner.hgraph, planner.built, known.storey))

    async def _execute(self, handle: Any) -> Any:
        request, pose = handle.request, self._now().pose
        known, answered = self._known, Future()
        self._worker.submit(lambda: self._answer(known, request, pose), answered.set_result)
        answer = await answered
        if answer.found:
            handle.succeed()
        else:
            self._node.get_logger().error(f"a route was refused: {answer.result.error_msg}")
            handle.abort()
        return answer.result

    def _answer(self, known: _Known | None, request: Any, pose: Pose2 | None) -> _Answer:
        """Return the answer to a request; it runs in the worker."""
        result, begun = self._type.Result(), time.perf_counter()
        try:
            if known is None:
                raise _Refused(NO_VALID_GRAPH, "the map belongs to no building: start with a map folder of one")
            self._fill(result, known, request, pose)
        except _Refused as error:
            result.error_code, result.error_msg = error.code, str(error)
        except NoPath as error:
            result.error_code, result.error_msg = NO_VALID_ROUTE, str(error)
        except (BuildingError, PlanningError, MessageError) as error:
            result.error_code, result.error_msg = NO_NODES, str(error)
        except WaychairError as error:
            result.error_code, result.error_msg = UNKNOWN, str(error)
        result.planning_time = Duration(seconds=time.perf_counter() - begun).to_msg()
        return _Answer(result, not result.error_msg)

    def _fill(self, result: Any, known: _Known, request: Any, pose: Pose2 | None) -> None:
        planner, built = known.planner, known.planner.built
        try:
            require_ids(built)
        except BuildingError as error:
            raise _Refused(NO_VALID_GRAPH, str(error)) from error
        if request.use_start:
            start = self._end(known, request.use_poses, request.start_id, request.start)
        elif pose is None:
            raise _Refused(TF_ERROR, "the chair is not localised: wait until it is, or give a start")
        else:
            start = self._nearest(known, pose)
        goal = self._end(known, request.use_poses, request.goal_id, request.goal)
        way = planner.way(built.refs[start], built.refs[goal])
        now_ns, frame = self._node.now_ns(), planner.hgraph.storey_frame(known.storey)
        result.route = native(route(now_ns, built, frame, start, way.arcs, way.cost))
        result.path = native(path(now_ns, route_path(built, frame, start, way.arcs)))

    def _end(self, known: _Known, by_pose: bool, number: int, stamped: Any) -> int:
        """Return the number of the node that a request names, by its id or by a pose in map."""
        if by_pose:
            return self._nearest(known, read_pose_stamped(stamped))
        if number >= len(known.planner.built.refs):
            last = len(known.planner.built.refs) - 1
            raise _Refused(NO_NODES, f"there is no node {number}: ids go from 0 to {last}, see building_graph")
        return number

    def _nearest(self, known: _Known, pose: Pose2) -> int:
        """Return the number of the node that is nearest to a pose in map by driving."""
        assert self._folder is not None  # a building is known
        costmap = costmap_from_grid(load_map(self._folder), self._body, zones=load_zones(self._folder))
        node, _ = nearest_node(known.planner.hgraph, known.storey, pose, costmap)
        return known.planner.built.index[node]

    def _record(self) -> None:
        """Record a drive; once it has arrived, its times are learnt in the worker."""
        now = self._now()
        if now.drives:
            if now.pose is not None:
                self._recorded.add(time.monotonic_ns(), now.pose)
            return
        drive, self._recorded = self._recorded, RecordedDrive()
        if now.arrived and self._known is not None and drive.tells:
            self._worker.submit(lambda: self._learn(drive), self._learnt)

    def _learn(self, drive: RecordedDrive) -> str:
        """Learn a drive's times if the rider has said yes to a record; return the sentence of a failure, "" without one."""
        try:
            wanted = self._folder is not None and Habits(default_path()).wanted
            found = building_of_map(self._folder) if self._folder is not None and wanted else None
            if found is not None:
                drive.teach(*found)
        except WaychairError as error:
            return str(error)
        return ""

    def _learnt(self, failure: str) -> None:
        if failure:
            self._node.get_logger().error(f"{failure}; the drive's times were not learnt")
        else:
            self._load()
