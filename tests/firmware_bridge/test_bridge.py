"""The gate before the joystick lines: what passes, what is released, what is really sent."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.dac import DEFAULT, LinearDac, counts_from_wheel_speeds, wheel_speeds_from_counts
from waychair.firmware_bridge import bridge as bridge_module
from waychair.firmware_bridge.bridge import Bridge, BridgeSettings
from waychair.types import WheelSpeeds

TICK_NS = 50_000_000
MS = 1_000_000
GOOD = WheelSpeeds(0.3, 0.3)


class RecordedLines:
    """Lines that remember the volts they are held at, None while released."""

    def __init__(self) -> None:
        self.volts: tuple[float, float] | None = (0.0, 0.0)

    def drive(self, forward_volts: float, turn_volts: float) -> None:
        self.volts = (forward_volts, turn_volts)

    def release(self) -> None:
        self.volts = None


def _bridge(settings: BridgeSettings | None = None) -> tuple[Bridge, RecordedLines]:
    lines = RecordedLines()
    return Bridge(lines, DEFAULT, settings), lines


def test_a_new_bridge_releases_the_lines() -> None:
    assert _bridge()[1].volts is None


def test_a_fresh_command_is_on_the_lines_as_reported() -> None:
    bridge, lines = _bridge()
    sent = bridge.send(WheelSpeeds(0.2, 0.2), 0, 0)
    assert sent.active
    assert sent.reason == ""
    assert (sent.forward_counts, sent.turn_counts) == counts_from_wheel_speeds(DEFAULT, WheelSpeeds(0.2, 0.2))
    assert lines.volts == (sent.forward_volts, sent.turn_volts)
    assert sent.wheel_speeds == wheel_speeds_from_counts(DEFAULT, sent.forward_counts, sent.turn_counts)
    assert sent.wheel_speeds.left == pytest.approx(0.2, abs=0.0175)


@pytest.mark.parametrize(
    ("speeds", "stamp_ns", "reason"),
    [
        (None, 1000 * MS, "no command"),
        (WheelSpeeds(math.nan, 0.1), 1000 * MS, "not finite"),
        (WheelSpeeds(0.1, math.inf), 1000 * MS, "not finite"),
        (WheelSpeeds(-math.inf, 0.1), 1000 * MS, "not finite"),
        (WheelSpeeds(1.61, 0.1), 1000 * MS, "beyond"),
        (WheelSpeeds(0.1, -1.61), 1000 * MS, "beyond"),
        (GOOD, 849 * MS, "old"),
        (GOOD, -1000 * MS, "old"),
        (GOOD, 1000 * MS + 1, "future"),
    ],
)
def test_a_command_that_must_not_pass_releases_the_lines_in_the_same_tick(
    speeds: WheelSpeeds | None, stamp_ns: int, reason: str
) -> None:
    bridge, lines = _bridge()
    assert bridge.send(GOOD, 950 * MS, 950 * MS).active
    assert lines.volts is not None
    sent = bridge.send(speeds, stamp_ns, 1000 * MS)
    assert lines.volts is None
    assert not sent.active
    assert reason in sent.reason
    assert sent.wheel_speeds == WheelSpeeds()
    assert (sent.forward_counts, sent.turn_counts) == (128, 128)


@pytest.mark.parametrize("age_ms", [0, 1, 149, 150])
def test_a_command_of_up_to_150_ms_is_fresh(age_ms: int) -> None:
    bridge, lines = _bridge()
    assert bridge.send(GOOD, (1000 - age_ms) * MS, 1000 * MS).active
    assert lines.volts is not None


def test_a_clock_that_goes_back_releases_the_lines_once() -> None:
    bridge, lines = _bridge()
    bridge.send(GOOD, 1000 * MS, 1000 * MS)
    assert "clock" in bridge.send(GOOD, 900 * MS, 900 * MS).reason
    assert lines.volts is None
    assert bridge.send(GOOD, 950 * MS, 950 * MS).active


@pytest.mark.parametrize("wrong", [(300, 128), (-1, 128), (128, 256), (128.4, 128)])
def test_wrong_counts_release_the_lines(monkeypatch: pytest.MonkeyPatch, wrong: tuple[int, int]) -> None:
    bridge, lines = _bridge()

    def broken(_model: LinearDac, _speeds: WheelSpeeds) -> tuple[int, int]:
        return wrong

    monkeypatch.setattr(bridge_module, "counts_from_wheel_speeds", broken)
    sent = bridge.send(GOOD, 0, 0)
    assert not sent.active
    assert "no counts" in sent.reason
    assert lines.volts is None


def test_a_jump_is_spread_over_ticks_and_ends_at_the_command() -> None:
    bridge, _ = _bridge(BridgeSettings(slew=10))
    wanted = counts_from_wheel_speeds(DEFAULT, WheelSpeeds(0.9, 0.9))
    counts = []
    for tick in range(12):
        sent = bridge.send(WheelSpeeds(0.9, 0.9), tick * TICK_NS, tick * TICK_NS)
        counts.append(sent.forward_counts)
    assert counts[:3] == [138, 148, 158]
    assert (sent.forward_counts, sent.turn_counts) == wanted


def test_after_a_release_the_slew_starts_at_neutral_again() -> None:
    bridge, _ = _bridge(BridgeSettings(slew=10))
    for tick in range(5):
        bridge.send(WheelSpeeds(0.9, 0.9), tick * TICK_NS, tick * TICK_NS)
    bridge.send(None, 5 * TICK_NS, 5 * TICK_NS)
    assert bridge.send(WheelSpeeds(0.9, 0.9), 6 * TICK_NS, 6 * TICK_NS).forward_counts == 138


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(), st.floats(), st.integers(-200, 200)), max_size=30), st.integers(1, 60))
def test_no_stream_of_commands_raises_or_outruns_the_slew(commands: list[tuple[float, float, int]], slew: int) -> None:
    bridge, lines = _bridge(BridgeSettings(slew=slew))
    before, active_before = (128, 128), False
    for tick, (left, right, age_ms) in enumerate(commands):
        now_ns = tick * TICK_NS
        sent = bridge.send(WheelSpeeds(left, right), now_ns - age_ms * MS, now_ns)
        counts = (sent.forward_counts, sent.turn_counts)
        assert sent.active == (lines.volts is not None)
        assert sent.active == (
            0 <= age_ms <= 150 and math.isfinite(left) and math.isfinite(right) and max(abs(left), abs(right)) <= 1.6
        )
        reference = before if active_before else (128, 128)
        assert max(abs(counts[0] - reference[0]), abs(counts[1] - reference[1])) <= slew or not sent.active
        before, active_before = counts, sent.active
