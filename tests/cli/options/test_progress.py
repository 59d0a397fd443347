"""The sentence while numba compiles: once a process, on standard error, and not where the kernels are kept."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

_PROGRAM = """
from numba import njit
from waychair.cli.options.progress import announce_compiling
announce_compiling()
announce_compiling()

@njit(cache=True)
def double(x):
    return 2 * x

@njit(cache=True)
def more(x):
    return double(x) + 1

assert more(1) == 3 and more(1.0) == 3.0
"""


def test_compiling_is_announced_once_and_not_where_the_kernels_are_kept(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(_PROGRAM)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    told = [
        subprocess.run([sys.executable, str(program)], capture_output=True, text=True, check=True, env=environment)
        for _ in range(2)
    ]
    assert told[0].stderr.count("compiling for this computer, once") == 1
    assert "waychair doctor --warm" in told[0].stderr
    assert (told[0].stdout, told[1].stdout, told[1].stderr) == ("", "", "")
