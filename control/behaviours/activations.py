"""Activation functions of the paper (2.1.1): by-pass, algebraic sum, sigmoid, Gaussian and logic, as behaviours.

Each has DI ports named by the caller. A missing value gives no output, except for the logic, where it is false.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from waychair.control.behaviours.cell import Behaviour, DataPort


def bypass(kind: Any, port: str = "value") -> Behaviour:
    """Return the direct link between input and output."""
    return Behaviour(lambda **values: values[port], {port: DataPort(kind)}, kind)


def weighted_sum(weights: Mapping[str, float], bias: float = 0.0) -> Behaviour:
    """Return the algebraic sum of ports, each times its weight, plus a bias."""
    return _of_numbers(weights, lambda values: _sum(weights, values, bias))


def sigmoid(weights: Mapping[str, float], bias: float = 0.0, slope: float = 1.0) -> Behaviour:
    """Return 1 / (1 + exp(-slope * sum)) of the weighted sum of ports, in [0, 1]."""
    return _of_numbers(weights, lambda values: _logistic(slope * _sum(weights, values, bias)))


def gaussian(port: str, mean: float, sigma: float) -> Behaviour:
    """Return exp(-(x - mean)^2 / (2 sigma^2)) of a port, in [0, 1].

    Raises:
        ValueError: sigma is not positive.
    """
    if not sigma > 0.0:
        raise ValueError(f"sigma is {sigma}: give a positive number")
    return _of_numbers((port,), lambda values: math.exp(-0.5 * min(((values[port] - mean) / sigma) ** 2, 1400.0)))


def logic(ports: Sequence[str], rule: Callable[..., bool]) -> Behaviour:
    """Return a logical rule of truth values, which gets the ports by name; a missing value is false."""

    def decide(**values: bool | None) -> bool:
        return bool(rule(**{name: bool(value) for name, value in values.items()}))

    return Behaviour(decide, {name: DataPort(bool, needed=False) for name in ports}, bool)


def _of_numbers(ports: Mapping[str, float] | Sequence[str], rule: Callable[[Mapping[str, float]], float]) -> Behaviour:
    return Behaviour(lambda **values: rule(values), {name: DataPort(float) for name in ports}, float)


def _sum(weights: Mapping[str, float], values: Mapping[str, float], bias: float) -> float:
    return sum((weight * values[name] for name, weight in weights.items()), bias)


def _logistic(x: float) -> float:
    if x >= 0.0:
        return 1.0 / (1.0 + math.exp(-x))
    power = math.exp(max(x, -700.0))
    return power / (1.0 + power)
