"""Portable firmware under AddressSanitizer and UndefinedBehaviorSanitizer, with the lines that no case runs."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from waychair.firmware_bridge.board import FIRMWARE

ROOT = FIRMWARE.parent.parent


def run_cases(module: str, library: Path, **variables: str) -> None:
    """Run the cases of a module against a library in a process of their own, which has to end well."""
    done = subprocess.run(
        [sys.executable, "-m", module, str(library)],
        cwd=ROOT,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]


def check_every_line(
    module: str, folder: Path, build: Callable[[Path, tuple[str, ...]], Path], sources: Iterable[str]
) -> None:
    """Run the cases under sanitizers; every line of the sources has to be run, and the sanitizers find nothing."""
    if shutil.which("gcov") is None:
        pytest.skip("gcov is not installed")
    runtime = subprocess.run(["cc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=False)
    if not Path(runtime.stdout.strip()).is_absolute():
        pytest.skip("this C compiler has no AddressSanitizer of its own")
    library = build(folder, ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "--coverage", "-O0"))
    run_cases(module, library, LD_PRELOAD=runtime.stdout.strip(), ASAN_OPTIONS="detect_leaks=0")
    notes = sorted(folder.glob("*.gcno"))
    done = subprocess.run(["gcov", *map(str, notes)], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in sources:
        report = (folder / f"{Path(name).name}.gcov").read_text()
        assert re.findall(r"^\s*#####:\s*(\d+):(.*)$", report, re.MULTILINE) == [], name
        assert len(re.findall(r"^\s*\d+\*?:", report, re.MULTILINE)) >= 4, name
