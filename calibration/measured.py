"""Base class and fields of measured data, which refuse impossible values: the parts of a chair's file."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TypeVar

from waychair.errors import ConfigError

T = TypeVar("T")


def measured(default: T, unit: str, about: str, *, low: float = -math.inf, high: float = math.inf) -> T:
    """Return a dataclass field with its unit, its meaning, and the closed range of its possible values."""
    return dataclasses.field(default=default, metadata={"unit": unit, "about": about, "low": low, "high": high})


@dataclass(frozen=True, slots=True)
class Measured:
    """Base of measured data; a value that is not finite or out of its range raises `ConfigError`."""

    def __post_init__(self) -> None:
        for entry in dataclasses.fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            low, high = entry.metadata.get("low", -math.inf), entry.metadata.get("high", math.inf)
            if not (math.isfinite(value) and low <= value <= high):
                unit = entry.metadata.get("unit", "")
                raise ConfigError(f"{entry.name} = {value} is impossible: it must lie in [{low:g}, {high:g}] {unit}")
