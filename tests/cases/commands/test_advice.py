"""Advice that a user copies: the same in a clone and beside an installed wheel, always words that work there."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

from waychair import install_advice
from waychair.install_advice import document, install_command, pip_install

ROOT = Path(__file__).resolve().parents[3]


def installed(monkeypatch: pytest.MonkeyPatch, folder: Path, source: dict[str, object] | None) -> None:
    """Let waychair be installed from a source, as pip notes it in direct_url.json (PEP 610); None: by its name."""
    info = folder / "waychair-0.2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: waychair\nVersion: 0.2.0\n")
    if source is not None:
        (info / "direct_url.json").write_text(json.dumps(source))
    monkeypatch.setattr(install_advice.metadata, "distribution", lambda name: metadata.PathDistribution(info))


def test_in_a_clone_the_command_names_the_clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clone = tmp_path / "my clone"
    clone.mkdir()
    installed(monkeypatch, tmp_path, {"url": clone.as_uri(), "dir_info": {"editable": True}})
    monkeypatch.chdir(clone)
    assert install_command("ui").endswith("pip install -e '.[ui]'")
    monkeypatch.chdir(tmp_path)
    assert shlex.split(install_command("ui"))[-2:] == ["-e", f"{clone}[ui]"]


@pytest.mark.parametrize(
    "source",
    [
        None,
        {"url": "file:///home/me/waychair-0.2.0-py3-none-any.whl", "archive_info": {}},
        {"url": "file:///home/me/waychair", "dir_info": {}},
        {"url": "https://example.org/waychair.git", "vcs_info": {"vcs": "git", "commit_id": "0" * 40}},
    ],
)
def test_beside_a_wheel_the_command_names_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: dict[str, object] | None
) -> None:
    installed(monkeypatch, tmp_path, source)
    assert install_command("sim").endswith("pip install 'waychair[sim]'")


def test_the_pip_is_that_of_the_python_that_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("mine", "theirs"):
        (tmp_path / folder).mkdir()
        pip = tmp_path / folder / "pip"
        pip.write_text("#!/bin/sh\n")
        pip.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "mine" / "python"))
    monkeypatch.setenv("PATH", str(tmp_path / "mine"))
    assert pip_install() == "pip install"
    monkeypatch.setenv("PATH", str(tmp_path / "theirs"))
    assert pip_install() == f"{tmp_path / 'mine' / 'python'} -m pip install"


def test_documents_are_named_where_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert document("docs/hardware.md") == "docs/hardware.md"
    monkeypatch.chdir(tmp_path)
    assert document("docs/hardware.md") == str(ROOT / "docs" / "hardware.md")
    installed(monkeypatch, tmp_path, None)
    assert document("docs/hardware.md") == "docs/hardware.md in waychair's sources"
    assert Path(document("firmware_bridge/README.md")).is_file()


def sentences() -> Iterator[tuple[Path, int, str]]:
    """The lines of the product's code, without its comments."""
    for room in (path for path in (ROOT / "src" / "waychair").iterdir() if path.is_symlink()):
        for file in (ROOT / room.name).rglob("*.py"):
            for number, line in enumerate(file.read_text().splitlines(), 1):
                yield file.relative_to(ROOT), number, line.partition("  #")[0]


def test_no_sentence_has_a_command_or_path_that_only_a_clone_or_only_a_wheel_has() -> None:
    wrong = [
        f"{file}:{number}: {line.strip()}"
        for file, number, line in sentences()
        if "pip install" in line or ('"' in line and "docs/" in line and "document(" not in line)
    ]
    assert wrong == []


@pytest.mark.nightly
def test_pip_takes_the_command_of_a_clone() -> None:
    command = [
        *shlex.split(install_command("ui")),
        "--dry-run",
        "--no-build-isolation",
        "--no-index",
        "--no-deps",
        "-q",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
