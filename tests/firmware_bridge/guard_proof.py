"""The proof of the guard on the shipped safety core: `python -m tests.firmware_bridge.guard_proof sweep 5`, or `fuzz 1e7 0`."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from waychair.firmware_bridge.board import FIRMWARE, compile_c

SOURCES = ("safety_core.c", "guard.c", "families.c")


@dataclass(frozen=True, slots=True)
class Proof:
    """The result of one run; `complaint` names the first exceptions."""

    steps: int
    guarded: int
    passed_through: int
    exceptions: int
    complaint: str


def build_proof(folder: Path, firmware: Path = FIRMWARE) -> Path:
    """Return the program, built in `folder`.

    Raises:
        BoardBuildError: the compiler is missing, or refuses the sources.
    """
    program = folder / "guard_proof"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", f"-I{firmware}"]
    sources = [str(Path(__file__).with_name("guard_proof.c")), *(str(firmware / name) for name in SOURCES)]
    compile_c([*flags, *sources, "-o", str(program)])
    return program


def prove(program: Path, *words: str | int) -> Proof:
    """Run `sweep STEP_MV` or `fuzz STEPS SEED`."""
    done = subprocess.run([str(program), *map(str, words)], capture_output=True, text=True, check=False)
    counted = re.match(r"(\d+) steps, (\d+) guarded, (\d+) passed through, (\d+) exceptions", done.stdout)
    if counted is None:
        return Proof(0, 0, 0, 1, f"status {done.returncode}: {done.stderr[:500]}")
    steps, guarded, passed, exceptions = map(int, counted.groups())
    return Proof(steps, guarded, passed, exceptions, done.stderr[:500])


def main(words: list[str]) -> int:
    """Run once and print the result."""
    with tempfile.TemporaryDirectory() as folder:
        proof = prove(build_proof(Path(folder)), words[0], *(int(float(word)) for word in words[1:]))
    print(proof)
    return 1 if proof.exceptions else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
