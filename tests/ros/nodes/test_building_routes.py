"""The action compute_route and the topic building_graph of a node whose map is a storey of a building."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from waychair.calibration.chair_body import CHAIR_A
from waychair.config import Settings
from waychair.maps.building.building import Building, save_with_map
from waychair.maps.building.hgraph import ArcRef, NodeRef
from waychair.maps.building.hgraph_edits import closed
from waychair.maps.building.hgraph_files import read_hgraph, write_hgraph
from waychair.maps.building.indexed import indexed
from waychair.maps.folders.map_files import save_map
from waychair.runtime.rider.habits import Habits, default_path
from waychair.types import OccupancyGrid, Pose2

if TYPE_CHECKING:
    from tests.ros.harness import Harness
    from waychair.ros.nodes.navigator_parts.building_routes import DriveNow

SUCCEEDED, ABORTED = 4, 6


@dataclass(frozen=True, slots=True)
class NoSettings(Settings):
    """None."""


class Site:
    """A node in this process with a building's ground floor as its map, and an action client."""

    def __init__(self, ros: Harness, folder: Path, name: str) -> None:
        from rclpy.action import ActionClient

        from waychair.ros import topics
        from waychair.ros.interface_types import interface_type
        from waychair.ros.nodes.navigator_parts.building_routes import BuildingRoutes, DriveNow
        from waychair.ros.nodes.node import ChairNode

        self.now: DriveNow = DriveNow(drives=False, arrived=False, pose=Pose2(3.5, 0.5))
        self.drive: Iterator[DriveNow] = iter(())
        """The next answers to the question how the drive goes, one each."""
        self.ros, self.folder = ros, folder
        self.node: Any = ChairNode(name, NoSettings)
        self.began_s = time.monotonic()
        self.markers = ros.heard(topics.BUILDING_GRAPH)
        BuildingRoutes(self.node, folder / "maps" / "g", CHAIR_A, lambda: next(self.drive, self.now))
        self.kind = interface_type("nav2_msgs/action/ComputeRoute")
        self.client = ActionClient(ros.node, self.kind, topics.COMPUTE_ROUTE)

    def watched(self) -> bool:
        """Return whether two seconds have passed since the graph was heard, in which the files are looked at."""
        return time.monotonic() - self.began_s > 2.5

    def ask(self, **request: Any) -> tuple[int, Any]:
        """Return the status and the result of a request."""
        asked = self.client.send_goal_async(self.kind.Goal(**request))
        self.ros.spin_until(asked.done, "the request's acceptance")
        done = asked.result().get_result_async()
        self.ros.spin_until(done.done, "the route")
        return done.result().status, done.result().result


@pytest.fixture
def site(ros: Harness, tmp_path: Path) -> Iterator[Site]:
    save_map(tmp_path / "map", OccupancyGrid(np.zeros((120, 200), np.int8), 0.1, Pose2(0.0, -6.0)))
    hgraph = closed(two_storeys(), ArcRef("1", "c2", "c3"), "wet floor")
    save_with_map(Building(tmp_path / "clinic", hgraph), "g", tmp_path / "map")
    found = Site(ros, tmp_path / "clinic", "routes")
    with ros.serving(found.node):
        ros.spin_until(lambda: found.markers and found.client.server_is_ready(), "the graph and the server")
        yield found
        found.client.destroy()


def test_routes_are_computed_by_ids_by_poses_and_from_where_the_chair_is(site: Site) -> None:
    from waychair.ros.messages.motion import pose_stamped
    from waychair.ros.messages.wire import native

    index = indexed(two_storeys()).index
    names = {marker.text for marker in site.markers[-1].markers if marker.ns == "names"}
    assert names == {"Bed g"}
    bed, upstairs = index[NodeRef("g/ward", "e")], index[NodeRef("1/ward", "e")]
    status, result = site.ask(use_start=True, start_id=bed, goal_id=upstairs)
    assert (status, result.error_code, result.error_msg) == (SUCCEEDED, 0, "")
    assert result.route.nodes[-1].nodeid == upstairs
    assert result.path.poses[-1].pose.position.x == pytest.approx(3.0)

    goal = native(pose_stamped(0, Pose2(15.0, 3.0), "map"))
    status, result = site.ask(use_poses=True, goal=goal)
    assert status == SUCCEEDED
    assert result.route.nodes[0].nodeid == index[NodeRef("g", "v")]  # the chair stands beside the lift
    assert result.route.nodes[-1].nodeid == index[NodeRef("g/store", "e")]

    status, result = site.ask(use_start=True, start_id=500, goal_id=0)
    assert (status, result.error_code) == (ABORTED, 403)
    assert "there is no node 500: ids go from 0 to 17" in result.error_msg
    status, result = site.ask(use_start=True, start_id=bed, goal_id=index[NodeRef("1/store", "e")])
    assert (status, result.error_code) == (ABORTED, 405)
    assert "1:c2>c3 is closed (wet floor)" in result.error_msg


def test_a_drive_that_arrives_is_learnt_after_the_riders_yes_only(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from waychair.ros.nodes.navigator_parts.building_routes import DriveNow

    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    poses = [Pose2(x, 0.0) for x in np.linspace(3.0, 10.0, 30).tolist()]
    arrived = DriveNow(drives=False, arrived=True, pose=None)
    drive = [*(DriveNow(drives=True, arrived=False, pose=pose) for pose in poses), arrived]
    site.drive, ended_s = iter(drive), time.monotonic() + 4.0
    site.ros.spin_until(lambda: time.monotonic() > ended_s, "the end of the first drive")
    assert next(site.drive, None) is None
    assert not (site.folder / "drives.json").exists()
    Habits(default_path()).say_yes()
    site.drive = iter(drive)
    site.ros.spin_until(lambda: (site.folder / "drives.json").is_file(), "the drive's times")


def test_an_arc_that_is_closed_in_the_text_files_is_closed_for_routes(site: Site) -> None:
    index = indexed(two_storeys()).index
    ends = {"start_id": index[NodeRef("g", "v")], "goal_id": index[NodeRef("g", "c3")]}
    assert site.ask(use_start=True, **ends)[0] == SUCCEEDED
    site.ros.spin_until(lambda: site.watched(), "the first look at the files")
    write_hgraph(site.folder, closed(read_hgraph(site.folder), ArcRef("g", "c1", "c2"), "wet floor"))
    before = len(site.markers)
    site.ros.spin_until(lambda: len(site.markers) > before, "the changed graph")
    status, result = site.ask(use_start=True, **ends)
    assert (status, result.error_code) == (ABORTED, 405)
    assert "wet floor" in result.error_msg
