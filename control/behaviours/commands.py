"""The commands that the cells hand to each other: orientations, directions, door commands, signals.

Angles are in radians in the base frame, to the left positive; a sector is named by the angle of its middle.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from waychair.geometry import wrap_angle

SECTORS = 8
"""Sectors of the paper's free space: 45 degrees each, one for each outer tactor."""

WORDS = ("forward", "front-left", "left", "rear-left", "back", "rear-right", "right", "front-right")
"""Words of the eight directions, to the left."""


class FreeKind(enum.Enum):
    """LIST: orientations without an immediate obstacle. STOP: looked and found none. NULL: did not look."""

    LIST = "list"
    STOP = "stop"
    NULL = "null"


@dataclass(frozen=True, slots=True)
class FreeCommand:
    """Command_free: its kind, the free orientations [rad], in the order of the sectors, and the number of sectors."""

    kind: FreeKind
    orientations: tuple[float, ...] = ()
    sectors: int = SECTORS


NULL = FreeCommand(FreeKind.NULL)
STOP = FreeCommand(FreeKind.STOP)


class Move(enum.Enum):
    """GO: drive towards an orientation. SWIVEL: turn on the spot towards it. DONE: the door lies behind."""

    GO = "go"
    SWIVEL = "swivel"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class DoorCommand:
    """Command_door: a move and its orientation [rad]."""

    move: Move
    orientation: float = 0.0


class SignalKind(enum.Enum):
    """The three kinds of vibrotactile signals (paper 3.5)."""

    WARNING = "warning"
    SPACE = "space"
    DIRECTION = "direction"


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal to the rider. `move` and `orientation` [rad] of a direction; `classes` by sector of a space signal."""

    kind: SignalKind
    reason: str = ""
    move: Move = Move.GO
    orientation: float = 0.0
    classes: tuple[int, ...] = ()


def sector_middles(count: int = SECTORS) -> tuple[float, ...]:
    """Return the middles of equal sectors [rad], from straight ahead to the left, in (-pi, pi]."""
    return tuple(wrap_angle(k * math.tau / count) for k in range(count))


def sector_of(angle: float, count: int = SECTORS) -> int:
    """Return the index of the sector that an angle lies in."""
    return round(angle / math.tau * count) % count


def between(first: float, second: float) -> float:
    """Return the angle between two directions, in [0, pi]."""
    return abs(wrap_angle(first - second))


def move_words(move: Move, orientation: float) -> str:
    """Return a move in the paper's words, such as "go front-left" or "swivel clockwise"."""
    if move is Move.DONE:
        return "through the door"
    if move is Move.SWIVEL:
        return f"swivel {'counter-clockwise' if orientation >= 0.0 else 'clockwise'}"
    return f"go {WORDS[sector_of(orientation)]}"


def signal_words(signal: Signal) -> str:
    """Return a signal in words."""
    if signal.kind is SignalKind.WARNING:
        return f"stop the chair: {signal.reason}"
    if signal.kind is SignalKind.DIRECTION:
        return move_words(signal.move, signal.orientation)
    return signal.reason or "nothing near"
