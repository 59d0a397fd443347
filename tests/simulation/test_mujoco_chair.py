"""The physical chair on an empty floor and against a wall: the figures that its parameter set was measured to give."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from waychair.calibration.chair import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import ConfigError, MissingExtra, WorldError
from waychair.simulation.follower import Follower, follow
from waychair.simulation.mujoco_chair import MujocoChair
from waychair.simulation.mujoco_model import MujocoSettings
from waychair.simulation.plant import KinematicChair, PlantSettings, volts_from_twist
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.simulation.world import world_from_grid
from waychair.slam.odometry import WheelOdometry
from waychair.types import OccupancyGrid, Pose2, Twist, WheelTicks

EVEN = PlantSettings(speed_noise=0.0, slip_noise=0.0, forward_skew=0.0, turn_skew=0.0)
EMPTY = OccupancyGrid(np.zeros((4, 4), np.int8), 0.05)
NEUTRAL = (1.65, 1.65)


class Drive:
    """A chair, the odometry of its encoders every 20 ms, and how far it has truly turned [rad]."""

    def __init__(
        self,
        body: ChairBody = CHAIR_A,
        plant: PlantSettings = EVEN,
        settings: MujocoSettings | None = None,
        start: Pose2 | None = None,
        grid: OccupancyGrid = EMPTY,
        seed: int = 0,
    ) -> None:
        self.start = start or Pose2(5.0, -3.0, 0.4)
        self.chair = MujocoChair(
            grid, body, plant, settings or MujocoSettings(), np.random.default_rng(seed), self.start
        )
        self.body, self.plant = body, plant
        self.turned = 0.0
        self._odometry = WheelOdometry(body)
        self._steps = 0
        self.odom = self._odometry.update(WheelTicks(0, *self.chair.ticks)).odom_from_base

    def hold(self, twist: Twist, seconds: float) -> bool:
        """Holds the stick where a chair without mass would do this; whether no wall was touched."""
        volts = volts_from_twist(self.plant, self.body.track, twist)
        free = True
        for _ in range(round(seconds * 100)):
            before = self.chair.pose.theta
            free = self.chair.step(*volts) and free
            self.turned += math.remainder(self.chair.pose.theta - before, math.tau)
            self._steps += 1
            if self._steps % 2 == 0:
                stamp_ns = self._steps * 10_000_000
                self.odom = self._odometry.update(WheelTicks(stamp_ns, *self.chair.ticks)).odom_from_base
        return free

    def moved(self) -> Pose2:
        """True pose seen from the start."""
        return self.start.inverse() @ self.chair.pose

    def odometry_error(self) -> Pose2:
        """Odometry seen from the truth."""
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


def test_odometry_of_a_five_metre_square_driven_twice_is_within_30_centimetres_and_five_degrees() -> None:
    start = Pose2(5.0, 5.0, 0.0)
    world = world_from_grid(OccupancyGrid(np.zeros((300, 300), np.int8), 0.05), start)
    simulator = Simulator(world, CHAIR_A, SimulatorSettings(plant_model="mujoco", plant=EVEN))
    odometry = WheelOdometry(CHAIR_A)
    odom = odometry.update(WheelTicks(0, 0, 0)).odom_from_base
    square = np.array([[10.0, 5.0], [10.0, 10.0], [5.0, 10.0], [5.0, 5.0]] * 2)
    for message in follow(simulator, Follower(square, CHAIR_A.track, EVEN)):
        if isinstance(message, WheelTicks):
            odom = odometry.update(message).odom_from_base
    truth = start.inverse() @ simulator.truth()
    assert math.hypot(truth.x, truth.y) < 0.15
    error = truth.inverse() @ odom
    assert 0.01 < math.hypot(error.x, error.y) < 0.30
    assert abs(math.degrees(error.theta)) < 5.0


def test_wheels_droop_under_load_by_some_percent_and_more_with_weaker_motors() -> None:
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


def _walled(distance: float) -> OccupancyGrid:
    """A wall across the way of a chair at the origin that looks along x, on a grid that is not at the origin."""
    cells = np.zeros((120, 120), np.int8)
    cells[:, 60 + round(distance / 0.05) :] = 100
    return OccupancyGrid(cells, 0.05, Pose2(-3.0, -3.0, 0.0))


def test_a_wall_stops_the_chair_and_is_reported_and_its_motors_stall() -> None:
    drive = Drive(start=Pose2(), grid=_walled(2.0))
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
def test_a_wall_beside_the_chair_is_met_where_its_outline_is(side: float) -> None:
    cells = np.zeros((60, 120), np.int8)
    row = 30 + round(side * 0.5 / 0.05) - (side < 0)
    cells[row] = 100
    grid = OccupancyGrid(cells, 0.05, Pose2(-3.0, -1.5, 0.0))
    drive = Drive(start=Pose2(), grid=grid)
    assert drive.hold(Twist(), 0.5)
    assert not drive.hold(Twist(0.3, side * 0.6), 3.0)
    outline_y = [(drive.chair.pose @ Pose2(x, y)).y for x, y in CHAIR_A.outline().tolist()]
    assert max(side * y for y in outline_y) < 0.505


def test_same_seed_gives_identical_motion_and_another_seed_another_ripple() -> None:
    def state(seed: int) -> bytes:
        drive = Drive(plant=PlantSettings(), seed=seed)
        drive.hold(Twist(0.5, 0.3), 2.0)
        return drive.chair.pose.array().tobytes() + repr(drive.chair.ticks).encode()

    assert state(3) == state(3)
    assert state(3) != state(4)


def test_both_plants_share_one_controller_and_differ_by_what_mass_does() -> None:
    drive = Drive(start=Pose2())
    bare = KinematicChair(CHAIR_A, EVEN, np.random.default_rng(0))
    volts = volts_from_twist(EVEN, CHAIR_A.track, Twist(0.6, 0.0))
    speeds = []
    for _ in range(300):
        bare.step(*volts, lambda _pose: True)
        drive.chair.step(*volts)
        speeds.append((bare.twist.v, drive.chair.twist.v))
    assert speeds[4][0] == 0.0
    assert abs(speeds[4][1]) < 1e-6  # the delay is the same
    physical = np.array(speeds)[:, 1]
    assert physical[50] < speeds[50][0]  # mass lags behind
    assert physical[-1] == pytest.approx(0.6, rel=0.05)


def test_a_plant_step_that_is_not_whole_time_steps_is_refused() -> None:
    with pytest.raises(ConfigError, match="timestep_ms = 3 is impossible"):
        Drive(settings=MujocoSettings(timestep_ms=3.0))


def test_physics_that_runs_away_is_told_and_not_begun_anew_in_silence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own log of warnings where it runs
    drive = Drive()
    drive.hold(Twist(), 0.1)
    drive.chair._data.qvel[0] = math.nan
    with pytest.raises(WorldError, match="unstable"):
        drive.chair.step(*NEUTRAL)


def test_without_mujoco_the_chair_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtra, match=r"pip install waychair\[sim\]"):
        Drive()


def test_importing_the_simulator_does_not_import_mujoco() -> None:
    code = "import sys, waychair.simulation.simulator; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
