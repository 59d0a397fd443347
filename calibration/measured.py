"""Base class and fields of measured data, which refuse impossible values: the parts of a chair's file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

from waychair.config import check_ranges, setting

T = TypeVar("T")


def measured(default: T, unit: str, about: str, *, low: float = -math.inf, high: float = math.inf) -> T:
    """Return a dataclass field with its unit, its meaning, and the closed range of its possible values."""
    return setting(default, unit, about, low=low, high=high)


@dataclass(frozen=True, slots=True)
class Measured:
    """Base of measured data; a value that is not finite or out of its range raises `ConfigError`."""

    def __post_init__(self) -> None:
        check_ranges(self)
