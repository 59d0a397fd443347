"""The heartbeat's thread: no error ends it, and every error is reported."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.firmware_bridge.bridged import GOOD, TICK_MS, Bridged
from waychair.firmware_bridge.heartbeat import Heartbeat

PATIENCE_S = 20.0


def _eventually(condition: Callable[[], object]) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


def test_a_failed_beat_is_reported_once_ends_the_drive_and_later_beats_are_tried(
    board_program: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with Bridged(board_program) as link:
        link.drive()
        failing, beats = [True], [0]

        def clock() -> int:
            beats[0] += 1
            if failing[0]:
                raise TypeError("no descriptor")
            return link.now_ns

        with caplog.at_level(logging.ERROR), Heartbeat(link.bridge, link.cable, clock):
            assert _eventually(lambda: beats[0] >= 3)
            sent = link.send(GOOD)
            assert (sent.active, "the heartbeat failed (no descriptor)" in sent.reason) == (False, True)
            assert link.bridge.trouble == (sent.reason,)
            failing[0] = False
            assert _eventually(lambda: link.bridge.trouble == ())
            assert not link.send(GOOD).active  # nothing resumes by itself
        assert [record.getMessage() for record in caplog.records] == [sent.reason]
        link.run(TICK_MS, None)
        link.drive()
