"""Limits of the figures of a simulated chair, in the types of the dataclasses that a chair's file holds.

@dataclass(frozen=True, slots=True)
class Motor:
    torque: Annotated[float, Limits(0.01, 500.0)] = 55.0  # N m

    def __post_init__(self) -> None:
        check_limits(self)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, get_type_hints

from waychair.errors import ConfigError


class Limits(NamedTuple):
    """The closed range of a figure."""

    low: float
    high: float


_FOUND: dict[type, Mapping[str, Limits]] = {}  # by dataclass: resolving type hints takes long


def limits_of(kind: type) -> Mapping[str, Limits]:
    """Return the limits of a dataclass's fields, for those that have limits."""
    if kind not in _FOUND:
        hints = get_type_hints(kind, include_extras=True)
        metadata = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
        _FOUND[kind] = {name: each for name, found in metadata.items() for each in found if isinstance(each, Limits)}
    return _FOUND[kind]


def check_limits(figures: Any) -> None:
    """Check all figures of a dataclass against their limits.

    Raises:
        ConfigError: a figure is not finite or outside its limits.
    """
    for name, (low, high) in limits_of(type(figures)).items():
        value = getattr(figures, name)
        if not (math.isfinite(value) and low <= value <= high):
            raise ConfigError(f"{name} = {value} is impossible: give a value in [{low:g}, {high:g}]")
