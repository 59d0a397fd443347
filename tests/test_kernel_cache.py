"""Kernels from the cache, and compiled, in processes of their own."""

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

COMPILE = """
import gc, hashlib, sys
from numba.core import event
from numba.core.compiler import Flags
if sys.argv[1:] == ["lightly"]:
    from waychair.kernel_cache import compile_lightly
    compile_lightly()
    assert Flags.__eq__.__name__ == "has_equal_options"
import numpy as np
from numba import njit

@njit
def inner(value):
    return np.sqrt(value) + 1.0

@njit(error_model="numpy")
def outer(values):
    return inner(values[0]) / np.empty(3)[0]

class Watch(event.Listener):
    def on_start(self, event):
        assert gc.isenabled() == (sys.argv[1:] != ["lightly"])

    def on_end(self, event):
        pass

event.register("numba:compile", Watch())
outer(np.ones(3))
assert gc.isenabled()
(code,) = outer.inspect_asm().values()
one, other = Flags(), Flags()
same = [one == other]
one.nrt = False  # as the default
same.append(one == other)
one.nrt = True
same += [one == other, hash(one) == hash(other), one == 1]
print(hashlib.sha256(code.encode()).hexdigest(), same)
"""


def _ran(folder: Path) -> str:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path]), "NUMBA_CACHE_DIR": str(folder)}
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, env=env, check=True)
    return done.stdout.strip()


def test_a_kernel_that_is_not_in_the_cache_is_compiled_and_then_loaded_without_scipy(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    assert _ran(tmp_path) == "15.0 0 False"
    assert _ran(tmp_path) == "15.0 1 False"


def test_a_kernel_that_is_compiled_lightly_has_the_same_machine_code_and_options_are_compared_as_numba_does() -> None:
    ways = ([], ["lightly"])
    command = [sys.executable, "-c", COMPILE]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    plain, light = (
        subprocess.run([*command, *way], capture_output=True, text=True, env=env, check=True).stdout for way in ways
    )
    assert light == plain
    assert light.endswith("[True, True, False, True, False]\n")
