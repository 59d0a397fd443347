"""A sample of the guard's proof, and that it notices wrong code."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.firmware_bridge.guard_proof import build_proof, prove
from waychair.firmware_bridge.board import FIRMWARE
from waychair.firmware_bridge.guard_trials import kill_guard


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_proof(tmp_path_factory.mktemp("proof"))


def test_no_stick_cap_and_reference_gives_more_than_the_stick(proof: Path) -> None:
    done = prove(proof, "sweep", 40)
    assert (done.exceptions, done.complaint) == (0, "")
    assert done.guarded == done.steps > 200_000
    assert done.passed_through > 5_000


def test_no_random_life_gives_more_than_the_stick_or_widens_a_lost_guard(proof: Path) -> None:
    done = prove(proof, "fuzz", 1_000_000, 3)
    assert (done.exceptions, done.complaint) == (0, "")
    assert done.guarded > 500_000


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("file", "right", "wrong"),
    [
        ("guard.c", "deflection_mv < -down ? -down", "deflection_mv < -down ? down"),
        ("guard.c", "deflection_mv > up ? up", "deflection_mv > up ? deflection_mv"),
        ("guard.c", "least(highest, least(self->asked[to], self->caps[to]))", "highest"),
        ("safety_core.c", "possible_stick ? inputs", "possible_stick || true ? inputs"),
        ("safety_core.c", "(!core->stopping || (found & FAULT_BOARD))", "true"),
    ],
)
def test_the_proof_notices_wrong_code(tmp_path: Path, file: str, right: str, wrong: str) -> None:
    firmware = tmp_path / "firmware"
    shutil.copytree(FIRMWARE, firmware)
    source = firmware / file
    assert right in source.read_text()
    source.write_text(source.read_text().replace(right, wrong))
    program = build_proof(tmp_path, firmware)
    assert prove(program, "sweep", 100).exceptions + prove(program, "fuzz", 1_000_000, 0).exceptions > 0


def test_f1_the_computer_is_killed_at_random_moments_of_a_guarded_drive(board_program: Path) -> None:
    report = kill_guard(board_program, 3)
    assert report.failures == ()
    assert 60 <= report.longest_ms <= 100
