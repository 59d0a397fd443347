"""Advice from the signal of the behaviour cells: warnings, and the nearest obstacle whenever its class or side changes."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.control.behaviours.commands import Signal, SignalKind, sector_middles
from waychair.control.behaviours.sonar import Obstacle
from waychair.control.haptics.symbols import Advice, Symbol

VALID_NS = 500_000_000
"""Time for which the signal of a tick is good."""

_FIRST = 1_000_000
"""Numbers of this advice begin here, beyond those of the guide."""


@dataclass(frozen=True, slots=True)
class CellMemory:
    """What was signalled last: the warning's reason or the obstacle's sector and class, and how many signals there were."""

    told: tuple[str, int, int] | None = None
    count: int = 0


def cell_advice(signal: Signal | None, memory: CellMemory, now_ns: int) -> tuple[Advice | None, CellMemory]:
    """Return the advice of a tick, None where there is nothing to tell, and the memory after it.

    Of obstacles only close and immediate ones are told; the directions of the paper's cells are left to the guide.
    """
    told = None if signal is None else _told(signal)
    if signal is None or told is None:
        return None, CellMemory(None, memory.count)
    if told != memory.told:
        memory = CellMemory(told, memory.count + 1)
    number, valid_ns = _FIRST + memory.count, now_ns + VALID_NS
    if signal.kind is SignalKind.WARNING:
        return Advice(Symbol.WARNING, number, valid_ns, reason=signal.reason), memory
    direction = sector_middles(len(signal.classes))[told[1]]
    return Advice(Symbol.OBSTACLE_AT, number, valid_ns, direction), memory


def _told(signal: Signal) -> tuple[str, int, int] | None:
    """Return what identifies a signal; None for one that is not told."""
    if signal.kind is SignalKind.WARNING:
        return signal.reason, 0, 0
    if signal.kind is not SignalKind.SPACE or not signal.classes:
        return None
    nearest = max(signal.classes)
    return ("", signal.classes.index(nearest), nearest) if nearest >= Obstacle.CLOSE else None
