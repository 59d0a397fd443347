"""The coverage-guided fuzz run and the random commands over the glove's loop:

python -m tests.firmware_bridge.glove.fuzzing [bytes|commands] [COUNT]
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from tests.firmware_bridge.fuzzing import SANITIZE
from tests.firmware_bridge.glove.rig import LIMIT, SOURCES
from waychair.firmware_bridge.board import FIRMWARE, compile_c


def build_glove_fuzzer(folder: Path, firmware: Path = FIRMWARE) -> Path:
    """The fuzzer with every portable source of the glove's firmware traced.

    Raises:
        BoardBuildError: the compiler is missing or knows no `-fsanitize-coverage=trace-pc`.
    """
    objects = []
    for name in SOURCES:
        target = folder / f"{Path(name).stem}.o"
        flags = ["-std=c99", "-O1", "-g", LIMIT, *SANITIZE, "-fsanitize-coverage=trace-pc"]
        compile_c([*flags, "-c", str(firmware / name), "-o", str(target)])
        objects.append(str(target))
    program = folder / "fuzz"
    driver = str(Path(__file__).with_name("fuzz.c"))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-g", LIMIT, *SANITIZE, f"-I{firmware}"]
    compile_c([*flags, driver, *objects, "-o", str(program)])
    return program


def fuzz_glove(program: Path, kind: str, count: int, seed: int) -> subprocess.CompletedProcess[str]:
    """Feed so many bytes or commands; the status is not 0 when a promise was broken."""
    return subprocess.run([str(program), kind, str(count), str(seed)], capture_output=True, text=True, check=False)


def main() -> int:
    """One run, its result as a line."""
    kind = sys.argv[1] if len(sys.argv) > 1 else "bytes"
    with tempfile.TemporaryDirectory() as folder:
        count = int(float(sys.argv[2])) if len(sys.argv) > 2 else 10_000_000
        done = fuzz_glove(build_glove_fuzzer(Path(folder)), kind, count, 0)
    print(done.stdout.strip() if done.returncode == 0 else f"broken with status {done.returncode}\n{done.stderr}")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
