"""The shipped firmware between the rider's stick and the simulated chair's lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.firmware_bridge.board import BoardSettings, HostBoard, build_board
from waychair.firmware_bridge.bridge import Bridge
from waychair.firmware_bridge.protocol import Family
from waychair.firmware_bridge.transports import Reconnecting
from waychair.simulation.plan.world import load_world
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.types import JoystickInput, SentCommand, WheelSpeeds

BEAT_NS = 10_000_000
QUIET = SimulatorSettings(plant=PlantSettings(speed_noise=0.0, slip_noise=0.0), lidar=LidarSettings(beams=2))


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_board(tmp_path_factory.mktemp("board"))


@pytest.fixture
def board(program: Path) -> Iterator[HostBoard]:
    with HostBoard(program, BoardSettings(family=Family.EIGHT_PIN_3V3, dac_bits=8)) as board:
        yield board


def _run(simulator: Simulator, bridge: Bridge, seconds: float, speeds: WheelSpeeds | None) -> SentCommand:
    for beat in range(round(seconds * 1e9 / BEAT_NS)):
        if beat % 5 == 0:
            sent = bridge.send(speeds, simulator.now_ns, simulator.now_ns)
        else:
            bridge.beat(simulator.now_ns)
        simulator.advance(BEAT_NS)
    return sent


def test_wheel_speeds_become_motion_through_bridge_and_board(board: HostBoard) -> None:
    simulator = Simulator(load_world("corridor_t").without_people(), CHAIR_A, QUIET)
    simulator.wire(board)
    bridge = Bridge(Reconnecting(lambda: board.transport), DEFAULT, "A")
    _run(simulator, bridge, 2.3, WheelSpeeds())
    assert _run(simulator, bridge, 1.5, WheelSpeeds(0.4, 0.6)).active
    assert simulator.twist().v == pytest.approx(0.5, abs=0.02)
    assert simulator.twist().omega == pytest.approx(0.2 / CHAIR_A.track, abs=0.05)
    _run(simulator, bridge, 2.0, None)
    assert simulator.twist().v == pytest.approx(0.0, abs=1e-4)


def test_the_rider_drives_through_a_board_without_a_computer(board: HostBoard) -> None:
    simulator = Simulator(load_world("corridor_t").without_people(), CHAIR_A, QUIET)
    simulator.wire(board)
    simulator.rider = JoystickInput(0, 0.4, 0.0)
    simulator.advance(1_000_000_000)
    assert simulator.twist().v > 0.3
    simulator.board_inputs = replace(simulator.board_inputs, estop_released=False)
    simulator.advance(2_000_000_000)
    assert simulator.twist().v == pytest.approx(0.0, abs=1e-4)


def test_voltages_cannot_be_set_on_lines_held_by_a_board(board: HostBoard) -> None:
    simulator = Simulator(load_world("corridor_t"), CHAIR_A, QUIET)
    simulator.wire(board)
    with pytest.raises(ValueError, match="wire"):
        simulator.drive(2.0, 1.65)
    simulator.wire(None)
    simulator.drive(2.0, 1.65)
    simulator.advance(1_000_000_000)
    assert simulator.twist().v > 0.2
