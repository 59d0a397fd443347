"""Files are written whole or not at all."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from waychair.errors import OutputError
from waychair.files import replacing, write_bytes, write_json, write_text


def test_a_file_is_written_with_the_folders_it_needs(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "c.txt"
    write_text(path, "one\n")
    write_text(path, "two\n")
    assert path.read_text() == "two\n"
    assert list(path.parent.iterdir()) == [path]
    assert path.stat().st_mode & 0o777 == 0o644


def test_a_failure_half_way_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "map.pgm"
    write_bytes(path, b"old")

    def fail_half_way() -> None:
        with replacing(path) as aside:
            aside.write_bytes(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_half_way()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_report_with_a_nan_is_refused_and_the_old_one_stays(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    write_json(path, {"ate_m": 0.1})
    with pytest.raises(ValueError, match="JSON"):
        write_json(path, {"ate_m": math.nan})
    assert json.loads(path.read_text()) == {"ate_m": 0.1}


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        write_text(tmp_path / "file" / "x.txt", "")
