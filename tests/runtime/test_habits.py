"""The rider's habits: nothing before the yes, everything after it, nothing after erasing; damaged files and full disks."""

from __future__ import annotations

import csv
import io
import stat
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from tests.full_disk import content, files_up_to
from waychair.control.guidance.practice import DecisionMade, Practice, RiderDecision
from waychair.errors import HabitsError, OutputError
from waychair.planning.movements import MovementKind
from waychair.runtime.rider.habits import DecisionRow, DriveRow, Habits

DAY = datetime(2026, 11, 26, 14, 5)
MADE = DecisionMade("Ground/c2", MovementKind.LEFT, RiderDecision.FOLLOWED, 0.0, 1)
COUNTS = {"stops": 2, "reversals": 1, "interventions": 0, "prompts": 5, "replans": 1}


def habits(folder: Path, now: datetime = DAY) -> Habits:
    return Habits(folder / "chair" / "habits.jsonl", lambda: now)


def used(known: Habits) -> None:
    known.note_decision(MADE)
    known.note_drive("Ground/Ward/Bed", arrived=True, seconds=61.24, expected_s=50.0, counts=COUNTS)


def test_without_the_riders_yes_nothing_at_all_is_on_disk(tmp_path: Path) -> None:
    known = habits(tmp_path)
    used(known)
    assert content(tmp_path) == {}
    assert known.rows() == ()


def test_after_the_yes_what_is_recorded_is_read_again_and_only_the_owner_may_read_it(tmp_path: Path) -> None:
    known = habits(tmp_path)
    known.say_yes()
    used(known)
    path = tmp_path / "chair" / "habits.jsonl"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    again = habits(tmp_path)
    assert again.wanted
    assert again.rows() == known.rows()
    assert again.rows() == (
        DecisionRow("2026-11-26", "Ground/c2", "left", "followed", 0.0, 1),
        DriveRow("2026-11-26", 14, "Ground/Ward/Bed", True, 61.2, 50.0, 2, 1, 0, 5, 1),
    )


def test_a_no_ends_recording_also_in_the_next_run_and_keeps_what_there_is(tmp_path: Path) -> None:
    known = habits(tmp_path)
    known.say_yes()
    used(known)
    known.say_no()
    used(known)
    again = habits(tmp_path)
    assert not again.wanted
    assert len(again.rows()) == 2


def test_erasing_leaves_no_file_and_no_yes(tmp_path: Path) -> None:
    known = habits(tmp_path)
    known.say_yes()
    used(known)
    (tmp_path / "chair" / ".habits.half.jsonl").write_text("Ground/Ward/Bed")  # of a writer that was killed
    known.erase()
    assert [name for name, data in content(tmp_path).items() if data is not None] == []
    used(known)
    assert not habits(tmp_path).wanted
    assert habits(tmp_path).rows() == ()


def test_the_export_equals_what_was_recorded(tmp_path: Path) -> None:
    known = habits(tmp_path)
    known.say_yes()
    used(known)
    known.note_drive('Ward "A", bed 2', arrived=False, seconds=5.0, expected_s=9.0, counts={})
    table = list(csv.DictReader(io.StringIO(known.csv())))
    assert [row["kind"] for row in table] == ["decision", "drive", "drive"]
    assert (table[0]["place"], table[0]["done"], table[0]["goal"]) == ("Ground/c2", "followed", "")
    assert (table[1]["goal"], table[1]["seconds"], table[1]["hour"]) == ("Ground/Ward/Bed", "61.2", "14")
    assert (table[2]["goal"], table[2]["arrived"]) == ('Ward "A", bed 2', "False")


def test_rows_older_than_ninety_days_are_forgotten_on_disk_as_well(tmp_path: Path) -> None:
    old = habits(tmp_path, DAY - timedelta(days=91))
    old.say_yes()
    used(old)
    habits(tmp_path, DAY - timedelta(days=89)).note_decision(MADE)
    known = habits(tmp_path)
    assert [row.day for row in known.rows()] == [f"{DAY - timedelta(days=89):%Y-%m-%d}"]
    path = tmp_path / "chair" / "habits.jsonl"
    assert "Bed" not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert habits(tmp_path).wanted


def test_a_line_cut_off_by_a_crash_is_dropped_and_the_next_one_is_whole(tmp_path: Path) -> None:
    known = habits(tmp_path)
    known.say_yes()
    used(known)
    path = tmp_path / "chair" / "habits.jsonl"
    path.write_bytes(path.read_bytes()[:-20])
    again = habits(tmp_path)
    assert len(again.rows()) == 1
    again.note_decision(MADE)
    assert len(habits(tmp_path).rows()) == 2


@pytest.mark.parametrize(
    "line",
    [
        b"\x00\xff rubbish",
        b'{"kind": "drive"}',
        b'{"kind": "theft", "day": "2026-11-26"}',
        b"[1, 2]",
        b'{"kind": "decision", "day": "2026-11-26", "place": "c", "proposed": "fly", "done": "other", "hesitation_s": 0, "prompts": 0}',
        b'{"kind": "decision", "day": "2026-11-26", "place": 7, "proposed": "left", "done": "other", "hesitation_s": 0, "prompts": 0}',
    ],
)
def test_a_damaged_file_is_named_by_its_line_not_touched_and_records_nothing(tmp_path: Path, line: bytes) -> None:
    known = habits(tmp_path)
    known.say_yes()
    used(known)
    path = tmp_path / "chair" / "habits.jsonl"
    path.write_bytes(path.read_bytes() + line + b"\n")
    before = path.read_bytes()
    damaged = habits(tmp_path)
    assert f"{path}:5 is damaged" in damaged.trouble
    used(damaged)
    assert path.read_bytes() == before
    with pytest.raises(HabitsError):
        damaged.say_yes()
    damaged.erase()
    assert not path.exists()


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "chair" / "habits.jsonl"
    path.parent.mkdir()
    path.write_text('{"kind": "yes"}\n')
    assert "no record of habits" in habits(tmp_path).trouble


def test_on_a_full_disk_a_row_is_dropped_whole_the_trouble_is_said_and_the_next_row_fits_again(tmp_path: Path) -> None:
    known = habits(tmp_path)
    with files_up_to(30), pytest.raises(OutputError):
        known.say_yes()
    assert not known.wanted
    known.say_yes()
    used(known)
    path = tmp_path / "chair" / "habits.jsonl"
    before = path.read_bytes()
    with files_up_to(len(before) + 20):
        known.note_decision(MADE)
    assert "are not kept" in known.trouble
    assert path.read_bytes() == before
    known.note_decision(MADE)
    assert known.trouble == ""
    assert habits(tmp_path).rows() == known.rows()
    assert len(known.rows()) == 3


def test_practice_and_favourites_come_from_the_record(tmp_path: Path) -> None:
    known = habits(tmp_path)
    known.say_yes()
    for _ in range(3):
        used(known)
    assert known.practice() == {"Ground/c2": Practice(1)}
    assert known.visits() == {"Ground/Ward/Bed": 3}
    assert habits(tmp_path, DAY + timedelta(days=61)).visits() == {}
