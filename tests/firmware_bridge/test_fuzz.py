"""Coverage-guided random bytes break no invariant; a firmware with a defect is caught."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.firmware_bridge.fuzzing import build_fuzzer, fuzz
from waychair.firmware_bridge.board import FIRMWARE


def test_a_hundred_thousand_fuzzed_bytes_crash_nothing_and_move_nothing(tmp_path: Path) -> None:
    done = fuzz(build_fuzzer(tmp_path), 100_000, seed=1)
    assert done.returncode == 0, done.stderr
    counted = re.match(r"(\d+) bytes, (\d+) edges, corpus of (\d+)", done.stdout)
    assert counted is not None
    assert int(counted[1]) >= 100_000
    assert int(counted[2]) > 100
    assert int(counted[3]) > 5


@pytest.mark.parametrize(
    ("file", "right", "wrong"),
    [
        ("frame.c", "if (length < FRAME_WIRE_MAX - 1)", "if (length <= FRAME_WIRE_MAX)"),  # writes past its buffer
        ("safety_core.h", "NEUTRAL_HOLD_MS = 2000", "NEUTRAL_HOLD_MS = 0"),  # drives without a hold
    ],
)
def test_the_fuzzer_catches_a_firmware_with_a_defect(tmp_path: Path, file: str, right: str, wrong: str) -> None:
    broken = tmp_path / "firmware"
    shutil.copytree(FIRMWARE, broken)
    source = (broken / file).read_text()
    assert right in source
    (broken / file).write_text(source.replace(right, wrong))
    assert fuzz(build_fuzzer(tmp_path, broken), 100_000, seed=1).returncode != 0
