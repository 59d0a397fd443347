"""The chair's own bend: how far it turns by itself while the stick asks for none, by its motors, its tyres or the floor.

The guard clamps the stick and cannot correct it. So the rider's pushes are judged along the bend, not along a straight line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.firmware_bridge.bridge import AT_REST
from waychair.types import Twist

SETTLED_NS, SLOWEST = 400_000_000, 0.08
"""ns after the last turn of the stick, and m/s: before, or slower, the chair does not show its own bend."""

AVERAGED_M, MOST = 0.3, 0.4
"""m of driving over which the bend is averaged, and rad/m: more is no chair's own."""


@dataclass(frozen=True, slots=True)
class OwnBend:
    """The bend [rad/m, left positive] beyond that of the joystick's model, as the latest straight stretches have shown it.

    `straight_ns`: since when no turn has been passed to the chair; `stamp_ns`: of the last tick in which it was not.
    """

    bend: float = 0.0
    straight_ns: int | None = None
    stamp_ns: int | None = None

    def after(self, now_ns: int, passed_turn: float, measured: Twist, modelled: float) -> OwnBend:
        """Return the bend after a tick.

        `passed_turn`: the stick's turn that reaches the chair, a share of the swing. `modelled`: the bend [rad/m] of a straight
        push by the joystick's model, which the pushes have in them already.
        """
        if not (abs(passed_turn) <= AT_REST and math.isfinite(measured.v) and math.isfinite(measured.omega)):
            return OwnBend(self.bend)
        since_ns = now_ns if self.straight_ns is None else self.straight_ns
        if self.stamp_ns is None or now_ns - since_ns < SETTLED_NS or abs(measured.v) < SLOWEST:
            return OwnBend(self.bend, since_ns, now_ns)
        way = abs(measured.v) * max(now_ns - self.stamp_ns, 0) * 1e-9
        shown = min(max(measured.omega / measured.v - modelled, -MOST), MOST)
        return OwnBend(self.bend + min(way / AVERAGED_M, 1.0) * (shown - self.bend), since_ns, now_ns)
