"""The topic `floor`: the mapper tells it, the navigator and the bridge follow it, and no drive begins while they differ."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from tests.maps.building.test_lift_cabins import with_cabins
from waychair.maps.building.building import Building, save_with_map
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.ros import topics
from waychair.ros.messages.chair import read_drive_request, read_drive_state, read_places
from waychair.ros.messages.floor import Floor, floor, read_floor
from waychair.ros.messages.motion import pose as pose_message
from waychair.ros.messages.wire import native
from waychair.runtime.last_pose import remember_pose, remembered_pose
from waychair.types import OccupancyGrid, Place, Pose2

if TYPE_CHECKING:
    from tests.ros.harness import Harness


def storey(folder: Path, place: str, rows: int = 80) -> Path:
    """A room with one place."""
    cells = np.zeros((rows, 120), np.int8)
    cells[:2] = cells[-2:] = 100
    cells[:, :2] = cells[:, -2:] = 100
    save_map(folder, OccupancyGrid(cells, 0.05))
    save_places(folder, {place: Place(place, Pose2(2.0, 1.5))})
    return folder


def call(ros: Harness, kind: str, name: str, **request: Any) -> Any:
    """Return the answer of a service."""
    from waychair.ros.interface_types import interface_type

    service = interface_type(kind)
    client = ros.node.create_client(service, name)
    ros.spin_until(client.service_is_ready, f"the service {name}")
    answer = client.call_async(service.Request(**request))
    ros.spin_until(answer.done, f"the answer of {name}")
    ros.node.destroy_client(client)
    return answer.result()


def test_another_map_brings_its_places_to_the_navigator_and_both_tell_its_revision(
    ros: Harness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from waychair.ros.nodes.mapper_node import MapperNode

    ward, attic = storey(tmp_path / "ward", "bed"), storey(tmp_path / "attic", "trunk", 70)
    kept = tmp_path / "pose.json"
    floors, named, requests = ros.heard(topics.FLOOR), ros.heard(topics.PLACES), ros.heard(topics.DRIVE_REQUEST)
    mapper = MapperNode(["--ros-args", "-p", f"map_folder:={ward}", "-p", f"pose_file:={kept}"])
    with (
        ros.serving(mapper),
        ros.process("-m", "waychair.ros.nodes.navigator_node", "--ros-args", "-p", f"map_folder:={ward}") as navigator,
    ):
        ros.spin_until(lambda: named and floors, "places and floor")
        assert set(read_places(named[-1])) == {"bed"}
        first = read_floor(floors[-1])
        assert (first.map_folder, first.certain, first.storey) == (str(ward), True, "")
        ros.spin_until(
            lambda: requests and read_drive_request(requests[-1]).floor_revision == first.revision, "the revision"
        )

        answer = call(ros, "nav2_msgs/srv/LoadMap", "map_server/load_map", map_url=str(attic))
        assert answer.result == answer.RESULT_SUCCESS
        ros.spin_until(lambda: set(read_places(named[-1])) == {"trunk"}, "the places of the other map")
        second = read_floor(floors[-1])
        assert second.revision > first.revision
        ros.spin_until(lambda: read_drive_request(requests[-1]).floor_revision == second.revision, "the other revision")

        placed = {"placed": True, "map_from_base": native(pose_message(Pose2(1.0, 0.5, 0.0)))}
        answer = call(ros, "waychair_msgs/srv/SetFloor", "set_floor", map_url=str(attic), certain=True, **placed)
        assert answer.success
        assert remembered_pose(kept, attic) == Pose2(1.0, 0.5, 0.0)  # at once, before any scan
        restarts: list[Pose2] = []
        monkeypatch.setattr(mapper._localiser, "restart", restarts.append)
        mapper._restart_localiser()  # as after a bridge was killed now
        assert restarts == [Pose2(1.0, 0.5, 0.0)]

        answer = call(ros, "waychair_msgs/srv/SetFloor", "set_floor", map_url="", certain=False)
        assert answer.success
        ros.spin_until(lambda: not read_floor(floors[-1]).certain, "the doubt")
        assert json.loads(kept.with_suffix(".floor.json").read_text()) == {"map": str(attic), "certain": False}
        answer = call(ros, "waychair_msgs/srv/SetFloor", "set_floor", map_url=str(tmp_path / "none"), certain=True)
        assert not answer.success
        assert "none" in answer.message
        assert not read_floor(floors[-1]).certain
        navigator.send_signal(signal.SIGINT)
    for heard in (floors, named, requests):
        heard.close()


def test_a_mapper_that_was_killed_in_a_lift_stays_uncertain_and_keeps_its_storey(ros: Harness, tmp_path: Path) -> None:
    from waychair.ros.nodes.mapper_node import MapperNode

    ward, kept = storey(tmp_path / "ward", "bed"), tmp_path / "pose.json"
    kept.with_suffix(".floor.json").write_text(json.dumps({"map": str(ward), "certain": False}))
    floors = ros.heard(topics.FLOOR)
    with ros.serving(MapperNode(["--ros-args", "-p", f"map_folder:={ward}", "-p", f"pose_file:={kept}"])):
        ros.spin_until(lambda: floors, "the floor")
        assert not read_floor(floors[-1]).certain
    floors.close()


@pytest.mark.parametrize(
    ("pose", "certain"), [((4.0, -2.4, 1.5), False), ((4.0, -1.2, 1.5), False), ((9.0, 3.0, 0.0), True), (None, False)]
)
def test_a_mapper_that_was_killed_in_a_cabin_is_uncertain_whatever_the_journey_was_doing(
    ros: Harness, tmp_path: Path, pose: tuple[float, float, float] | None, certain: bool
) -> None:
    from waychair.ros.nodes.mapper_node import MapperNode

    save_map(tmp_path / "map", OccupancyGrid(np.zeros((120, 200), np.int8), 0.1, Pose2(0.0, -6.0)))
    building = Building(tmp_path / "clinic", with_cabins(two_storeys()))
    for each in ("g", "1"):
        building = save_with_map(building, each, tmp_path / "map")
    ground, kept = tmp_path / "clinic" / "maps" / "g", tmp_path / "pose.json"
    kept.with_suffix(".floor.json").write_text(json.dumps({"map": str(ground), "certain": True}))
    if pose is not None:
        remember_pose(kept, ground, Pose2(*pose))
    floors = ros.heard(topics.FLOOR)
    with ros.serving(MapperNode(["--ros-args", "-p", f"map_folder:={ground}", "-p", f"pose_file:={kept}"])):
        ros.spin_until(lambda: floors, "the floor")
        assert read_floor(floors[-1]).certain is certain
    floors.close()


def test_a_floor_of_another_building_is_not_kept_over_the_given_map(ros: Harness, tmp_path: Path) -> None:
    from waychair.ros.nodes.mapper_node import MapperNode

    ward, attic, kept = storey(tmp_path / "w", "bed"), storey(tmp_path / "a", "trunk"), tmp_path / "pose.json"
    kept.with_suffix(".floor.json").write_text(json.dumps({"map": str(attic), "certain": False}))
    floors = ros.heard(topics.FLOOR)
    with ros.serving(MapperNode(["--ros-args", "-p", f"map_folder:={ward}", "-p", f"pose_file:={kept}"])):
        ros.spin_until(lambda: floors, "the floor")
        told = read_floor(floors[-1])
        assert (told.map_folder, told.certain) == (str(ward), True)
    floors.close()


@pytest.mark.parametrize(
    ("certain", "revision", "halted"),
    [(False, 0, "floor_differs"), (True, 7, "floor_differs"), (False, 7, "floor_uncertain")],
)
def test_the_bridge_refuses_drives_while_maps_differ_or_the_storey_is_uncertain(
    certain: bool, revision: int, halted: str
) -> None:
    from waychair.ros.nodes.parts.bridge_state import Localised

    told = Floor(0, "/maps/1", 7, certain=certain)
    known = Localised(revision=revision, floor=told)
    navigators = revision if halted == "floor_uncertain" else 8
    assert [each.stop.id for each in known.floor_halts(navigators)] == [halted]
    assert Localised(revision=7, floor=Floor(0, "/maps/1", 7)).floor_halts(7) == []
    assert Localised(revision=7, floor=Floor(0, "/maps/1", 7)).floor_halts(None) == []
    assert Localised().floor_halts(0) == []  # a map that is being made


def test_the_running_bridge_names_an_uncertain_storey(ros: Harness, tmp_path: Path) -> None:
    states = ros.heard(topics.DRIVE_STATE)
    cable = tmp_path / "none"
    with ros.process("-m", "waychair.ros.nodes.bridge_node", "--ros-args", "-p", f"cable:=pty:{cable}"):
        ros.spin_until(lambda: states, "the bridge")
        assert "floor_differs" not in read_drive_state(states[-1]).halts
        send = ros.publisher(topics.FLOOR)
        send(floor(Floor(int(ros.node.get_clock().now().nanoseconds), str(tmp_path), 7)))
        ros.spin_until(lambda: "floor_differs" in dict(read_drive_state(states[-1]).halts), "the halt")
    states.close()
