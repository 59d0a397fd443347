"""The map made by the nodes during a drive equals the one made by `waychair map` from the drive's bag."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.ros.realtime import ALONE
from tests.ros.transforms import read_transforms
from waychair.geometry import in_space
from waychair.maps.drawn.places import add_place, load_places
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.maps.folders.map_files import load_map, save_map
from waychair.offline.mapping import MappingSettings, map_recording
from waychair.recordings.recording import read_recording, read_tum
from waychair.ros import topics
from waychair.ros.messages import sensors
from waychair.ros.messages.chair import read_localisation
from waychair.ros.nodes.parts.map_builder import MAX_QUEUED, MapBuilder
from waychair.slam.localising.localiser import Localisation, LocalisationState
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.types import FloatArray, ImuSample, JoystickInput, OccupancyGrid, Odometry, Pose2, Scan, Twist

if TYPE_CHECKING:
    from tests.ros.harness import Harness

WAY_M = 2.5
BAR_M = 0.02


def occupied(grid: OccupancyGrid) -> FloatArray:
    """(N, 2) [m] middles of occupied cells."""
    rows, columns = np.nonzero(grid.cells >= 65)
    corner = [grid.map_from_grid.x, grid.map_from_grid.y]
    return np.stack([columns + 0.5, rows + 0.5], axis=1) * grid.resolution + corner


@ALONE
@pytest.mark.nightly
def test_the_map_of_the_recorded_bag_is_the_live_one(ros: Harness, tmp_path: Path) -> None:
    """The rider's stick drives, in real time; both get all messages from the first one on."""
    from tests.ros.harness import ended
    from waychair.ros.interface_types import interface_type
    from waychair.ros.messages.wire import serialised

    truth = ros.heard(topics.TRUTH)
    found = ros.heard(topics.LOCALISATION)
    maps = ros.heard(topics.MAP)
    moved = ros.heard(topics.TF)
    stick = ros.node.create_publisher(interface_type(topics.JOY.type), topics.JOY.name, topics.profile(topics.JOY.qos))
    kind = interface_type("nav2_msgs/srv/SaveMap")
    saver = ros.node.create_client(kind, "map_saver/save_map")

    def push(forward: float, turn: float) -> Callable[[], None]:
        now = ros.node.get_clock().now
        return lambda: stick.publish(serialised(sensors.joy(JoystickInput(now().nanoseconds, forward, turn))))

    def way() -> float:
        first, last = (message.pose.pose.position for message in (truth[0], truth[-1]))
        return math.hypot(last.x - first.x, last.y - first.y)

    bag, live, kept = tmp_path / "drive.mcap", tmp_path / "live", tmp_path / "kept"
    mapping = ("-p", f"save_folder:={kept}")
    simulated = ("-p", "world:=small_clinic", "-p", "people:=false", "-p", "camera:=false")
    with (
        ros.process("-m", "waychair.ros.nodes.recorder_node", "--ros-args", "-p", f"bag:={bag}") as recorder,
        ros.process("-m", "waychair.ros.nodes.mapper_node", "--ros-args", *mapping) as mapper,
    ):
        ros.spin_until(lambda: ros.node.count_subscribers("imu/data") == 2, "recorder and mapper")
        with ros.process("-m", "waychair.ros.nodes.simulator_node", "--ros-args", *simulated):
            ros.spin_until(lambda: len(found) > 5, "the first places")
            ros.spin_until(lambda: way() > WAY_M, "the drive", push(0.5, 0.05))
            ros.spin_until(lambda: abs(truth[-1].twist.twist.linear.x) < 0.01, "the chair to rest")
            ros.spin_until(saver.service_is_ready, "the service")
            answer = saver.call_async(kind.Request(map_url=str(live)))
            before = len(found)
            ros.spin_until(answer.done, "the map to be saved")
            assert answer.result().result
            assert len(found) > before, "the mapper continues while it saves"
        assert ended(mapper)[0] == 0
        assert ended(recorder)[0] == 0
    ros.node.destroy_publisher(stick)
    ros.node.destroy_client(saver)

    offline = map_recording(read_recording(bag), MappingSettings())
    driven = read_tum(live / "trajectory.tum")
    common, first, second = np.intersect1d(
        driven.stamps_ns, offline.result.drive_trajectory.stamps_ns, return_indices=True
    )
    assert len(common) >= 0.9 * len(driven.stamps_ns)
    apart = driven.poses[first] - offline.result.drive_trajectory.poses[second]
    assert np.hypot(apart[:, 0], apart[:, 1]).max() < BAR_M
    one, other = occupied(load_map(live)), occupied(offline.grid)
    nearest = np.array([np.hypot(*(other - point).T).min() for point in one])
    assert np.quantile(nearest, 0.95) < 0.051, "no wall is more than a cell elsewhere"

    last = read_localisation(found[-1])[1]
    assert last.state is LocalisationState.OK
    assert last.health == last.inliers > 0.5
    transforms = [pose for each in moved for edge, (_, pose) in read_transforms(each).items() if edge[0] == "map"]
    np.testing.assert_allclose(transforms[-1].translation, in_space(last.map_from_odom).translation, atol=1e-6)
    assert 0 < len(maps) < 30
    assert len(load_map(kept).cells) >= len(load_map(live).cells), "the map is kept at the end, too"


def test_an_unchanged_map_is_sent_once(room: Room) -> None:
    for k in range(10):
        room.drive(k, Pose2())
    drawn: list[OccupancyGrid] = []
    for _ in range(3):
        room.builder.send_grid(drawn.append)
    assert len(drawn) == 1


def stamp(k: int) -> int:
    """[ns] of the scan in step k."""
    return (k + 11) * 100_000_000


class Inline:
    """Runs each job at once, or keeps jobs until they are requested."""

    def __init__(self) -> None:
        self.held: list[tuple[Callable[[], Any], Callable[[Any], None]]] | None = None

    def submit(self, job: Callable[[], Any], done: Callable[[Any], None]) -> None:
        if self.held is None:
            done(job())
        else:
            self.held.append((job, done))


class Room:
    """A chair in a room of 6 x 4 m, with a `MapBuilder` for its messages."""

    def __init__(self) -> None:
        self.worker, self.found = Inline(), list[tuple[int, Localisation]]()
        live = LiveMapping(LiveMappingSettings(), Pose2())
        self.builder = MapBuilder(self.worker, lambda: live, lambda *found: self.found.append(found))  # type: ignore[arg-type]
        for k in range(-5, 0):  # while all topics are found
            self.drive(k, Pose2())
        assert self.found == []

    def see(self, stamp_ns: int, pose: Pose2) -> Scan:
        angles = -math.pi + np.arange(360) * (2 * math.pi / 360) + pose.theta
        c, s = np.cos(angles), np.sin(angles)
        with np.errstate(divide="ignore"):
            x = np.where(c > 0, (4.0 - pose.x) / c, (-2.0 - pose.x) / c)
            y = np.where(s > 0, (2.5 - pose.y) / s, (-1.5 - pose.y) / s)
        return Scan(
            stamp_ns, np.minimum(np.abs(x), np.abs(y)).astype(np.float32), -math.pi, 2 * math.pi / 360, 0.0, 0.05, 30.0
        )

    def drive(self, k: int, pose: Pose2, odom: Pose2 | None = None, anew: bool = False) -> None:
        """A tenth of a second: IMU, odometry, a scan, and odometry to it."""
        now = stamp(k)
        own = pose if odom is None else odom
        self.builder.add_imu(ImuSample(now - 2_000_000, np.array([0.0, 0.0, 9.81]), np.zeros(3)))
        self.builder.add_odometry(Odometry(now - 1_000_000, own, Twist(0.4, 0.0)), anew)
        self.builder.add_scan(self.see(now, pose))
        self.builder.add_imu(ImuSample(now + 1_000_000, np.array([0.0, 0.0, 9.81]), np.zeros(3)))
        self.builder.add_odometry(Odometry(now + 1_000_000, own, Twist(0.4, 0.0)))


@pytest.fixture
def room() -> Room:
    return Room()


def test_the_first_frames_and_scans_without_odometry_are_left_out() -> None:
    found: list[tuple[int, Localisation]] = []
    live = LiveMapping(LiveMappingSettings(), Pose2())
    room = Room()
    room.builder = MapBuilder(room.worker, lambda: live, lambda *each: found.append(each))  # type: ignore[arg-type]
    for k in range(5):
        room.builder.add_scan(room.see(stamp(k) - 1_000_000_000, Pose2()))
    for k in range(5, 15):
        room.drive(k, Pose2())
    assert [stamp_ns for stamp_ns, _ in found] == [stamp(k) for k in range(10, 15)]


def test_a_restarted_base_does_not_tear_the_map(room: Room) -> None:
    for k in range(30):
        room.drive(k, Pose2(0.04 * k, 0.0, 0.0))
    for k in range(30, 60):
        room.drive(k, Pose2(0.04 * k, 0.0, 0.0), Pose2(0.04 * (k - 30)), anew=k == 30)
    stamp_ns, last = room.found[-1]
    assert stamp_ns == stamp(59)
    assert last.state is LocalisationState.OK
    assert math.hypot(last.map_from_base.x - 0.04 * 59, last.map_from_base.y) < 0.05
    np.testing.assert_allclose((last.map_from_odom @ Pose2(0.04 * 29)).array(), last.map_from_base.array(), atol=1e-3)


def test_a_pose_near_the_start_of_the_drive_is_not_taken_for_a_new_drive(room: Room) -> None:
    for k in range(20):
        room.drive(k, Pose2(0.02 * k, 0.0, 0.0))
    room.drive(20, Pose2(0.4, 0.0, 0.0), Pose2(0.4, 0.0, 0.0), anew=True)
    assert room.found[-1][1].map_from_odom.x == pytest.approx(0.0, abs=0.03)


def test_a_chair_in_another_room_is_lost_until_the_parts_join(room: Room) -> None:
    """It was kidnapped: its new scans do not match the old ones."""
    for k in range(20):
        room.drive(k, Pose2(0.04 * k, 0.0, 0.0))
    elsewhere = room.see(0, Pose2())
    for k in range(20, 40):
        now = stamp(k)
        odom = Pose2(0.04 * k, 0.0, 0.0)
        ragged = 1.0 + 0.8 * np.abs(np.sin(np.arange(360) * 0.11 + 0.04 * k)).astype(np.float32)
        room.builder.add_odometry(Odometry(now - 1_000_000, odom, Twist(0.4, 0.0)))
        room.builder.add_scan(replace(elsewhere, stamp_ns=now, ranges=ragged))
        room.builder.add_imu(ImuSample(now + 1_000_000, np.array([0.0, 0.0, 9.81]), np.zeros(3)))
        room.builder.add_odometry(Odometry(now + 1_000_000, odom, Twist(0.4, 0.0)))
    states = {found.state for _, found in room.found[20:]}
    assert states & {LocalisationState.DEGRADED, LocalisationState.LOST}


def test_a_slow_computer_drops_scans_but_no_odometry_and_says_so(room: Room) -> None:
    room.drive(0, Pose2())
    room.worker.held = []
    for k in range(1, MAX_QUEUED + 21):
        room.drive(k, Pose2(0.02 * k, 0.0, 0.0))
    assert "wait to be mapped" in room.builder.report().message
    while room.worker.held:
        job, done = room.worker.held.pop(0)
        done(job())
    assert room.builder.dropped_scans == 19  # one is being processed
    assert room.found[-1][1].map_from_base.x == pytest.approx(0.02 * (MAX_QUEUED + 20), abs=0.05)
    assert room.builder.report().message == ""


def test_a_map_is_saved_completely_and_an_impossible_folder_is_named(room: Room, tmp_path: Path) -> None:
    for k in range(10):
        room.drive(k, Pose2(0.04 * k, 0.0, 0.0))
    told: list[str] = []
    room.builder.save(tmp_path / "map", told.append)
    assert told == [""]
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    assert report["frames"] == 10
    assert (tmp_path / "map" / "session.npz").is_file()
    (tmp_path / "file").touch()
    room.builder.save(tmp_path / "file" / "map", told.append)
    assert "file" in told[1]


def test_a_map_saved_again_keeps_its_drawings(room: Room, tmp_path: Path) -> None:
    told: list[str] = []
    for k in range(20):
        room.drive(k, Pose2(0.04 * k, 0.0, 0.0))
        if k % 10 == 9:
            room.builder.save(tmp_path, told.append)
            add_place(tmp_path, f"place {k}", Pose2(0.1, 0.0, 0.0))
    assert told == ["", ""]
    assert set(load_places(tmp_path)) == {"place 9", "place 19"}
    assert room.builder.finish(tmp_path) == ""
    assert set(load_places(tmp_path)) == {"place 9", "place 19"}


def test_drawings_of_another_map_are_neither_on_the_new_one_nor_lost(room: Room, tmp_path: Path) -> None:
    folder, told = tmp_path / "made_map", list[str]()
    save_map(folder, OccupancyGrid(np.full((40, 40), 100, np.int8), 0.05, Pose2()))
    layout = DrawingEditor(folder)
    layout.erase(np.array([[0.5, 0.5], [1.0, 0.5], [1.0, 1.0]]))
    for k in range(10):
        room.drive(k, Pose2(0.04 * k, 0.0, 0.0))
    room.builder.save(folder, told.append)
    assert "those of another map: choose another folder" in told[0]
    assert room.builder.finish(folder) == ""
    assert not (folder / "erased.yaml").exists()
    assert len(load_map(folder).cells) > 40
    assert load_map(tmp_path / "made_map-1").cells.shape == (40, 40)
    assert DrawingEditor(tmp_path / "made_map-1").undoable


def test_before_the_first_scan_there_is_no_map_to_save(room: Room, tmp_path: Path) -> None:
    told: list[str] = []
    room.builder.save(tmp_path / "map", told.append)
    assert told[0].startswith("there is no map yet")
    assert room.builder.finish(tmp_path / "map") == ""
    assert not (tmp_path / "map").exists()


@ALONE
def test_a_localising_mapper_saves_its_map_with_places_and_zones(ros: Harness, tmp_path: Path) -> None:
    from tests.ros.harness import ended
    from waychair.maps.drawn.places import save_places
    from waychair.simulation.plan.world import load_world

    world = load_world("small_clinic")
    save_map(tmp_path / "map", world.grid)
    save_places(tmp_path / "map", {place.name: place for place in world.places})
    save = ("-c", "from waychair.cli.main import main; main()", "save")
    (tmp_path / "file").touch()
    with ros.process(
        "-m", "waychair.ros.nodes.mapper_node", "--ros-args", "-p", f"map_folder:={tmp_path / 'map'}"
    ) as mapper:
        with ros.process(*save, tmp_path / "copy") as saver:
            output, _ = saver.communicate(timeout=60.0)
        assert saver.returncode == 0, output
        with ros.process(*save, tmp_path / "file" / "copy") as saver:
            output, _ = saver.communicate(timeout=60.0)
        assert saver.returncode == 1
        assert output.splitlines()[-1].startswith(f"waychair: the map was not saved in {tmp_path / 'file' / 'copy'}")
        assert ended(mapper, signal.SIGTERM)[0] == 0
    assert load_places(tmp_path / "copy") == load_places(tmp_path / "map")
    np.testing.assert_array_equal(load_map(tmp_path / "copy").cells, load_map(tmp_path / "map").cells)


@ALONE
def test_a_mapper_on_another_clock_uses_no_scan_and_says_why(ros: Harness, tmp_path: Path) -> None:
    from waychair.recordings.bags.ros_messages import header, make
    from waychair.ros.interface_types import interface_type
    from waychair.ros.messages.wire import serialised
    from waychair.simulation.plan.world import load_world

    save_map(tmp_path / "map", load_world("small_clinic").grid)
    found, topic = ros.heard(topics.LOCALISATION), topics.CLOCK
    clock = ros.node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))

    def tick(late_ns: int) -> Callable[[], None]:
        now = ros.node.get_clock().now
        return lambda: clock.publish(serialised(make(topic.type, header(now().nanoseconds - late_ns, "").stamp)))

    simulated = ("-p", "world:=small_clinic", "-p", "people:=false", "-p", "camera:=false")
    localising = ("-p", f"map_folder:={tmp_path / 'map'}", "-p", "use_sim_time:=true")
    with (
        ros.process("-m", "waychair.ros.nodes.simulator_node", "--ros-args", *simulated),
        ros.process("-m", "waychair.ros.nodes.mapper_node", "--ros-args", *localising),
    ):
        ros.report(
            "mapper: input scan", lambda report: "set use_sim_time alike" in report.message, tick(60_000_000_000)
        )
        assert found == []
        ros.spin_until(lambda: found, "a place by the right time", tick(0))
    ros.node.destroy_publisher(clock)
