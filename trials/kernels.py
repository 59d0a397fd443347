"""Compiling the numba kernels of a whole chair, so that no command and no drive waits for them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from waychair.calibration.chair_body import CHAIR_A
from waychair.kernel_cache import compile_lightly
from waychair.planning import warm_up as planning_kernels
from waychair.runtime.haptics import leading_warm_up as leading_kernels
from waychair.runtime.perception import Perception
from waychair.slam.mapping import mapper_warm_up as mapping_kernels
from waychair.trials.demo.demo import StageProgress, run_demo

_HALL = """\
name: hall
size: [8.0, 6.0]
start: [1.5, 3.0, 0.0]
walls:
  - {start: [0.0, 0.0], end: [8.0, 0.0]}
  - {start: [8.0, 0.0], end: [8.0, 6.0]}
  - {start: [8.0, 6.0], end: [0.0, 6.0]}
  - {start: [0.0, 6.0], end: [0.0, 0.0]}
boxes:
  - {centre: [4.0, 5.5], size: [1.2, 0.6]}
places:
  door: [2.0, 3.0, 3.1]
routes:
  mapping: [[6.0, 3.0], [2.0, 3.0]]
"""
"""Floor plan of a small hall with one place and a route that maps it."""


def compile_kernels(progress: StageProgress = lambda stage, share: None) -> None:
    """Compile the kernels of planner, mapper, guidance and behaviour cells, and by a short demo those of simulator and a drive.

    numba keeps them on disk, for this user and this processor; where they are kept already it takes some seconds. `progress`
    is called with the part that is compiled or the stage of the demo, and the share (0 or 1 of a part) that is done.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    compile_lightly()
    parts: dict[str, Callable[[], object]] = {
        "planner": planning_kernels.warm_up,
        "mapper": mapping_kernels.warm_up,
        "guidance": leading_kernels.warm_up,
        "behaviour cells": lambda: Perception(CHAIR_A),  # its constructor runs the cells
    }
    for name, run in parts.items():
        progress(name, 0.0)
        run()
        progress(name, 1.0)
    with tempfile.TemporaryDirectory() as name:
        plan = Path(name) / "hall.yaml"
        plan.write_text(_HALL, encoding="utf-8")
        run_demo(Path(name) / "demo", seed=1, world=plan, surprises=False, progress=progress)
