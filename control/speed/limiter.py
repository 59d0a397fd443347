"""The comfort limiter between the navigator and the closed loop: acceleration, braking, curves and jerk.

The command keeps to the arc that was asked for and is only slowed down along it, so that the path checked by the
planner is the path driven. Speeding up is limited in acceleration and jerk, and turning faster is limited by alpha.
Braking that the planner asks for passes unchanged, up to emergency braking: the planner chose the arc on the promise of
that braking, and its own window limits it. Speed caps from outside (a zone, a doubtful gain, an unmeasured chair, the
collision monitor's share) and comfortable stops are approached with limited jerk. An emergency is exempt from all of it.

Sources of the figures. No accessible standard limits a wheelchair's accelerations in numbers, so they are engineering
choices. ISO 2631-1 (1997), annex C, calls a weighted acceleration of less than 0.315 m/s^2 r.m.s. not uncomfortable and
0.5 to 1 m/s^2 fairly uncomfortable; Solea and Nunes (ICINCO 2008) judge a robotic wheelchair by it and smooth its
speeds by limited jerk. So acceleration and lateral acceleration stay at 0.5 m/s^2, where a drive's r.m.s. is below
0.315. An emergency brakes at 1.5 m/s^2, beyond which riders without a belt slide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from waychair.config import Settings, setting
from waychair.control.safety.stops import Braking
from waychair.types import Twist

_LONGEST_S = 0.1
"""s; a step after a longer pause is no larger than after this."""

_FASTEST = 3.0
"""m/s, rad/s; a faster command is a fault of its source (F5), because no setting allows it."""

_LATE = 1.25
"""A command that slows down to a permitted share with limited jerk is at most so many times the share: about half of the
way that lies between a comfortable stop and an emergency's is left."""

_AT_REST = 1e-3
"""m/s; a slower command is at rest."""


@dataclass(frozen=True, slots=True)
class LimiterSettings(Settings):
    """One comfort profile; the defaults are `PROFILES["normal"]`."""

    max_speed: float = setting(
        0.8, "m/s", "highest speed of a command, forwards or in reverse; larger: faster drive", low=0.05, high=3.0
    )
    max_omega: float = setting(
        0.8, "rad/s", "highest turning speed of a command; larger: faster turns", low=0.05, high=3.0
    )
    acceleration: float = setting(
        0.5,
        "m/s^2",
        "highest acceleration when the chair speeds up; larger: quicker, rougher starts",
        low=0.05,
        high=3.0,
    )
    braking: float = setting(
        0.6, "m/s^2", "deceleration of a comfortable stop; larger: shorter, harder stops", low=0.05, high=3.0
    )
    emergency: float = setting(
        1.5, "m/s^2", "deceleration of an emergency stop; larger: shorter, harder stops", low=0.5, high=4.0
    )
    alpha: float = setting(
        0.8,
        "rad/s^2",
        "highest angular acceleration in comfort; larger: turns begin and end more abruptly",
        low=0.05,
        high=5.0,
    )
    emergency_alpha: float = setting(
        3.0, "rad/s^2", "angular deceleration of an emergency stop; larger: turns end more abruptly", low=0.5, high=10.0
    )
    lateral: float = setting(
        0.5, "m/s^2", "highest lateral acceleration v * omega; larger: faster bends", low=0.05, high=3.0
    )
    jerk: float = setting(
        0.7,
        "m/s^3",
        "highest change of the acceleration per second; larger: quicker, rougher drive",
        low=0.1,
        high=20.0,
    )


PROFILES: Mapping[str, LimiterSettings] = MappingProxyType(
    {
        "gentle": LimiterSettings(
            max_speed=0.5, max_omega=0.5, acceleration=0.3, braking=0.4, alpha=0.5, lateral=0.3, jerk=0.4
        ),
        "normal": LimiterSettings(),
        "brisk": LimiterSettings(max_speed=1.2, max_omega=1.0, acceleration=0.8, braking=0.8, alpha=1.2, jerk=1.5),
    }
)
"""Profiles for riders with little balance, for most riders, and for riders that sit firmly; emergencies brake alike."""


class Limiter:
    """The comfort limiter with its state: the last command and its rate of change."""

    def __init__(self, settings: LimiterSettings | None = None) -> None:
        self._settings = settings or LimiterSettings()
        self._lever = self._settings.acceleration / self._settings.alpha  # m; both limits are equal at this radius
        self.rest()

    @property
    def command(self) -> Twist:
        """The last command."""
        return self._command

    @property
    def moving(self) -> bool:
        """Whether the last command was not at rest."""
        return self._size(self._command) > _AT_REST

    def rest(self) -> None:
        """Start the next command from standstill, because the lines were released."""
        self._command, self._rate = Twist(), 0.0
        self._last_ns: int | None = None

    def step(
        self,
        asked: Twist,
        now_ns: int,
        cap: float = math.inf,
        share: float = 1.0,
        braking: Braking | None = None,
    ) -> Twist:
        """Return the command of this tick.

        `cap` [m/s] limits the speed smoothly. So does `share` in [0, 1] of the asked twist, the collision monitor's, but
        the command is never faster than `_LATE` times the share. With `braking` the chair comes to rest in that way,
        whatever is asked. An asked twist that is not finite or not possible is an emergency (F5).
        """
        s, before = self._settings, self._command
        passed = 0.05 if self._last_ns is None else (now_ns - self._last_ns) * 1e-9
        seconds = min(max(passed, 0.0), _LONGEST_S)
        self._last_ns = now_ns
        if not is_possible(asked):
            braking = Braking.EMERGENCY
        if braking is Braking.RELEASE:
            command = Twist()
        elif braking is Braking.EMERGENCY:
            command = _towards(before, Twist(), s.emergency * seconds, s.emergency_alpha * seconds)
        elif braking is Braking.COMFORT:
            command = self._sized(before, self._slower(self._size(before), 0.0, seconds))
        else:
            wanted = self._comfortable(asked)
            if share < 1.0:
                cap, wanted = min(cap, share * self._size(wanted)), _scaled(wanted, min(1.0, _LATE * share))
            size = min(self._size(wanted), self._faster(self._size(before), cap, seconds))
            if self._size(before) > cap and self._size(wanted) > cap:
                size = min(self._size(wanted), self._slower(self._size(before), cap, seconds))
            command = _towards(before, self._sized(wanted, size), s.emergency * seconds, s.emergency_alpha * seconds)
            command = _no_faster(before, command, s.acceleration * seconds, s.alpha * seconds)
        self._rate = (self._size(command) - self._size(before)) / max(seconds, 1e-3)
        self._command = command
        return command

    def _comfortable(self, asked: Twist) -> Twist:
        """Return the twist of the same arc within the profile's speeds and lateral acceleration."""
        s = self._settings
        sideways = math.sqrt(s.lateral / max(abs(asked.v * asked.omega), 1e-9))
        fastest = min(s.max_speed / max(abs(asked.v), 1e-9), s.max_omega / max(abs(asked.omega), 1e-9))
        return _scaled(asked, min(1.0, sideways, fastest))

    def _faster(self, size: float, cap: float, seconds: float) -> float:
        """Return the greatest size of the next command that still reaches the cap, or the top speed, smoothly."""
        s = self._settings
        room = max(min(cap, s.max_speed) - size, 0.0)
        rate = min(max(self._rate, 0.0) + s.jerk * seconds, s.acceleration, _rate_before(room, s.jerk, seconds))
        return size + rate * seconds

    def _slower(self, size: float, target: float, seconds: float) -> float:
        """Return the next size on the way down to a target."""
        s = self._settings
        room = max(size - target, 0.0)
        rate = min(max(-self._rate, 0.0) + s.jerk * seconds, s.braking, _rate_before(room, s.jerk, seconds))
        after = size - max(rate, s.jerk * seconds) * seconds
        return max(after, target)

    def _size(self, twist: Twist) -> float:
        """Return a twist's size [m/s]: its speed, or that of a point the lever off the axle if it is faster."""
        return max(abs(twist.v), self._lever * abs(twist.omega))

    def _sized(self, twist: Twist, size: float) -> Twist:
        """Return the twist of the same arc at another size."""
        return _scaled(twist, size / max(self._size(twist), 1e-9))


def is_possible(asked: Twist) -> bool:
    """Return whether some setting could allow a twist (F5); False if it is not a number."""
    return abs(asked.v) <= _FASTEST and abs(asked.omega) <= _FASTEST


def _rate_before(room: float, jerk: float, seconds: float) -> float:
    """Return the greatest rate of change that can fall to 0 by limited jerk within `room` left, in steps of a tick."""
    lost = 0.5 * jerk * seconds
    return math.sqrt(lost * lost + 2.0 * jerk * room) - lost


def _no_faster(before: Twist, after: Twist, dv: float, domega: float) -> Twist:
    """Return `after` with at most dv more speed and domega more turning than `before`, each on its own."""
    return Twist(_grown(before.v, after.v, dv), _grown(before.omega, after.omega, domega + _ROUNDED))


def _grown(before: float, after: float, most: float) -> float:
    """Return `after`, limited to an increase of `most` in magnitude; a reversal counts as an increase from 0."""
    direction = math.copysign(1.0, after)
    return direction * min(abs(after), max(direction * before, 0.0) + most)


_ROUNDED = 1e-9
"""rad/s; tolerance for the planner's own rounding of the same limit."""


def _scaled(twist: Twist, share: float) -> Twist:
    return Twist(share * twist.v, share * twist.omega)


def _towards(before: Twist, wanted: Twist, dv: float, domega: float) -> Twist:
    """Return the twist on the straight line from `before` to `wanted`, neither speed changed by more than its limit."""
    v, omega = wanted.v - before.v, wanted.omega - before.omega
    share = min(1.0, dv / max(abs(v), 1e-12), domega / max(abs(omega), 1e-12))
    return Twist(before.v + share * v, before.omega + share * omega)
