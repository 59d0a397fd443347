"""Chairs in processes of their own drive to their goals, and go on after any of the processes was killed."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from waychair.trials.fleet.live.live_fleet import LiveFleet
from waychair.trials.fleet.live.live_plan import new_plan

PATIENCE_S = 300.0
OVER_LINE_M = 0.05


def until(fleet: LiveFleet, holds: Callable[[], bool]) -> None:
    """Watch a fleet until something holds; only a broken program reaches the limit."""
    ends = time.monotonic() + PATIENCE_S
    while not holds():
        fleet.watch()
        assert not fleet.ended, fleet.ended
        assert time.monotonic() < ends, (fleet.record.words, fleet.record.ended)


@pytest.mark.nightly
@pytest.mark.realtime
def test_chairs_reach_goals_though_a_chair_and_the_world_are_killed(tmp_path: Path) -> None:
    with LiveFleet(tmp_path, new_plan(tmp_path, "T", 2, 0)) as fleet:
        record = fleet.record
        until(fleet, lambda: record.is_moving)
        for name in ("chair 1", "world"):
            before = sum(chair.metres for chair in record.run.chairs)
            os.kill(fleet.pids[name], signal.SIGKILL)
            until(fleet, lambda before=before: sum(each.metres for each in record.run.chairs) > before + 1.0)  # type: ignore[misc]
        until(fleet, lambda: sum(chair.reached for chair in record.run.chairs) >= 2)
        assert record.run.contacts == 0
        assert max(chair.over_line for chair in record.run.chairs) <= OVER_LINE_M
        assert len([what for _, what in record.ended if "SIGKILL" in what]) == 2
