"""The firmware's tests again, under AddressSanitizer and with full line coverage."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.firmware_bridge.rig import SOURCES, build_core
from tests.firmware_bridge.sanitised import check_every_line, run_cases
from waychair.firmware_bridge.board import FIRMWARE

CASES = "tests.firmware_bridge.cases"


def test_sanitizers_find_nothing_and_every_line_of_the_portable_firmware_is_run(tmp_path: Path) -> None:
    check_every_line(CASES, tmp_path, build_core, SOURCES)


def test_a_library_that_fails_a_test_is_noticed(tmp_path: Path) -> None:
    altered = tmp_path / "firmware"
    shutil.copytree(FIRMWARE, altered)
    header = altered / "safety_core.h"
    header.write_text(header.read_text().replace("HOST_BUDGET_MS = 100,", "HOST_BUDGET_MS = 101,"))
    library = build_core(tmp_path, firmware=altered)
    with pytest.raises(AssertionError):
        run_cases(CASES, library)
