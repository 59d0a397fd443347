"""Files are written completely or not at all."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
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


def test_a_failure_during_writing_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
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


def test_a_file_is_synchronised_before_its_name_and_then_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    path, sync, rename = tmp_path / "zones.yaml", os.fsync, Path.replace

    def synced(descriptor: int) -> None:
        sync(descriptor)
        done.append("folder" if os.path.samestat(os.fstat(descriptor), tmp_path.stat()) else "file")

    def renamed(self: Path, target: Path) -> Path:
        done.append("name")
        return rename(self, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", renamed)
    write_text(path, "a: 1\n")
    assert done == ["file", "name", "folder"]
    write_json(path, {"pose": 1}, lasting=False)
    assert done[3:] == ["name"], "frequently written files do not wait for the disk"


def test_a_report_with_a_nan_is_refused_and_the_old_one_stays(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    write_json(path, {"ate_m": 0.1})
    with pytest.raises(ValueError, match="JSON"):
        write_json(path, {"ate_m": math.nan})
    assert json.loads(path.read_text()) == {"ate_m": 0.1}


def test_an_impossible_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        write_text(tmp_path / "file" / "x.txt", "")


def test_an_existing_path_that_is_not_a_file_is_left_unchanged(tmp_path: Path) -> None:
    folder, pipe, circle = tmp_path / "folder", tmp_path / "pipe", tmp_path / "circle"
    folder.mkdir()
    os.mkfifo(pipe)
    circle.symlink_to(circle)
    (tmp_path / "to_pipe").symlink_to(pipe)
    for path, said in (
        (folder, "it is a folder"),
        (pipe, "a device, pipe or socket"),
        (tmp_path / "to_pipe", "a device, pipe or socket"),
        (circle, "its symbolic links form a loop"),
        (tmp_path / ("a" * 300), "use a shorter name|another folder or name"),
    ):
        with pytest.raises(OutputError, match=said):
            write_text(path, "new")
    assert folder.is_dir()
    assert pipe.is_fifo()
    assert circle.is_symlink()
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "pipe", "circle", "to_pipe"}


def test_a_symbolic_link_stays_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    link, target = tmp_path / "link", tmp_path / "there" / "map.pgm"
    link.symlink_to(target)
    for text in ("one", "two"):
        write_text(link, text)
        assert link.is_symlink()
        assert target.read_text() == text
    assert list((tmp_path / "there").iterdir()) == [target]


def test_a_folder_without_permission_is_named(tmp_path: Path) -> None:
    """In a separate process that drops root, since root may enter every folder."""
    (tmp_path / "private").mkdir()
    (tmp_path / "private" / "a.txt").write_text("mine")
    tmp_path.chmod(0o755)
    (tmp_path / "private").chmod(0o700 if os.getuid() == 0 else 0o000)
    program = (
        "import os, sys\nfrom pathlib import Path\n"
        "from waychair.errors import ConfigError\nfrom waychair.files import path_exists, read_text\n"
        "if os.getuid() == 0:\n    os.setgroups([]), os.setgid(65534), os.setuid(65534)\n"
        "for look in (path_exists, read_text):\n"
        "    try:\n        look(Path('private/a.txt'), ConfigError)\n"
        "    except ConfigError as error:\n        print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path)
    (tmp_path / "private").chmod(0o700)
    assert done.stderr == ""
    sentence = "cannot read private/a.txt: Permission denied; give this user permission for it and its folders"
    assert done.stdout.splitlines() == [sentence, sentence]
