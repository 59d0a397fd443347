"""A measurement of hours may be interrupted: what was done is taken up, and never that of other code."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from benchmarks.acceptance import runs
from benchmarks.acceptance.runs import over_seeds


def _noted(notes: Path, seed: int) -> int:
    """The square of a seed; that it was asked for is noted."""
    with notes.open("a") as file:
        file.write(f"{seed}\n")
    return seed * seed


def test_what_was_done_is_not_run_again_and_what_is_missing_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "_kept", lambda: tmp_path / "kept")
    notes = tmp_path / "notes"
    assert over_seeds("squares", partial(_noted, notes), 3) == [0, 1, 4]
    assert over_seeds("squares", partial(_noted, notes), 5) == [0, 1, 4, 9, 16]
    assert sorted(notes.read_text().split()) == ["0", "1", "2", "3", "4"]


def test_runs_of_another_name_are_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "_kept", lambda: tmp_path / "kept")
    notes = tmp_path / "notes"
    over_seeds("squares", partial(_noted, notes), 1)
    over_seeds("other squares", partial(_noted, notes), 1)
    assert notes.read_text().split() == ["0", "0"]


def test_nothing_is_kept_of_code_that_no_commit_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "_git", lambda *words: " M planning/dwa.py" if words[0] == "status" else "123456789abc")
    runs.commit.cache_clear()
    try:
        assert runs._kept() is None
    finally:
        runs.commit.cache_clear()
