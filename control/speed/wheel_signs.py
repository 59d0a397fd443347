"""Recognition of wheel encoders that are exchanged, reversed or dead, by the wheels' motion beside the expected one.

Such encoders make the chair seem to turn, stand or drive backwards. A speed dial or a free-wheel lever changes both
wheels alike, and never their signs. So each way to connect the encoders wrongly is a hypothesis about both wheels, and
the one that explains the last moments far better than right encoders is named. Two causes look alike to wheels alone:
an encoder that tells no motion, and a wheel that does not move. The scans tell them apart.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from waychair.types import FloatArray, Pose2, Twist

WINDOW_S = 1.2
"""s; the motion of so long is judged."""

LEAST_PATH = 0.07
"""m; each wheel must be expected to drive so far in it. In a turn about one wheel, the other one alone is enough if it leaves
one hypothesis only."""

DEAD_PATH = 0.15
"""m; path of a wheel beside which the other one counts as dead, longer because a wheel may stall at a sill. Twice as far that
the dead one should have driven is enough as well, if the other one, on the inside of a bend, has driven LEAST_PATH."""

BETTER, WRONG, RIGHT = 4.0, 0.12, 0.2
"""A hypothesis must leave this many times less than right encoders, which leave more than WRONG, and itself at most RIGHT
of the expected motion's square unexplained."""

LEAST_GAIN, MOST_GAIN = 0.4, 1.6
"""Range of the chair's gain, alike on both wheels: the speed dial may be turned, too."""

_WAYS = ("", "exchanged", "left", "right", "both", "turned", "left dead", "right dead")


class WheelSigns:
    """The wheels' paths of the last moments, expected and measured; `fault` stays until a new watch is made."""

    def __init__(self, track: float) -> None:
        """`track` [m] is the distance between the drive wheels."""
        self._half = track / 2
        self._steps: deque[tuple[float, ...]] = deque()  # seconds, expected and measured path, each left and right [m]
        self._last_ns: int | None = None
        self._places: deque[tuple[int, Pose2, Pose2]] = deque()  # stamp, pose by scans, pose by odometry
        self.fault = ""

    def locate(self, stamp_ns: int, map_from_base: Pose2, odom_from_base: Pose2) -> None:
        """Take in the pose by the scans at a stamp, and that by the odometry."""
        self._places.append((stamp_ns, map_from_base, odom_from_base))
        while len(self._places) > 2 and stamp_ns - self._places[0][0] > WINDOW_S * 1e9:
            self._places.popleft()

    def forget_places(self) -> None:
        """Forget the poses by the scans, because the map has changed."""
        self._places.clear()

    def step(self, expected: Twist, paths: tuple[float, float] | None, now_ns: int, *, judged: bool) -> str:
        """Take in a tick: the expected mean twist, and the paths [m] of left and right wheel since the last tick.

        `paths` None: no reading came. Ticks that are not `judged` (brake, joystick) start the judgement anew. Return the
        fault with its remedy, or "".
        """
        seconds = 0.0 if self._last_ns is None else (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        if not judged or not 0.0 < seconds < WINDOW_S:
            self._steps.clear()
            return self.fault
        if paths is None or not (math.isfinite(expected.v) and math.isfinite(expected.omega)):
            return self.fault
        turn = expected.omega * self._half
        self._steps.append((seconds, (expected.v - turn) * seconds, (expected.v + turn) * seconds, *paths))
        while sum(step[0] for step in self._steps) > WINDOW_S:
            self._steps.popleft()
        self.fault = self.fault or self._judge(np.array(self._steps))
        return self.fault

    def blind_standstill(self) -> bool:
        """Return whether the scans moved while the wheels stood, so that the encoders, not the chair, are at rest."""
        if len(self._places) < 2:
            return False
        (_, place, odometry), (_, there, odometry_there) = self._places[0], self._places[-1]
        moved, told = place.inverse() @ there, odometry.inverse() @ odometry_there
        return math.hypot(moved.x, moved.y) > LEAST_PATH > 4.0 * math.hypot(told.x, told.y)

    def _judge(self, steps: FloatArray) -> str:
        expected, measured = steps[:, 1:3], steps[:, 3:5]
        driven = np.abs(expected).sum(axis=0)
        if len(steps) < 4 or driven.max() < LEAST_PATH:
            return ""
        left, right = expected.T
        still = np.zeros_like(left)
        wheels = (
            (left, right), (right, left), (-left, right), (left, -right),
            (-left, -right), (-right, -left), (still, right), (left, still),
        )  # fmt: skip
        power = float((expected**2).sum())
        missed = [_unexplained(np.column_stack(pair), measured) / power for pair in wheels]
        best = int(np.argmin(missed))
        way = _WAYS[best]
        if not way or missed[0] < WRONG or missed[best] > RIGHT or missed[0] < BETTER * missed[best]:
            return ""
        if way.endswith("dead"):
            told = float(np.abs(measured).sum(axis=0).max())
            if told < LEAST_PATH or (told < DEAD_PATH and driven.max() < 2 * DEAD_PATH):
                return ""
        # a straight drive does not show whether the wheels are exchanged, too, and a turn on the spot shows either
        alike = {_WAYS[k] for k in range(1, len(_WAYS)) if missed[k] <= min(RIGHT, BETTER * missed[best])}
        if driven.min() < LEAST_PATH and len(alike) > 1:
            return ""
        if {"exchanged", "both"} <= alike:
            return _sentence("exchanged or both")
        return _sentence("both" if {"both", "turned"} <= alike else way)


def _unexplained(supposed: FloatArray, measured: FloatArray) -> float:
    """Return the squared paths [m^2] that a hypothesis leaves unexplained at its best gain."""
    power = float((supposed**2).sum())
    gain = float((supposed * measured).sum()) / max(power, 1e-12)
    gain = min(max(gain, LEAST_GAIN), MOST_GAIN)
    return float(((measured - gain * supposed) ** 2).sum())


def _sentence(way: str) -> str:
    """Return the fault and its remedy."""
    if way == "exchanged":
        return "the wheel encoders are exchanged, left for right (F20): change their plugs, then press Reset"
    if way == "exchanged or both":
        return (
            "the wheel encoders are exchanged, left for right, or both count backwards (F20): check their plugs and wires, "
            "then press Reset"
        )
    if way == "turned":
        return (
            "the wheel encoders are exchanged and count backwards (F20): change their plugs and wires, then press Reset"
        )
    if way == "both":
        return (
            "both wheel encoders count backwards, or the chair drives backwards at a command forwards (F20): check the "
            "encoders' wires and the joystick lines, then press Reset"
        )
    if way.endswith("dead"):
        side = way.split()[0]
        return (
            f"the {side} wheel's encoder tells no motion while the other one does (F20): check its cable, and whether that "
            "wheel turns, then press Reset"
        )
    return f"the {way} wheel's encoder counts backwards (F20): change its wires, then press Reset"


BOTH_DEAD = "both wheel encoders tell no motion while the scans do (F20): check their cables, then press Reset"
