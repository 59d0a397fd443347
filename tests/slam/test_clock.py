"""A sensor's clock is found under the jitter of its messages' arrivals, and follows when somebody sets it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.errors import ThinData
from waychair.slam.clock import ClockEstimator, ClockSettings, SensorClock, first_beam
from waychair.types import IntArray, Scan

BOOT = 5_000_000_000
EPOCH = 1_700_000_000_000_000_000
MS = 1_000_000


def arrivals(
    clock: SensorClock, seconds: float, rate_hz: float = 50.0, jitter_s: float = 0.01, seed: int = 0
) -> tuple[IntArray, IntArray]:
    """Stamps and arrivals of a sensor whose messages are late by an exponential jitter, a few by half a second."""
    rng = np.random.default_rng(seed)
    stamps = BOOT + np.arange(round(seconds * rate_hz)) * round(1e9 / rate_hz)
    late = rng.exponential(jitter_s, len(stamps)) + 0.5 * (rng.random(len(stamps)) < 0.01)
    hosts = np.array([clock.host_from_sensor(stamp) for stamp in stamps.tolist()], np.int64)
    return stamps, hosts + (late * 1e9).astype(np.int64)


def feed(estimator: ClockEstimator, stamps: IntArray, hosts: IntArray) -> None:
    """Everything in the order of arrival at the sensor."""
    for stamp, host in zip(stamps.tolist(), hosts.tolist(), strict=True):
        estimator.add(stamp, host)


def worst_error(found: SensorClock, true: SensorClock, stamps: IntArray) -> float:
    """Largest error of a conversion [s]."""
    return (
        max(abs(found.host_from_sensor(s) - true.host_from_sensor(s)) for s in stamps[:: len(stamps) // 20].tolist())
        * 1e-9
    )


@given(offset=st.integers(-(10**18), 10**18), latency=st.integers(0, 10**9), stamp=st.integers(0, 2 * 10**18))
def test_without_drift_the_conversion_is_exact_to_the_nanosecond(offset: int, latency: int, stamp: int) -> None:
    assert SensorClock(offset, 0.0, latency).host_from_sensor(stamp) == stamp + offset - latency


def test_drift_counts_from_the_reference() -> None:
    clock = SensorClock(1000, 10.0, 200, reference_ns=EPOCH)
    assert clock.host_from_sensor(EPOCH) == EPOCH + 800
    assert clock.host_from_sensor(EPOCH + 10**9) == EPOCH + 10**9 + 800 + 10_000


@pytest.mark.parametrize("drift_ppm", [-200.0, -20.0, 0.0, 50.0, 400.0])
def test_offset_and_drift_are_found_under_the_jitter_of_arrivals(drift_ppm: float) -> None:
    true = SensorClock(EPOCH, drift_ppm, 0, BOOT)
    stamps, hosts = arrivals(true, 120.0)
    estimator = ClockEstimator()
    feed(estimator, stamps, hosts)
    found = estimator.clock()
    assert found.drift_ppm == pytest.approx(drift_ppm, abs=10.0)
    assert worst_error(found, true, stamps) < 0.002  # where the mean arrival is 15 ms late
    assert estimator.steps == 0


def test_a_known_latency_is_taken_off() -> None:
    stamps, hosts = arrivals(SensorClock(EPOCH), 30.0)
    estimator = ClockEstimator()
    feed(estimator, stamps, hosts)
    assert estimator.clock().host_from_sensor(BOOT) - estimator.clock(7 * MS).host_from_sensor(BOOT) == 7 * MS


def test_no_line_below_the_arrivals_is_nearer_to_them() -> None:
    """The hull's edge against a search over all lines through two of the points."""
    stamps, hosts = arrivals(SensorClock(EPOCH, 80.0, 0, BOOT), 40.0, seed=3)
    estimator = ClockEstimator(ClockSettings(bucket_s=1.0))
    feed(estimator, stamps, hosts)
    found = estimator.clock()
    buckets = stamps // 10**9
    earliest = [
        int(np.flatnonzero(buckets == b)[np.argmin((hosts - stamps)[buckets == b])]) for b in np.unique(buckets)
    ]
    x, y = (stamps[earliest] - BOOT).astype(float), (hosts - stamps - EPOCH)[earliest].astype(float)
    sums = []
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            line = y[i] + (y[j] - y[i]) / (x[j] - x[i]) * (x - x[i])
            if (line <= y + 1.0).all():
                sums.append(float((y - line).sum()))
    own = np.array([found.host_from_sensor(s) - s - EPOCH for s in stamps[earliest].tolist()], float)
    assert (own <= y + 2.0).all()
    assert float((y - own).sum()) == pytest.approx(min(sums), abs=100.0)


@pytest.mark.parametrize("step_s", [-3600.0, -0.2, 0.2, 3600.0])
def test_a_computer_whose_clock_is_set_is_noticed_and_followed(step_s: float) -> None:
    true = SensorClock(EPOCH, 30.0, 0, BOOT)
    stamps, hosts = arrivals(true, 60.0)
    later = hosts + np.where(stamps > stamps[len(stamps) // 2], round(step_s * 1e9), 0)
    estimator = ClockEstimator()
    feed(estimator, stamps, later)
    assert estimator.steps == 1
    moved = SensorClock(true.offset_ns + round(step_s * 1e9), 30.0, 0, BOOT)
    assert worst_error(estimator.clock(), moved, stamps[-500:]) < 0.003


def test_a_sensor_that_starts_again_is_noticed() -> None:
    estimator = ClockEstimator()
    stamps, hosts = arrivals(SensorClock(EPOCH), 30.0)
    feed(estimator, stamps, hosts)
    feed(estimator, stamps, hosts + 60 * 10**9)  # its clock begins at 5 s once more
    assert estimator.steps == 1
    assert worst_error(estimator.clock(), SensorClock(EPOCH + 60 * 10**9), stamps) < 0.003


def test_memory_is_bounded_by_the_window() -> None:
    estimator = ClockEstimator(ClockSettings(window_s=20.0))
    wobbling = SensorClock(EPOCH, 100.0, 0, BOOT)
    feed(estimator, *arrivals(wobbling, 200.0))
    assert len(estimator._earliest) == 20


def test_before_anything_arrived_there_is_no_clock() -> None:
    with pytest.raises(ThinData, match="switched on"):
        ClockEstimator().clock()


@pytest.mark.parametrize(("stamped", "late"), [("first", 0), ("middle", 5), ("last", 10)])
def test_a_scan_is_stamped_at_its_first_beam_whichever_its_driver_stamps(stamped: str, late: int) -> None:
    scan = Scan(100 * MS, np.ones(11, np.float32), 0.0, 0.1, time_step=0.001)
    moved = first_beam(scan, stamped)  # type: ignore[arg-type]
    assert moved.stamp_ns == (100 - late) * MS
    assert math.isclose(moved.time_step, scan.time_step)
