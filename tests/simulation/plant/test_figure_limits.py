"""The limits of a chair's figures: read from their types, and checked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import pytest

from waychair.errors import ConfigError
from waychair.simulation.plant.figure_limits import Limits, check_limits, limits_of


@dataclass(frozen=True, slots=True)
class Motor:
    torque: Annotated[float, Limits(0.01, 500.0)] = 55.0
    poles: Annotated[int, Limits(2, 8)] = 4
    name: str = ""

    def __post_init__(self) -> None:
        check_limits(self)


def test_limits_are_read_from_the_types() -> None:
    assert limits_of(Motor) == {"torque": (0.01, 500.0), "poles": (2, 8)}


@pytest.mark.parametrize("torque", [0.01, 500.0])
def test_figures_at_the_limits_are_accepted(torque: float) -> None:
    assert Motor(torque).torque == torque


@pytest.mark.parametrize("torque", [0.0, 500.1, math.nan, math.inf])
def test_figures_beyond_the_limits_are_refused(torque: float) -> None:
    with pytest.raises(ConfigError, match=r"torque = .* is impossible: give a value in \[0\.01, 500\]"):
        Motor(torque)
