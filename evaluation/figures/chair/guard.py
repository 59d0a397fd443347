"""The guard in the board: the proof over all sticks, caps and references, random lives, killed computers and mutants.

Mutants and lines are those of both boards, the chair's and the glove's.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.firmware_bridge.glove.rig import build_glove_core
from tests.firmware_bridge.guard_proof import build_proof, prove
from tests.firmware_bridge.mutation import CHAIR, GLOVE, Target, explained, mutants, run
from tests.firmware_bridge.rig import build_core
from tests.firmware_bridge.sanitised import check_every_line

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
    """No line with more than the rider's stick: swept, fuzzed, the computer killed, and of both boards every line of code run, and
    every mutant noticed or explained."""
    with tempfile.TemporaryDirectory() as folder:
        program = build_proof(Path(folder))
        swept, fuzzed = prove(program, "sweep", STEP_MV), prove(program, "fuzz", FUZZED_STEPS, 0)
    killed = kill_guard(board_program(), MOMENTS)
    boards = {"chair": _mutated(CHAIR, MUTATED), "glove": _mutated(GLOVE, GLOVE.mutated)}
    glove_sources = [
        source for source in GLOVE.sources if source.startswith("glove/")
    ]  # the others are the chair's, too
    every_line = {
        "chair": _runs_every_line("tests.firmware_bridge.cases", build_core, CHAIR.sources),
        "glove": _runs_every_line("tests.firmware_bridge.glove.cases", build_glove_core, glove_sources),
    }
    return {
        "passed": swept.exceptions == fuzzed.exceptions == 0
        and swept.passed_through > 0
        and fuzzed.guarded > FUZZED_STEPS // 2
        and not killed.failures
        and killed.longest_ms <= BUDGET_MS
        and all(every_line.values())
        and not any(row["survivors_unexplained"] for row in boards.values()),
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
        "every_line": every_line,
        "boards": boards,
    }


def _mutated(target: Target, files: Sequence[str]) -> Json:
    """Return how many mutants of a board's files there are, and which of those that no case notices are explained."""
    fates = run([mutant for mutant in mutants(target) if mutant.file in files][::MUTANTS_EVERY], target)
    survivors, reasons = [mutant.name() for mutant, fate in fates if fate == "survived"], explained(target)
    unexplained = [name for name in survivors if name not in reasons]
    return {
        "mutants": len(fates),
        "killed": sum(fate == "killed" for _, fate in fates),
        "survivors_explained": len(survivors) - len(unexplained),
        "survivors_unexplained": unexplained,
    }


def _runs_every_line(cases: str, build: Callable[[Path, tuple[str, ...]], Path], sources: Sequence[str]) -> bool:
    """Return whether a module's cases run every line of a board's portable C, under sanitizers that find nothing."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            check_every_line(cases, Path(folder), build, sources)
        except AssertionError:
            return False
    return True
