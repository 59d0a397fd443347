"""`waychair doctor`: every missing part has a command, and only needed parts are failures."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections import namedtuple
from importlib import metadata
from pathlib import Path

import pytest

from waychair.cli import doctor
from waychair.cli.doctor import Check, PartState
from waychair.install_advice import pip_install

WAYCHAIR = Path(sys.executable).parent / "waychair"
_Usage = namedtuple("_Usage", "total used free")


def test_every_faulty_part_comes_with_a_command_that_mends_it() -> None:
    found = doctor.examine()
    assert len({check.part for check in found}) == len(found) >= 12
    for check in found:
        assert bool(check.remedy) == (check.state is not PartState.OK), check
        assert check.purpose


def test_the_command_prints_the_table_and_its_exit_code_depends_on_needed_parts() -> None:
    done = subprocess.run([str(WAYCHAIR), "doctor"], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    assert done.returncode == ("missing" in done.stdout)
    for part in ("Python", "packages [sim]", "packages [ui]", "EGL", "ROS 2", "C compiler", "serial ports", "disk"):
        assert part in done.stdout
    assert max(len(line) for line in done.stdout.splitlines()) <= 200


@pytest.mark.parametrize(("state", "code"), [(PartState.OPTIONAL, None), (PartState.MISSING, 1)])
def test_only_a_missing_needed_part_gives_exit_code_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], state: PartState, code: int | None
) -> None:
    monkeypatch.setattr(doctor, "_CHECKS", (lambda: Check("the [thing]", state, "all", "pip install 'x[y]'"),))
    ended = None
    try:
        doctor.doctor_command()
    except SystemExit as stop:
        ended = stop.code
    assert ended == code
    printed = capsys.readouterr().out
    assert all(text in printed for text in ("the [thing]", state.value, "pip install 'x[y]'"))


def test_missing_packages_are_named_with_the_required_versions(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        if name in ("mujoco", "numba"):
            raise metadata.PackageNotFoundError(name)
        return "1"

    monkeypatch.setattr(metadata, "version", version)
    assert (doctor._core().state, doctor._core().remedy) == (PartState.MISSING, f"{pip_install()} 'numba>=0.60'")
    assert doctor._physics().state is PartState.OPTIONAL
    assert doctor._physics().remedy.startswith(f"{pip_install()} 'mujoco")
    assert doctor._web().state is PartState.OK


def test_a_machine_without_egl_only_loses_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    failed = subprocess.CompletedProcess([], 1)
    monkeypatch.setattr(doctor, "find_spec", lambda name: object())
    monkeypatch.setattr(doctor.subprocess, "run", lambda *arguments, **options: failed)
    check = doctor._camera()
    assert (check.state, check.remedy) == (PartState.OPTIONAL, "sudo apt-get install libegl1 libgl1-mesa-dri")
    monkeypatch.setattr(doctor, "find_spec", lambda name: None)
    assert doctor._camera().remedy == f"{pip_install()} moderngl"


def test_a_full_disk_is_a_failure_and_a_missing_compiler_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: _Usage(1 << 40, 0, 10**9))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert doctor._disk().state is PartState.MISSING
    assert "1.0 GB free" in doctor._disk().part
    assert (doctor._compiler().state, doctor._compiler().remedy) == (
        PartState.OPTIONAL,
        "sudo apt-get install gcc libc6-dev",
    )


def test_serial_ports_need_the_group_that_owns_them_on_debian(monkeypatch: pytest.MonkeyPatch) -> None:
    import grp

    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(os, "getgroups", lambda: [4711])
    assert doctor._serial_ports().remedy.startswith("sudo usermod -aG dialout")
    group = grp.struct_group(("dialout", "x", 4711, []))
    monkeypatch.setattr(grp, "getgrnam", lambda name: group)
    assert doctor._serial_ports().state is PartState.OK


def test_the_cache_of_kernels_may_be_moved_to_a_writable_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) == tmp_path)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/proc/numba")
    assert (doctor._kernel_cache().state, doctor._kernel_cache().remedy) == (
        PartState.MISSING,
        "export NUMBA_CACHE_DIR=/tmp/numba",
    )
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "not" / "yet" / "there"))
    assert doctor._kernel_cache().state is PartState.OK


def test_recordings_are_found_in_the_folder_of_the_environment_variable(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("WAYCHAIR_DATA", str(tmp_path))
    assert doctor._recordings().state is PartState.OPTIONAL
    (tmp_path / "lidar_intel").mkdir()
    assert doctor._recordings().state is PartState.OK


@pytest.mark.nightly
def test_warm_compiles_everything_for_a_drive_and_the_next_command_compiles_nothing(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    told = [
        subprocess.run([str(WAYCHAIR), "doctor", "--warm"], capture_output=True, text=True, check=True, env=environment)
        for _ in range(2)
    ]
    assert "compiling for this computer, once" in told[0].stderr
    assert re.search(r"^(planner|mapper|guidance|behaviour cells): \d+ s so far$", told[0].stderr, re.MULTILINE)
    assert all("compiled for this computer" in each.stdout for each in told)
    assert "compiling" not in told[1].stderr


def test_a_missing_speech_program_is_optional_and_has_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert (doctor._speech().state, doctor._speech().remedy) == (PartState.OPTIONAL, "sudo apt-get install espeak-ng")


def test_make_demo_compiles_once_for_a_set_up_and_for_the_kernels_that_are_there(tmp_path: Path) -> None:
    (tmp_path / ".ci").mkdir()
    shutil.copy(Path(__file__).parents[2] / ".ci" / "warm", tmp_path / ".ci" / "warm")
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    set_up, program, calls = tmp_path / ".venv" / ".waychair-ui", tmp_path / ".venv/bin/waychair", tmp_path / "calls"
    set_up.write_text("first")
    (tmp_path / "kernel.py").write_text("from numba import njit")

    def warmed(exit_code: int = 0) -> int:
        """Return how often waychair was called until the end of one more run of the script."""
        program.write_text(f'#!/bin/sh\necho "$*" >>"{calls}"\necho "the table"\nexit {exit_code}\n')
        program.chmod(0o755)
        done = subprocess.run(["bash", ".ci/warm"], cwd=tmp_path, capture_output=True, text=True, check=True)
        assert done.stdout == ""
        assert ("the table" in done.stderr) == (exit_code != 0)
        return len(calls.read_text().splitlines())

    assert warmed(exit_code=1) == 1  # a part is missing: it is told, and tried again the next time
    assert [warmed(), warmed()] == [2, 2]
    (tmp_path / "kernel.py").write_text("from numba import njit, prange")
    assert [warmed(), warmed()] == [3, 3]
    (tmp_path / "other.py").write_text("import numpy")
    assert warmed() == 3
    set_up.write_text("second")
    assert warmed() == 4
    assert set(calls.read_text().splitlines()) == {"doctor --warm"}
