"""The glove's firmware under sanitizers with full line coverage, fuzzed, mutated, and with the same table as in Python."""

from __future__ import annotations

import random
import re
import shutil
from pathlib import Path

import pytest

from tests.firmware_bridge.glove.fuzzing import build_glove_fuzzer, fuzz_glove
from tests.firmware_bridge.glove.rig import SOURCES, build_glove_core
from tests.firmware_bridge.mutation import GLOVE, explained, mutants, run
from tests.firmware_bridge.sanitised import check_every_line
from waychair.firmware_bridge.board import FIRMWARE

CASES = "tests.firmware_bridge.glove.cases"


def test_sanitizers_find_nothing_and_every_line_of_the_gloves_firmware_is_run(tmp_path: Path) -> None:
    own = (source for source in SOURCES if source.startswith("glove/"))
    check_every_line(CASES, tmp_path, build_glove_core, own)


@pytest.fixture(scope="module")
def fuzzer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fuzzer of the shipped firmware."""
    return build_glove_fuzzer(tmp_path_factory.mktemp("fuzz"))


def test_a_hundred_thousand_fuzzed_bytes_crash_nothing_and_break_no_limit(fuzzer: Path) -> None:
    done = fuzz_glove(fuzzer, "bytes", 100_000, seed=1)
    assert done.returncode == 0, done.stderr
    counted = re.match(r"(\d+) bytes, (\d+) edges, corpus of (\d+)", done.stdout)
    assert counted is not None
    assert int(counted[1]) >= 100_000
    assert int(counted[2]) > 100
    assert int(counted[3]) > 5


def test_random_commands_reach_every_limit_and_break_none(fuzzer: Path) -> None:
    done = fuzz_glove(fuzzer, "commands", 3_000, seed=1)
    assert done.returncode == 0, done.stderr
    counted = re.search(r"worst duty (\d+), run (\d+), crowd (\d+)", done.stdout)
    assert counted is not None
    assert 4500 < int(counted[1]) <= 5000
    assert 400 < int(counted[2]) <= 500
    assert 200 < int(counted[3]) <= 250


@pytest.mark.parametrize(
    ("file", "right", "wrong", "kind"),
    [
        ("glove/glove_protocol.c", "steps / STEP_LENGTH > GLOVE_STEPS_MAX", "false", "bytes"),
        ("glove/glove_core.h", "GLOVE_DUTY_MAX_MS = 5000", "GLOVE_DUTY_MAX_MS = 5100", "commands"),
    ],
)
def test_the_fuzzer_catches_a_firmware_with_a_defect(
    tmp_path: Path, file: str, right: str, wrong: str, kind: str
) -> None:
    broken = tmp_path / "firmware"
    shutil.copytree(FIRMWARE, broken)
    source = (broken / file).read_text()
    assert right in source
    (broken / file).write_text(source.replace(right, wrong))
    done = fuzz_glove(build_glove_fuzzer(tmp_path, broken), kind, 100_000 if kind == "bytes" else 3_000, seed=1)
    assert done.returncode != 0


@pytest.mark.parametrize("count", [4, pytest.param(12, marks=pytest.mark.nightly)])
def test_a_sample_of_wrong_changes_is_noticed_or_explained(count: int) -> None:
    reasons = explained(GLOVE)
    chosen = random.Random(3).sample(mutants(GLOVE), count)
    results = run(chosen, GLOVE)
    assert [mutant.name() for mutant, fate in results if fate == "survived" and mutant.name() not in reasons] == []
    assert sum(fate == "killed" for _, fate in results) >= count // 2


def test_every_explanation_belongs_to_an_existing_mutant_and_gives_a_reason() -> None:
    names = {mutant.name() for mutant in mutants(GLOVE)}
    for name, reason in explained(GLOVE).items():
        assert name in names
        assert len(reason) > 20, name
