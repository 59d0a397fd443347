"""The trainer's record: nothing before the rider's yes, one row a drive, erased at a press; and what was learnt of a rider."""

from __future__ import annotations

import csv
import io
import json
import stat
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import pytest

from waychair.control.haptics.learning import KEPT, RiderLearner
from waychair.control.haptics.rider import RiderModel
from waychair.errors import LearntError, OutputError
from waychair.runtime.haptics.haptic_state import HapticInputs, HapticState
from waychair.runtime.haptics.learnt_file import forget_learnt, load_learner, save_learner
from waychair.runtime.haptics.session_log import Counted, GuidedDriveRow, SessionCounter, SessionLog
from waychair.types import GuardReport, HelpLevel, Twist

TICK_NS = 50_000_000
FREE = GuardReport((1.0, 1.0, 1.0, 1.0), capped=False, warns=False, overridden=False, lost=False)
HELD = replace(FREE, capped=True)


def _drive(counter: SessionCounter) -> None:
    """Ten seconds at 0.4 m/s towards the desk, held back for one of them; two symbols, one of them not felt; one repeated."""
    count = 0
    for tick in range(201):
        now = HapticInputs(
            tick * TICK_NS, None, Twist(0.4, 0.0), HelpLevel.GUIDE, guard=HELD if 40 <= tick < 60 else FREE
        )
        state = HapticState(now.now_ns, HelpLevel.GUIDE, goal="desk", symbol="forward", count=count)
        if tick in (20, 80):
            count += 1
            state = replace(state, count=count, unfelt="motor 4 is open" if tick == 80 else "")
        counter.note(now, state, asked=tick == 80)
    counter.note(
        HapticInputs(201 * TICK_NS, None, Twist(), HelpLevel.GUIDE),
        HapticState(201 * TICK_NS, arrived=True, reason="arrived", count=count),
        asked=False,
    )


def test_nothing_is_kept_before_a_yes_and_a_drive_is_one_row_after_it(tmp_path: Path) -> None:
    path = tmp_path / "drives.jsonl"
    log = SessionLog(path, lambda: datetime(2026, 5, 4, 15, 30))
    touches = iter([3, 5, 3, 5])
    counter = SessionCounter(log, lambda: next(touches))
    _drive(counter)
    assert not path.exists()
    log.say_yes()
    counter = SessionCounter(log, iter([3, 5, 5]).__next__)
    _drive(counter)
    assert log.rows() == (
        GuidedDriveRow(
            "2026-05-04", 15, "desk", "guide", True, "arrived", 10.0, 4.0, 2, 1, 1.0, 0, 2, 0, 1, 1, "forward 2"
        ),
    )
    assert SessionLog(path, lambda: datetime(2026, 5, 4)).rows() == log.rows()
    (row,) = csv.DictReader(io.StringIO(log.csv()))
    assert (row["touches"], row["distance_m"], row["by_symbol"]) == ("2", "4.0", "forward 2")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    log.erase()
    assert not path.exists()
    assert not log.wanted


def test_the_nodes_of_page_and_glove_share_the_record(tmp_path: Path) -> None:
    path = tmp_path / "drives.jsonl"
    page, glove = SessionLog(path), SessionLog(path)
    counter = SessionCounter(glove)
    _drive(counter)
    assert not path.exists()
    page.say_yes()
    _drive(counter)
    page.look_again()
    assert [row.goal for row in page.rows()] == ["desk"]
    page.say_no()
    _drive(counter)
    page.look_again()
    assert (len(page.rows()), page.wanted) == (1, False)
    page.say_yes()
    glove.look_again()
    page.erase()
    glove.note_drive(Counted(level="guide"), "desk", arrived=True, ended="arrived", touches=None)
    assert not path.exists(), "no row begins a record anew that the rider has erased"
    _drive(counter)
    assert (path.exists(), glove.wanted, glove.rows()) == (False, False, ())


def test_a_no_that_cannot_be_written_holds_for_this_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = SessionLog(tmp_path / "drives.jsonl")
    log.say_yes()
    with monkeypatch.context() as full:
        full.setattr("os.fsync", _no_space)
        with pytest.raises(OutputError, match="No space"):
            log.say_no()
    _drive(SessionCounter(log))
    assert (log.wanted, log.rows()) == (False, ())
    log.say_yes()
    assert log.wanted


def _no_space(_: int) -> None:
    raise OSError(28, "No space left on device")


def test_a_chair_that_counts_no_touches_says_so_by_an_empty_field(tmp_path: Path) -> None:
    log = SessionLog(tmp_path / "drives.jsonl")
    log.say_yes()
    _drive(SessionCounter(log))
    assert log.rows()[0].touches is None
    assert next(csv.DictReader(io.StringIO(log.csv())))["touches"] == ""
    assert SessionLog(tmp_path / "drives.jsonl").trouble == ""


def test_what_was_learnt_is_kept_for_its_owner_alone_and_forgotten_at_will(tmp_path: Path) -> None:
    path = tmp_path / "learnt.json"
    learner = RiderLearner()
    learner.restore({"lag_s": [0.9] * 12, "veer_per_m": [5.0]}, {("forward", "back"): 2})
    assert (learner.model.lag_s, learner.model.veer_per_m) == (0.9, 0.0)  # a veer of 5 rad/m is nobody's
    save_learner(path, learner)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    known = load_learner(path)
    assert known.exported() == learner.exported()
    assert known.answers() == {("forward", "back"): 2}
    forget_learnt(path)
    assert load_learner(path).model == RiderModel()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"version": 2}, "not of version 1"),
        ({"values": {"height": [1.8]}}, "'height' is no figure of a rider"),
        ({"values": {"lag_s": [0.5] * (KEPT + 1)}}, "lists of up to 25 numbers"),
        ({"values": {"lag_s": ["soon"]}}, "'lag_s' holds something that is no number"),
        ({"answers": {"forward back": 1}}, "the answer 'forward back' cannot be read"),
    ],
)
def test_a_damaged_file_of_what_was_learnt_is_named(tmp_path: Path, change: dict[str, object], told: str) -> None:
    path = tmp_path / "learnt.json"
    save_learner(path, RiderLearner())
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(LearntError, match=told):
        load_learner(path)
