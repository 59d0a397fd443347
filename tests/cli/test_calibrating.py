"""`waychair calibrate`: results are added to a chair's file, and results of other chairs are refused."""

from __future__ import annotations

import csv
import io
import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from tests.calibration.drives.board_rig import PLANT, BoardRig
from tests.calibration.synthetic import NEUTRAL, TRUE, SyntheticChair
from waychair.calibration.calibration_file import ChairCalibration, load_calibration, save_calibration
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.drive_log import COLUMNS, read_sweep_log
from waychair.calibration.fits.stopping import UNMEASURED_SPEED, permitted_speed
from waychair.calibration.fits.sweep import SweepSettings, sweep
from waychair.cli.main import app
from waychair.cli.options.arguments import BadArgument
from waychair.errors import (
    BridgeError,
    CalibrationDamaged,
    CalibrationError,
    CalibrationMismatch,
    NotMonotone,
    RecordingError,
    ThinData,
    TransportError,
)
from waychair.firmware_bridge.board import build_board
from waychair.firmware_bridge.transports import open_pseudo_terminal
from waychair.recordings.recording import write_tum
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.open_hall import open_hall
from waychair.trials.record import drive_route
from waychair.trials.simulated_calibration import WHEELS_HALL, square_both_ways
from waychair.trials.simulated_drive import with_few_beams
from waychair.types import JoystickInput, Trajectory


def _run(*arguments: str) -> None:
    app(["calibrate", *arguments], exit_on_error=False, result_action="return_value")


@pytest.fixture(scope="module")
def sweep_csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of a sweep of a known chair."""
    log = sweep(SyntheticChair(), NEUTRAL, SweepSettings(levels=45, combined=2))
    path = tmp_path_factory.mktemp("sweep") / "sweep.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows(
            (int(stamp), *counts, f"{v:.5f}", f"{omega:.5f}")
            for stamp, counts, (v, omega) in zip(log.stamps_ns, log.counts.tolist(), log.twists.tolist(), strict=True)
        )
    return path


FROM_CSV = ("--neutral", str(NEUTRAL[0]), str(NEUTRAL[1]), "--chair-id", "ward 3")


def test_a_logged_sweep_becomes_a_chairs_file_and_a_picture(
    sweep_csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, plot = tmp_path / "chair.json", tmp_path / "fit.png"
    _run("dac", "--csv", str(sweep_csv), *FROM_CSV, "--out", str(out), "--plot", str(plot))
    calibration = load_calibration(out, "ward 3")
    assert calibration.dac is not None
    assert calibration.dac.forward.above.limit == pytest.approx(TRUE.forward.above.limit, rel=0.02)
    assert plot.stat().st_size > 10_000
    said = capsys.readouterr().out
    assert "forward: dead band" in said
    assert "rms" in said


def test_on_blocks_the_dead_bands_are_printed_and_nothing_is_written(
    sweep_csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "chair.json"
    _run("dac", "--blocks", "--csv", str(sweep_csv), *FROM_CSV, "--out", str(out))
    said = capsys.readouterr().out
    assert "forward: neutral 1.640 V" in said
    assert "turn: neutral 1.660 V" in said
    assert "below is positive" in said
    assert not out.exists()


def test_a_sweep_of_another_chair_does_not_change_the_file_of_this_one(sweep_csv: Path, tmp_path: Path) -> None:
    out = tmp_path / "chair.json"
    save_calibration(out, ChairCalibration("sim-1", "2026-01-31"))
    with pytest.raises(CalibrationMismatch, match="'sim-1', not 'ward 3'"):
        _run("dac", "--csv", str(sweep_csv), *FROM_CSV, "--out", str(out), "--quiet")


def test_a_csv_needs_a_neutral_and_a_chairs_name(sweep_csv: Path, tmp_path: Path) -> None:
    with pytest.raises(BadArgument, match="--neutral"):
        _run("dac", "--csv", str(sweep_csv), "--out", str(tmp_path / "chair.json"))


def test_an_incomplete_sweep_is_refused_and_nothing_is_written(sweep_csv: Path, tmp_path: Path) -> None:
    out, part = tmp_path / "chair.json", tmp_path / "part.csv"
    part.write_text("".join(sweep_csv.read_text().splitlines(keepends=True)[:10_000]))
    with pytest.raises(ThinData, match="too few"):
        _run("dac", "--csv", str(part), *FROM_CSV, "--out", str(out), "--quiet")
    assert not out.exists()


def test_stops_need_a_model_first(tmp_path: Path) -> None:
    out = tmp_path / "chair.json"
    with pytest.raises(CalibrationError, match="calibrate dac"):
        _run("stop", "--out", str(out))
    save_calibration(out, ChairCalibration("sim-0", "2026-01-31"))
    with pytest.raises(CalibrationError, match="holds no model of the joystick"):
        _run("stop", "--out", str(out))


def test_one_file_collects_all_measurements_of_a_chair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "chair.json"
    _run("imu", "--chair-sim", "3", "--seconds", "20", "--out", str(out))
    _run("wheels", "--chair-sim", "3", "--out", str(out))
    calibration = load_calibration(out, "sim-3")
    assert calibration.imu is not None
    assert calibration.wheels is not None
    assert calibration.dac is None
    said = capsys.readouterr().out
    assert "gyro bias" in said
    assert "radius" in said


def test_less_speed_at_more_stick_is_refused_and_nothing_is_written(sweep_csv: Path, tmp_path: Path) -> None:
    out, bent = tmp_path / "chair.json", tmp_path / "bent.csv"
    head, *rows = sweep_csv.read_text().splitlines()
    fast = [row.split(",") for row in rows]
    weak = [",".join([*row[:3], f"{0.5 * float(row[3]):.5f}", row[4]] if int(row[1]) > 3200 else row) for row in fast]
    bent.write_text("\n".join([head, *weak]) + "\n")
    with pytest.raises(NotMonotone, match="forward axis above neutral"):
        _run("dac", "--csv", str(bent), *FROM_CSV, "--out", str(out), "--quiet")
    assert not out.exists()


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("x,2000,2000,0.1,0.1", "line 3: cannot be read as numbers"),
        ("99,9999,2000,0.1,0.1", r"9999 counts lie outside 0\.\.4095"),
        ("99,2000,2000,nan,0.1", "v = nan is no speed of a chair"),
        ("99,2000", "line 3: cannot be read as numbers"),
    ],
)
def test_an_invalid_line_of_a_log_is_refused_by_its_number(tmp_path: Path, line: str, says: str) -> None:
    path = tmp_path / "sweep.csv"
    path.write_text(",".join(COLUMNS) + "\n98,2000,2000,0.1,0.1\n" + line + "\n")
    with pytest.raises(CalibrationError, match=says):
        _run("dac", "--csv", str(path), *FROM_CSV, "--out", str(tmp_path / "chair.json"))


def test_an_edited_file_is_refused(sweep_csv: Path, tmp_path: Path) -> None:
    out = tmp_path / "chair.json"
    save_calibration(out, ChairCalibration("ward 3", "2026-01-31"))
    out.write_text(out.read_text().replace("2026-01-31", "2026-02-01"))
    with pytest.raises(CalibrationDamaged, match="altered"):
        _run("dac", "--csv", str(sweep_csv), *FROM_CSV, "--out", str(out), "--quiet")


def test_stops_of_a_simulated_chair_go_into_its_file_and_permit_more_than_a_crawl(tmp_path: Path) -> None:
    out = tmp_path / "chair.json"
    save_calibration(out, ChairCalibration("sim-0", "2026-01-31", dac=replace(TRUE)))
    assert permitted_speed(load_calibration(out).stops) == UNMEASURED_SPEED
    _run("stop", "--out", str(out), "--fastest", "0.5", "--repetitions", "1", "--quiet")
    stops = load_calibration(out, "sim-0").stops
    assert stops is not None
    assert stops.speeds[0] == pytest.approx(0.2, abs=0.05)
    assert permitted_speed(stops) > UNMEASURED_SPEED


# --- a real chair: its board is the shipped firmware; only time, plant and sensors are simulated


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_board(tmp_path_factory.mktemp("board"))


@pytest.fixture
def rig(program: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[BoardRig]:
    """Yield a chair at the ports `board` and `sensors`, in simulated time, with a confirmation on standard input."""
    with BoardRig(program) as rig:
        ports = {"--port": rig.board.transport, "--sensors": rig.sensors}
        monkeypatch.setattr(
            "waychair.firmware_bridge.transports.transport_from_text", lambda text, option: ports[option]
        )
        monkeypatch.setattr("waychair.calibration.drives.board_drive.MonotonicClock", lambda: rig)
        monkeypatch.setattr("sys.stdin", io.StringIO("drive\n"))
        yield rig


REAL = ("--port", "board", "--sensors", "sensors", "--family", "eight_pin_3v3", "--quiet")
SWEEP = ("dac", *REAL, "--chair-id", "ward 3", "--levels", "11", "--repetitions", "1")


def test_the_dead_bands_of_a_real_chair_on_blocks_are_measured_through_its_board(
    rig: BoardRig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "chair.json"
    _run(*SWEEP, "--blocks", "--swing", "0.4", "--out", str(out))
    said = capsys.readouterr()
    assert f"forward: neutral {PLANT.neutral_volts:.3f} V" in said.out
    assert "turn: neutral" in said.out
    assert "Chair 'ward 3' will drive by itself" in said.err
    assert not out.exists()
    log = read_sweep_log(tmp_path / "chair.sweep.csv", 12, 3.3)
    assert np.abs(log.volts - PLANT.neutral_volts).max() == pytest.approx(0.4, abs=0.01)


def test_the_stops_of_a_real_chair_are_measured_through_its_board(rig: BoardRig, tmp_path: Path) -> None:
    out = tmp_path / "chair.json"
    save_calibration(out, ChairCalibration("ward 3", "2026-01-31", dac=TRUE))
    _run("stop", *REAL, "--fastest", "0.4", "--repetitions", "1", "--out", str(out))
    stops = load_calibration(out, "ward 3").stops
    assert stops is not None
    assert 0.05 < stops.delay_s < 0.4
    assert (tmp_path / "chair.stops.csv").exists()


@pytest.mark.parametrize(
    ("event", "error", "says"),
    [
        (lambda rig: setattr(rig, "stick", JoystickInput(0, turn=0.9)), BridgeError, "joystick was touched"),
        (lambda rig: rig.board.transport.close(), TransportError, "cable to the board was lost"),
        (lambda rig: rig.pull_sensors(), TransportError, "cable to the sensors was lost"),
    ],
)
def test_an_interrupted_sweep_tells_the_cause_and_the_place_of_its_log(
    rig: BoardRig, tmp_path: Path, event: Callable[[BoardRig], None], error: type[Exception], says: str
) -> None:
    out, part = tmp_path / "chair.json", tmp_path / "chair.sweep.csv.part"
    rig.events.append((9000, lambda: event(rig)))
    with pytest.raises(error, match=f"{says}.*; the samples until then are in {part}"):
        _run(*SWEEP, "--out", str(out))
    assert len(read_sweep_log(part, 12, 3.3).stamps_ns) > 300
    assert not out.exists()
    assert {path.name for path in tmp_path.iterdir()} == {part.name}


def test_ctrl_c_releases_the_lines_and_keeps_the_log(rig: BoardRig, tmp_path: Path) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    rig.events.append((3000, interrupt))
    with pytest.raises(KeyboardInterrupt) as stopped:
        _run(*SWEEP, "--out", str(tmp_path / "chair.json"))
    assert stopped.value.__notes__ == [f"the samples until then are in {tmp_path / 'chair.sweep.csv.part'}"]
    assert rig.board.transport.closed
    rig.wait_until(rig.now_ns() + 200_000_000)
    assert rig.lines[-1].holder.name == "JOYSTICK"


@pytest.mark.parametrize("word", ["", "no\n"])
def test_without_a_confirmation_the_real_chair_does_not_move(
    rig: BoardRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, word: str
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(word))
    with pytest.raises(BadArgument, match="'drive' was not typed"):
        _run(*SWEEP, "--out", str(tmp_path / "chair.json"))
    assert all(state.holder.name == "JOYSTICK" for state in rig.lines)
    assert list(tmp_path.iterdir()) == []


def test_the_file_of_another_chair_is_refused_before_anything_moves(rig: BoardRig, tmp_path: Path) -> None:
    out = tmp_path / "chair.json"
    save_calibration(out, ChairCalibration("ward 9", "2026-01-31"))
    with pytest.raises(CalibrationMismatch, match="'ward 9', not 'ward 3'"):
        _run(*SWEEP, "--out", str(out))
    assert rig.lines == []


def test_firmware_with_another_hash_is_refused_before_anything_moves(
    rig: BoardRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("waychair.firmware_bridge.protocol.LAYOUT_HASH", 1)
    with pytest.raises(BridgeError, match="this computer's 00000001: flash the firmware"):
        _run(*SWEEP, "--out", str(tmp_path / "chair.json"))
    assert all(state.holder.name == "JOYSTICK" for state in rig.lines)


@pytest.mark.parametrize(
    ("port", "error", "says"),
    [
        ("ttyUSB0", TransportError, "--port must be /dev/..."),
        ("tcp:localhost", TransportError, "needs a host and a number"),
        ("/dev/no_such_port", TransportError, "there is no serial port /dev/no_such_port"),
        ("pty:/dev/pts/none", TransportError, "there is no terminal /dev/pts/none"),
        ("tcp:127.0.0.1:1", TransportError, "cannot connect"),
    ],
)
def test_an_impossible_port_is_refused(port: str, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        _run("dac", "--port", port, "--sensors", port, "--chair-id", "ward 3")


@pytest.mark.parametrize(
    "arguments", [("--port", "/dev/x"), ("--port", "/dev/x", "--chair-id", "a", "--chair-sim", "1")]
)
def test_a_real_chair_needs_a_name_and_cannot_be_simulated_too(arguments: tuple[str, ...]) -> None:
    with pytest.raises(BadArgument, match="--chair-id"):
        _run("dac", *arguments)


def test_over_a_real_terminal_a_board_of_another_chair_is_refused_in_one_sentence(
    program: Path, tmp_path: Path
) -> None:
    board, computer, path = open_pseudo_terminal()
    sensors, far, sensors_path = open_pseudo_terminal()
    os.set_blocking(board, False)
    words = [str(program), "--serial-fd", str(board), "--realtime", "--chair", "ward 3"]
    running = subprocess.Popen(words, pass_fds=(board,), stdin=subprocess.DEVNULL)
    try:
        waychair = str(Path(sys.executable).parent / "waychair")
        ports = ("--port", f"pty:{path}", "--sensors", f"pty:{sensors_path}", "--chair-id", "ward 4")
        done = subprocess.run(
            [waychair, "calibrate", "dac", *ports, "--out", str(tmp_path / "chair.json")],
            input="drive\n",
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        running.kill()
        running.wait()
        for descriptor in (board, computer, sensors, far):
            os.close(descriptor)
    assert done.returncode == 1
    assert done.stderr.startswith("waychair: the board is built into chair 'ward 3' and this calibration is of")
    assert done.stderr.count("\n") == 1


# --- recordings of real drives


@pytest.fixture(scope="module")
def squares(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of two squares in each direction, with trajectory.tum beside it."""
    folder = tmp_path_factory.mktemp("squares")
    simulator = Simulator(open_hall(WHEELS_HALL, 0.05), CHAIR_A, with_few_beams(SimulatorSettings(plant=PLANT)), 4)
    drive_route(simulator, CHAIR_A, square_both_ways(simulator.truth(), 1.5), folder / "squares.mcap")
    return folder


def _truth(folder: Path) -> Path:
    """Write the true trajectory of a bag, as if it had been mapped."""
    stamps, poses = [], []
    with AnyReader([folder / "squares.mcap"]) as bag:
        wanted = [connection for connection in bag.connections if connection.topic == "/ground_truth/odom"]
        for connection, stamp_ns, raw in bag.messages(wanted):
            pose = bag.deserialize(raw, connection.msgtype).pose.pose  # type: ignore[attr-defined]
            stamps.append(stamp_ns)
            poses.append((pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)))
    path = folder / "trajectory.tum"
    write_tum(path, Trajectory(np.array(stamps, np.int64), np.array(poses)))
    return path


def test_wheels_are_found_from_a_recording_and_its_mapped_trajectory(squares: Path, tmp_path: Path) -> None:
    out = tmp_path / "chair.json"
    _run("wheels", "--recording", str(squares / "squares.mcap"), "--trajectory", str(_truth(squares)),
         "--chair-id", "ward 3", "--out", str(out), "--quiet")  # fmt: skip
    wheels = load_calibration(out, "ward 3").wheels
    assert wheels is not None
    assert wheels.left_radius == pytest.approx(PLANT.left_wheel_scale * CHAIR_A.wheel_radius, rel=0.004)
    assert wheels.right_radius == pytest.approx(PLANT.right_wheel_scale * CHAIR_A.wheel_radius, rel=0.004)
    assert wheels.track == pytest.approx(PLANT.track_scale * CHAIR_A.track, rel=0.008)


def test_unsuitable_recordings_are_refused(squares: Path, tmp_path: Path) -> None:
    bag, tum = str(squares / "squares.mcap"), tmp_path / "other.tum"
    tum.write_text("1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n")
    with pytest.raises(CalibrationError, match="share no time"):
        _run("wheels", "--recording", bag, "--trajectory", str(tum), "--chair-id", "w", "--out", str(tmp_path / "c"))
    with pytest.raises(RecordingError, match="holds no sensor_msgs/msg/Imu"):
        _run("imu", "--recording", bag, "--chair-id", "w", "--out", str(tmp_path / "c"))
    with pytest.raises(RecordingError, match="is not a bag"):
        _run("imu", "--recording", str(tum), "--chair-id", "w", "--out", str(tmp_path / "c"))
    with pytest.raises(BadArgument, match="--trajectory belong together"):
        _run("wheels", "--recording", bag, "--chair-id", "w")
