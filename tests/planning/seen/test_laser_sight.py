"""The laser's line as the simulator draws it gives points in base; a covered lens, a dead laser and lying servos are named."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.servo_camera_mount import SERVO_CAMERA
from waychair.geometry import in_space, transform_points
from waychair.planning.seen.laser_sight import (
    DARK,
    MOST_PAIRS,
    SILENT,
    SURELY,
    VAGUE,
    LaserSight,
    SightMemory,
    line_view,
    look,
)
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.pan_tilt import ServoCameraFaults
from waychair.simulation.sensors.rays import scenery_from_slice
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.sensors.servo_camera import ServoCamera
from waychair.types import FloatArray, PanTiltAngles, PanTiltCommand, Picture, Pose2, Twist

if renderer_problem():
    pytest.skip(str(renderer_problem()), allow_module_level=True)

HERE = Pose2(3.75, 4.2, math.pi / 2)
"""In a room of `small_clinic`, between its walls, a desk and a shelf."""

PERIOD_NS, STEP_NS = 100_000_000, 5_000_000


@pytest.fixture(scope="module")
def clinic() -> World:
    return load_world("small_clinic")


class Rig:
    """A camera in a world, its looks, and the lidar's points beside it."""

    def __init__(self, world: World, faults: ServoCameraFaults, lidar: bool = True) -> None:
        self.camera = ServoCamera(np.random.default_rng(2), world)
        self.camera.faults = faults
        self.memory, self.now_ns, self.place, self.pose = SightMemory(), 0, HERE, Pose2()
        self.others: FloatArray | None = None
        if lidar:
            scan = Lidar(LidarSettings(), CHAIR_A, np.random.default_rng(1)).scan_at_rest(
                scenery_from_slice(slice_at(world.blocks, 0.65)), HERE, 0
            )
            met = np.isfinite(scan.ranges)
            ends = scan.ranges[met, None] * np.stack([np.cos(scan.angles()[met]), np.sin(scan.angles()[met])], axis=1)
            self.others = transform_points(CHAIR_A.base_from_laser, ends.astype(np.float64))

    def aim(self, pan: float, count: int = 4) -> list[LaserSight]:
        """Turn, settle, and return the looks at `count` pictures."""
        self.camera.order(PanTiltCommand(0, math.radians(pan), 0.0, laser=True))
        for _ in range(400):
            self.camera.step(STEP_NS)
        seen = []
        for _ in range(count):
            self.now_ns += PERIOD_NS
            angles, picture = self.camera.sense(self.now_ns, in_space(self.place @ self.pose), Twist())
            assert isinstance(angles, PanTiltAngles)
            assert isinstance(picture, Picture)
            sight, self.memory = look(picture, angles, self.pose, self.others, self.memory)
            seen += [sight] if sight is not None else []
        return seen


SOUND = ServoCameraFaults()


def test_the_points_lie_on_what_stands_there_within_their_own_errors(clinic: World) -> None:
    rig = Rig(clinic, SOUND)
    sights = [*rig.aim(0.0), *rig.aim(75.0)]
    assert len(sights) >= 4
    outline = slice_at(clinic.blocks, SERVO_CAMERA.height - SERVO_CAMERA.baseline).segments
    for sight in sights:
        assert sight.fault == ""
        assert len(sight.points) > 200
        assert sight.points[:, 2] == pytest.approx(SERVO_CAMERA.height - SERVO_CAMERA.baseline, abs=0.01)
        off = _distances(transform_points(HERE, sight.points[:, :2]), outline)
        assert np.percentile(off, 95) < 0.05
        assert np.mean(off < 3 * sight.errors + 0.01) > 0.98
        ends = sight.view().ends
        bearings = np.unwrap(np.arctan2(*(ends - [SERVO_CAMERA.forward, SERVO_CAMERA.left]).T[::-1]))
        assert (np.diff(bearings) > -1e-6).all()  # in the order in which they turn to the left


def _distances(points: FloatArray, segments: FloatArray) -> FloatArray:
    """The distance (N,) of points from the nearest segment."""
    a, b = segments[:, :2], segments[:, 2:]
    along = b - a
    part = ((points[:, None] - a) * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12)
    nearest = a + np.clip(part, 0.0, 1.0)[..., None] * along
    found: FloatArray = np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)
    return found


def test_pictures_of_a_rest_are_averaged_and_show_the_line_farther_away(clinic: World) -> None:
    rig = Rig(clinic, SOUND, lidar=False)
    rig.place = clinic.start  # a wall stands 7 m to the left
    sights = rig.aim(90.0, 2 + 2 * MOST_PAIRS)
    far = [np.hypot(*(each.points[:, :2] - [SERVO_CAMERA.forward, 0.0]).T) > 5.0 for each in sights]
    assert far[-1].sum() > 1.3 * far[0].sum()
    off = _distances(
        transform_points(rig.place, sights[-1].points[:, :2]),
        slice_at(clinic.blocks, SERVO_CAMERA.height - SERVO_CAMERA.baseline).segments,
    )
    assert np.mean(off < 3 * sights[-1].errors + 0.01) > 0.98
    rig.pose = Pose2(0.1, 0.0)  # the chair moves: earlier pictures show another view
    moved = rig.aim(90.0, 2)[-1]
    assert np.count_nonzero(np.hypot(*moved.points[:, :2].T) > 5.0) < far[-1].sum()


def test_a_far_point_shows_no_surface_but_that_its_beam_goes_on() -> None:
    ends = np.array([[9.0, 0.0], [2.0, 0.5]])
    view = line_view(np.zeros(2), ends, np.array([VAGUE + 0.1, 0.02]))
    assert view.met.tolist() == [False, True]
    assert view.ends[0] == pytest.approx([9.0 - SURELY * (VAGUE + 0.1), 0.0])
    assert view.ends[1] == pytest.approx(ends[1])


def _last_fault(sights: list[LaserSight]) -> str:
    assert sights
    assert all(not len(each.points) for each in sights if each.fault)
    return sights[-1].fault


def test_a_covered_lens_is_named_and_shows_nothing(clinic: World) -> None:
    sights = Rig(clinic, ServoCameraFaults(dark=True)).aim(0.0)
    assert _last_fault(sights) == DARK
    assert not any(len(each.points) for each in sights)


def test_a_laser_without_light_is_named_where_other_sensors_see_something_near(clinic: World) -> None:
    rig = Rig(clinic, ServoCameraFaults(laser_off=True))
    sights = rig.aim(80.0, 10)
    assert "the laser is off" in _last_fault(sights)
    assert not any(len(each.points) for each in sights)
    alone = Rig(clinic, ServoCameraFaults(laser_off=True), lidar=False).aim(80.0, 10)
    assert not any(len(each.points) or each.fault for each in alone)  # nothing is known to be there


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("lidar", "pan"), [(True, 80.0), (False, 20.0), (False, 80.0)])
def test_a_stuck_pan_that_reports_its_order_is_named(clinic: World, lidar: bool, pan: float) -> None:
    rig = Rig(clinic, SOUND, lidar)
    assert not any(each.fault for each in rig.aim(0.0))
    rig.camera.faults = ServoCameraFaults(pan_stuck=True, echoes=True)
    fault = _last_fault(rig.aim(pan))
    assert "stuck" in fault or (lidar and "to the right of the angle" in fault)
    rig.camera.faults = SOUND
    rig.aim(30.0)
    assert not any(each.fault for each in rig.aim(50.0)[-1:])  # the pictures bear its angle out again


@pytest.mark.parametrize("degrees", [-40.0, 12.0, 90.0])
def test_a_report_that_is_off_by_an_angle_is_named_with_it(clinic: World, degrees: float) -> None:
    rig = Rig(clinic, ServoCameraFaults(pan_error=math.radians(degrees)))
    fault = _last_fault(rig.aim(100.0))
    told = int(fault.split("about ")[1].split()[0])
    assert told == pytest.approx(abs(degrees), abs=4.0)
    assert ("right" if degrees > 0 else "left") in fault


def test_a_camera_that_turns_tells_nothing_and_silent_servos_are_named(clinic: World) -> None:
    camera = ServoCamera(np.random.default_rng(2), clinic)
    camera.order(PanTiltCommand(0, 1.0, 0.0, laser=True))
    camera.step(STEP_NS)
    angles, picture = camera.sense(PERIOD_NS, in_space(HERE), Twist())
    assert isinstance(angles, PanTiltAngles)
    assert isinstance(picture, Picture)
    assert look(picture, angles, Pose2(), None, SightMemory())[0] is None
    for silent in (None, PanTiltAngles(0, math.nan, 0.0, True), PanTiltAngles(0, 0.0, math.inf, True)):
        sight, memory = look(picture, silent, Pose2(), None, SightMemory())
        assert sight is not None
        assert (sight.fault, len(sight.points), memory) == (SILENT, 0, SightMemory())
