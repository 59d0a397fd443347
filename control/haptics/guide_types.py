"""What the guide remembers, hears and says: data of `guide`."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from waychair.control.haptics.guide_numbers import PUSHED
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.planning.steps.step import Step
from waychair.types import Pose2, Twist


class LeadingPhase(enum.Enum):
    """What the driver is doing: turning to a heading, driving along a leg, backing, or nothing more."""

    TURN = "turn"
    GO = "go"
    BACK = "back"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Nudge:
    """A nudge on its way: its turn [rad], and when it is done."""

    turn: float
    done_ns: int


@dataclass(frozen=True, slots=True)
class Aim:
    """Where the chair's course passes a door: offset from its middle [m], heading to its axis [rad], over so many ticks."""

    offset: float
    turned: float
    ticks: int


@dataclass(frozen=True, slots=True)
class GuideState:
    """Memory of the guide between two steps.

    `step` is the index in the plan. `heading` [rad] is the one to turn to, `back_until` [m] the place along the leg up to
    which to back. `said`, `said_ns`: the last symbol and its beginning. `still_ns`: since when the chair has not moved as
    it should. `nudged`: nudges in a row to one side without an effect, left positive. `tries`: at the present door
    or turn. `ignored`: symbols in a row without any effect.
    """

    step: int = -1
    phase: LeadingPhase = LeadingPhase.GO
    heading: float = 0.0
    back_until: float = 0.0
    number: int = 0
    said: Symbol | None = None
    said_ns: int = -(10**18)
    nudges: tuple[Nudge, ...] = ()
    still_ns: int | None = None
    tries: int = 0
    ignored: int = 0
    quiet_ns: int = -(10**18)
    shuffles: int = 0
    aim: Aim | None = None
    nudged: int = 0


_HELD, _HELD_AT = 0.03, 0.1
"""Shares of the swing: the stick is pushed so far beyond a cap, and the cap leaves hardly any motion."""

_SHUT_BACK = 0.13
"""Share of the swing; behind, where it passes 0.15 m/s at most, the guard slows a push down to this for what is within 0.1 m."""


@dataclass(frozen=True, slots=True)
class GuideInputs:
    """The chair now: its pose in the plan's frame, its measured twist, and whether the guard holds the stick back.

    `held_swivel`: all that the hand does is a turn that the guard holds. `holds`: the board holds the stick as the guide asks
    (`StickHold`). `pushes_ahead`, `pushes_aside`: the hand pushes the stick so; true where nobody tells. `shut_ahead`, `shut_back`:
    the guard by itself lets hardly any push pass there, whatever is asked for: less than 0.1 m is free.
    """

    now_ns: int
    pose: Pose2
    twist: Twist
    held_ahead: bool = False
    held_back: bool = False
    held_turn: bool = False
    held_swivel: bool = False
    holds: bool = False
    pushes_ahead: bool = True
    pushes_aside: bool = True
    shut_ahead: bool = False
    shut_back: bool = False

    @classmethod
    def under(
        cls,
        caps: tuple[float, float, float, float],
        forward: float,
        turn: float,
        now_ns: int,
        pose: Pose2,
        twist: Twist,
        own_caps: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0),
    ) -> GuideInputs:
        """Return the inputs for a stick under caps to the front, the rear, the left and the right, all in shares of the swing.

        `own_caps` are those of the guard without the hold that the guide asked for.
        """
        front, rear, left, right = caps
        held_turn = turn > left + _HELD or -turn > right + _HELD
        return cls(
            now_ns,
            pose,
            twist,
            held_ahead=forward > front + _HELD and front < _HELD_AT,
            held_back=-forward > rear + _HELD and rear < _HELD_AT,
            held_turn=held_turn,
            held_swivel=held_turn and abs(turn) > 2.0 * abs(forward),
            holds=True,
            pushes_ahead=forward > PUSHED,
            pushes_aside=abs(turn) > PUSHED,
            shut_ahead=own_caps[0] < _HELD_AT,
            shut_back=own_caps[1] < _SHUT_BACK,
        )


@dataclass(frozen=True, slots=True)
class StickHold:
    """How the rider's stick is best held while the rider is led, in shares of the swing.

    `front`, `rear`: it passes ahead and back up to this. `left`, `right`: a smaller turn to that side is not passed on, because it
    leads off the heading that was asked for: the drift of a hand that does not see where straight ahead is, or a turn that has come
    far enough.
    """

    front: float = 1.0
    left: float = 0.0
    right: float = 0.0
    rear: float = 1.0


@dataclass(frozen=True, slots=True)
class GuideWord:
    """The guide's word in a tick: advice to say now or None, the present step, its reason in words.

    `hold`: how the stick is best held, ahead less near a door, least before a tight one. `astray`: new steps are wanted;
    `blocked`: because something holds the chair.
    `offers_repeat`: the rider seems to have a reason not to follow; the guide is silent for a while, or until asked.
    """

    advice: Advice | None
    step: Step
    reason: str
    hold: StickHold = StickHold()
    astray: bool = False
    blocked: bool = False
    offers_repeat: bool = False
    arrived: bool = False
