"""Pacing: in real time, as fast as possible, or one tick for each answer."""

from __future__ import annotations

import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.errors import DriverSilent
from waychair.simulation.pacing import PaceMode, Pacer
from waychair.simulation.plant.pseudo_terminal import PseudoTerminal

MS = 1_000_000


class Wall:
    """A clock that advances only by sleeping and computing."""

    def __init__(self) -> None:
        self.now_ns = 77
        self.slept: list[float] = []

    def clock(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.slept.append(seconds)
        self.now_ns += round(seconds * 1e9)


def run(mode: PaceMode, work_ms: list[int], tick_ms: int = 50, slack: float = 0.1) -> tuple[Pacer, Wall]:
    """Run ticks of simulated time that take this long to compute."""
    wall = Wall()
    pacer = Pacer(mode, slack_s=slack, clock=wall.clock, sleep=wall.sleep)
    pacer.pace(0)
    for k, work in enumerate(work_ms):
        wall.now_ns += work * MS
        pacer.pace((k + 1) * tick_ms * MS)
    return pacer, wall


def test_realtime_sleeps_for_the_rest_of_each_tick() -> None:
    pacer, wall = run(PaceMode.REALTIME, [10, 20, 49, 0])
    assert wall.slept == pytest.approx([0.040, 0.030, 0.001, 0.050])
    assert pacer.real_time_factor == pytest.approx(1.0)
    assert pacer.lost_s == 0.0


def test_realtime_catches_up_a_short_delay() -> None:
    pacer, wall = run(PaceMode.REALTIME, [120, 10, 10])
    assert wall.now_ns - 77 == 150 * MS
    assert pacer.lost_s == 0.0


def test_realtime_never_hurries_after_a_long_delay_and_reports_the_lost_time() -> None:
    pacer, wall = run(PaceMode.REALTIME, [1050, *[10] * 20])
    assert pacer.lost_s == pytest.approx(0.9)
    assert wall.now_ns - 77 == (21 * 50 + 900) * MS
    assert pacer.real_time_factor == pytest.approx(1050 / 1950)


def test_a_machine_that_is_too_slow_reports_its_factor() -> None:
    pacer, wall = run(PaceMode.REALTIME, [100] * 50)
    assert wall.slept == []
    assert pacer.real_time_factor == pytest.approx(0.5)
    assert pacer.lost_s == pytest.approx(2.4)  # 2.5 s behind, of which the slack is to be caught up


@given(st.lists(st.integers(0, 400), min_size=1, max_size=40))
def test_realtime_is_never_early_and_late_by_no_more_than_the_lost_time_and_the_slack(work_ms: list[int]) -> None:
    pacer, wall = run(PaceMode.REALTIME, work_ms)
    behind = (wall.now_ns - 77) * 1e-9 - 0.05 * len(work_ms) - pacer.lost_s
    assert -1e-6 <= behind <= 0.1 + 1e-6


@pytest.mark.parametrize("mode", [PaceMode.FAST, PaceMode.LOCKSTEP])
def test_fast_pacing_and_a_driver_in_the_same_process_never_wait(mode: PaceMode) -> None:
    pacer, wall = run(mode, [5] * 10)
    assert wall.slept == []
    assert pacer.real_time_factor == pytest.approx(10.0)


def test_before_the_first_tick_there_is_no_factor_and_a_repeated_time_counts_once() -> None:
    wall = Wall()
    pacer = Pacer(PaceMode.REALTIME, clock=wall.clock, sleep=wall.sleep)
    assert pacer.real_time_factor == 0.0
    for _ in range(3):
        pacer.pace(50 * MS)
    assert wall.slept == []
    pacer.pace(100 * MS)
    pacer.pace(100 * MS)
    assert wall.slept == pytest.approx([0.05])


def test_realtime_follows_the_real_clock() -> None:
    pacer, began = Pacer(PaceMode.REALTIME), time.monotonic()
    for k in range(11):
        pacer.pace(k * 10 * MS)
    assert time.monotonic() - began >= 0.0999


def test_lockstep_takes_one_tick_for_each_answer_of_the_peer() -> None:
    with PseudoTerminal() as cable:

        def peer() -> None:
            with cable.path.open("r+b", buffering=0) as port:
                for _ in range(20):
                    tick = port.read(1)
                    time.sleep(0.002)
                    port.write(tick)

        thread = threading.Thread(target=peer, daemon=True)
        thread.start()
        while not cable.connected:
            time.sleep(0.001)
        pacer = Pacer(PaceMode.LOCKSTEP, cable)
        answers = []
        for k in range(20):
            assert cable.write(bytes([k])) == 1
            pacer.pace((k + 1) * 50 * MS)
            answers.append(cable.read())
        thread.join(5.0)
    assert answers == [bytes([k]) for k in range(20)]


def test_lockstep_gives_up_on_a_driver_that_stays_silent() -> None:
    with PseudoTerminal() as cable:
        pacer = Pacer(PaceMode.LOCKSTEP, cable, timeout_s=0.02)
        with pytest.raises(DriverSilent, match=r"for 0\.02 s at 0\.050 s of simulated time; start it"):
            pacer.pace(50 * MS)
