"""A glove of plain Python for tests: plays patterns as motor levels, millisecond by millisecond."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from waychair.control.haptics.patterns import vocabulary
from waychair.firmware_bridge.glove.levels import MotorLevels
from waychair.firmware_bridge.glove.messages import PlayStep

WORDS = vocabulary("glove_3x3")
LEARNT = WORDS.steps()


class PlainGlove:
    """Plays one pattern at a time; a new one cuts the old one off."""

    def __init__(self) -> None:
        self._rows: list[np.ndarray] = []
        self._now_ms = 0

    def play(self, steps: Sequence[PlayStep]) -> None:
        """Begin a pattern."""
        rest = np.zeros(16, np.uint8)
        self._rows = []
        for step in steps:
            on = np.array([step.strength if step.mask >> k & 1 else 0 for k in range(16)], np.uint8)
            self._rows += [on] * step.on_ms + [rest] * step.off_ms

    def step(self, now_ms: int) -> MotorLevels:
        """Return the levels since the last step."""
        first, count = self._now_ms, now_ms - self._now_ms
        rows = [self._rows.pop(0) if self._rows else np.zeros(16, np.uint8) for _ in range(count)]
        self._now_ms = now_ms
        return MotorLevels(first, np.array(rows, np.uint8).reshape(-1, 16))
