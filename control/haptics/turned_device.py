"""A device that sits the wrong way round on the skin: the rider does the opposite of what was asked for.

Turned by half a turn it swaps ahead and back, and keeps the sense of the swivels, which run round; upside down or on the other hand it
swaps left and right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from waychair.control.haptics.guide_numbers import PUSHED, SWIVELS
from waychair.control.haptics.symbols import Symbol
from waychair.types import JoystickInput

ANSWERED_S = 0.2
"""s beyond the time in which the chair obeys, until the answer is looked at: before the symbol is said again."""

IN_A_ROW = 4
"""Opposite answers in a row to symbols of one axis. Of a rider who takes 30 % of all symbols for any other of four, so many in a row are
one in 10,000; one who answers at random is told sooner or later, too."""

_ASKED = {
    Symbol.FORWARD: (1.0, 0.0),
    Symbol.BACK: (-1.0, 0.0),
    Symbol.SWIVEL_LEFT: (0.0, 1.0),
    Symbol.SWIVEL_RIGHT: (0.0, -1.0),
}
"""The push ahead and to the left that each held motion asks for, by its sign."""


def turned_words(along: bool, round_: bool) -> str:
    """Return in a sentence how a device sits whose symbols along, or round, are answered by their opposites; empty for neither."""
    if along and round_:
        return "ahead and back, and left and right, were answered as each other: the device may sit upside down; put it on anew"
    if along:
        return "ahead and back were answered as each other: the device may be turned by half a turn; put it on anew"
    if round_:
        return "left and right were answered as each other: the device may sit upside down, or on the other hand; put it on anew"
    return ""


@dataclass(frozen=True, slots=True)
class OppositeAnswers:
    """Opposite answers in a row by the joystick during a drive, `along` and `round`; the symbol whose answer is waited for, and until
    when [ns]."""

    along: int = 0
    round: int = 0
    waits: tuple[Symbol, int] | None = None

    @property
    def words(self) -> str:
        """How the device may sit; empty while nothing is amiss."""
        return turned_words(self.along >= IN_A_ROW, self.round >= IN_A_ROW)

    def said(self, symbol: Symbol, stick: JoystickInput | None, now_ns: int, lead_s: float) -> OppositeAnswers:
        """Note a symbol that the rider obeys after `lead_s` [s]. Its answer is waited for until another held motion is asked for.

        A hand that does the opposite already gives no answer by going on with it: it may have missed the symbol.
        """
        if symbol not in _ASKED or (self.waits is not None and self.waits[0] is symbol):
            return self
        is_fresh = stick is not None and _push(stick, symbol) > -PUSHED
        return replace(self, waits=(symbol, now_ns + round((lead_s + ANSWERED_S) * 1e9)) if is_fresh else None)

    def after(self, stick: JoystickInput | None, now_ns: int) -> OppositeAnswers:
        """Return the answers after a tick with the stick so; None: nobody tells its position."""
        if self.waits is None or now_ns < self.waits[1]:
            return self
        symbol, done = self.waits[0], replace(self, waits=None)
        push = 0.0 if stick is None else _push(stick, symbol)
        if not abs(push) > PUSHED:
            return done
        if symbol in SWIVELS:
            return replace(done, round=0 if push > 0.0 else self.round + 1)
        return replace(done, along=0 if push > 0.0 else self.along + 1)


def _push(stick: JoystickInput, symbol: Symbol) -> float:
    """Return the push of the stick towards what a symbol asks for, negative for its opposite."""
    ahead, left = _ASKED[symbol]
    return stick.forward * ahead + stick.turn * left
