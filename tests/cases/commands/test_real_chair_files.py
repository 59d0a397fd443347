"""A real chair is driven by its own file only: refusals of `waychair up`, of the bridge's cable, and the joystick's family."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from waychair.calibration.calibration_file import (
    ChairCalibration,
    check_real,
    content_hash,
    load_calibration,
    save_calibration,
    update_calibration,
)
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.calibration.fits.dac import DEFAULT
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.errors import (
    CalibrationDamaged,
    CalibrationError,
    CalibrationMismatch,
    ConfigError,
    TransportError,
    WaychairError,
)
from waychair.firmware_bridge.board import BoardSettings, HostBoard, at_rest, board_program
from waychair.firmware_bridge.bridge import Bridge, BridgeSettings, with_family_of
from waychair.firmware_bridge.protocol import Family
from waychair.firmware_bridge.real_boards import check_cable, is_real, open_cable
from waychair.firmware_bridge.transports import Reconnecting, open_pseudo_terminal
from waychair.ros.stack import Stack
from waychair.ros.stack_checks import check_chair, check_folders
from waychair.runtime.chair import ChairSettings
from waychair.trials.simulated_stops import simulated_calibration

OWN_BODY = replace(CHAIR_A, chair_id="mine", width=0.66)
MINE = ChairCalibration("mine", "2026-05-01", OWN_BODY, dac=FittedDac(), family="hall_5v")


@pytest.fixture
def terminal() -> Iterator[str]:
    """The path of a terminal, as of a simulated board."""
    board, computer, path = open_pseudo_terminal()
    yield path
    os.close(board)
    os.close(computer)


def stack(tmp_path: Path, known: ChairCalibration | None = MINE, **parts: object) -> Stack:
    """A run with a chair's file."""
    path = None if known is None else tmp_path / "chair.json"
    if path is not None and known is not None:
        save_calibration(path, known)
    return replace(Stack(tmp_path, calibration=path), **parts)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("known", "parts", "error", "sentence"),
    [
        (None, {"cable": "/dev/ttyUSB0"}, ConfigError, "--cable needs --chair: a real chair is driven by its own file"),
        (None, {"cable": "pty:/tmp/x"}, ConfigError, "--cable needs --chair"),
        (MINE, {}, ConfigError, "--chair needs --cable"),
        (MINE, {"world": "small_clinic", "cable": "/dev/ttyUSB0"}, ConfigError, "--sim and --cable exclude each other"),
        (MINE, {"world": "small_clinic"}, CalibrationMismatch, "of chair 'mine', and the simulated chair is 'A'"),
        (MINE, {"cable": "ttyUSB0"}, TransportError, "--cable must be /dev/"),
        (replace(MINE, dac=None), {"cable": "/dev/ttyUSB0"}, CalibrationError, "holds no model of the joystick"),
        (replace(MINE, dac=None), {"cable": "/dev/pts/999"}, CalibrationError, "holds no model of the joystick"),
        (replace(MINE, body=CHAIR_B), {"cable": "/dev/ttyUSB0"}, CalibrationMismatch, "of the built-in chair 'B'"),
        (
            replace(MINE, chair_id="sim-4"),
            {"cable": "/dev/ttyUSB0"},
            CalibrationMismatch,
            "the simulated chair 'sim-4'",
        ),
        (
            replace(MINE, simulated=True),
            {"cable": "tcp:chair:9000"},
            CalibrationMismatch,
            "is driven by its own file only",
        ),
    ],
)
def test_a_chair_that_must_not_be_driven_by_a_file_is_refused_before_any_node_starts(
    tmp_path: Path, known: ChairCalibration | None, parts: dict[str, object], error: type[WaychairError], sentence: str
) -> None:
    with pytest.raises(error, match=sentence):
        check_chair(stack(tmp_path, known, **parts), ChairSettings())


def test_the_chairs_own_measured_file_may_drive_it(tmp_path: Path) -> None:
    assert check_chair(stack(tmp_path, cable="/dev/ttyUSB0"), ChairSettings()) == MINE
    assert check_chair(stack(tmp_path, None, world="small_clinic"), ChairSettings()) is None


@pytest.mark.parametrize("name", ["nowhere.json", "."])
def test_a_file_that_is_none_is_told_once(tmp_path: Path, name: str) -> None:
    with pytest.raises(CalibrationError, match="cannot read"):
        check_chair(Stack(tmp_path, calibration=tmp_path / name, world="small_clinic"), ChairSettings())


def test_a_folder_of_the_run_that_is_a_file_is_told_before_any_node_starts(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for wrong in (Stack(tmp_path / "file"), Stack(tmp_path, box=tmp_path / "file" / "box")):
        with pytest.raises(WaychairError, match="is a file: name another one"):
            check_folders(wrong)
    check_folders(Stack(tmp_path / "new" / "run", box=tmp_path / "new" / "box"))


@pytest.mark.parametrize(
    ("cable", "real"),
    [
        ("/dev/ttyUSB0", True),
        ("/dev/no_such_port", True),
        ("tcp:chair:9000", True),
        ("pty:/tmp/run/board", False),
        ("/dev/pts/7", False),
    ],
)
def test_only_terminals_of_this_computer_lead_to_simulated_boards(cable: str, real: bool) -> None:
    assert is_real(cable) is real


def test_a_simulated_calibration_meets_a_simulated_board_and_no_real_one(tmp_path: Path, terminal: str) -> None:
    simulated = simulated_calibration(CHAIR_A)
    assert simulated.is_simulated
    open_cable(terminal, simulated).close()
    measured = replace(MINE, chair_id="sim-0")
    check_cable(terminal, measured, "chair.json")
    for cable in ("/dev/ttyUSB0", "tcp:127.0.0.1:9"):
        with pytest.raises(CalibrationMismatch):
            check_cable(cable, measured, "chair.json")
        with pytest.raises(
            TransportError, match="the port of a real board, which the calibration of the simulated chair"
        ):
            open_cable(cable, simulated)
    link = tmp_path / "board"
    link.symlink_to("/dev/null")  # where a simulated board was
    with pytest.raises(TransportError, match="the port of a real board"):
        open_cable(f"pty:{link}", simulated)
    link.unlink()
    with pytest.raises(TransportError, match="there is no terminal"):
        open_cable(f"pty:{link}", simulated)


def test_a_mark_of_the_simulator_stays_and_old_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "chair.json"
    save_calibration(path, replace(MINE, simulated=True))
    assert update_calibration(path, replace(MINE, dac=None)).simulated
    assert load_calibration(path).dac == MINE.dac
    assert load_calibration(path).family == "hall_5v"
    assert content_hash(MINE) != content_hash(replace(MINE, family=None))
    text = path.read_text()
    path.write_text(text.replace("hall_5v", "hall_6v"))
    with pytest.raises(CalibrationDamaged):
        load_calibration(path)


def test_the_family_of_the_file_is_that_of_the_bridge() -> None:
    assert with_family_of(BridgeSettings(), MINE).family == Family.HALL_5V
    assert with_family_of(BridgeSettings(family=1), MINE).family == Family.HALL_5V
    unknown = replace(MINE, family=None)
    assert with_family_of(BridgeSettings(family=2), unknown).family == Family.INDUCTIVE_12V
    with pytest.raises(
        CalibrationMismatch, match=r"`bridge.family: 3` is set, and the file of chair 'mine' is of .*hall_5v"
    ):
        with_family_of(BridgeSettings(family=3), MINE)


def test_a_board_of_the_files_family_is_accepted_and_another_one_is_named_with_both_remedies() -> None:
    for family in (Family.HALL_5V, Family.INDUCTIVE_12V):
        with HostBoard(board_program(), BoardSettings(chair_id="mine", family=family)) as board:
            cable = Reconnecting(lambda board=board: board.transport)
            bridge = Bridge(cable, DEFAULT, "mine", with_family_of(BridgeSettings(), MINE))
            for ms in range(10, 200, 10):
                bridge.listen(ms * 1_000_000)
                board.step(ms, at_rest(family))
            told = " ".join(bridge.trouble)
            if family is Family.HALL_5V:
                assert "made for joystick family" not in told
            else:
                assert "made for joystick family 2 (inductive_12v) and the computer is set to 1 (hall_5v)" in told
                assert "`waychair calibrate dac`" in told
                assert "`bridge.family: 2`" in told


def test_names_of_families_are_those_of_the_firmware() -> None:
    from typing import get_args

    from waychair.calibration.calibration_file import JoystickFamily
    from waychair.cli.options import chair_options

    assert set(get_args(JoystickFamily)) == {family.name.lower() for family in Family if family}
    assert get_args(chair_options.JoystickFamily) == get_args(JoystickFamily)


def test_the_sketch_has_no_name_of_a_chair_until_somebody_writes_one() -> None:
    from waychair.errors import BoardBuildError
    from waychair.firmware_bridge.board import FIRMWARE, compile_c

    shims = Path(__file__).parents[2] / "firmware_bridge" / "shims"
    words = ["-fsyntax-only", f"-I{shims}", f"-I{FIRMWARE}", str(FIRMWARE / "esp32" / "sketch.c")]
    with pytest.raises(BoardBuildError, match=r"write the chair.s name and its joystick family into sketch\.c"):
        compile_c(words)
    compile_c(['-DCHAIR_ID="mine"', "-DCHAIR_FAMILY=FAMILY_HALL_5V", *words])


def test_a_built_in_body_is_no_measured_one() -> None:
    check_real(MINE, "mine.json")
    with pytest.raises(CalibrationMismatch, match="dimensions of the built-in chair 'A'"):
        check_real(replace(MINE, body=CHAIR_A), "mine.json")
