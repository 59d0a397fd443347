"""A recorded drive through the safety core gives the recorded lines, and no fault.

`recorded_drive.csv` holds the set-points of the demo's three places (20 a second, 94 s, driven in simulation with the
eight-pin stick's 3.3 V converter) and the lines [mV] at the end of each tick.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.firmware_bridge.rig import BOARD, DRIVE, Rig
from waychair.types import IntArray

RECORDING = Path(__file__).with_name("recorded_drive.csv")
NEUTRAL_MV, SWING_MV, TICK_MS = 1650, 1200, 50


def replay(rig: Rig, setpoints: IntArray) -> IntArray:
    """Lines (N, 2) [mV] at the end of each tick; set-points (N, 2) are repeated every 20 ms within it."""
    rig.start(rig.settings(family=3))
    rig.stick, rig.reference = [NEUTRAL_MV] * 2, NEUTRAL_MV
    rig.out.line_mv[:] = rig.stick
    rig.hello()
    rig.run(2041)
    lines = []
    for forward, turn in setpoints.tolist():
        rig.run(TICK_MS, forward, turn)
        assert rig.out.faults == 0
        lines.append(rig.lines())
    return np.array(lines)


def test_a_recorded_drive_gives_the_recorded_lines_without_a_fault(rig: Rig) -> None:
    recording = np.loadtxt(RECORDING, delimiter=",", dtype=np.int64, skiprows=1)
    lines = replay(rig, recording[:, :2])
    differs = np.flatnonzero((lines != recording[:, 2:]).any(axis=1))
    assert differs.size == 0, f"tick {differs[0]}: {lines[differs[0]]} instead of {recording[differs[0]]}"
    assert (rig.out.state, rig.out.holder) == (DRIVE, BOARD)


def test_the_lines_of_a_recorded_drive_follow_its_commands(rig: Rig) -> None:
    recording = np.loadtxt(RECORDING, delimiter=",", dtype=np.int64, skiprows=1)
    wanted = NEUTRAL_MV + recording[:, :2] * SWING_MV / 10_000
    assert np.abs(replay(rig, recording[:, :2]) - wanted).max() <= 0.5
