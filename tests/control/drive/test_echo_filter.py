"""Sonar echoes count once they are confirmed by a second one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.runtime.riding import FAR, Ride
from waychair.control.drive.echo_filter import EchoFilter
from waychair.control.drive.navigator import Stage
from waychair.simulation.sensors import sonar
from waychair.simulation.sensors.sonar import SonarSettings
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.drive import start_drive
from waychair.types import SonarReadings

PERIOD_MS = 50


def told(*ranges: float, period_ms: int = PERIOD_MS) -> list[float]:
    """Filter one sonar's readings, one a period; nan for unconfirmed echoes."""
    echoes = EchoFilter()
    readings = (
        SonarReadings(k * period_ms * 1_000_000, np.array([r], np.float32)) for k, r in enumerate(ranges, start=1)
    )
    return [round(float(echoes.confirmed(each).ranges[0]), 3) for each in readings]


def test_an_echo_counts_from_its_second_reading_on() -> None:
    np.testing.assert_equal(told(1.0, 1.04, 0.98), [math.nan, 1.04, 0.98])


def test_a_single_echo_is_unknown_and_a_missing_echo_stays_no_echo() -> None:
    np.testing.assert_equal(told(math.inf, 1.0, math.inf, -math.inf), [math.inf, math.nan, math.inf, -math.inf])


def test_an_echo_between_two_of_a_farther_wall_does_not_replace_the_wall() -> None:
    np.testing.assert_equal(told(2.0, 2.0, 0.7, 2.0), [math.nan, 2.0, math.nan, 2.0])


def test_an_echo_in_every_other_reading_counts() -> None:
    np.testing.assert_equal(told(1.0, math.inf, 1.0, math.inf, 1.0)[2:], [1.0, math.inf, 1.0])


@pytest.mark.parametrize(("off", "counts"), [(0.14, True), (0.16, False)])
def test_echoes_confirm_each_other_within_the_distance_that_the_chair_may_have_driven(off: float, counts: bool) -> None:
    assert math.isnan(told(1.0, 1.0 - off)[1]) is not counts


@pytest.mark.parametrize(("period_ms", "counts"), [(250, True), (251, False)])
def test_echoes_confirm_each_other_for_a_short_time_only(period_ms: int, counts: bool) -> None:
    assert math.isnan(told(1.0, 1.0, period_ms=period_ms)[1]) is not counts


def test_readings_of_another_clock_confirm_nothing() -> None:
    echoes = EchoFilter()
    for stamp_ns in (10**12, 50_000_000):  # set back
        assert np.isnan(echoes.confirmed(SonarReadings(stamp_ns, np.ones(1, np.float32))).ranges).all()


@given(st.lists(st.floats(0.0625, 4.0, width=32), min_size=8, max_size=8))
def test_each_sonar_is_confirmed_by_its_own_readings_only(ranges: list[float]) -> None:
    echoes, moved = EchoFilter(), np.array(ranges, np.float32)
    moved[3] += 0.2
    echoes.confirmed(SonarReadings(0, np.array(ranges, np.float32)))
    found = echoes.confirmed(SonarReadings(PERIOD_MS * 1_000_000, moved)).ranges
    assert np.flatnonzero(np.isnan(found)).tolist() == [3]


@pytest.mark.nightly
def test_crosstalk_between_sonars_stops_no_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sonar, "CROSS_TALK", 0.02)
    with Ride(simulator=SimulatorSettings(sonar=SonarSettings(rate_hz=20.0))) as ride:
        start_drive(ride.simulator, ride.chair, FAR)
        stages = [ride.tick().navigation.stage for _ in range(20 * 20)]
        plans = ride.states[-1].navigation.plans
    assert stages[-1] is Stage.ARRIVED
    assert Stage.WAITING not in stages
    assert plans <= 2
