"""Journeys are kept as they end, so that an interrupted batch goes on where it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from waychair.errors import OutputError
from waychair.trials.travel.journey_runs import keep_record, kept_records
from waychair.trials.travel.journeys import JourneyRecord


def record(arrived: bool = True) -> JourneyRecord:
    return JourneyRecord("0/a", "1/b", arrived, "arrived", 90.0, 0, 0, 0.0, 0, 1, (1.4,), 0.02, {"drive": 60.0})


def test_journeys_of_the_same_world_are_found_again_by_their_seeds(tmp_path: Path) -> None:
    file = tmp_path / "runs" / "journeys.jsonl"
    assert kept_records(file, "hospital", 3, imu=True) == {}
    keep_record(file, "hospital", 3, True, 7, record())
    keep_record(file, "hospital", 3, True, 9, record(arrived=False))
    keep_record(file, "hospital", 0, True, 8, record())
    assert kept_records(file, "hospital", 3, imu=True) == {7: record(), 9: record(arrived=False)}
    assert kept_records(file, "hospital", 3, imu=False) == {}


def test_a_line_that_was_cut_off_is_run_again_and_another_file_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "journeys.jsonl"
    for seed in (1, 2):
        keep_record(file, "two_floors", 0, True, seed, record())
    file.write_bytes(file.read_bytes()[:-20])
    assert list(kept_records(file, "two_floors", 0, imu=True)) == [1]
    keep_record(file, "two_floors", 0, True, 2, record())
    assert list(kept_records(file, "two_floors", 0, imu=True)) == [1, 2]
    notes = tmp_path / "notes.txt"
    notes.write_text("milk\n")
    with pytest.raises(OutputError, match=r"notes\.txt:1 is no journey"):
        kept_records(notes, "two_floors", 0, imu=True)
    assert notes.read_text() == "milk\n"
