"""`waychair report` as a user types it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.command import refused, waychair
from waychair.files import write_json


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    counts = {"frames": 30, "stm": 10, "wm": 15, "ltm": 5, "entered_wm": 22, "transferred": 7, "retrieved": 2}
    told = {
        "pictures": 31,
        "memory": {**counts, "words": 900},
        "references": 1200,
        "words_made": 1000,
        "links": {"by appearance": 4, "on known ground": 3},
        "revisits": 2,
        "per_picture": {"words": 40.0, "extraction_ms": 5.0, "words_ms": 3.0, "total_ms": 12.0},
    }
    write_json(tmp_path / "report.json", {"distance_m": 12.5, "memory": told})
    return tmp_path


def test_both_counts_are_shown_beside_the_published_ones(folder: Path) -> None:
    done = waychair("report", "--paper", folder, folder)
    assert done.returncode == 0, done.stderr
    lines = [line.replace("│", " ").split() for line in done.stdout.splitlines()]
    assert ["WM", "nodes", "15", "22", "1498"] in [line[:5] for line in lines]
    assert ["LTM", "nodes", "5", "7", "132"] in [line[:5] for line in lines]
    assert "131.61" in done.stdout


def test_a_folder_without_a_map_is_named(tmp_path: Path) -> None:
    assert str(tmp_path) in refused(waychair("report", "--paper", tmp_path))


def test_three_maps_are_refused(folder: Path) -> None:
    assert "one or two" in refused(waychair("report", "--paper", folder, folder, folder))
