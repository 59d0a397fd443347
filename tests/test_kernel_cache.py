"""Kernels from the cache, in processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

KERNEL = """
import numpy as np
from numba import njit

@njit(cache=True)
def middle(values):
    return np.median(values) + values.sum()
"""

RUN = """
import sys
from waychair.kernel_cache import load_lightly
load_lightly()
import kernel, numpy as np
print(kernel.middle(np.array([3.0, 1.0, 8.0])), sum(kernel.middle.stats.cache_hits.values()), "scipy.linalg" in sys.modules)
"""


def _ran(folder: Path) -> str:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path]), "NUMBA_CACHE_DIR": str(folder)}
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, env=env, check=True)
    return done.stdout.strip()


def test_a_kernel_that_is_not_in_the_cache_is_compiled_and_then_loaded_without_scipy(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    assert _ran(tmp_path) == "15.0 0 False"
    assert _ran(tmp_path) == "15.0 1 False"
