"""The code that the motor-array controller plays on the glove's tactors (paper 2.2 and 3.5).

Tactors form a 3 by 3 grid on the back of the hand, numbered row by row from 0: 0 front-left, 1 front, 2 front-right,
3 left, 4 centre, 5 right, 6 rear-left, 7 rear, 8 rear-right. A direction is a sequence through the centre, a swivel a
circuit, a warning all tactors at once, and an obstacle its outer tactor, longer the nearer it is.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair.control.behaviours.commands import Move, Signal, SignalKind, sector_of
from waychair.control.behaviours.sonar import Obstacle

OUTER = (1, 0, 3, 6, 7, 8, 5, 2)
"""Outer tactors by sector, from straight ahead to the left."""

CLOCKWISE, COUNTER_CLOCKWISE = (1, 5, 7, 3), (1, 3, 7, 5)
_BURST_MS, _SEQUENCE_MS, _CIRCUIT_MS, _WARNING_MS = 100, 150, 110, 250
"""Durations of a stimulus: of a point, in a sequence of three, in a circuit of 440 ms, of a warning."""


@dataclass(frozen=True, slots=True)
class Stimulus:
    """Tactors that vibrate at once, for a time [ms]."""

    tactors: tuple[int, ...]
    milliseconds: int


@dataclass(frozen=True, slots=True)
class ControlCode:
    """Stimuli in turn."""

    stimuli: tuple[Stimulus, ...]


@dataclass(frozen=True, slots=True)
class GloveLayout:
    """Static data of the encoding: the directions [rad] of the classes of a space signal."""

    directions: tuple[float, ...]


def encode_signal(effect: Signal, static: GloveLayout) -> ControlCode:
    """Return the code of a signal."""
    signal, directions = effect, static.directions
    if signal.kind is SignalKind.WARNING:
        return ControlCode((Stimulus(tuple(range(9)), _WARNING_MS),))
    if signal.kind is SignalKind.DIRECTION:
        if signal.move is Move.SWIVEL:
            circuit = COUNTER_CLOCKWISE if signal.orientation >= 0.0 else CLOCKWISE
            return ControlCode(tuple(Stimulus((tactor,), _CIRCUIT_MS) for tactor in circuit))
        sector = sector_of(signal.orientation)
        steps = (OUTER[(sector + 4) % 8], 4, OUTER[sector])
        return ControlCode(tuple(Stimulus((tactor,), _SEQUENCE_MS) for tactor in steps))
    nearest: dict[int, int] = {}
    for angle, found in zip(directions, signal.classes, strict=False):
        sector = sector_of(angle)
        nearest[sector] = max(nearest.get(sector, 0), found)
    told = sorted((sector for sector, found in nearest.items() if found >= Obstacle.NEAR), key=lambda k: -nearest[k])
    return ControlCode(tuple(Stimulus((OUTER[k],), _BURST_MS * (nearest[k] - Obstacle.FAR)) for k in told))
