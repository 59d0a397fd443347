"""Interrupted measurements reuse their results, but never those of other code."""

from __future__ import annotations

import subprocess
from functools import partial
from pathlib import Path

import pytest
from evaluation.runs import kept_runs as runs
from evaluation.runs.kept_runs import over_seeds


def _noted(notes: Path, seed: int) -> int:
    """Return the square of a seed, and note the call."""
    with notes.open("a") as file:
        file.write(f"{seed}\n")
    return seed * seed


def test_finished_runs_are_not_repeated_and_missing_ones_are_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "_kept", lambda: tmp_path / "kept")
    notes = tmp_path / "notes"
    assert over_seeds("squares", partial(_noted, notes), 3) == [0, 1, 4]
    assert over_seeds("squares", partial(_noted, notes), 5) == [0, 1, 4, 9, 16]
    assert sorted(notes.read_text().split()) == ["0", "1", "2", "3", "4"]


def test_runs_of_another_name_are_separate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "_kept", lambda: tmp_path / "kept")
    notes = tmp_path / "notes"
    over_seeds("squares", partial(_noted, notes), 1)
    over_seeds("other squares", partial(_noted, notes), 1)
    assert notes.read_text().split() == ["0", "0"]


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Create a repository with a file in each folder."""
    for name in (*runs._RUNS, "docs"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("one")
    monkeypatch.setattr(runs, "_HERE", tmp_path)
    committed(tmp_path)
    return tmp_path


def committed(repository: Path) -> None:
    who = ["-c", "user.name=somebody", "-c", "user.email=somebody@example.org"]
    for words in (["init", "-q"], ["add", "-A"], [*who, "commit", "-qm", "a step"]):
        subprocess.run(["git", *words], cwd=repository, check=True)


def code_now() -> str:
    runs.code.cache_clear()
    try:
        return runs.code()
    finally:
        runs.code.cache_clear()


def test_runs_are_kept_by_the_code_that_ran_and_documents_do_not_count(checkout: Path) -> None:
    first = code_now()
    assert len(first) == 12
    (checkout / "docs" / "file").write_text("two")
    assert code_now() == first
    committed(checkout)
    assert code_now() == first
    (checkout / "planning" / "file").write_text("two")
    committed(checkout)
    assert code_now() not in ("", first)


@pytest.mark.parametrize("changed", ["planning/file", "src/new.py"])
def test_runs_of_uncommitted_code_are_not_kept(checkout: Path, changed: str) -> None:
    (checkout / changed).write_text("two")
    assert code_now() == ""
    runs.code.cache_clear()
    assert runs._kept() is None
    runs.code.cache_clear()


def test_every_folder_of_the_repository_counts_as_code_or_as_documents() -> None:
    here = Path(__file__).parents[2]
    folders = {path.name for path in here.iterdir() if (path / "__init__.py").exists()} - {"tests"}
    assert folders - set(runs._RUNS) == {"cli", "ros", "ui"}
