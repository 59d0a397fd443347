"""The firmware's tests again, under AddressSanitizer and with full line coverage."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.firmware_bridge.rig import SOURCES, build_core
from waychair.firmware_bridge.board import FIRMWARE

ROOT = FIRMWARE.parent.parent


def _run_cases(library: Path, **variables: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.firmware_bridge.cases", str(library)],
        cwd=ROOT,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]


def test_sanitizers_find_nothing_and_every_line_of_the_portable_firmware_is_run(tmp_path: Path) -> None:
    if shutil.which("gcov") is None:
        pytest.skip("gcov is not installed")
    runtime = subprocess.run(["cc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=False)
    if not Path(runtime.stdout.strip()).is_absolute():
        pytest.skip("this C compiler has no AddressSanitizer of its own")
    library = build_core(tmp_path, ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "--coverage", "-O0"))
    _run_cases(library, LD_PRELOAD=runtime.stdout.strip(), ASAN_OPTIONS="detect_leaks=0")
    notes = sorted(tmp_path.glob("*.gcno"))
    done = subprocess.run(["gcov", *map(str, notes)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in SOURCES:
        report = (tmp_path / f"{name}.gcov").read_text()
        assert re.findall(r"^\s*#####:\s*(\d+):(.*)$", report, re.MULTILINE) == [], name
        assert len(re.findall(r"^\s*\d+\*?:", report, re.MULTILINE)) >= 4, name


def test_a_library_that_fails_a_test_is_noticed(tmp_path: Path) -> None:
    altered = tmp_path / "firmware"
    shutil.copytree(FIRMWARE, altered)
    header = altered / "safety_core.h"
    header.write_text(header.read_text().replace("HOST_BUDGET_MS = 100,", "HOST_BUDGET_MS = 101,"))
    library = build_core(tmp_path, firmware=altered)
    with pytest.raises(AssertionError):
        _run_cases(library)
