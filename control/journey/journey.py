"""A journey over several storeys as a pure step: from its state and a view of the chair to the next state and an order.

The phases of a ride: drive to the lobby, call the lift, wait for its open door, enter, ride, find out the storey, switch the map,
relocalise, leave, drive on. The chair rests, its lines released, in all phases but the drives. Replans and a cancel in the
car change later legs only: the storey is always found out.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from waychair.control.journey.door_view import Door, DoorView
from waychair.control.journey.which_storey import decided
from waychair.types import Goal


class JourneyPhase(enum.StrEnum):
    """The phases of a journey."""

    DRIVE = "drive"
    CALL = "call"
    WAIT = "wait"
    ENTER = "enter"
    RIDE = "ride"
    WHICH = "which storey"
    SWITCH = "switch"
    RELOCALISE = "relocalise"
    LEAVE = "leave"
    ARRIVED = "arrived"
    HELD = "held"  # the rider has taken over, or something has ended a drive: `go_on` continues
    FAILED = "failed"


ENDED = (JourneyPhase.ARRIVED, JourneyPhase.FAILED)
"""Phases after which nothing happens any more."""

QUIET_S = 2.5
"""s; a chair enters or leaves once nothing has moved in the doorway for so long: never within 2 s of a leaf's motion."""

SEEN_OPEN_S = 1.0
"""s; a door counts as open once it has been seen open for so long."""

CROWDED_S = 10.0
"""s; a chair waits so long for a cabin that is not free, then lets it go and calls again."""

MAKES_WAY_S = 5.0
"""s; a chair that rests so long before somebody in the cabin backs out, so that the lift can go."""

GONE_S, LEFT_S = 12.0, 3.0
"""s; a lift that was let go has the first to close its door and leave; one that has been closed for the second has left. A button
that is pressed earlier opens it again, with everybody in it.
"""

COMES_WITHIN_S, RIDES_WITHIN_S, ENTERS_WITHIN_S, LOCALISES_WITHIN_S = 240.0, 240.0, 60.0, 10.0
"""s; longest times of the phases."""

DOUBTED = "the storey is not certain any more: say which one it is, then ask for the goal again"
"""Why a journey ends."""

MOST_TRIES = 4
"""Attempts to enter, or rides that stop elsewhere, after which the rider is asked."""


@dataclass(frozen=True, slots=True)
class Leg:
    """A part of a journey on one storey: its goal; before a ride that is the lobby, and `lift` and `cabin` say which lift is
    taken to the next leg's storey and where the chair stands in it.
    """

    storey: str
    goal: Goal
    lift: str = ""
    cabin: Goal | None = None


class DriveProgress(enum.Enum):
    """How the drive that was ordered last is doing."""

    NONE = "none"
    UNDER_WAY = "under way"
    ARRIVED = "arrived"
    FAILED = "failed"  # the navigator gave up
    ENDED = "ended"  # the rider, Stop or a fault


class Standing(enum.Enum):
    """Where a chair stands beside its lift."""

    INSIDE = "inside"  # its front is not beyond the doorway
    DOORWAY = "doorway"  # its front is, but not the whole of it
    CLEAR = "clear"  # the whole of it is, or there is no lift


@dataclass(frozen=True, slots=True)
class JourneyView:
    """What a step knows of the chair.

    `storey`: that of the map in use. `in_cabin`: the axle is in the cabin of the leg's lift. `cabin_free`: the lidar sees nothing
    where the chair will stand, None if it cannot tell. `riding`: the IMU feels a ride. `chances`: probabilities of the lift's
    stops; of those in `without_map` there is none. `localised`: the pose on the present map is certain. `doubted`: the chair has
    been in a lift without its door in sight and open, though this journey did not ride there.
    """

    now_ns: int
    storey: str
    drive: DriveProgress = DriveProgress.NONE
    why: str = ""
    taken_over: bool = False
    at_rest: bool = True
    in_cabin: bool = False
    standing: Standing = Standing.CLEAR
    door: DoorView = field(default_factory=DoorView)
    cabin_free: bool | None = True
    riding: bool = False
    chances: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    without_map: frozenset[str] = frozenset()
    localised: bool = False
    doubted: bool = False

    @property
    def clear_of_lift(self) -> bool:
        """Whether the whole chair is out of its lift."""
        return self.standing is Standing.CLEAR


@dataclass(frozen=True, slots=True)
class JourneyOrder:
    """What is to be done now.

    `goal`: the drive to be under way, None: rest. `key` tells drives apart. `call`: the storey whose button is pressed now,
    the hall's or the cabin's. `hold`: keep the door open. `switch`: change to the map of this storey, if nothing else drives.
    `ask`: the stops among which the rider chooses. `sentence`: for the rider.
    """

    sentence: str
    goal: Goal | None = None
    key: tuple[int, int] | None = None
    call: str | None = None
    hold: bool = False
    switch: str | None = None
    ask: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Journey:
    """The state of a journey: its legs, the present one, the phase and since when; `tries` counts attempts of it.

    `drives` numbers the drives. `crowded_ns`: since when the open cabin has not been free. `closed`: the door has been seen
    closed since the chair stands in the cabin. `to`: the storey whose map is to be used next. `cancelled`: only the storey
    is still to be found out. `resume`: the phase that `go_on` leads to. `out`: the rider has driven out of the lift by the
    joystick, so that the ride is over.
    """

    legs: tuple[Leg, ...]
    leg: int = 0
    phase: JourneyPhase = JourneyPhase.DRIVE
    since_ns: int = 0
    tries: int = 0
    drives: int = 0
    crowded_ns: int | None = None
    closed: bool = False
    to: str = ""
    cancelled: bool = False
    resume: JourneyPhase = JourneyPhase.DRIVE
    out: bool = False
    why: str = ""

    @property
    def here(self) -> Leg:
        """The present leg."""
        return self.legs[self.leg]

    @property
    def next_storey(self) -> str:
        """The storey to which the present leg's lift is taken."""
        return self.legs[min(self.leg + 1, len(self.legs) - 1)].storey

    @property
    def going(self) -> JourneyPhase:
        """The phase that goes on: the present one, or that to which `go_on` leads."""
        return self.resume if self.phase is JourneyPhase.HELD else self.phase

    @property
    def lift_leg(self) -> int:
        """The leg whose lift the journey is about: the present one, but where the chair drives away from the lift before."""
        away = self.going is JourneyPhase.LEAVE or (self.going is JourneyPhase.DRIVE and not self.here.lift)
        return max(self.leg - 1, 0) if away else self.leg

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen."""
        return self.phase in ENDED


IN_THE_CAR = (JourneyPhase.RIDE, JourneyPhase.WHICH, JourneyPhase.SWITCH, JourneyPhase.RELOCALISE)
"""Phases in which the storey is not certain: no drive begins."""


def begun(legs: tuple[Leg, ...], now_ns: int) -> Journey:
    """Return a journey that sets off now."""
    return Journey(legs, since_ns=now_ns, drives=1)


def cancel(journey: Journey, now_ns: int) -> Journey:
    """Return a journey that the rider has cancelled: in the car it still finds out the storey."""
    if journey.ended:
        return journey
    if journey.going in IN_THE_CAR:
        return replace(journey, cancelled=True, phase=journey.going)
    return _to(journey, JourneyPhase.FAILED, now_ns, why="the journey was cancelled: choose a goal to drive on")


def go_on(journey: Journey, now_ns: int) -> Journey:
    """Return a journey that goes on where it was held, by the rider's own act."""
    if journey.phase is not JourneyPhase.HELD:
        return journey
    return replace(_to(journey, journey.resume, now_ns), drives=journey.drives + 1, closed=journey.closed)


def step(journey: Journey, view: JourneyView) -> tuple[Journey, JourneyOrder]:
    """Return the state after this view, and what is to be done."""
    if (
        not journey.ended
        and journey.phase is not JourneyPhase.HELD
        and (view.taken_over or view.drive is DriveProgress.ENDED)
    ):
        journey = _held(journey, view, view.why or "you drive")
    if view.doubted and not journey.ended:
        journey = _to(journey, JourneyPhase.FAILED, view.now_ns, why=DOUBTED)
    after = _STEPS[journey.phase](journey, view)
    return after, _order(after, view)


def _drive(journey: Journey, view: JourneyView) -> Journey:
    if view.in_cabin and view.door.door is Door.CLOSED:
        return _ridden(journey, view)
    if view.drive is DriveProgress.FAILED:
        return _held(journey, view, view.why)
    if view.drive is not DriveProgress.ARRIVED:
        return journey
    if journey.leg + 1 == len(journey.legs):
        return _to(journey, JourneyPhase.ARRIVED, view.now_ns)
    call = _to(journey, JourneyPhase.CALL, view.now_ns, tries=journey.tries)
    return replace(call, crowded_ns=view.now_ns) if journey.tries else call  # let go of a lift that it has come out of


def _call(journey: Journey, view: JourneyView) -> Journey:
    if journey.crowded_ns is not None:  # let go: it must leave first
        left = view.door.door is Door.CLOSED and view.door.still_s(view.now_ns) >= LEFT_S
        gone = left or (view.now_ns - journey.crowded_ns) * 1e-9 > GONE_S
        return replace(journey, crowded_ns=None if gone else journey.crowded_ns)
    if view.door.door is Door.OPEN:
        return _to(journey, JourneyPhase.WAIT, view.now_ns, tries=journey.tries)
    if _lasts_s(journey, view) > COMES_WITHIN_S:
        return _held(journey, view, "the lift does not come: see whether it works, take another one, or go on to wait")
    return journey


def _wait(journey: Journey, view: JourneyView) -> Journey:
    if view.at_rest and not view.clear_of_lift:  # it came to rest in the doorway, from where it sees no door
        return _back(journey, view)
    if view.door.door in (Door.CLOSED, Door.UNSEEN) and _lasts_s(journey, view) > 1.0:
        return _to(journey, JourneyPhase.CALL, view.now_ns, tries=journey.tries)
    free = view.cabin_free is True
    crowded = None if free else journey.crowded_ns or view.now_ns
    if crowded is not None and (view.now_ns - crowded) * 1e-9 > CROWDED_S:
        # nobody can ride with the chair in there: let them go, and call again
        return replace(_to(journey, JourneyPhase.CALL, view.now_ns, tries=journey.tries), crowded_ns=view.now_ns)
    if free and view.door.open_s(view.now_ns) >= SEEN_OPEN_S and view.door.still_s(view.now_ns) >= QUIET_S:
        entering = _to(journey, JourneyPhase.ENTER, view.now_ns, tries=journey.tries + 1)
        return replace(entering, drives=journey.drives + 1)
    return replace(journey, crowded_ns=crowded)


def _enter(journey: Journey, view: JourneyView) -> Journey:
    if view.in_cabin and view.door.door is Door.CLOSED:
        return _ridden(journey, view)
    closes = view.door.door is Door.PART and view.door.still_s(view.now_ns) < 0.3
    if view.drive is DriveProgress.ARRIVED and view.in_cabin:
        return _to(journey, JourneyPhase.RIDE, view.now_ns)
    # somebody whom the door's jamb had hidden stands in the cabin, and cannot ride while the chair is in the door
    blocked = view.at_rest and view.cabin_free is False
    journey = replace(journey, crowded_ns=(journey.crowded_ns or view.now_ns) if blocked else None)
    makes_way = journey.crowded_ns is not None and (view.now_ns - journey.crowded_ns) * 1e-9 > MAKES_WAY_S
    gave_up = makes_way or view.drive is DriveProgress.FAILED or _lasts_s(journey, view) > ENTERS_WITHIN_S
    if not gave_up and (view.in_cabin or not (closes and view.clear_of_lift)):
        return journey
    if journey.tries >= MOST_TRIES:
        return _held(
            journey, view, view.why or "the chair does not get into the lift: drive in by joystick, then go on"
        )
    if view.clear_of_lift:  # the chair is in nobody's way: wait for the door again
        return _to(journey, JourneyPhase.WAIT, view.now_ns, tries=journey.tries)
    return _back(journey, view)


def _back(journey: Journey, view: JourneyView) -> Journey:
    """Return a journey that drives back to the lobby, to call again."""
    return replace(_to(journey, JourneyPhase.DRIVE, view.now_ns, tries=journey.tries), drives=journey.drives + 1)


def _ride(journey: Journey, view: JourneyView) -> Journey:
    if journey.out:
        return _to(journey, JourneyPhase.WHICH, view.now_ns, tries=journey.tries)
    closed = journey.closed or view.door.door is Door.CLOSED
    journey = replace(journey, closed=closed)
    if closed and view.door.door is Door.OPEN and not view.riding:
        return _to(journey, JourneyPhase.WHICH, view.now_ns, tries=journey.tries)
    if _lasts_s(journey, view) > RIDES_WITHIN_S:
        return _held(journey, view, f"the lift has not gone to {journey.next_storey}: press its button, then go on")
    return journey


def _which(journey: Journey, view: JourneyView) -> Journey:
    storey = decided(view.chances)
    if storey is None or view.riding:
        return journey
    if storey == journey.here.storey and not journey.cancelled and not journey.out:
        # it has not left: the door opened again
        return _to(journey, JourneyPhase.RIDE, view.now_ns, tries=journey.tries)
    unmapped = f"this is {storey}, of which there is no map"
    if storey in view.without_map and (journey.cancelled or journey.out):
        return _held(journey, view, f"{unmapped}: ride to another storey, or drive out by the joystick")
    if storey != journey.next_storey and not journey.cancelled and not journey.out:
        if journey.tries + 1 >= MOST_TRIES:
            why = f"the lift stops at {storey} instead of {journey.next_storey}: press its button, then go on"
            return _held(journey, view, why)
        what = unmapped if storey in view.without_map else f"this is {storey}"
        why = f"{what}: press {journey.next_storey} again, and stay in the lift"
        return _to(journey, JourneyPhase.RIDE, view.now_ns, tries=journey.tries + 1, why=why)
    elsewhere = storey not in (journey.here.storey, journey.next_storey)
    switch = _to(journey, JourneyPhase.SWITCH, view.now_ns, tries=journey.tries)
    return replace(switch, to=storey, cancelled=journey.cancelled or elsewhere)


def _switch(journey: Journey, view: JourneyView) -> Journey:
    return (
        _to(journey, JourneyPhase.RELOCALISE, view.now_ns, tries=journey.tries)
        if view.storey == journey.to
        else journey
    )


def _relocalise(journey: Journey, view: JourneyView) -> Journey:
    if _car_leaves(view) and not journey.out:  # somebody has called the car away
        return replace(_to(journey, JourneyPhase.RIDE, view.now_ns, tries=journey.tries), closed=True)
    if view.localised:
        if journey.cancelled:
            return _to(
                journey, JourneyPhase.FAILED, view.now_ns, why="the journey was cancelled: choose a goal to drive on"
            )
        leg = journey.leg if journey.to == journey.here.storey else min(journey.leg + 1, len(journey.legs) - 1)
        out = _to(journey, JourneyPhase.DRIVE if journey.out else JourneyPhase.LEAVE, view.now_ns)
        return replace(out, leg=leg, drives=journey.drives + 1)
    if _lasts_s(journey, view) > LOCALISES_WITHIN_S:
        why = f"what the chair sees does not fit the map of {journey.to}: choose the storey, then go on"
        return replace(_held(journey, view, why), resume=JourneyPhase.WHICH)
    return journey


def _leave(journey: Journey, view: JourneyView) -> Journey:
    if view.drive in (DriveProgress.UNDER_WAY, DriveProgress.ARRIVED):
        closes = view.door.door in (Door.PART, Door.CLOSED) and view.door.still_s(view.now_ns) < 0.3
        if view.clear_of_lift:
            return _drive(_to(journey, JourneyPhase.DRIVE, journey.since_ns), view)
        if closes and view.in_cabin and view.drive is DriveProgress.UNDER_WAY and view.at_rest:
            return _again(journey, view, journey.tries)
        return journey
    if view.in_cabin and _car_leaves(view):
        return _ridden(journey, view)
    if view.drive is DriveProgress.FAILED:
        return (
            _held(journey, view, view.why) if journey.tries >= MOST_TRIES else _again(journey, view, journey.tries + 1)
        )
    return journey


def _ridden(journey: Journey, view: JourneyView) -> Journey:
    """Return a journey whose car may leave now, called by somebody: the storey is uncertain, and found out as after any ride."""
    ride = _to(journey, JourneyPhase.RIDE, view.now_ns, tries=journey.tries)
    return replace(ride, leg=journey.lift_leg, closed=True)


def _hold(journey: Journey, view: JourneyView) -> Journey:
    """Return a held journey, whose rider may drive into its lift and out by the joystick; if the car leaves with the chair, the
    storey is found out again before it goes on.
    """
    journey = replace(journey, closed=journey.closed or view.door.door is Door.CLOSED)
    if view.in_cabin or (journey.resume in IN_THE_CAR and view.taken_over and view.clear_of_lift):
        journey = replace(journey, out=not view.in_cabin)
    if view.in_cabin and journey.resume is JourneyPhase.DRIVE:
        return replace(journey, leg=journey.lift_leg, resume=JourneyPhase.RIDE)
    if journey.resume is JourneyPhase.LEAVE and view.in_cabin and _car_leaves(view):
        return replace(journey, leg=journey.lift_leg, resume=JourneyPhase.WHICH)
    return journey


def _car_leaves(view: JourneyView) -> bool:
    return view.riding or view.door.door is Door.CLOSED


def _again(journey: Journey, view: JourneyView, tries: int) -> Journey:
    """Return the journey with a new drive out of the lift, once its door rests."""
    return replace(_to(journey, JourneyPhase.LEAVE, view.now_ns, tries=tries), drives=journey.drives + 1)


def _rest(journey: Journey, view: JourneyView) -> Journey:
    return journey


_STEPS = {
    JourneyPhase.DRIVE: _drive,
    JourneyPhase.CALL: _call,
    JourneyPhase.WAIT: _wait,
    JourneyPhase.ENTER: _enter,
    JourneyPhase.RIDE: _ride,
    JourneyPhase.WHICH: _which,
    JourneyPhase.SWITCH: _switch,
    JourneyPhase.RELOCALISE: _relocalise,
    JourneyPhase.LEAVE: _leave,
    JourneyPhase.ARRIVED: _rest,
    JourneyPhase.HELD: _hold,
    JourneyPhase.FAILED: _rest,
}


def _order(journey: Journey, view: JourneyView) -> JourneyOrder:
    """Return what is to be done in a phase."""
    here, there, key = journey.here, journey.next_storey, (journey.leg, journey.drives)
    if journey.phase is JourneyPhase.DRIVE:
        return JourneyOrder("drives", goal=here.goal, key=key, hold=bool(here.lift) and not view.clear_of_lift)
    if journey.phase is JourneyPhase.CALL:
        return JourneyOrder(
            f"press the lift's button: you want to go to {there}",
            call=here.storey if journey.crowded_ns is None else None,
        )
    if journey.phase is JourneyPhase.WAIT:
        return JourneyOrder("waits until the lift's door rests and its cabin is free", hold=True)
    if journey.phase is JourneyPhase.ENTER:
        return JourneyOrder("drives into the lift", goal=here.cabin, key=key, hold=True)
    if journey.phase is JourneyPhase.RIDE:
        return JourneyOrder(journey.why or f"press {there}: the chair waits until the lift is there", call=there)
    if journey.phase is JourneyPhase.WHICH:
        ask = tuple(view.chances) if decided(view.chances) is None and _lasts_s(journey, view) > SEEN_OPEN_S else ()
        return JourneyOrder("which storey is this? choose it" if ask else "finds out the storey", hold=True, ask=ask)
    if journey.phase is JourneyPhase.SWITCH:
        return JourneyOrder(f"takes the map of {journey.to}", hold=True, switch=journey.to if view.at_rest else None)
    if journey.phase is JourneyPhase.RELOCALISE:
        return JourneyOrder("finds its place on the map", hold=True)
    if journey.phase is JourneyPhase.LEAVE:
        quiet = view.door.door is Door.OPEN and view.door.still_s(view.now_ns) >= QUIET_S
        sees_door = view.standing is Standing.INSIDE  # not from the doorway, nor beyond it
        drives = view.drive is DriveProgress.UNDER_WAY or quiet or not sees_door
        return JourneyOrder(
            "leaves the lift", goal=here.goal if drives else None, key=(journey.leg, journey.drives), hold=True
        )
    if journey.phase is JourneyPhase.ARRIVED:
        return JourneyOrder("arrived")
    if journey.phase is JourneyPhase.HELD:
        ask = tuple(view.chances) if journey.resume is JourneyPhase.WHICH else ()
        return JourneyOrder(f"{journey.why}; press Go on to continue", ask=ask)
    return JourneyOrder(journey.why)


def _held(journey: Journey, view: JourneyView, why: str) -> Journey:
    resume = {
        JourneyPhase.ENTER: JourneyPhase.RIDE if view.in_cabin else JourneyPhase.DRIVE,
        JourneyPhase.WAIT: JourneyPhase.DRIVE,
        JourneyPhase.CALL: JourneyPhase.DRIVE,
        JourneyPhase.SWITCH: JourneyPhase.WHICH,
        JourneyPhase.RELOCALISE: JourneyPhase.WHICH,
    }.get(journey.phase, journey.phase)
    return replace(_to(journey, JourneyPhase.HELD, view.now_ns), resume=resume, why=why)


def _to(journey: Journey, phase: JourneyPhase, now_ns: int, tries: int = 0, why: str = "") -> Journey:
    closed = journey.closed if phase in (JourneyPhase.WHICH, JourneyPhase.SWITCH, JourneyPhase.RELOCALISE) else False
    out = journey.out and phase in (*IN_THE_CAR, JourneyPhase.HELD)
    return replace(journey, phase=phase, since_ns=now_ns, tries=tries, crowded_ns=None, closed=closed, out=out, why=why)


def _lasts_s(journey: Journey, view: JourneyView) -> float:
    return (view.now_ns - journey.since_ns) * 1e-9
