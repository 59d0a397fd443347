"""The motors' levels that the glove's program on this computer reports, millisecond by millisecond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class MotorLevels:
    """Levels of the board's outputs, `levels` (n, 16) uint8, of the milliseconds from `first_ms` on, modulo 2^32.

    A level is the drive that the motor really gets, from 0 (at rest) to 255 (its full strength), behind gains, limits and
    defects. Row k holds the millisecond `first_ms + k`; outputs without a motor stay 0.
    """

    first_ms: int
    levels: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.levels)
