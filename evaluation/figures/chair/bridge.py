"""Bridge and board: a live joystick after the death of either, harmless random bytes, and the round-trip time."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path

import numpy as np
from tests.firmware_bridge.fuzzing import build_fuzzer, fuzz

from waychair.firmware_bridge.board import board_program
from waychair.firmware_bridge.fail_safe import BUDGET_MS, KillReport, kill_board, kill_host
from waychair.firmware_bridge.round_trip import round_trips_ms
from waychair.types import Json

MOMENTS = 1000
FUZZED_BYTES = 10_000_000
ROUND_TRIPS = 3000
ROUND_TRIP_MS = 10.0


def host_killed(out: Path) -> Json:
    """SIGKILL of the computer's process at 1,000 random moments of a drive: simulated time to a live joystick."""
    return _deaths(kill_host(board_program(), MOMENTS))


def board_killed(out: Path) -> Json:
    """The board freezes, browns out or is killed at 1,000 random moments of a drive: time to a live joystick."""
    return _deaths(kill_board(board_program(), MOMENTS))


def round_trip(out: Path) -> Json:
    """From a command to its echo, in real time over a pseudo-terminal; with and without real-time priority.

    The bar applies to the figure with real-time priority, if the system grants it: a real board has its own processor,
    so the delays by other programs here do not count. The other figure and the machine's load are reported beside it.
    """
    program = board_program()
    times, granted = round_trips_ms(program, ROUND_TRIPS)
    plain, _ = round_trips_ms(program, ROUND_TRIPS, urgently=False)
    p99 = float(np.percentile(times, 99))
    return {
        "passed": p99 <= ROUND_TRIP_MS,
        "round_trips": ROUND_TRIPS,
        "real_time_priority": granted,
        "median_ms": round(float(np.median(times)), 2),
        "p99_ms": round(p99, 2),
        "longest_ms": round(float(times.max()), 2),
        "plain_median_ms": round(float(np.median(plain)), 2),
        "plain_p99_ms": round(float(np.percentile(plain, 99)), 2),
        "load_per_core": round(os.getloadavg()[0] / (os.cpu_count() or 1), 1),
    }


def run_fuzz(out: Path) -> Json:
    """10^7 fuzzed bytes into the board's loop under AddressSanitizer and UndefinedBehaviorSanitizer."""
    with tempfile.TemporaryDirectory() as folder:
        done = fuzz(build_fuzzer(Path(folder)), FUZZED_BYTES, seed=0)
    counted = re.match(r"(\d+) bytes, (\d+) edges, corpus of (\d+)", done.stdout)
    return {
        "passed": done.returncode == 0 and counted is not None and int(counted[1]) >= FUZZED_BYTES,
        "status": done.returncode,
        "bytes": int(counted[1]) if counted else 0,
        "edges": int(counted[2]) if counted else 0,
        "complaint": done.stderr.strip()[:500],
    }


def _deaths(report: KillReport) -> Json:
    return {
        "passed": len(report.trials) == MOMENTS and not report.failures and report.longest_ms <= BUDGET_MS,
        "moments": len(report.trials),
        "failures": len(report.failures),
        "longest_ms": report.longest_ms,
        "failure_rate_bound_95": round(report.failure_bound, 5),
    }
