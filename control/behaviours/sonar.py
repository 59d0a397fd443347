"""Obstacle notification (paper 3.1): the sonars' packet, `decode_packet`, and `translate_data`.

The paper gives no packet. Ours holds what an SRF-08 measures: `A5`, the number of sonars, a range in centimetres for
each (two bytes, high byte first; 0: no echo, FFFF: the sonar did not answer), and the low byte of the sum of all before.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from waychair.control.behaviours.paper_settings import ObstacleLimits
from waychair.errors import BehaviourError

_START = 0xA5
_SILENT = 0xFFFF
_NO_ECHO = 0
LEAST_RANGE = 0.03
"""m; an SRF-08 measures from 3 cm on; a nearer thing reads less, and is too close."""


class PacketDamaged(BehaviourError):
    """A sonar packet is cut short or altered."""


@dataclass(frozen=True, slots=True)
class SonarPacket:
    """A packet as it came from the microcontroller."""

    data: bytes


@dataclass(frozen=True, slots=True)
class SonarRanges:
    """Ranges [m] by REP-117: +inf no echo, -inf too close, nan silent."""

    metres: tuple[float, ...]


class Obstacle(enum.IntEnum):
    """Class of the nearest obstacle that a sonar sees, the nearer the higher; UNKNOWN: the sonar is silent."""

    UNKNOWN = 0
    FAR = 1
    NEAR = 2
    CLOSE = 3
    IMMEDIATE = 4


@dataclass(frozen=True, slots=True)
class ObstacleClasses:
    """Command_obs: a class for each sonar."""

    classes: tuple[Obstacle, ...]

    def immediate(self) -> int:
        """Return the number of immediate obstacles."""
        return sum(each is Obstacle.IMMEDIATE for each in self.classes)

    @property
    def known(self) -> bool:
        """Whether any sonar is heard."""
        return any(each is not Obstacle.UNKNOWN for each in self.classes)


def packet_from_ranges(metres: Sequence[float]) -> SonarPacket:
    """Return the packet of ranges [m] by REP-117, rounded to centimetres."""
    body = bytes([_START, len(metres)]) + b"".join(_centimetres(each).to_bytes(2, "big") for each in metres)
    return SonarPacket(body + bytes([sum(body) & 0xFF]))


def _centimetres(metres: float) -> int:
    if math.isnan(metres):
        return _SILENT
    if metres == math.inf:
        return _NO_ECHO
    return min(max(round(100.0 * metres) if math.isfinite(metres) else 1, 1), _SILENT - 1)


def read_sonars(packet: SonarPacket) -> SonarPacket:
    """Return the packet: the Sonar reader is a by-pass, shared by all networks that need sonars."""
    return packet


def decode_packet(packet: SonarPacket) -> SonarRanges:
    """Return the ranges in a packet.

    Raises:
        PacketDamaged: it is cut short or altered.
    """
    data = packet.data
    wanted = 3 + 2 * data[1] if len(data) > 1 else 3
    if len(data) != wanted or data[0] != _START:
        raise PacketDamaged(f"a sonar packet of {len(data)} bytes is cut short or altered: {wanted} were announced")
    if sum(data[:-1]) & 0xFF != data[-1]:
        raise PacketDamaged("a sonar packet does not have its check sum: see the cable of the sonars")
    values = (int.from_bytes(data[k : k + 2], "big") for k in range(2, len(data) - 1, 2))
    return SonarRanges(tuple(_metres(value) for value in values))


def _metres(value: int) -> float:
    if value == _SILENT:
        return math.nan
    if value == _NO_ECHO:
        return math.inf
    return -math.inf if value < round(100 * LEAST_RANGE) else value / 100.0


@dataclass(frozen=True, slots=True)
class LastClasses:
    """Dynamic data of `translate_data`: the classes before; empty at the beginning."""

    classes: tuple[Obstacle, ...] = ()


def translate_data(
    ranges: SonarRanges, constants: ObstacleLimits, dynamic: LastClasses
) -> tuple[ObstacleClasses, LastClasses]:
    """Return the class of each range. A nearer class begins at its limit and ends a hysteresis beyond it."""
    before = dynamic.classes
    if len(before) != len(ranges.metres):
        before = (Obstacle.UNKNOWN,) * len(ranges.metres)
    pairs = zip(ranges.metres, before, strict=True)
    classes = tuple(obstacle_class(metres, was, constants) for metres, was in pairs)
    return ObstacleClasses(classes), LastClasses(classes)


def obstacle_class(metres: float, before: Obstacle, limits: ObstacleLimits) -> Obstacle:
    """Return the class of a range after the class before."""
    if math.isnan(metres):
        return Obstacle.UNKNOWN
    bounds = (
        (Obstacle.IMMEDIATE, limits.immediate),
        (Obstacle.CLOSE, limits.close),
        (Obstacle.NEAR, limits.near),
    )
    for name, bound in bounds:
        if metres < bound + (limits.hysteresis if before >= name else 0.0):
            return name
    return Obstacle.FAR
