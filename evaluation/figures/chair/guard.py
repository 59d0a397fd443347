"""The guard in the board: the proof over all sticks, caps and references, random lives, killed computers and mutants."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from tests.firmware_bridge.guard_proof import build_proof, prove
from tests.firmware_bridge.mutation import explained, mutants, run

from waychair.firmware_bridge.board import board_program
from waychair.firmware_bridge.fail_safe import BUDGET_MS
from waychair.firmware_bridge.guard_trials import kill_guard
from waychair.types import Json

STEP_MV = 5
FUZZED_STEPS = 10_000_000
MOMENTS = int(os.environ.get("GUARD_PROOF_MOMENTS", "1000"))
MUTANTS_EVERY = int(os.environ.get("GUARD_PROOF_MUTANTS_EVERY", "1"))
MUTATED = ("axes.h", "guard.h", "guard.c", "safety_core.h", "safety_core.c")


def guard_proof(out: Path) -> Json:
    """No line with more than the rider's stick: swept, fuzzed, the computer killed, and every mutant noticed or explained."""
    with tempfile.TemporaryDirectory() as folder:
        program = build_proof(Path(folder))
        swept, fuzzed = prove(program, "sweep", STEP_MV), prove(program, "fuzz", FUZZED_STEPS, 0)
    killed = kill_guard(board_program(), MOMENTS)
    fates = run([mutant for mutant in mutants() if mutant.file in MUTATED][::MUTANTS_EVERY])
    survivors = [mutant.name() for mutant, fate in fates if fate == "survived"]
    unexplained = [name for name in survivors if name not in explained()]
    return {
        "passed": swept.exceptions == fuzzed.exceptions == 0
        and swept.passed_through > 0
        and fuzzed.guarded > FUZZED_STEPS // 2
        and not killed.failures
        and killed.longest_ms <= BUDGET_MS
        and not unexplained,
        "swept": swept.steps,
        "swept_exceptions": swept.exceptions,
        "full_caps": swept.passed_through,
        "fuzzed": fuzzed.steps,
        "fuzzed_guarded": fuzzed.guarded,
        "fuzzed_exceptions": fuzzed.exceptions,
        "complaint": swept.complaint + fuzzed.complaint,
        "killed": len(killed.trials),
        "killed_failures": len(killed.failures),
        "longest_to_narrow_ms": killed.longest_ms,
        "longest_to_free_ms": killed.longest_rest_ms,
        "mutants": len(fates),
        "survivors_explained": len(survivors) - len(unexplained),
        "survivors_unexplained": unexplained,
    }
