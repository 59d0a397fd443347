"""A grave halt of a drive stays until somebody resets it; a loop that was held up does not blame the monitor."""

from __future__ import annotations

from waychair.control.safety.collision_monitor import SILENT_MS, MonitorVerdict
from waychair.control.safety.stops import Halt, halt, halt_as_told
from waychair.runtime.halt_watch import HaltWatch
from waychair.types import Twist

TICK_NS = 50_000_000
DISOBEYS = halt_as_told("disobeys", "it turns left when it should drive ahead")


def ids(halts: tuple[Halt, ...]) -> list[str]:
    return [halted.stop.id for halted in halts]


def verdict(stamp_ns: int, stop: str = "") -> MonitorVerdict:
    return MonitorVerdict(stamp_ns, stamp_ns, Twist(), 1.0, stop=stop)


def test_before_the_first_tick_no_drive_may_begin() -> None:
    assert not HaltWatch().allow_driving


def test_a_grave_halt_of_a_drive_stays_until_it_is_reset() -> None:
    watch = HaltWatch()
    assert ids(watch.update(TICK_NS, verdict(TICK_NS), [DISOBEYS], driven=True)) == ["disobeys"]
    assert ids(watch.update(2 * TICK_NS, verdict(2 * TICK_NS), [], driven=False)) == ["disobeys"]
    assert not watch.allow_driving
    watch.reset()
    assert watch.update(3 * TICK_NS, verdict(3 * TICK_NS), [], driven=False) == ()
    assert watch.allow_driving


def test_a_grave_halt_while_the_rider_drives_goes_with_its_cause() -> None:
    watch = HaltWatch()
    watch.update(TICK_NS, verdict(TICK_NS), [DISOBEYS], driven=False)
    assert watch.update(2 * TICK_NS, verdict(2 * TICK_NS), [], driven=False) == ()


def test_a_latched_halt_that_is_still_there_is_named_once() -> None:
    watch = HaltWatch()
    for tick in (1, 2):
        assert ids(watch.update(tick * TICK_NS, verdict(tick * TICK_NS), [DISOBEYS], driven=True)) == ["disobeys"]


def test_a_monitors_stop_comes_after_the_halts_that_were_found() -> None:
    watch = HaltWatch()
    halts = watch.update(TICK_NS, verdict(TICK_NS, "lidar_late"), [halt("pushed")], driven=True)
    assert ids(halts) == ["pushed", "lidar_late"]


def test_an_old_verdict_counts_as_silence_only_once_the_ticks_have_come_for_so_long() -> None:
    watch, last = HaltWatch(), verdict(TICK_NS)
    watch.update(TICK_NS, last, [], driven=False)
    back_ns = 60 * TICK_NS  # three seconds without a tick
    named = [
        "monitor_silent" in ids(watch.update(back_ns + tick * TICK_NS, last, [], driven=True)) for tick in range(14)
    ]
    assert named.index(True) * TICK_NS == (SILENT_MS + 50) * 1_000_000
    assert all(named[named.index(True) :])
