"""The coverage-guided fuzz run over the board's loop: `python -m tests.firmware_bridge.fuzzing [BYTES]`, 10^7 by default."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from waychair.firmware_bridge.board import FIRMWARE, compile_c

SANITIZE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def build_fuzzer(folder: Path, firmware: Path = FIRMWARE) -> Path:
    """The fuzzer with every portable source of the firmware traced.

    Raises:
        BoardBuildError: the compiler is missing or knows no `-fsanitize-coverage=trace-pc`.
    """
    objects = []
    for source in sorted(firmware.glob("*.c")):
        target = folder / f"{source.stem}.o"
        flags = ["-std=c99", "-O1", "-g", *SANITIZE, "-fsanitize-coverage=trace-pc"]
        compile_c([*flags, "-c", str(source), "-o", str(target)])
        objects.append(str(target))
    program = folder / "fuzz"
    driver = str(Path(__file__).with_name("fuzz.c"))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-g", *SANITIZE, f"-I{firmware}"]
    compile_c([*flags, driver, *objects, "-o", str(program)])
    return program


def fuzz(program: Path, count: int, seed: int) -> subprocess.CompletedProcess[str]:
    """Feed so many bytes; the status is not 0 when a promise was broken."""
    return subprocess.run([str(program), str(count), str(seed)], capture_output=True, text=True, check=False)


def main() -> int:
    """One run, its result as a line."""
    with tempfile.TemporaryDirectory() as folder:
        done = fuzz(build_fuzzer(Path(folder)), int(float(sys.argv[1])) if len(sys.argv) > 1 else 10_000_000, 0)
    print(done.stdout.strip() if done.returncode == 0 else f"broken with status {done.returncode}\n{done.stderr}")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
