"""The physical chair on an empty floor and against a wall: the measured figures of its parameter set."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import ConfigError, MissingExtra, WorldError
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.world import World, world_from_grid
from waychair.simulation.plant.chair_file import CHAIRS
from waychair.simulation.plant.kinematic_chair import KinematicChair
from waychair.simulation.plant.mujoco_chair import MujocoChair
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import GRAVITY, PlantSettings, volts_from_twist
from waychair.simulation.plant.plant_families import PlantFamily
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.types import OccupancyGrid, Pose2, Twist, WheelTicks

EVEN = PlantSettings(
    speed_noise=0.0,
    slip_noise=0.0,
    forward_skew=0.0,
    turn_skew=0.0,
    left_wheel_scale=1.0,
    right_wheel_scale=1.0,
)
EMPTY = world_from_grid(OccupancyGrid(np.zeros((4, 4), np.int8), 0.05), Pose2(0.1, 0.1, 0.0))
NEUTRAL = (1.65, 1.65)


class Drive:
    """A chair, the odometry of its encoders every 20 ms, and its true turn [rad]."""

    def __init__(
        self,
        body: ChairBody = CHAIR_A,
        plant: PlantSettings = EVEN,
        settings: MujocoSettings | None = None,
        start: Pose2 | None = None,
        world: World = EMPTY,
        seed: int = 0,
    ) -> None:
        self.start = start or Pose2(5.0, -3.0, 0.4)
        self.chair = MujocoChair(
            world, body, plant, settings or MujocoSettings(), np.random.default_rng(seed), self.start
        )
        self.body, self.plant = body, plant
        self.turned = 0.0
        self._odometry = OdometryFilter(body)
        self._steps = 0
        self.odom = self._odometry.update_wheels(WheelTicks(0, *self.chair.ticks)).odom_from_base

    def hold(self, twist: Twist, seconds: float) -> bool:
        """Hold the stick at the place for this motion of a chair without mass; return whether no wall was touched."""
        volts = volts_from_twist(self.plant, self.body.track, twist)
        free = True
        for _ in range(round(seconds * 200)):
            before = self.chair.pose.theta
            free = self.chair.step(*volts) and free
            self.turned += math.remainder(self.chair.pose.theta - before, math.tau)
            self._steps += 1
            if self._steps % 4 == 0:
                stamp_ns = self._steps * 5_000_000
                self.odom = self._odometry.update_wheels(WheelTicks(stamp_ns, *self.chair.ticks)).odom_from_base
        return free

    def moved(self) -> Pose2:
        """Return the true pose relative to the start."""
        return self.start.inverse() @ self.chair.pose

    def odometry_error(self) -> Pose2:
        """Return the odometry relative to the truth."""
        return self.moved().inverse() @ self.odom


def test_a_new_chair_stands_exactly_at_its_start_with_its_encoders_at_zero() -> None:
    for theta in (-3.0, 0.0, math.pi):
        chair = Drive(start=Pose2(1.0, 2.0, theta)).chair
        assert chair.pose.array() == pytest.approx([1.0, 2.0, theta], abs=1e-12)
        assert (chair.ticks, chair.twist) == ((0, 0), Twist())


def test_five_seconds_at_rest_creep_less_than_a_tenth_of_a_millimetre() -> None:
    drive = Drive()
    assert drive.hold(Twist(), 5.0)
    assert math.hypot(drive.moved().x, drive.moved().y) < 1e-4
    assert abs(drive.moved().theta) < 1e-4
    assert max(abs(count) for count in drive.chair.ticks) <= 1


@pytest.mark.sampled(1)
@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
@pytest.mark.parametrize(("omega", "seconds"), [(0.6, 8.0), (-0.6, 8.0), (1.0, 6.0)])
def test_odometry_of_a_spin_is_within_five_degrees_and_the_chair_stays_where_it_turns(
    body: ChairBody, omega: float, seconds: float
) -> None:
    drive = Drive(body)
    drive.hold(Twist(0.0, omega), seconds)
    assert 200.0 < abs(math.degrees(drive.turned)) < 320.0
    error = drive.odometry_error()
    assert 0.1 < abs(math.degrees(error.theta)) < 5.0
    assert math.hypot(error.x, error.y) < 0.02
    assert math.hypot(drive.moved().x, drive.moved().y) < 0.05


def test_odometry_of_a_straight_drive_of_ten_metres_is_within_five_centimetres() -> None:
    drive = Drive()
    drive.hold(Twist(0.62, 0.0), 16.5)
    assert drive.moved().x == pytest.approx(9.7, abs=0.2)
    error = drive.odometry_error()
    assert math.hypot(error.x, error.y) < 0.05
    assert abs(math.degrees(error.theta)) < 0.5


@pytest.mark.nightly
def test_odometry_of_a_five_metre_square_driven_twice_is_within_30_centimetres_and_five_degrees() -> None:
    start = Pose2(5.0, 5.0, 0.0)
    world = world_from_grid(OccupancyGrid(np.zeros((300, 300), np.int8), 0.05), start)
    simulator = Simulator(world, CHAIR_A, SimulatorSettings(plant_model="mujoco", plant=EVEN))
    odometry = OdometryFilter(CHAIR_A)
    odom = odometry.update_wheels(WheelTicks(0, 0, 0)).odom_from_base
    square = np.array([[10.0, 5.0], [10.0, 10.0], [5.0, 10.0], [5.0, 5.0]] * 2)
    for message in follow(simulator, Follower(square, CHAIR_A.track, EVEN)):
        if isinstance(message, WheelTicks):
            odom = odometry.update_wheels(message).odom_from_base
    truth = start.inverse() @ simulator.truth()
    assert math.hypot(truth.x, truth.y) < 0.15
    error = truth.inverse() @ odom
    assert 0.01 < math.hypot(error.x, error.y) < 0.30
    assert abs(math.degrees(error.theta)) < 5.0


def test_wheels_slow_under_load_by_some_percent_and_more_with_weaker_motors() -> None:
    def reached(gain: float) -> float:
        drive = Drive(settings=MujocoSettings(motor_gain=gain))
        drive.hold(Twist(0.0, 0.6), 4.0)
        return drive.chair.twist.omega / 0.6

    assert 0.80 < reached(60.0) < 0.97
    assert reached(30.0) < reached(60.0) - 0.03


def test_a_wet_floor_lets_the_wheels_spin_unseen_by_the_odometry() -> None:
    slippery = MujocoSettings(floor_friction=0.12, wheel_friction=0.12, caster_friction=0.12)
    errors = []
    for settings in (MujocoSettings(), slippery):
        drive = Drive(settings=settings)
        for _ in range(3):
            drive.hold(Twist(1.2, 0.0), 1.5)
            drive.hold(Twist(-0.6, 0.0), 1.5)
        error = drive.odometry_error()
        errors.append(math.hypot(error.x, error.y))
    assert errors[0] < 0.05
    assert errors[1] > 5 * errors[0]


def test_a_larger_wheel_drives_a_curve_that_the_encoders_do_not_see() -> None:
    drive = Drive(plant=dataclasses.replace(EVEN, left_wheel_scale=1.01, right_wheel_scale=0.99))
    drive.hold(Twist(0.6, 0.0), 6.0)
    unseen = -0.02 * drive.moved().x / CHAIR_A.track
    assert -drive.odometry_error().theta == pytest.approx(unseen, rel=0.05)


def _walled(distance: float) -> World:
    """A wall across the way of a chair at the origin that looks along x, on a grid that is not at the origin."""
    cells = np.zeros((120, 120), np.int8)
    cells[:, 60 + round(distance / 0.05) :] = 100
    return world_from_grid(OccupancyGrid(cells, 0.05, Pose2(-3.0, -3.0, 0.0)), Pose2())


def test_a_wall_stops_the_chair_and_stalls_its_motors_and_is_reported() -> None:
    drive = Drive(start=Pose2(), world=_walled(2.0))
    assert drive.hold(Twist(0.6, 0.0), 1.5)
    assert not drive.hold(Twist(0.6, 0.0), 4.0)
    before, ticks = drive.chair.pose, drive.chair.ticks
    assert before.x + CHAIR_A.front == pytest.approx(2.0, abs=0.005)
    assert not drive.hold(Twist(0.6, 0.0), 2.0)
    assert drive.chair.pose.array() == pytest.approx(before.array(), abs=0.005)
    assert drive.chair.ticks == pytest.approx(ticks, abs=150)  # 4 cm of slip at most; the stick asks for 1.2 m
    assert abs(drive.chair.twist.v) < 0.01
    drive.hold(Twist(-0.5, 0.0), 2.0)
    assert drive.hold(Twist(), 1.0)
    assert drive.chair.pose.x < before.x - 0.3


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_wall_beside_the_chair_is_touched_at_the_outline(side: float) -> None:
    cells = np.zeros((60, 120), np.int8)
    row = 30 + round(side * 0.5 / 0.05) - (side < 0)
    cells[row] = 100
    world = world_from_grid(OccupancyGrid(cells, 0.05, Pose2(-3.0, -1.5, 0.0)), Pose2())
    drive = Drive(start=Pose2(), world=world)
    assert drive.hold(Twist(), 0.5)
    assert not drive.hold(Twist(0.3, side * 0.6), 3.0)
    outline_y = [(drive.chair.pose @ Pose2(x, y)).y for x, y in CHAIR_A.outline().tolist()]
    assert max(side * y for y in outline_y) < 0.505


def test_the_same_seed_gives_identical_motion_and_another_seed_another_ripple() -> None:
    def state(seed: int) -> bytes:
        drive = Drive(plant=PlantSettings(), seed=seed)
        drive.hold(Twist(0.5, 0.3), 2.0)
        return drive.chair.pose.array().tobytes() + repr(drive.chair.ticks).encode()

    assert state(3) == state(3)
    assert state(3) != state(4)


def test_both_plants_share_one_controller_and_differ_by_the_effects_of_mass() -> None:
    drive = Drive(start=Pose2())
    bare = KinematicChair(CHAIR_A, EVEN, np.random.default_rng(0))
    volts = volts_from_twist(EVEN, CHAIR_A.track, Twist(0.6, 0.0))
    speeds = []
    for _ in range(600):
        bare.step(*volts, lambda _pose: True)
        drive.chair.step(*volts)
        speeds.append((bare.twist.v, drive.chair.twist.v))
    assert speeds[9][0] == 0.0
    assert abs(speeds[9][1]) < 1e-6  # the delay is the same
    physical = np.array(speeds)[:, 1]
    assert physical[100] < speeds[100][0]  # mass lags behind
    assert physical[-1] == pytest.approx(0.6, rel=0.05)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["A", "B", "A_mid", "A_front"])
def test_every_drive_type_goes_straight_at_the_same_volts_and_turns_in_place_upright(name: str) -> None:
    chair = CHAIRS[name]
    straight = Drive(chair.body, settings=chair.mujoco)
    assert straight.hold(Twist(0.6, 0.0), 5.0)
    assert straight.moved().x == pytest.approx(2.62, abs=0.03)
    assert abs(straight.moved().y) < 0.005
    spin = Drive(chair.body, settings=chair.mujoco)
    assert spin.hold(Twist(0.0, 0.8), 8.0)
    assert spin.turned > 5.0
    assert math.hypot(spin.moved().x, spin.moved().y) < 0.06
    for drive in (straight, spin):
        assert drive.chair.upright
        assert abs(drive.chair.pose3.translation[2]) < 0.003


def test_the_small_robot_drives_and_turns_as_commanded() -> None:
    chair = CHAIRS["robot"]
    drive = Drive(chair.body, settings=chair.mujoco)
    assert drive.hold(Twist(0.2, 0.0), 5.0)
    assert drive.moved().x == pytest.approx(0.9, abs=0.06)
    assert drive.hold(Twist(0.0, 0.8), 5.0)
    assert drive.turned == pytest.approx(3.2, rel=0.15)
    assert drive.chair.upright


@pytest.mark.parametrize("name", ["A", "A_mid", "A_front"])
def test_at_rest_the_imu_measures_gravity_along_the_true_vertical(name: str) -> None:
    drive = Drive(CHAIRS[name].body, settings=CHAIRS[name].mujoco)
    drive.hold(Twist(), 1.0)
    up = drive.chair.pose3.rotation[2]
    assert drive.chair.specific_force == pytest.approx(GRAVITY * up, abs=0.02)
    assert drive.chair.angular_rate == pytest.approx(np.zeros(3), abs=1e-3)


def test_the_imu_measures_the_motion_of_the_chair() -> None:
    drive, felt, turned = Drive(), [], []
    volts = volts_from_twist(EVEN, CHAIR_A.track, Twist(0.8, 0.5))
    before = drive.chair.twist
    for _ in range(800):
        drive.chair.step(*volts)
        felt.append(drive.chair.specific_force)
        turned.append(drive.chair.angular_rate[2])
    forces, after = np.array(felt), drive.chair.twist
    assert sum(turned) * 0.005 == pytest.approx(drive.chair.pose.theta - drive.start.theta, abs=2e-3)
    # Ahead of the axle the way round the curve pulls to its middle, so the speed is the rest of the sum.
    centripetal = np.array(turned) ** 2 * CHAIR_A.imu_x
    assert (forces[:, 0] + centripetal).sum() * 0.005 == pytest.approx(after.v - before.v, abs=0.02)
    assert forces[-200:, 1].mean() == pytest.approx(after.v * after.omega, rel=0.05)
    assert forces[:, 2].mean() == pytest.approx(GRAVITY, abs=0.05)


def test_pose_and_3d_pose_agree_and_the_base_stands_on_the_floor() -> None:
    drive = Drive()
    drive.hold(Twist(0.5, 0.3), 3.0)
    pose = drive.chair.pose3
    assert pose.planar().array() == pytest.approx(drive.chair.pose.array(), abs=1e-9)
    assert abs(pose.translation[2]) < 0.002
    assert pose.rotation @ pose.rotation.T == pytest.approx(np.eye(3), abs=1e-9)


def test_pose_and_twist_are_of_the_same_instant() -> None:
    drive, way = Drive(settings=MujocoSettings(timestep_ms=5.0)), 0.0
    volts = volts_from_twist(EVEN, CHAIR_A.track, Twist(1.0, 0.0))
    for _ in range(400):
        drive.chair.step(*volts)
        way += 0.005 * drive.chair.twist.v
    assert drive.moved().x == pytest.approx(way, abs=0.001)  # a time step is 5 mm


def test_swinging_casters_push_the_chair_sideways_at_a_start_in_reverse() -> None:
    drive = Drive()
    drive.hold(Twist(0.5, 0.2), 2.0)
    drive.hold(Twist(), 1.5)
    rates = []
    for _ in range(1000):
        drive.chair.step(*volts_from_twist(EVEN, CHAIR_A.track, Twist(-0.4, 0.0)))
        rates.append(abs(drive.chair.twist.omega))
    assert max(rates[:400]) > 0.03
    assert max(rates[-100:]) < 0.005


def test_locked_wheels_hold_the_chair_until_the_brake_opens() -> None:
    plant = dataclasses.replace(EVEN, family=PlantFamily(brake_release_s=0.4))
    drive, prompt = Drive(plant=plant), Drive()
    for chair in (drive, prompt):
        chair.hold(Twist(0.6, 0.0), 0.4)
    assert abs(drive.moved().x) < 1e-4
    assert prompt.moved().x > 0.02
    drive.hold(Twist(0.6, 0.0), 2.0)
    assert drive.moved().x > 0.5


def test_fading_motors_slow_the_chair_by_their_share() -> None:
    fading = PlantFamily(thermal_fade=0.5, thermal_from=0.0, thermal_full=0.01, thermal_s=1.0)
    tired = Drive(plant=dataclasses.replace(EVEN, family=fading))
    fresh = Drive()
    for drive in (tired, fresh):
        drive.hold(Twist(1.2, 0.0), 6.0)
    assert 0.5 * fresh.chair.twist.v < tired.chair.twist.v < 0.95 * fresh.chair.twist.v


def test_a_plant_step_other_than_whole_time_steps_is_refused() -> None:
    with pytest.raises(ConfigError, match="timestep_ms = 3 is impossible"):
        Drive(settings=MujocoSettings(timestep_ms=3.0))


def test_diverging_physics_is_reported_and_not_silently_restarted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own log of warnings where it runs
    drive = Drive()
    drive.hold(Twist(), 0.1)
    drive.chair._physics.data.qvel[0] = math.nan
    with pytest.raises(WorldError, match="unstable"):
        drive.chair.step(*NEUTRAL)


def test_without_mujoco_the_error_names_the_package_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtra, match=r"pip install .*\[sim\]"):
        Drive()


def test_importing_the_simulator_does_not_import_mujoco() -> None:
    code = "import sys, waychair.simulation.simulator; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
