"""Phase margin and stability of the speed loop from its exact sampled transfer function.

The chair answers with gain K, a delay that need not be a whole number of ticks, and a lag. Its mean speed over a tick
is measured at the tick's end, and the command holds for a tick (Astrom and Wittenmark, Computer-Controlled Systems,
section 3.2). Ramps and dead bands are not linear, so simulations test them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.control.speed.speed_loop import Gains
from waychair.types import FloatArray

_FREQUENCIES = 4000


@dataclass(frozen=True, slots=True)
class TrueAxis:
    """The true response of a chair's axis: gain, delay [s] and lag [s]."""

    gain: float
    delay_s: float
    lag_s: float


def loop_polynomials(gains: Gains, axis: TrueAxis, period_s: float, *, held: bool) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator of the open loop, highest power of z first; `held`: with heading and line
    hold."""
    t = period_s
    ticks, part = divmod(axis.delay_s, t)
    begin, end = _held(axis.lag_s, part), _held(axis.lag_s, t - part)
    keep = begin.keep * end.keep
    # Speed at the tick's end and distance over the tick, from the older input and then the newer one.
    older = np.array([(1.0 - begin.keep) * end.keep, begin.way_of_input + (1.0 - begin.keep) * end.way_of_speed])
    newer = np.array([1.0 - end.keep, end.way_of_input])
    way_of_speed = begin.way_of_speed + begin.keep * end.way_of_speed
    chair = np.polymul([1.0, -keep], [newer[1], older[1]])
    chair = np.polyadd(chair, way_of_speed * np.array([newer[0], older[0]])) * axis.gain / t
    chair_below = np.polymul([1.0, -keep], np.eye(1, int(ticks) + 3)[0])
    pi = np.polyadd(gains.proportional * np.array([1.0, -1.0]), gains.integral * t * np.array([1.0, 0.0]))
    above, below = np.polymul(chair, pi), np.polymul(chair_below, [1.0, -1.0])
    if held:
        along = gains.heading * t * np.array([1.0, -1.0, 0.0])
        across = gains.heading * gains.line * t * t * np.array([1.0, 0.0, 0.0])
        above = np.polymul(above, np.array([1.0, -2.0, 1.0]) + along + across)
        below = np.polymul(below, [1.0, -2.0, 1.0])
    return above, below


def phase_margin(gains: Gains, axis: TrueAxis, period_s: float, *, held: bool) -> float:
    """Return the least phase margin [rad] over all crossings of magnitude 1; +inf if there is none."""
    above, below = loop_polynomials(gains, axis, period_s, held=held)
    z = np.exp(1j * np.geomspace(1e-4, math.pi, _FREQUENCIES))
    loop = np.polyval(above, z) / np.polyval(below, z)
    size = np.abs(loop)
    crossings = np.flatnonzero((size[:-1] >= 1.0) != (size[1:] >= 1.0))
    if not len(crossings):
        return math.inf
    phases = -np.mod(-np.angle(loop), 2.0 * math.pi)  # in (-2 pi, 0]
    return float(math.pi + np.minimum(phases[crossings], phases[crossings + 1]).min())


def slowest_decay(gains: Gains, axis: TrueAxis, period_s: float, *, held: bool) -> float:
    """Return the largest magnitude of the closed loop's poles; below 1 every disturbance decays."""
    above, below = loop_polynomials(gains, axis, period_s, held=held)
    return float(np.abs(np.roots(np.polyadd(below, above))).max())


@dataclass(frozen=True, slots=True)
class _Held:
    """A lag under a constant input for some time: the remaining share of its speed, and the distances driven.

    One distance comes from its speed at the start, the other from the input.
    """

    keep: float
    way_of_speed: float
    way_of_input: float


def _held(lag_s: float, seconds: float) -> _Held:
    keep = math.exp(-seconds / lag_s)
    way = lag_s * (1.0 - keep)
    return _Held(keep, way, seconds - way)
