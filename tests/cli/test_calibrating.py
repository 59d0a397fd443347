"""`waychair calibrate`: a chair's file grows by what is measured, and refuses what does not belong to it."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from tests.calibration.synthetic import NEUTRAL, TRUE, SyntheticChair
from waychair.calibration.calibration_file import ChairCalibration, load_calibration, save_calibration
from waychair.calibration.drive_log import COLUMNS
from waychair.calibration.sweep import SweepSettings, sweep
from waychair.cli.arguments import BadArgument
from waychair.cli.calibrating import calibrate_app
from waychair.errors import CalibrationError, CalibrationMismatch, ThinData


def _run(*arguments: str) -> None:
    calibrate_app([*arguments], exit_on_error=False, result_action="return_value")


@pytest.fixture(scope="module")
def sweep_csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of a known chair, as somebody might have logged it."""
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


def test_a_sweep_of_another_chair_does_not_go_into_this_ones_file(sweep_csv: Path, tmp_path: Path) -> None:
    out = tmp_path / "chair.json"
    save_calibration(out, ChairCalibration("sim-1", "2026-01-31"))
    with pytest.raises(CalibrationMismatch, match="'sim-1', not 'ward 3'"):
        _run("dac", "--csv", str(sweep_csv), *FROM_CSV, "--out", str(out), "--quiet")


def test_a_csv_needs_its_neutral_and_its_chairs_name(sweep_csv: Path, tmp_path: Path) -> None:
    with pytest.raises(BadArgument, match="--neutral"):
        _run("dac", "--csv", str(sweep_csv), "--out", str(tmp_path / "chair.json"))


def test_a_sweep_that_was_broken_off_is_refused_and_nothing_is_written(sweep_csv: Path, tmp_path: Path) -> None:
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
    with pytest.raises(CalibrationError, match="no model of the joystick yet"):
        _run("stop", "--out", str(out))


def test_one_file_collects_what_is_measured_of_a_chair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
