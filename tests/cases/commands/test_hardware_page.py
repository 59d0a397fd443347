"""docs/hardware.md to the letter: its files are written and its commands are run as printed, against the board's firmware.

The ports of the page lead to the shipped C program and to a simulated chair's sensors, in simulated time. The recordings of
the page are simulated drives. The short test adds options that measure less; the nightly one runs the page as it is.
"""

from __future__ import annotations

import io
import re
import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.calibration.drives.board_rig import PLANT, SEED, BoardRig
from tests.calibration.synthetic import TRUE
from waychair.calibration.calibration_file import (
    ChairCalibration,
    JoystickFamily,
    check_real,
    load_calibration,
    update_calibration,
)
from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.fits.stopping import UNMEASURED_SPEED, permitted_speed
from waychair.cli.main import app
from waychair.cli.options.arguments import BadArgument
from waychair.errors import CalibrationError, CalibrationMismatch
from waychair.firmware_bridge.board import build_board
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.simulation.plant.chair_file import load_chair
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.trials.open_hall import open_hall
from waychair.trials.record import drive_route
from waychair.trials.simulated_calibration import (
    TIME_HALL,
    WHEELS_HALL,
    square_both_ways,
    turns_to_and_fro,
    with_legs,
)
from waychair.trials.simulated_drive import with_few_beams, with_gyro

PAGE = Path(__file__).parents[3] / "docs" / "hardware.md"
BLOCKS = re.findall(r"^ *```(\w*)\n(.*?)^ *```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
COMMANDS = [line.strip() for kind, text in BLOCKS if not kind for line in text.splitlines() if "waychair " in line]
LESS = {"stop": ("--fastest", "0.3", "--repetitions", "1")}
"""Options that shorten a command, for the test that runs often."""

FAMILY: JoystickFamily = "eight_pin_3v3"


def commands(*names: str) -> list[str]:
    """The page's calibrations of these names, in its order."""
    found = [line for line in COMMANDS if line.startswith("waychair calibrate") and line.split()[2] in names]
    assert {line.split()[2] for line in found} == set(names)
    return found


def run(line: str, *more: str) -> None:
    """Run a command of the page, with further options."""
    app([*shlex.split(line)[1:], *more], exit_on_error=False, result_action="return_value")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_board(tmp_path_factory.mktemp("board"))


@pytest.fixture
def builder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ChairBody:
    """Somebody in an empty folder with the page's mine.yaml; return the dimensions in it."""
    monkeypatch.chdir(tmp_path)
    (text,) = (text for kind, text in BLOCKS if kind == "yaml" and text.strip().startswith("body:"))
    Path("mine.yaml").write_text(text)
    assert yaml.safe_load(text)["body"].keys() <= set(CHAIR_A.__slots__)
    return load_chair("mine.yaml").body


@pytest.fixture
def rig(program: Path, builder: ChairBody, monkeypatch: pytest.MonkeyPatch) -> Iterator[BoardRig]:
    """The chair "mine" at the page's two ports."""
    settings = with_few_beams(SimulatorSettings(plant=PLANT))
    with BoardRig(program, settings, chair_id="mine", body=builder) as rig:
        ports = {"/dev/ttyUSB0": rig.board.transport, "/dev/ttyACM0": rig.sensors}
        for each in (rig.board.transport, rig.sensors):
            monkeypatch.setattr(each, "close", lambda: None)  # the next command opens the same port again
        monkeypatch.setattr("waychair.firmware_bridge.transports.transport_from_text", lambda text, what: ports[text])
        monkeypatch.setattr("waychair.calibration.drives.board_drive.MonotonicClock", lambda: rig)
        yield rig


def drive(rig: BoardRig, monkeypatch: pytest.MonkeyPatch, line: str, *more: str) -> None:
    """Run a command that drives the chair, confirmed by its user, from the middle of an empty hall."""
    monkeypatch.setattr("sys.stdin", io.StringIO("drive\n"))
    run(line, *more)
    rig.wait_until(rig.now_ns() + 3_000_000_000)


def test_the_sweeps_of_the_page_fit_board_name_and_family_and_wait_for_a_word(
    rig: BoardRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(commands("body")[0])
    for line in commands("dac"):
        monkeypatch.setattr("sys.stdin", io.StringIO("no\n"))
        with pytest.raises(BadArgument, match="'drive' was not typed"):
            run(line)
    assert all(state.holder.name == "JOYSTICK" for state in rig.lines)
    other = commands("dac")[0].replace("mine", "thine")
    with pytest.raises(CalibrationMismatch, match="the board is built into chair 'mine'"):
        run(other)


def test_the_stops_of_the_page_go_into_the_chairs_file_beside_what_is_there(
    rig: BoardRig, builder: ChairBody, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(commands("body")[0])
    swept = ChairCalibration("mine", "2026-05-01", load_calibration(Path("mine.json")).body, dac=TRUE, family=FAMILY)
    update_calibration(Path("mine.json"), swept)
    drive(rig, monkeypatch, commands("stop")[0], *LESS["stop"])
    known = load_calibration(Path("mine.json"), "mine")
    assert (known.dac, known.family) == (TRUE, FAMILY)
    assert known.body == replace(builder, chair_id="mine")
    assert known.stops is not None
    check_real(known, "mine.json")


def test_a_chair_whose_dimensions_are_unknown_is_told_when_something_is_measured(
    builder: ChairBody, capsys: pytest.CaptureFixture[str]
) -> None:
    record_rest(Path("rest.mcap"), builder, 25.0)
    run(commands("imu")[0])
    assert "mine.json has the dimensions of the built-in chair A" in capsys.readouterr().err
    run(commands("body")[0])
    assert "built-in" not in capsys.readouterr().err
    known = load_calibration(Path("mine.json"), "mine")
    assert known.imu is not None
    assert known.body == replace(builder, chair_id="mine")
    run(commands("imu")[0])
    assert load_calibration(Path("mine.json")).body == known.body, "no later command forgets the dimensions"
    with pytest.raises(CalibrationError, match="holds no model of the joystick: run `waychair calibrate dac`"):
        check_real(known, "mine.json")


def record_rest(path: Path, body: ChairBody, seconds: float) -> None:
    """Write the bag of a chair that stands."""
    simulator = Simulator(open_hall(), body, with_gyro(SimulatorSettings(plant=PLANT)), SEED)
    with RecordingWriter(path, body.base_from_laser) as writer:
        for message in simulator.advance(round(seconds * 1e9)):
            writer.write(message)


@pytest.mark.nightly
def test_the_page_as_it_is_printed_leaves_a_file_with_every_part(
    rig: BoardRig, builder: ChairBody, monkeypatch: pytest.MonkeyPatch
) -> None:
    record_rest(Path("rest.mcap"), builder, 60.0)
    squares = Simulator(open_hall(WHEELS_HALL, 0.05), builder, with_gyro(SimulatorSettings(plant=PLANT)), SEED)
    drive_route(squares, builder, square_both_ways(squares.truth(), 1.5), Path("squares.mcap"))
    seeing = with_legs(with_all_sensors(SimulatorSettings(plant=PLANT)))
    turning = Simulator(open_hall(TIME_HALL, 0.05), builder, seeing, SEED)
    if turning.camera_problem is not None:
        pytest.skip(f"no camera is simulated: {turning.camera_problem}")
    with RecordingWriter(Path("turns.mcap"), builder.base_from_laser) as writer:
        for message in turns_to_and_fro(turning, 30.0, SEED):
            writer.write(message)
    for line in COMMANDS:
        if line.startswith("waychair calibrate") and "--port" in line:
            drive(rig, monkeypatch, line)
        elif line.startswith(("waychair calibrate", "waychair map")):
            run(line)
    known = load_calibration(Path("mine.json"), "mine")
    check_real(known, "mine.json")
    parts = (known.dac, known.stops, known.imu, known.wheels, known.camera, known.sensor_delays, known.self_mask)
    assert None not in parts
    assert known.body.width == builder.width
    assert known.wheels is not None
    assert known.wheels.left_radius == pytest.approx(PLANT.left_wheel_scale * builder.wheel_radius, rel=0.01)
    assert permitted_speed(known.stops) > UNMEASURED_SPEED
    assert np.isfinite(known.camera.camera_from_laser.translation).all() if known.camera else False


def test_every_command_of_the_page_names_the_chairs_file_or_leads_to_it() -> None:
    told = [line for line in COMMANDS if line.startswith("waychair calibrate")]
    assert len(told) >= 9
    assert all("--chair-id mine" in line for line in told)
    assert all("..." not in line and "#" not in line for line in COMMANDS)
    assert [line for line in COMMANDS if line.startswith("waychair up")]
