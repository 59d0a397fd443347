"""A chair in a world: lockstep, messages, the rider, walls."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import ConfigError, WorldError
from waychair.simulation.contact_watch import CONTACT_ENDS
from waychair.simulation.plan.world import World, load_world, world_from_grid
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.types import JoystickInput, OccupancyGrid, Pose2, Scan, SensorMessage, Twist, WheelTicks

SECOND = 1_000_000_000


def _hall(distance: float = 3.0) -> World:
    """An open hall with one wall in front of the chair, `distance` [m] ahead of the axle."""
    cells = np.zeros((200, 200), np.int8)
    cells[:, 40 + round(distance / 0.05)] = 100
    return world_from_grid(OccupancyGrid(cells, 0.05), Pose2(2.0, 5.0, 0.0))


def _bytes(messages: tuple[SensorMessage, ...]) -> list[bytes]:
    return [
        m.ranges.tobytes() + bytes(str(m.stamp_ns), "ascii") if isinstance(m, Scan) else repr(m).encode()
        for m in messages
    ]


def _drive(seed: int) -> list[bytes]:
    simulator = Simulator(load_world("small_clinic"), CHAIR_A, seed=seed)
    simulator.drive(2.1, 1.8)
    return _bytes(simulator.advance(2 * SECOND))


def test_the_same_seed_gives_identical_scans_and_ticks() -> None:
    assert _drive(3) == _drive(3)
    assert _drive(3) != _drive(4)


def test_any_ticks_give_the_same_messages() -> None:
    whole, cut = (Simulator(load_world("small_clinic"), CHAIR_A, seed=1) for _ in range(2))
    for simulator in (whole, cut):
        simulator.drive(2.1, 1.6)
    pieces = [message for _ in range(100) for message in cut.advance(SECOND // 100)]
    assert _bytes(whole.advance(SECOND)) == _bytes(tuple(pieces))


def test_scans_come_at_10_hz_and_ticks_at_50_hz_in_order_of_time() -> None:
    snapshots = SimulatorSettings(lidar=LidarSettings(sweep_s=0.0))
    messages = Simulator(_hall(), CHAIR_A, snapshots).advance(SECOND)
    assert [m.stamp_ns for m in messages if isinstance(m, Scan)] == list(range(SECOND // 10, SECOND + 1, SECOND // 10))
    assert [m.stamp_ns for m in messages if isinstance(m, WheelTicks)] == list(
        range(SECOND // 50, SECOND + 1, SECOND // 50)
    )
    assert [m.stamp_ns for m in messages] == sorted(m.stamp_ns for m in messages)
    assert isinstance(messages[-1], Scan)


def test_changing_the_lidar_does_not_change_the_ticks() -> None:
    def ticks(lidar: LidarSettings) -> list[SensorMessage]:
        simulator = Simulator(_hall(), CHAIR_A, SimulatorSettings(lidar=lidar), seed=5)
        simulator.drive(2.0, 1.7)
        return [m for m in simulator.advance(SECOND) if isinstance(m, WheelTicks)]

    assert ticks(LidarSettings()) == ticks(LidarSettings(beams=100, sigma=0.1))


def test_released_lines_follow_the_riders_joystick() -> None:
    simulator = Simulator(_hall(), CHAIR_A)
    simulator.rider = JoystickInput(0, forward=0.4, turn=0.3)
    simulator.drive(1.65, 1.65)
    simulator.advance(SECOND)
    assert simulator.truth() == simulator.world.start
    simulator.release()
    simulator.advance(SECOND)
    assert simulator.twist().v > 0.1
    assert simulator.twist().omega > 0.1


def test_a_new_simulator_rests_with_its_lines_released() -> None:
    simulator = Simulator(_hall(), CHAIR_A)
    simulator.advance(SECOND)
    assert simulator.truth() == simulator.world.start
    assert simulator.now_ns == SECOND


def test_the_chair_cannot_pass_through_a_wall_and_one_push_is_one_contact() -> None:
    simulator = Simulator(_hall(), CHAIR_A)
    simulator.drive(2.6, 1.65)
    for _ in range(100):
        simulator.advance(SECOND // 10)
        assert simulator.truth().x < 5.0 - CHAIR_A.front + 0.02
    assert simulator.in_contact
    assert simulator.contacts == 1
    assert simulator.clearance() < 0.01
    assert abs(simulator.twist().v) < 0.02


def test_a_chair_that_backs_away_from_a_wall_is_free_again_and_may_touch_again() -> None:
    simulator = Simulator(_hall(1.5), CHAIR_A)
    for contact in (1, 2):
        simulator.drive(2.4, 1.65)
        simulator.advance(4 * SECOND)
        assert simulator.in_contact
        assert simulator.contacts == contact
        simulator.drive(1.3, 1.65)
        simulator.advance(2 * SECOND)
        assert not simulator.in_contact
        assert simulator.clearance() > CONTACT_ENDS


@pytest.mark.nightly
@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_random_driving_never_puts_the_chair_into_a_wall(body: ChairBody) -> None:
    simulator = Simulator(load_world("small_clinic"), body, SimulatorSettings(lidar=LidarSettings(beams=2)))
    rng = np.random.default_rng(0)
    for _ in range(300):
        simulator.drive(*rng.uniform(0.3, 3.0, 2))
        simulator.advance(SECOND // 2)
        assert simulator.clearance() > 0.0
    assert simulator.contacts > 3


def test_stopping_from_walking_speed_takes_less_than_a_metre() -> None:
    simulator = Simulator(_hall(7.0), CHAIR_A)
    simulator.drive(1.65 + 0.0945 + 0.8 / 1.324, 1.65)
    simulator.advance(2 * SECOND)
    before = simulator.truth()
    assert simulator.twist().v == pytest.approx(0.8, abs=0.05)
    simulator.release()
    simulator.advance(2 * SECOND)
    assert 0.2 < math.hypot(simulator.truth().x - before.x, simulator.truth().y - before.y) < 1.0
    assert simulator.twist().v == pytest.approx(Twist().v, abs=1e-4)


@pytest.mark.parametrize("volts", [math.nan, math.inf])
def test_volts_that_are_not_finite_are_refused(volts: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        Simulator(_hall(), CHAIR_A).drive(volts, 1.65)


@pytest.mark.parametrize("duration", [-10_000_000, 1, 12_000_000])
def test_time_advances_in_whole_steps_only(duration: int) -> None:
    with pytest.raises(ValueError, match="multiple"):
        Simulator(_hall(), CHAIR_A).advance(duration)


@pytest.mark.parametrize("rate", [30.0, 400.0])
def test_a_rate_that_does_not_fit_the_step_is_refused(rate: float) -> None:
    with pytest.raises(ConfigError, match="whole number of steps"):
        SimulatorSettings(wheels_hz=rate)


def test_a_world_with_a_start_too_tight_for_the_chair_is_refused() -> None:
    with pytest.raises(WorldError, match="does not fit"):
        Simulator(_hall(0.6), CHAIR_A)
