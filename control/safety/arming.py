"""Detection of a drive that does not get the joystick lines, because the stick does not rest or the board does not arm.

The board arms only once its stick has been at rest for two seconds. A worn stick that rests at 0.12 of its swing is
neither at rest nor a takeover: the chair would wait for ever, and creep by that stick meanwhile.
"""

from __future__ import annotations

from waychair.control.safety.stops import Halt, halt
from waychair.control.safety.supervisor import SupervisorSettings, deflection_of
from waychair.types import JoystickInput

TOUCHED_S = 0.5
"""s; a drive that waits for the stick to rest says so after this time."""

OFF_REST_S = 5.0
"""s; a stick off rest for so long without a takeover is not let go of: longer than a hand stays by accident."""

NEVER_ARMED_S = 10.0
"""s; a board that has not armed for so long, five times its own wait at rest, will not."""


class Arming:
    """The detection's state."""

    def __init__(self, settings: SupervisorSettings) -> None:
        self._settings = settings
        self._off_rest_since_ns: int | None = None
        self._unarmed_since_ns: int | None = None
        self._off_rest_ns = self._unarmed_ns = 0
        self._deflection = 0.0
        self._wants = self._holds = False

    def note_sent(self, *, wants: bool, holds: bool) -> None:
        """Note whether the computer wanted the lines in the last tick, and whether it held them."""
        self._wants, self._holds = wants, holds

    def update(self, now_ns: int, stick: JoystickInput | None) -> None:
        """Take in the rider's stick, once a tick."""
        wants, holds = self._wants, self._holds
        self._deflection = 0.0 if stick is None else deflection_of(stick)
        between = self._settings.at_rest < self._deflection <= self._settings.override  # a NaN is a takeover
        self._off_rest_since_ns, self._off_rest_ns = _lasting(self._off_rest_since_ns, between and not holds, now_ns)
        self._unarmed_since_ns, self._unarmed_ns = _lasting(self._unarmed_since_ns, wants and not holds, now_ns)

    def halts(self) -> tuple[Halt, ...]:
        """Return the reason for which the computer does not get the lines; none before its time has passed."""
        swing = f"it stands at {self._deflection:.2f} of its swing, and up to {self._settings.at_rest:.2f} is rest"
        if self._off_rest_ns >= OFF_REST_S * 1e9:
            return (halt("stick_off_rest", swing),)
        if self._unarmed_ns >= NEVER_ARMED_S * 1e9:
            return (halt("never_armed", f"for {self._unarmed_ns * 1e-9:.0f} s"),)
        if min(self._off_rest_ns, self._unarmed_ns) >= TOUCHED_S * 1e9:
            return (halt("stick_touched", swing),)
        return ()


def _lasting(since_ns: int | None, so: bool, now_ns: int) -> tuple[int | None, int]:
    """Return since when a condition has held, None if it does not, and for how long [ns]."""
    if not so:
        return None, 0
    since_ns = now_ns if since_ns is None else since_ns
    return since_ns, now_ns - since_ns
