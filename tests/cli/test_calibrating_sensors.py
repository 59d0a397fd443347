"""`waychair calibrate time` and `mask`: results are stored, errors are one sentence."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from waychair.calibration.calibration_file import load_calibration
from waychair.calibration.chair_body import CHAIR_A
from waychair.cli.main import app
from waychair.cli.options.arguments import BadArgument
from waychair.errors import CalibrationMismatch, RecordingDamaged, RecordingNotFound, ThinData, WaychairError
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.open_hall import open_hall
from waychair.trials.simulated_calibration import MASK_HALL, scans_while_turning, with_legs


def run(*arguments: str | Path) -> None:
    """Run `waychair calibrate ...`."""
    app(["calibrate", *map(str, arguments)], exit_on_error=False, result_action="return_value")


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of a chair that turned once round, without an IMU."""
    bag = tmp_path_factory.mktemp("turned") / "turned.mcap"
    simulator = Simulator(open_hall(MASK_HALL, 0.05), CHAIR_A, with_legs(SimulatorSettings()), 1)
    with RecordingWriter(bag, CHAIR_A.base_from_laser) as writer:
        for scan in scans_while_turning(simulator):
            writer.write(scan)
    return bag


def test_delays_and_mask_of_a_simulated_chair_are_stored_in_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "chair.json"
    run("time", "--out", out, "--no-camera", "--seconds", "12", "--inject", "40", "20", "0")
    assert "lidar: +" in capsys.readouterr().out
    run("mask", "--out", out)
    kept = load_calibration(out, "sim-0")
    assert kept.sensor_delays is not None
    assert kept.sensor_delays.lidar_ns == pytest.approx(40_000_000, abs=5_000_000)
    assert kept.sensor_delays.wheels_ns == pytest.approx(20_000_000, abs=5_000_000)
    assert kept.self_mask is not None
    assert len(kept.self_mask.begins) == 4
    with pytest.raises(CalibrationMismatch, match="belongs to chair 'sim-0', not 'sim-1'"):
        run("time", "--out", out, "--chair-sim", "1")


def test_a_recording_gives_the_mask_and_an_error_about_data_missing_for_delays(tmp_path: Path, turned: Path) -> None:
    out = tmp_path / "chair.json"
    run("mask", turned, "--chair-id", "ward 3", "--out", out, "--quiet")
    assert load_calibration(out, "ward 3").self_mask is not None
    before = out.read_bytes()
    with pytest.raises(ThinData, match="0 gyro samples tell no turn: record the IMU too"):
        run("time", turned, "--chair-id", "ward 3", "--out", out)
    assert out.read_bytes() == before


@pytest.mark.parametrize("command", ["time", "mask"])
@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("none.mcap", "--chair-id", "x"), RecordingNotFound),
        (("text.bag", "--chair-id", "x"), RecordingDamaged),
        (("text.bag",), BadArgument),
        (("text.bag", "--chair-id", "x", "--chair-sim", "1"), BadArgument),
    ],
)
def test_wrong_arguments_and_files_are_named_and_leave_no_file(
    tmp_path: Path, command: str, arguments: tuple[str, ...], error: type[WaychairError]
) -> None:
    (tmp_path / "text.bag").write_text("no bag at all")
    out = tmp_path / "chair.json"
    with pytest.raises(error):
        run(command, tmp_path / arguments[0], *arguments[1:], "--out", out)
    assert not out.exists()


def test_delays_cannot_be_given_to_a_recording(tmp_path: Path, turned: Path) -> None:
    with pytest.raises(BadArgument, match="--inject needs a simulated chair"):
        run("time", turned, "--chair-id", "x", "--inject", "1", "0", "0", "--out", tmp_path / "chair.json")


def test_a_failure_gives_one_sentence_and_an_exit_status(tmp_path: Path) -> None:
    command = [str(Path(sys.executable).parent / "waychair"), "calibrate", "mask", str(tmp_path / "none.mcap")]
    failed = subprocess.run([*command, "--chair-id", "x", "--quiet"], capture_output=True, text=True, check=False)
    assert failed.returncode == 1
    assert failed.stderr == f"waychair: there is no recording at {tmp_path / 'none.mcap'}; check the path\n"
