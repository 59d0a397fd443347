"""The bytes between a simulated world and its chairs' processes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

import numpy as np
import pytest

from waychair.trials.fleet.live.wire import (
    ChairStep,
    ChairWord,
    WorldMoment,
    WorldStep,
    decoded,
    encoded,
    packed_sensor,
    sensor_from,
)
from waychair.types import ImuSample, RgbdFrame, Scan, SensorMessage, SonarReadings, WheelTicks

MESSAGES: tuple[SensorMessage, ...] = (
    WheelTicks(5, -3, 70_000),
    Scan(6, np.array([1.5, np.inf, np.nan], np.float32), -1.0, 0.5, 1e-4, 0.05, 12.0),
    ImuSample(7, np.array([0.0, 0.1, 9.81]), np.array([0.0, 0.0, -0.2])),
    SonarReadings(8, np.array([0.4, np.inf], np.float32)),
    RgbdFrame(9, np.zeros((2, 3, 3), np.uint8), np.ones((2, 3), np.float32), np.eye(3), 0.01),
)


def values(message: SensorMessage) -> Iterator[object]:
    """Yield the fields of a message."""
    return (getattr(message, each.name) for each in fields(message))


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_sensor_message_comes_as_it_was_sent_or_later_by_the_chairs_clock(message: SensorMessage) -> None:
    step = decoded(WorldStep, encoded(WorldStep(1, 2, 3, [packed_sensor(message)], b"\x01")))
    assert step is not None
    kind, packed = step.sensors[0]
    found = sensor_from(kind, packed, 100)
    assert type(found) is type(message)
    assert found.stamp_ns == message.stamp_ns + 100
    for mine, sent in list(zip(values(found), values(message), strict=True))[1:]:
        np.testing.assert_array_equal(mine, sent)  # type: ignore[call-overload]
        assert getattr(mine, "dtype", None) == getattr(sent, "dtype", None)


def test_damaged_bytes_are_no_message() -> None:
    word = encoded(ChairWord(7, "room 4", line=((0.0, 1.0), (2.0, np.float64(3.0)))))
    assert decoded(ChairWord, word) == ChairWord(7, "room 4", line=((0.0, 1.0), (2.0, 3.0)))
    assert decoded(ChairWord, word[:-1]) is None
    assert decoded(WorldMoment, word) is None
    assert decoded(ChairStep, b"\xc1") is None
    for kind, packed in ((9, [0]), (0, [0]), (1, [0, {"t": "<f4"}, 0.0, 0.1])):
        with pytest.raises(ValueError, match="no sensor message"):
            sensor_from(kind, packed)
