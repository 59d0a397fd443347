"""Caps of the rider's own stick, which the board keeps in its state GUARD, and the stick as motion of the chair.

A cap is the part of the swing up to which a deflection passes, in one of four directions. The board clamps the stick; it
never enlarges a deflection and never turns it round (`firmware/guard.h`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.errors import CalibrationError
from waychair.firmware_bridge.line_counts import LineCounts
from waychair.firmware_bridge.protocol import SETPOINT_MAX, CommandFlag, HelloReply
from waychair.types import Twist, WheelSpeeds

STALE_CAP = 0.25
"""Part of the swing that no cap exceeds once the control loop gives no new ones: the board's own default for a lost
computer."""


@dataclass(frozen=True, slots=True)
class Caps:
    """Parts of the swing in [0, 1] that pass to the front, the rear, the left and the right.

    `drops`: for the same directions, whether a drop-off is the reason, which the rider cannot override.
    """

    front: float = 0.0
    rear: float = 0.0
    left: float = 0.0
    right: float = 0.0
    drops: tuple[bool, bool, bool, bool] = (False, False, False, False)

    @property
    def each(self) -> tuple[float, float, float, float]:
        """The four caps in their order."""
        return self.front, self.rear, self.left, self.right

    def narrowed(self, highest: float) -> Caps:
        """Return the caps with none above `highest`."""
        front, rear, left, right = (min(cap, highest) for cap in self.each)
        return Caps(front, rear, left, right, self.drops)

    def flags(self) -> CommandFlag:
        """Return the flags of a limit with these caps."""
        bits = (
            CommandFlag.DROP_TO_FRONT,
            CommandFlag.DROP_TO_REAR,
            CommandFlag.DROP_TO_LEFT,
            CommandFlag.DROP_TO_RIGHT,
        )
        flags = CommandFlag.ENABLE | CommandFlag.GUARD
        for bit, dropped in zip(bits, self.drops, strict=True):
            flags |= bit if dropped else CommandFlag(0)
        return flags

    def setpoints(self) -> tuple[int, int, int, int]:
        """Return the caps in 1/10000 of the swing, rounded down; a cap that is no number is none."""
        front, rear, left, right = (
            math.floor(SETPOINT_MAX * min(max(cap, 0.0), 1.0)) if math.isfinite(cap) else 0 for cap in self.each
        )
        return front, rear, left, right


@dataclass(frozen=True, slots=True)
class StickMotion:
    """The chair's motion at deflections of its own stick, by its calibration and its board; `track` [m]."""

    lines: LineCounts
    neutral_volts: float
    swing_volts: float
    track: float

    @classmethod
    def of(cls, lines: LineCounts, reply: HelloReply, track: float) -> StickMotion:
        """Return the motion with the neutral and the swing of a board's handshake reply."""
        return cls(lines, reply.reference_mv / 1000.0, reply.swing_mv / 1000.0, track)

    def twist(self, forward: float, turn: float) -> Twist:
        """Return the chair's twist at a deflection, each axis in [-1, 1] of the swing, left positive."""
        volts = self.neutral_volts + forward * self.swing_volts, self.neutral_volts - turn * self.swing_volts
        speeds = self.lines.speeds((self.lines.count(volts[0]), self.lines.count(volts[1])))
        return Twist((speeds.left + speeds.right) / 2.0, (speeds.right - speeds.left) / self.track)

    @property
    def bend(self) -> float:
        """Turn [rad/m, left positive] of a straight push, which the calibration knows of."""
        ahead = self.twist(1.0, 0.0)
        return ahead.omega / ahead.v if ahead.v > 0.0 else 0.0

    def deflection(self, twist: Twist) -> tuple[float, float]:
        """Return the deflection (forward, turn) of a twist, each in [-1, 1]; rest is (0, 0).

        Raises:
            CalibrationError: the twist is not finite, or the calibration has no counts for it.
        """
        if twist == Twist():
            return 0.0, 0.0
        half = twist.omega * self.track / 2.0
        if not math.isfinite(half):
            raise CalibrationError(f"{twist} has no deflection of the stick: give finite speeds")
        counts = self.lines.counts(WheelSpeeds(twist.v - half, twist.v + half))
        forward, turn = self.lines.volts(counts, self.neutral_volts)
        parts = (forward - self.neutral_volts) / self.swing_volts, (self.neutral_volts - turn) / self.swing_volts
        return min(max(parts[0], -1.0), 1.0), min(max(parts[1], -1.0), 1.0)
