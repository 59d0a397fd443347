"""Logs from CSV files, errors that name the line, and the holds in a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waychair.calibration.fits.drive_log import COLUMNS, SweepLog, read_sweep_log, steady_holds, write_sweep_log
from waychair.errors import CalibrationError, ThinData

HEADER = ",".join(COLUMNS)


def _written(tmp_path: Path, *lines: str, header: str = HEADER) -> Path:
    path = tmp_path / "sweep.csv"
    path.write_text("\n".join((header, *lines)) + "\n", encoding="utf-8")
    return path


def test_a_log_is_read_with_its_columns_in_any_order(tmp_path: Path) -> None:
    path = _written(
        tmp_path, "0.1,100,0,note,-0.2,200", "0.3,110,20,,0,210", header="v,forward_counts,stamp_ns,x,omega,turn_counts"
    )
    log = read_sweep_log(path, 8, 5.0)
    assert log.stamps_ns.tolist() == [0, 20]
    assert log.counts.tolist() == [[100, 200], [110, 210]]
    assert log.twists.tolist() == [[0.1, -0.2], [0.3, 0.0]]
    assert log.volts[0].tolist() == pytest.approx([100 * 5 / 255, 200 * 5 / 255])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("20,100,100,fast,0", "line 3: cannot be read"),
        ("20,100,100,0.1", "line 3: cannot be read"),
        ("20,100.5,100,0.1,0", "line 3: cannot be read"),
        ("20,256,100,0.1,0", r"line 3: 256 counts lie outside 0\.\.255"),
        ("20,100,-1,0.1,0", "line 3: -1 counts"),
        ("20,100,100,nan,0", "line 3: v = nan"),
        ("20,100,100,0,inf", "line 3: omega = inf"),
        ("20,100,100,5.1,0", "line 3: v = 5.1"),
        ("0,100,100,0,0", "sample 2: the stamp does not rise"),
    ],
)
def test_an_invalid_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(CalibrationError, match=message):
        read_sweep_log(_written(tmp_path, "0,100,100,0,0", line), 8, 3.3)


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="lacks the column omega"):
        read_sweep_log(_written(tmp_path, header="stamp_ns,forward_counts,turn_counts,v"), 8, 3.3)


def test_an_empty_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ThinData, match="no samples"):
        read_sweep_log(_written(tmp_path), 8, 3.3)


def test_a_missing_file_or_one_that_is_not_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="cannot read"):
        read_sweep_log(tmp_path / "none.csv", 8, 3.3)
    path = tmp_path / "noise.csv"
    path.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(CalibrationError, match="cannot read"):
        read_sweep_log(path, 8, 3.3)


def _log(*parts: tuple[int, float, float]) -> SweepLog:
    """Parts of (forward counts, seconds, speed per second) at 50 Hz; the speed of each begins at counts / 100."""
    counts, v = [], []
    for count, seconds, slope in parts:
        times = np.arange(0.0, seconds, 0.02)
        counts += [(count, 128)] * len(times)
        v += (count / 100 + slope * times).tolist()
    stamps = np.arange(len(v), dtype=np.int64) * 20_000_000
    return SweepLog(stamps, np.array(counts), np.stack([v, np.zeros(len(v))], axis=1), 8, 3.3)


def test_only_long_and_settled_stretches_are_holds() -> None:
    holds = steady_holds(_log((100, 3.0, 0.0), (120, 1.0, 0.0), (140, 3.0, 0.5), (160, 2.2, 0.0)), 1.0, (0.05, 0.1))
    assert len(holds) == 2
    assert (holds.short, holds.unsettled) == (1, 1)
    assert holds.volts[:, 0].tolist() == pytest.approx([100 * 3.3 / 255, 160 * 3.3 / 255])
    assert holds.twists[:, 0].tolist() == pytest.approx([1.0, 1.6])


def test_the_speed_of_a_hold_is_the_mean_of_its_last_part() -> None:
    holds = steady_holds(_log((100, 4.0, 0.01)), 1.0, (0.05, 0.1))
    assert holds.twists[0, 0] == pytest.approx(1.0 + 0.01 * 3.48, abs=0.0003)


def test_a_written_log_is_read_back_unchanged(tmp_path: Path) -> None:
    log = SweepLog(
        np.array([5, 10, 15], np.int64), np.array([[0, 4095], [7, 8], [2048, 1]], np.int64),
        np.array([[0.1, -0.2], [0.0, 0.0], [1.25, 3.14159]]), 12, 3.9, 1.1,
    )  # fmt: skip
    write_sweep_log(tmp_path / "sweep.csv", log)
    again = read_sweep_log(tmp_path / "sweep.csv", 12, 3.9, 1.1)
    assert again.stamps_ns.tolist() == log.stamps_ns.tolist()
    assert again.counts.tolist() == log.counts.tolist()
    assert again.twists == pytest.approx(log.twists)
    assert again.volts[0].tolist() == pytest.approx([1.1, 3.9])
