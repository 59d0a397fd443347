"""The supervisor, which decides whether rider or computer drives: a table from mode and event to the next mode.

The computer drives only while a goal is active that was confirmed when nothing was wrong, nothing is wrong now, and the
rider does nothing. A push of the joystick ends the drive at once and for good, and so does a fault: the goal is
dropped, so that nothing starts or resumes by itself when the fault clears. A fault leaves the rider's joystick live.

A page's joystick is a drive of its own: it moves the chair through the computer, at walking speed and monitored, and
ends any drive to a goal.

Where the rider has chosen the guard and the computer does not drive, the rider drives by the chair's own joystick within
the caps that the computer gives the board (`control.safety.guard`). A fault narrows the caps and does not end the guard;
Stop and a push of the joystick concern drives of the computer and leave it as it is.

The board decides by the same rule as `Override` within a millisecond, without this computer; the more sensitive of the
two ends the drive. Only a deflection below the threshold can be blended with the computer's command. So a rider with
tremor or spasm needs a higher threshold and a longer duration, the same here and on the board.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from waychair.config import Settings, setting
from waychair.control.safety.stops import BY_MAP_ONLY, Braking, Halt, Severity, gravest, halt
from waychair.errors import ConfigError
from waychair.types import DriveMode, JoystickInput


@dataclass(frozen=True, slots=True)
class SupervisorSettings(Settings):
    """Thresholds of the rider's joystick (the board's defaults, `BoardSettings.override_*`), and times of
    confirmation."""

    override: float = setting(
        0.2,
        "",
        "stick deflection beyond which the rider takes over; larger: the rider must push farther",
        low=0.021,
        high=0.8,
    )
    override_ms: int = setting(
        10,
        "ms",
        "time beyond the override deflection before the rider takes over; larger: the takeover comes later",
        low=0,
        high=500,
    )
    at_rest: float = setting(
        0.1,
        "",
        "stick deflection up to which no hand is on the stick; larger: lighter touches are ignored",
        low=0.02,
        high=0.2,
    )
    assist: bool = setting(
        False, "", "true: a small stick deflection slows the drive; false: it does nothing until the rider takes over"
    )
    confirm_s: float = setting(
        60.0,
        "s",
        "time after which an unconfirmed goal is dropped; larger: the chair waits longer for a yes",
        low=1.0,
        high=3600.0,
    )
    countdown_s: float = setting(
        0.0, "s", "time from the rider's yes to the first motion; larger: the chair sets off later", low=0.0, high=30.0
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.override <= self.at_rest:
            raise ConfigError(
                f"override = {self.override:g} leaves no stick at rest: it must be more than at_rest = {self.at_rest:g}"
            )


class SupervisorEvent(enum.Enum):
    """Events of a tick in order of precedence: the first one that applies counts."""

    STOP = "the rider pressed Stop"
    GUARD = "the rider drives by joystick, within the guard's caps"
    TAKE_OVER = "the rider pushes the stick"
    FAULT = "something is wrong that ends a drive"
    STEER = "somebody steers by a page's joystick"
    NO_GOAL = "there is nowhere to go"
    REFUSAL = "a drive was confirmed that must not begin"
    CONFIRM = "a drive was confirmed, and nothing stands against it"
    REQUEST = "another goal was asked for"
    HAND = "the rider's hand lies on the stick, and assistance is on"
    QUIET = "nothing"


_MANUAL, _ASSISTED, _AUTONOMOUS, _STOPPED, _GUARDED = DriveMode

_NEXT: Mapping[DriveMode, tuple[DriveMode, ...]] = {
    #             STOP      GUARD     TAKE_OVER FAULT     STEER      NO_GOAL   REFUSAL   CONFIRM      REQUEST   HAND       QUIET
    _MANUAL:     (_STOPPED, _GUARDED, _MANUAL,  _MANUAL,  _ASSISTED, _MANUAL,  _MANUAL,  _AUTONOMOUS, _MANUAL,  _MANUAL,   _MANUAL),
    _STOPPED:    (_STOPPED, _GUARDED, _MANUAL,  _STOPPED, _ASSISTED, _STOPPED, _STOPPED, _AUTONOMOUS, _STOPPED, _STOPPED,  _STOPPED),
    _AUTONOMOUS: (_STOPPED, _GUARDED, _MANUAL,  _MANUAL,  _ASSISTED, _MANUAL,  _MANUAL,  _AUTONOMOUS, _MANUAL,  _ASSISTED, _AUTONOMOUS),
    _ASSISTED:   (_STOPPED, _GUARDED, _MANUAL,  _MANUAL,  _ASSISTED, _MANUAL,  _MANUAL,  _ASSISTED,   _MANUAL,  _ASSISTED, _AUTONOMOUS),
    _GUARDED:    (_STOPPED, _GUARDED, _MANUAL,  _MANUAL,  _ASSISTED, _MANUAL,  _MANUAL,  _AUTONOMOUS, _MANUAL,  _MANUAL,   _MANUAL),
}  # fmt: skip

TABLE: Mapping[tuple[DriveMode, SupervisorEvent], DriveMode] = MappingProxyType(
    {(mode, event): after for mode, row in _NEXT.items() for event, after in zip(SupervisorEvent, row, strict=True)}
)
"""The next mode after a mode and an event. Only CONFIRM and STEER, both a person's own act, lead from a mode in which
the computer rests to one in which it drives."""

DRIVEN = (DriveMode.AUTONOMOUS, DriveMode.ASSISTED)
"""The modes in which the computer drives: alone, with the rider's hand on the stick, or by a page's joystick."""


@dataclass(frozen=True, slots=True)
class Situation:
    """The supervisor's input in a tick.

    `joystick` None: unknown. `taken_over`: the rider pushes the stick, or the board released the lines because of a
    push. `requested`, `confirmed`: another goal was requested since the last tick, and a person confirmed it.
    `steered`: a page's joystick is held, or the chair is held at rest for it. `guarded`: the rider has chosen the guard, it
    can act, and the computer did not drive in the tick before.
    """

    joystick: JoystickInput | None
    taken_over: bool
    stop_pressed: bool
    goal_active: bool
    requested: bool
    confirmed: bool
    halts: tuple[Halt, ...] = ()
    steered: bool = False
    guarded: bool = False


@dataclass(frozen=True, slots=True)
class SupervisorVerdict:
    """The mode of this tick and, unless the computer drives, the reason and the braking of a moving chair.

    `share`: the share of its speed that the rider's hand leaves the computer. `drops_goal`: the goal is given up.
    `steered`: the computer drives by a page's joystick. `guarded`: the board is given caps of the chair's own joystick.
    """

    mode: DriveMode
    reason: str = ""
    share: float = 1.0
    halt: Halt | None = None
    braking: Braking = Braking.COMFORT
    drops_goal: bool = False
    steered: bool = False
    guarded: bool = False

    @property
    def computer_drives(self) -> bool:
        """Whether the computer drives, alone or with the rider's hand on the stick."""
        return self.mode in DRIVEN


class Override:
    """Detects a push of the rider's stick: beyond the threshold for the set duration without a break."""

    def __init__(self, settings: SupervisorSettings) -> None:
        self._settings = settings
        self._since_ns: int | None = None

    def update(self, stick: JoystickInput | None) -> bool:
        """Take in the stick's position and return whether it is pushed; a NaN is a push at once, to be safe."""
        if stick is None:
            self._since_ns = None
            return False
        deflection = deflection_of(stick)
        if deflection <= self._settings.override:
            self._since_ns = None
            return False
        self._since_ns = stick.stamp_ns if self._since_ns is None else self._since_ns
        held_ns = stick.stamp_ns - self._since_ns
        return math.isnan(deflection) or held_ns >= self._settings.override_ms * 1_000_000


def supervise(mode: DriveMode, situation: Situation, settings: SupervisorSettings) -> SupervisorVerdict:
    """Return the verdict on a situation, with the mode that follows `mode`."""
    verdict = _verdict(mode, situation, settings)
    return replace(verdict, guarded=True) if situation.guarded and not verdict.computer_drives else verdict


def _verdict(mode: DriveMode, situation: Situation, settings: SupervisorSettings) -> SupervisorVerdict:
    """Return the verdict without the guard's part in it."""
    event = event_in(situation, settings)
    after = TABLE[mode, event]
    if event is SupervisorEvent.GUARD:
        goal = halt("unconfirmed") if situation.goal_active else None
        return SupervisorVerdict(after, SupervisorEvent.GUARD.value if goal is None else goal.text, halt=goal)
    if event is SupervisorEvent.STEER:
        return SupervisorVerdict(after, SupervisorEvent.STEER.value, drops_goal=situation.goal_active, steered=True)
    if after in DRIVEN:
        share = _share(situation.joystick, settings) if settings.assist else 1.0
        return SupervisorVerdict(
            after, "the rider's hand on the joystick slows the drive" if share < 1.0 else "", share
        )
    if event is SupervisorEvent.NO_GOAL:
        return SupervisorVerdict(
            after, "Stop was pressed; ask for a goal to drive on" if after is DriveMode.STOPPED else "no goal"
        )
    why = _why(event, situation)
    waits = event in (SupervisorEvent.REQUEST, SupervisorEvent.HAND, SupervisorEvent.QUIET)
    return SupervisorVerdict(after, why.text, 1.0, why, why.stop.braking, drops_goal=not waits)


def event_in(situation: Situation, settings: SupervisorSettings) -> SupervisorEvent:
    """Return the event of the highest precedence in a situation."""
    worst = _worst(situation)
    hand = settings.assist and _share(situation.joystick, settings) < 1.0
    happens = {
        SupervisorEvent.STOP: situation.stop_pressed,
        SupervisorEvent.GUARD: situation.guarded and not (situation.steered or situation.confirmed),
        SupervisorEvent.TAKE_OVER: situation.taken_over,
        SupervisorEvent.FAULT: worst is not None and worst.stop.severity >= Severity.ENDS,
        SupervisorEvent.STEER: situation.steered,
        SupervisorEvent.NO_GOAL: not situation.goal_active,
        SupervisorEvent.REFUSAL: situation.confirmed
        and any(h.stop.severity is Severity.REFUSES for h in situation.halts),
        SupervisorEvent.CONFIRM: situation.confirmed,
        SupervisorEvent.REQUEST: situation.requested,
        SupervisorEvent.HAND: hand,
        SupervisorEvent.QUIET: True,
    }
    return next(event for event, so in happens.items() if so)


def _why(event: SupervisorEvent, situation: Situation) -> Halt:
    """Return the halt for which the computer rests."""
    if event is SupervisorEvent.STOP:
        return halt("stop_pressed")
    if event is SupervisorEvent.TAKE_OVER:
        return halt("taken_over")
    if event is SupervisorEvent.REFUSAL:
        return next(h for h in situation.halts if h.stop.severity is Severity.REFUSES)
    worst = _worst(situation)
    return worst if event is SupervisorEvent.FAULT and worst is not None else halt("unconfirmed")


def _worst(situation: Situation) -> Halt | None:
    """Return the gravest halt; halts about map and goal do not count while a person steers by a joystick."""
    return gravest(halted for halted in situation.halts if not (situation.steered and halted.stop.id in BY_MAP_ONLY))


def deflection_of(stick: JoystickInput) -> float:
    """Return the larger deflection of the stick's two axes, as the board does; NaN if either is NaN."""
    deflections = abs(stick.forward), abs(stick.turn)
    return math.nan if any(map(math.isnan, deflections)) else max(deflections)


def _share(stick: JoystickInput | None, settings: SupervisorSettings) -> float:
    """Return the computer's share of its speed: 1 with the stick at rest, 0 at the threshold for taking over."""
    if stick is None:
        return 1.0
    way = (deflection_of(stick) - settings.at_rest) / (settings.override - settings.at_rest)
    return min(1.0, max(0.0, 1.0 - way))
