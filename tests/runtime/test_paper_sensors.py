"""The paper's network on a chair with the paper's sensors: what it hears, and where its camera looks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from evaluation.scenes.tight_places import TightScene, door_scene

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.behaviours.range_finder import OBJECT_TRACKER
from waychair.control.behaviours.view.servo_cells import SWEEP
from waychair.geometry import in_space
from waychair.planning.seen.doorways import DoorState, Doorway
from waychair.runtime.haptics.seen_ground import SeenGround
from waychair.runtime.perception import CellInputs, Perceived, Perception
from waychair.runtime.senses.paper_sensors import PaperSensors
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.pan_tilt import ServoCameraFaults
from waychair.simulation.sensors.rays import scenery_from_slice
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.sensors.servo_camera import ServoCamera
from waychair.simulation.sensors.sonar import SRF08, Sonars
from waychair.trials.guiding.paper_chair import paper_body
from waychair.types import OccupancyGrid, Odometry, PanTiltCommand, Pose2, Twist

if renderer_problem():
    pytest.skip(str(renderer_problem()), allow_module_level=True)

TICK_NS = 50_000_000
NOWHERE = OccupancyGrid(np.full((1, 1), -1, np.int8), 0.05)


class PaperRider:
    """The paper's cells of a chair at rest before a door, with its sonars, and a camera at 10 Hz that obeys them."""

    def __init__(self, at: Pose2, scene: TightScene) -> None:
        body = paper_body(CHAIR_A)
        self.cells, self.now_ns, self.at = Perception(body, timer=None, network="paper"), 0, at
        self.camera = ServoCamera(np.random.default_rng(2), scene.world)
        self._sonars = Sonars(SRF08, body, np.random.default_rng(3))
        self._scenery = scenery_from_slice(slice_at(scene.world.blocks, SRF08.height))
        self.orders: list[PanTiltCommand] = []

    def ticks(self, seconds: float) -> Perceived:
        for _ in range(round(seconds * 20)):
            self.now_ns += TICK_NS
            self.camera.step(TICK_NS)
            if self.now_ns % (2 * TICK_NS) == 0:
                for message in self.camera.sense(self.now_ns, in_space(self.at), Twist()):
                    self.cells.watch(message, Pose2())
                self.cells.hear(self._sonars.read(self._scenery, self.at, (), self.now_ns), Pose2())
            still = Odometry(self.now_ns, Pose2(), Twist())
            done = self.cells.step(self.now_ns, CellInputs(still, Pose2(), None, NOWHERE, np.empty((0, 2)), None))
            if done.order is not None:
                self.camera.order(done.order)
                self.orders.append(done.order)
        return done


@pytest.fixture(scope="module")
def scene() -> TightScene:
    return door_scene(0.9, 0.0, CHAIR_A, 3)


def before_door(scene: TightScene, turned: float = 0.0) -> Pose2:
    """A place 2 m before the door's middle."""
    assert scene.door is not None
    return scene.door @ Pose2(-2.0, 0.0, turned)


def test_the_camera_looks_in_turn_while_no_door_is_wanted_and_the_sonars_tell_of_obstacles(scene: TightScene) -> None:
    rider = PaperRider(before_door(scene), scene)
    done = rider.ticks(6.0)
    for way in SWEEP:
        assert any(abs(math.remainder(order.pan - way, math.tau)) < 1e-6 for order in rider.orders)
    assert done.troubles == ()
    assert done.done.ports["Way finder"].eo.command.orientations
    assert not done.done.ports["Object tracker"].ab


@pytest.mark.parametrize("turned", [0.1, -0.1])
def test_a_door_that_the_line_shows_is_validated_by_it_and_kept_in_view_without_a_whole_turn(
    scene: TightScene, turned: float
) -> None:
    rider = PaperRider(before_door(scene, turned), scene)
    rider.cells.door_wanted = True
    done = rider.ticks(6.0)
    assert done.done.ports["grant"].eo.client == OBJECT_TRACKER
    tracked = done.done.ports["Object tracker"].eo.door
    assert scene.door is not None
    true = rider.at.inverse() @ scene.door
    assert tracked.middle == pytest.approx((true.x, true.y), abs=0.12)
    assert tracked.width == pytest.approx(0.9, abs=0.12)
    rider.orders.clear()
    rider.ticks(2.0)
    assert {order.pan < math.pi for order in rider.orders} == {True}, "a door a little to the right is seen from ahead"
    assert done.signal.startswith("go") or done.signal.startswith("swivel")


def test_a_lidar_tells_the_papers_network_nothing(scene: TightScene) -> None:
    rider = PaperRider(before_door(scene), scene)
    outline = scenery_from_slice(slice_at(scene.world.blocks, CHAIR_A.laser_z))
    scan = Lidar(LidarSettings(), CHAIR_A, np.random.default_rng(1)).scan_at_rest(outline, rider.at, 0)
    rider.cells.see(scan, Pose2())
    assert set(rider.ticks(0.05).heard) == {"door wanted", "odometry"}


def test_a_covered_lens_is_named(scene: TightScene) -> None:
    rider = PaperRider(before_door(scene), scene)
    rider.camera.faults = ServoCameraFaults(dark=True)
    (told,) = rider.ticks(1.0).troubles
    assert "see whether its lens is covered" in told


@pytest.mark.parametrize("through", [0.0, math.pi])
def test_a_doorway_is_a_frame_between_its_jambs_whichever_way_it_is_held(through: float) -> None:
    at = Pose2(3.0, 0.0, through)
    (frame,) = PaperSensors().frames([Doorway(0, at, 0.9, 0.9, 0.05, DoorState.OPEN)], Pose2()).candidates
    assert (frame.left, frame.right) == pytest.approx((math.atan2(0.45, 3.0), -math.atan2(0.45, 3.0)))


def test_the_ground_by_the_line_holds_the_walls_beside_a_door_and_leaves_the_door_free(scene: TightScene) -> None:
    assert scene.door is not None
    rider, ground = PaperRider(before_door(scene), scene), SeenGround(CHAIR_A)
    for _ in range(40):
        told = rider.ticks(0.05).camera
        if told is not None and told.sight is not None:
            ground.look(told.sight, rider.at, told.stamp_ns)
    assert ground.is_seen
    walls = ground.walls(scene.door, 1.5)
    aside = np.abs((walls - [scene.door.x, scene.door.y])[:, 1])
    near = np.abs(walls[:, 0] - scene.door.x) < 0.2
    assert np.count_nonzero(near) > 15
    assert aside[near].min() > 0.4
