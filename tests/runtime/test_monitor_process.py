"""The monitor's process gives the same verdicts as the monitor in the tick, and its death or sleep stops the chair."""

from __future__ import annotations

import math
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.firmware_bridge.bridged import Bridged
from waychair.calibration.chair_body import CHAIR_B
from waychair.calibration.fits.self_mask import SelfMask
from waychair.calibration.fits.stopping import StopTable
from waychair.control.safety.arc_clearance import MonitorSettings
from waychair.control.safety.collision_monitor import MonitorVerdict, stale_stop
from waychair.firmware_bridge.board import board_program
from waychair.firmware_bridge.protocol import Holder
from waychair.runtime.monitor_process import (
    MonitorInStep,
    MonitorProcess,
    Watched,
    _scan_from,
    _scan_message,
    _verdict_from,
    _verdict_message,
)
from waychair.types import Scan, Twist, WheelSpeeds

PATIENCE_S = 20.0
AHEAD = Twist(0.3, 0.0)


def room(stamp_ns: int, away: float = 3.0) -> Scan:
    """A round room about the laser, with the noise of a lidar."""
    ranges = np.random.default_rng(stamp_ns).normal(away, 0.005, 240).astype(np.float32)
    return Scan(stamp_ns, ranges, -2.3, 4.6 / 239, 1e-4, 0.05, 25.0)


@pytest.fixture
def process() -> Iterator[MonitorProcess]:
    with MonitorProcess(Watched()) as process:
        yield process


def eventually(condition: Callable[[], bool]) -> bool:
    """Return whether a condition comes true; it is checked a hundred times a second."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.01)
    return False


def open_after_a_scan(process: MonitorProcess, away: float = 3.0) -> bool:
    """Pass a scan and a command on; return whether the latest verdict permits speed."""
    process.see(room(time.monotonic_ns(), away))
    process.judge(AHEAD, Twist(), 0)
    verdict = process.verdict
    return verdict is not None and verdict.twist == AHEAD and stale_stop(verdict, time.monotonic_ns()) == ""


def is_silent(process: MonitorProcess) -> bool:
    """Return whether the gate is closed for lack of a verdict."""
    process.see(room(time.monotonic_ns()))
    return stale_stop(process.verdict, time.monotonic_ns()) == "monitor_silent"


def test_messages_are_the_same_on_the_other_side() -> None:
    scan = replace(room(123456789012345), ranges=np.array([1.5, math.inf, -math.inf, math.nan], np.float32))
    back = _scan_from(_scan_message(scan))
    assert np.array_equal(back.ranges, scan.ranges, equal_nan=True)
    assert replace(back, ranges=scan.ranges) == scan
    for verdict in (
        MonitorVerdict(1, None, Twist(0.1, -0.2), 0.0, stop="lidar_late"),
        MonitorVerdict(2, -5, Twist(), 0.5, 1.25, ""),
    ):
        assert _verdict_from(_verdict_message(verdict)) == verdict


def verdict_on(process: MonitorProcess, scan: Scan) -> MonitorVerdict:
    """Return the process's verdict on this scan for the command AHEAD."""
    process.see(scan)

    def found() -> bool:
        process.judge(AHEAD, Twist(), 0)
        verdict = process.verdict
        return verdict is not None and (verdict.scan_ns, verdict.twist) == (scan.stamp_ns, AHEAD)

    assert eventually(found)
    verdict = process.verdict
    assert verdict is not None
    return verdict


def judged_in_step(watched: Watched, scan: Scan, at_ns: int) -> MonitorVerdict | None:
    """Return the same verdict of the monitor in the tick."""
    in_step = MonitorInStep(watched)
    in_step.see(scan)
    in_step.judge(AHEAD, Twist(), at_ns)
    return in_step.verdict


def test_the_process_gives_the_same_verdicts_as_the_monitor_in_the_tick(process: MonitorProcess) -> None:
    for away in (3.0, 0.3):
        scan = room(time.monotonic_ns(), away)
        verdict = verdict_on(process, scan)
        assert verdict == judged_in_step(Watched(), scan, verdict.stamp_ns)


def test_it_judges_by_its_own_timer_without_a_command(process: MonitorProcess) -> None:
    stamps: set[int] = set()

    def counted() -> bool:
        if process.verdict is not None:
            stamps.add(process.verdict.stamp_ns)
        return len(stamps) >= 5

    assert eventually(counted)


def test_it_judges_for_the_given_chair() -> None:
    table = StopTable(speeds=(0.2, 0.4), distances=(0.1, 0.9), turn_rate=0.5, turn_angle=0.3, delay_s=0.1)
    watched = Watched(CHAIR_B, MonitorSettings(reaction_s=0.1), table, SelfMask((-0.1,), (0.1,), (0.3,)))
    with MonitorProcess(watched) as process:
        scan = room(time.monotonic_ns(), 1.2)
        verdict = verdict_on(process, scan)
    assert verdict == judged_in_step(watched, scan, verdict.stamp_ns)


@pytest.mark.parametrize("death", [signal.SIGKILL, signal.SIGSTOP])
def test_f25_a_killed_or_stopped_monitor_takes_the_speed_from_the_lines(
    process: MonitorProcess, death: signal.Signals
) -> None:
    with Bridged(board_program()) as bridged:

        def gate(now_ns: int) -> str:
            process.see(room(time.monotonic_ns()))
            return stale_stop(process.verdict, time.monotonic_ns())

        bridged.bridge._gate = gate
        assert eventually(lambda: open_after_a_scan(process))
        bridged.run(2500, WheelSpeeds(0.3, 0.3))
        assert eventually(lambda: bridged.run(50, WheelSpeeds(0.3, 0.3)).wheel_speeds.left > 0.2)
        os.kill(process.pid, death)
        assert eventually(lambda: bridged.run(50, WheelSpeeds(0.3, 0.3)).reason == "monitor_silent")
        sent = bridged.run(300, WheelSpeeds(0.3, 0.3))
        assert (sent.wheel_speeds, sent.active) == (WheelSpeeds(), True)
        assert bridged.lines.holder is Holder.BOARD
        assert bridged.lines.forward_mv == pytest.approx(1650, abs=15)


def test_a_resumed_monitor_is_used_again_and_judges_by_new_scans(process: MonitorProcess) -> None:
    assert eventually(lambda: open_after_a_scan(process))
    os.kill(process.pid, signal.SIGSTOP)
    assert eventually(lambda: is_silent(process))
    for _ in range(500):  # more than the channel holds: no process waits
        process.see(room(time.monotonic_ns()))
    os.kill(process.pid, signal.SIGCONT)
    assert eventually(lambda: open_after_a_scan(process))


@pytest.mark.parametrize("death", [signal.SIGKILL, signal.SIGSTOP])
def test_a_dead_monitor_is_restarted_on_demand_only(process: MonitorProcess, death: signal.Signals) -> None:
    assert eventually(lambda: open_after_a_scan(process))
    before = process.pid
    os.kill(before, death)
    assert eventually(lambda: is_silent(process))
    process.restart()
    assert process.pid != before
    assert process.verdict is None
    assert eventually(lambda: open_after_a_scan(process))


def test_the_process_ends_with_the_control_loop(process: MonitorProcess) -> None:
    assert eventually(lambda: process.verdict is not None)
    process._socket.shutdown(socket.SHUT_RDWR)
    process._socket.close()
    assert process._process.wait(PATIENCE_S) == 0
