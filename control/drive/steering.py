"""A page's joystick, which steers the chair through the computer at walking speed, monitored like any command.

The rider's own joystick is wired to the chair and always overrides it. A page's joystick reports over a network, so
silence counts as release. A push that was interrupted counts again only after the joystick was released.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.types import Twist


@dataclass(frozen=True, slots=True)
class SteeringSettings(Settings):
    """Speeds at the ends of a page's joystick, and for how long it counts."""

    speed: float = setting(
        0.6,
        "m/s",
        "forward speed at full forward push of the page's joystick; larger: it drives faster",
        low=0.05,
        high=1.0,
    )
    reverse: float = setting(
        0.3,
        "m/s",
        "reverse speed at full backward pull of the page's joystick; larger: it reverses faster",
        low=0.05,
        high=1.0,
    )
    turn: float = setting(
        0.6,
        "rad/s",
        "turning speed at full sideways push of the page's joystick; larger: it turns faster",
        low=0.05,
        high=2.0,
    )


RELEASED_S, HELD_AT_REST_S = 0.3, 10.0
"""s; a joystick silent for so long was released; then the chair is held at rest for so long, so that the next push acts at
once."""

_FORGOTTEN_NS = 2_000_000_000
"""ns; an interrupted push goes on over shorter silences: the network was slow, and nobody released the joystick."""


class Steering:
    """The state of a page's joystick, and whether it counts."""

    def __init__(self, settings: SteeringSettings | None = None) -> None:
        self._settings = settings or SteeringSettings()
        self._asked = Twist()
        self._heard_ns: int | None = None  # while it is held
        self._holds_until_ns: int | None = None  # it holds the lines until then, even at rest
        self._blocked = False

    def push(self, forward: float, turn: float, now_ns: int) -> bool:
        """Take in the joystick's position, each axis in [-1, 1], left positive; a value that is not finite is a
        release.

        Return whether this starts a new push that counts.
        """
        if not (math.isfinite(forward) and math.isfinite(turn)):
            self.let_go(now_ns)
            return False
        s, was_held = self._settings, self.is_held(now_ns)
        silent = self._heard_ns is None or now_ns - self._heard_ns > _FORGOTTEN_NS
        self._blocked = self._blocked and not silent
        self._heard_ns = now_ns
        ahead = s.speed if forward > 0.0 else s.reverse
        self._asked = Twist(ahead * min(1.0, max(-1.0, forward)), s.turn * min(1.0, max(-1.0, turn)))
        if not self._blocked:
            self._holds_until_ns = now_ns + round((RELEASED_S + HELD_AT_REST_S) * 1e9)
        return not (was_held or self._blocked)

    def let_go(self, now_ns: int) -> None:
        """Release the joystick: the chair comes to rest, and is held there for a while."""
        if self.is_held(now_ns) and not self._blocked:
            self._holds_until_ns = now_ns + round(HELD_AT_REST_S * 1e9)
        self._heard_ns, self._blocked = None, False

    def end(self) -> None:
        """End the push for another source of commands; it counts again only after a release."""
        self._blocked, self._holds_until_ns = True, None

    def is_held(self, now_ns: int) -> bool:
        """Return whether somebody holds the joystick, by its latest news."""
        return self._heard_ns is not None and now_ns - self._heard_ns <= RELEASED_S * 1e9

    def counts(self, now_ns: int) -> bool:
        """Return whether the page has the lines, to move the chair or to hold it at rest."""
        return self._holds_until_ns is not None and now_ns <= self._holds_until_ns

    def twist(self, now_ns: int) -> Twist:
        """Return the twist that the joystick asks for now."""
        return self._asked if self.counts(now_ns) and self.is_held(now_ns) else Twist()
