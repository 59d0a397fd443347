"""Compile the numba kernels of a chair before the tests start: `python -m tests.kernels`.

The tests that keep real time need them compiled: a kernel that compiles during a drive stops the loop for seconds.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from tests.halls import mapped_hall
from waychair.planning.warm_up import warm_up
from waychair.trials.demo import run_demo

PLAN = mapped_hall("  door: [2.0, 3.0, 3.1]\n")


def compile_kernels() -> None:
    """Compile the planner's kernels, and those of a short demo: simulator, mapper, localiser and a drive."""
    warm_up()
    with tempfile.TemporaryDirectory() as name:
        plan = Path(name) / "hall.yaml"
        plan.write_text(PLAN, encoding="utf-8")
        run_demo(Path(name) / "demo", seed=1, world=plan, surprises=False)


if __name__ == "__main__":
    compile_kernels()
