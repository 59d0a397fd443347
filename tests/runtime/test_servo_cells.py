"""A chair with a camera on servos: the cells aim it, perceive by its laser's line, and name its faults in one sentence."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from evaluation.scenes.tight_places import door_scene

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.servo_camera_mount import SERVO_CAMERA
from waychair.control.behaviours.commands import FreeKind, between
from waychair.control.behaviours.view.servo_cells import SWEEP
from waychair.control.drive.doors.doorway_tracker import DoorwayTracker
from waychair.geometry import in_space
from waychair.planning.seen.door_frames import DoorFrame
from waychair.planning.seen.doorways import DoorState, Doorway
from waychair.runtime.pages.perception_view import perception_view
from waychair.runtime.perception import CellInputs, Perceived, Perception
from waychair.runtime.senses.frame_sight import FrameSight
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.sensors.camera import CameraSettings, RgbdCamera
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.pan_tilt import ServoCameraFaults
from waychair.simulation.sensors.rays import scenery_from_slice
from waychair.simulation.sensors.renderer import Renderer, camera_matrix, renderer_problem
from waychair.simulation.sensors.servo_camera import ServoCamera
from waychair.types import OccupancyGrid, Odometry, PanTiltAngles, Picture, Pose2, ServoMessage, SonarReadings, Twist

if renderer_problem():
    pytest.skip(str(renderer_problem()), allow_module_level=True)

HERE = Pose2(3.75, 4.2, math.pi / 2)
"""In a room of `small_clinic`, between its walls, a desk and a shelf."""

TICK_NS = 50_000_000
EMPTY_MAP = OccupancyGrid(np.zeros((160, 160), np.int8), 0.05, Pose2(-4.0, -4.0))

Spoil = Callable[[ServoMessage], ServoMessage | None]


@pytest.fixture(scope="module")
def clinic() -> World:
    return load_world("small_clinic")


class Rider:
    """The cells of chair A at rest, ticked at 20 Hz, with a camera on servos at 10 Hz that obeys them."""

    def __init__(self, world: World, faults: ServoCameraFaults | None = None, lidar: bool = False) -> None:
        self.cells, self.now_ns = Perception(CHAIR_A, timer=None), 0
        self.camera = ServoCamera(np.random.default_rng(2), world)
        self.camera.faults = faults or ServoCameraFaults()
        self.spoil: Spoil = lambda message: message
        self.scan = None
        if lidar:
            outline = scenery_from_slice(slice_at(world.blocks, 0.65))
            self.scan = Lidar(LidarSettings(), CHAIR_A, np.random.default_rng(1)).scan_at_rest(outline, HERE, 0)
        self.aims: list[float] = []

    def ticks(self, seconds: float) -> Perceived:
        for _ in range(round(seconds * 20)):
            self.now_ns += TICK_NS
            self.camera.step(TICK_NS)
            if self.scan is not None:
                self.cells.see(replace(self.scan, stamp_ns=self.now_ns), Pose2())
            if self.now_ns % (2 * TICK_NS) == 0:
                for message in self.camera.sense(self.now_ns, in_space(HERE), Twist()):
                    told = self.spoil(message)
                    if told is not None:
                        self.cells.watch(told, Pose2())
            if self.scan is None:  # sonars that do not answer: they free nothing
                self.cells.hear(SonarReadings(self.now_ns, np.full(8, math.nan, np.float32)), Pose2())
            moved = Odometry(self.now_ns, Pose2(), Twist())
            done = self.cells.step(self.now_ns, CellInputs(moved, Pose2(), None, EMPTY_MAP, np.empty((0, 2)), None))
            if done.order is not None:
                self.camera.order(done.order)
                self.aims.append(done.order.pan)
        return done


def test_a_chair_whose_sonars_are_silent_sees_walls_by_the_line_in_every_way_of_the_sweep_and_frees_no_ground(
    clinic: World,
) -> None:
    rider = Rider(clinic)
    done = rider.ticks(3.5)
    assert [each for each in done.troubles if "camera" in each or "laser" in each] == []
    for way in SWEEP:
        assert any(between(pan, way) < 1e-6 for pan in rider.aims)
    view = done.done.ports["View"].eo
    points = view.metres()
    bearings = np.degrees(np.arctan2(points[:, 1], points[:, 0] - 0.4))
    assert np.ptp(bearings) > 100.0
    assert len(points) > 50
    assert done.done.ports["Way finder"].eo.command.kind is not FreeKind.LIST


def test_a_chair_without_such_a_camera_gives_it_no_orders() -> None:
    cells = Perception(CHAIR_A, timer=None)
    moved = Odometry(TICK_NS, Pose2(), Twist())
    done = cells.step(TICK_NS, CellInputs(moved, Pose2(), None, EMPTY_MAP, np.empty((0, 2)), None))
    assert done.order is None
    assert done.done.ports["grant"].eo is None


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("faults", "sentence"),
    [
        (ServoCameraFaults(dark=True), "see whether its lens is covered"),
        (ServoCameraFaults(laser_off=True), "the laser is off or covered"),
        (ServoCameraFaults(pan_error=math.radians(40.0)), "degrees to the right of the angle"),
        (
            ServoCameraFaults(pan_stuck=True, echoes=True),
            "degrees to the right of the angle that its pan servo reports",
        ),
        (ServoCameraFaults(pan_stuck=True), "does not reach 35 degrees: see its servos"),
    ],
)
def test_a_fault_of_the_camera_is_named_in_one_sentence(
    clinic: World, faults: ServoCameraFaults, sentence: str
) -> None:
    rider = Rider(clinic, faults, lidar=True)
    for _ in range(9):
        named = rider.ticks(0.4).troubles
        if named:
            break
    assert len(named) == 1
    assert sentence in named[0]


def test_silent_servos_missing_pictures_and_a_camera_that_falls_silent_are_named(clinic: World) -> None:
    rider = Rider(clinic)
    rider.spoil = lambda message: message if isinstance(message, Picture) else None
    assert "the servos of the camera do not report their angles: see their cable" in rider.ticks(0.5).troubles
    rider = Rider(clinic)
    rider.spoil = lambda message: message if isinstance(message, PanTiltAngles) else None
    assert "the camera on the servos sends no pictures: see its cable" in rider.ticks(1.5).troubles
    rider = Rider(clinic)
    rider.ticks(0.5)
    rider.spoil = lambda message: None
    assert any("the camera on servos is silent" in each for each in rider.ticks(1.5).troubles)


def test_the_door_takes_the_camera_from_the_way_finder_which_is_said_to_wait(clinic: World) -> None:
    found = Doorway(4, Pose2(2.0, 1.0, 0.0), 0.9, 0.0, 0.2, DoorState.UNKNOWN, validated=False)
    rider = Rider(clinic)
    rider.cells.door_wanted = True
    with patch.object(DoorwayTracker, "doorways", (found,)):
        done = rider.ticks(1.5)
    order = done.done.ports["grant"].eo
    assert (order.client, order.waiting) == ("Range finder", ("Way finder",))
    assert rider.camera.servos.angles[0] == pytest.approx(math.atan2(1.0, 2.0), abs=0.02)
    aim = perception_view(done, CHAIR_A, PanTiltAngles(0, 0.46, 0.0, True)).aim
    assert aim is not None
    assert aim.words == "The camera looks 26 degrees left, level. The Range finder has it, the Way finder waits."


def test_a_chair_without_a_lidar_finds_a_doorway_by_its_depth_camera_and_tells_the_cells() -> None:
    scene = door_scene(0.95, 0.0, CHAIR_A, 3)
    assert scene.door is not None
    settings = CameraSettings(width=320, height=240)
    matrix = camera_matrix(settings.width, settings.height, settings.field_of_view)
    renderer = Renderer(scene.world, matrix, settings.width, settings.height)
    camera = RgbdCamera(settings, CHAIR_A.base_from_camera, np.random.default_rng(1), renderer)
    cells, now_ns = Perception(CHAIR_A, timer=None), 0
    cells.door_wanted = True
    for away in np.arange(3.2, 1.4, -0.12):
        for tick in range(3):
            now_ns += TICK_NS
            at = scene.door @ Pose2(-float(away))  # odom is map
            if tick == 0:
                cells.look(camera.frame(now_ns, in_space(at), Twist()), at, None)
            moved = Odometry(now_ns, at, Twist())
            done = cells.step(now_ns, CellInputs(moved, at, None, EMPTY_MAP, np.empty((0, 2)), None))
    assert done.troubles == ()
    (door,) = [each for each in done.doorways if each.validated]
    at = scene.door.inverse() @ door.pose
    assert math.hypot(at.x, at.y) < 0.1
    assert door.width == pytest.approx(0.95, abs=0.05)
    assert done.done.ports["Doorway detection"].eo.number == door.number


def test_a_frame_in_three_pictures_is_looked_at_and_one_that_range_does_not_bear_out_is_no_doorway(
    clinic: World,
) -> None:
    rider, sight = Rider(clinic), FrameSight()
    rider.cells.door_wanted = True
    picture = Picture(0, np.zeros((480, 640, 3), np.uint8), SERVO_CAMERA.camera_matrix)
    for pan in (0.0, 0.1, 0.1):
        columns = (319.5 + 600.0 * math.tan(pan - left) for left in (0.3, 0.1))  # the frame stays, the camera turns
        left, right = columns
        seen = sight.seen([DoorFrame((left, 100.0, right, 400.0), 2.0)], picture, pan, Pose2())
    (frame,) = seen.candidates
    assert (frame.left, frame.right) == pytest.approx((0.3, 0.1), abs=1e-6)
    rider.cells.propose(seen)
    done = rider.ticks(1.0)
    assert done.done.ports["grant"].eo.client == "Range finder"
    assert rider.camera.servos.angles[0] == pytest.approx(0.2, abs=0.02)
    assert not done.done.ports["Object tracker"].ab
    assert rider.ticks(1.5).done.ports["grant"].eo.client == "Way finder"  # the frame is too old by now
