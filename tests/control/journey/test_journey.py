from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.control.journey.door_view import Door, DoorView, forgotten, is_shut_in, seen_door
from waychair.control.journey.journey import (
    COMES_WITHIN_S,
    CROWDED_S,
    LOCALISES_WITHIN_S,
    MAKES_WAY_S,
    MOST_TRIES,
    QUIET_S,
    RIDES_WITHIN_S,
    DriveProgress,
    Journey,
    JourneyOrder,
    JourneyPhase,
    JourneyView,
    Leg,
    Standing,
    begun,
    cancel,
    go_on,
    step,
)
from waychair.control.journey.lift_site import LiftSite, pose_in_same_lift
from waychair.types import Goal, Pose2, Scan

LOBBY, CABIN, BED = Goal(Pose2(6.5, 3.5, 0.0)), Goal(Pose2(9.0, 3.5, math.pi)), Goal("bed")
LEGS = (Leg("g", LOBBY, "A", CABIN), Leg("1", BED))
S = 1_000_000_000
SURE = {"g": 0.001, "1": 0.998, "2": 0.001}


def door(kind: Door, since_s: float, now_s: float = 100.0) -> DoorView:
    stamp = round((now_s - since_s) * S)
    return DoorView(kind, 1.0, stamp, stamp if kind is Door.OPEN else None, round(now_s * S))


OPEN, CLOSED, MOVING = door(Door.OPEN, 5.0), door(Door.CLOSED, 5.0), door(Door.PART, 0.0)


INSIDE = {"in_cabin": True, "standing": Standing.INSIDE}


def view(**changes: object) -> JourneyView:
    return replace(JourneyView(100 * S, "g"), **changes)


def at(phase: JourneyPhase, **changes: object) -> Journey:
    return replace(replace(begun(LEGS, 0), phase=phase, since_ns=99 * S), **changes)


def after(phase: JourneyPhase, seen: JourneyView, **changes: object) -> tuple[Journey, JourneyOrder]:
    return step(at(phase, **changes), seen)


def test_a_journey_takes_all_its_steps_in_order() -> None:
    inside, above = INSIDE, {"storey": "1", **INSIDE}
    seen = [
        view(drive=DriveProgress.ARRIVED, door=CLOSED),
        view(door=OPEN),
        view(door=OPEN),
        view(drive=DriveProgress.ARRIVED, door=OPEN, **inside),
        view(door=CLOSED, **inside),
        view(door=OPEN, chances=SURE, **inside),
        view(door=OPEN, chances=SURE, **inside),
        view(door=OPEN, chances=SURE, **above),
        view(door=OPEN, localised=True, **above),
        view(storey="1", drive=DriveProgress.UNDER_WAY, door=OPEN),
        view(storey="1", drive=DriveProgress.ARRIVED),
    ]
    journey, phases, switched = begun(LEGS, 0), [], set()
    for each in seen:
        journey, order = step(journey, each)
        phases.append(journey.phase)
        switched.add(order.switch)
    expected = [
        "call",
        "wait",
        "enter",
        "ride",
        "ride",
        "which storey",
        "switch",
        "relocalise",
        "leave",
        "drive",
        "arrived",
    ]
    assert [str(phase) for phase in phases] == expected
    assert switched == {None, "1"}


@pytest.mark.parametrize(
    "phase",
    [
        JourneyPhase.CALL,
        JourneyPhase.WAIT,
        JourneyPhase.RIDE,
        JourneyPhase.WHICH,
        JourneyPhase.SWITCH,
        JourneyPhase.RELOCALISE,
    ],
)
def test_no_drive_is_ordered_while_the_chair_waits_or_the_storey_is_uncertain(phase: JourneyPhase) -> None:
    for seen in (OPEN, CLOSED, MOVING, DoorView()):
        for chances in ({}, {"g": 0.5, "1": 0.5}):
            journey, order = after(phase, view(door=seen, chances=chances, cabin_free=False, in_cabin=True))
            assert order.goal is None or journey.phase not in (
                JourneyPhase.RIDE,
                JourneyPhase.WHICH,
                JourneyPhase.SWITCH,
                JourneyPhase.RELOCALISE,
            )


def test_nobody_enters_within_two_seconds_of_a_leafs_motion_or_a_full_cabin() -> None:
    assert after(JourneyPhase.WAIT, view(door=door(Door.OPEN, QUIET_S - 0.1)))[0].phase is JourneyPhase.WAIT
    assert after(JourneyPhase.WAIT, view(door=OPEN, cabin_free=False))[0].phase is JourneyPhase.WAIT
    assert after(JourneyPhase.WAIT, view(door=OPEN, cabin_free=None))[0].phase is JourneyPhase.WAIT
    assert after(JourneyPhase.WAIT, view(door=OPEN))[0].phase is JourneyPhase.ENTER
    order = after(JourneyPhase.LEAVE, view(storey="1", door=door(Door.OPEN, 1.0), **INSIDE), leg=1)[1]
    assert order.goal is None
    assert after(JourneyPhase.LEAVE, view(storey="1", door=OPEN, **INSIDE), leg=1)[1].goal == BED


def test_a_door_that_closes_stops_an_entry_from_outside_only() -> None:
    outside, order = after(JourneyPhase.ENTER, view(drive=DriveProgress.UNDER_WAY, door=MOVING))
    assert (outside.phase, order.goal) == (JourneyPhase.WAIT, None)
    between, order = after(
        JourneyPhase.ENTER, view(drive=DriveProgress.UNDER_WAY, door=MOVING, standing=Standing.INSIDE)
    )
    assert (between.phase, order.goal) == (JourneyPhase.ENTER, CABIN)


def test_a_chair_makes_way_for_somebody_whom_it_sees_only_in_the_door_and_calls_again() -> None:
    between = {"door": OPEN, "drive": DriveProgress.UNDER_WAY, "standing": Standing.INSIDE}
    crowded = view(cabin_free=False, **between)
    journey, _ = after(JourneyPhase.ENTER, crowded, tries=1)
    assert journey.phase is JourneyPhase.ENTER
    later = replace(crowded, now_ns=crowded.now_ns + round((MAKES_WAY_S + 0.1) * S))
    assert step(journey, replace(later, at_rest=False))[0].phase is JourneyPhase.ENTER
    back, order = step(journey, later)
    assert (back.phase, order.goal, order.hold) == (JourneyPhase.DRIVE, LOBBY, True)
    assert order.key != step(journey, crowded)[1].key
    there = replace(later, drive=DriveProgress.ARRIVED, standing=Standing.CLEAR)
    calls, order = step(back, there)
    assert (calls.phase, order.call) == (JourneyPhase.CALL, None)  # first the lift goes
    gone, order = step(calls, replace(there, door=CLOSED))
    assert (gone.phase, order.call) == (JourneyPhase.CALL, "g")


def test_a_drive_into_the_lift_that_fails_is_tried_again_from_the_lobby_and_the_rider_is_asked_at_last() -> None:
    failed = view(drive=DriveProgress.FAILED, why="no way", door=OPEN, in_cabin=True, standing=Standing.INSIDE)
    assert after(JourneyPhase.ENTER, failed, tries=1)[0].phase is JourneyPhase.DRIVE
    last, order = after(JourneyPhase.ENTER, failed, tries=MOST_TRIES)
    assert (last.phase, order.sentence) == (JourneyPhase.HELD, "no way; press Go on to continue")


def test_a_full_lift_is_let_go_and_called_again() -> None:
    journey, _ = after(
        JourneyPhase.WAIT, view(door=OPEN, cabin_free=False), crowded_ns=100 * S - round(CROWDED_S * S) - S
    )
    assert journey.phase is JourneyPhase.CALL
    journey, order = step(journey, view(door=OPEN))
    assert (journey.phase, order.call, order.hold) == (JourneyPhase.CALL, None, False)
    journey, order = step(
        journey, view(door=door(Door.CLOSED, 1.0))
    )  # a button would open it again, and nobody could ride
    assert order.call is None
    journey, order = step(journey, view(door=CLOSED))
    assert order.call == "g"


def test_a_lift_that_never_comes_is_told_and_can_be_waited_for() -> None:
    journey, order = after(JourneyPhase.CALL, view(now_ns=round((100 + COMES_WITHIN_S) * S), door=CLOSED))
    assert journey.phase is JourneyPhase.HELD
    assert "does not come" in order.sentence
    assert go_on(journey, 400 * S).phase is JourneyPhase.DRIVE


def test_a_lift_that_stops_elsewhere_is_sent_on() -> None:
    elsewhere = {"g": 0.0, "1": 0.001, "2": 0.999}
    journey, order = after(JourneyPhase.WHICH, view(door=OPEN, chances=elsewhere, **INSIDE))
    assert (journey.phase, order.call) == (JourneyPhase.RIDE, "1")
    assert order.sentence == "this is 2: press 1 again, and stay in the lift"
    assert not journey.closed  # its door must close and open again
    assert (
        after(JourneyPhase.WHICH, view(door=OPEN, chances=elsewhere, **INSIDE), tries=3)[0].phase is JourneyPhase.HELD
    )


def test_no_chair_leaves_a_lift_on_a_storey_without_a_map() -> None:
    here = view(door=OPEN, chances={"g": 0.0, "1": 0.001, "2": 0.999}, without_map=frozenset("2"), **INSIDE)
    journey, order = after(JourneyPhase.WHICH, here)
    assert (journey.phase, order.goal, order.switch, order.call) == (JourneyPhase.RIDE, None, None, "1")
    assert order.sentence == "this is 2, of which there is no map: press 1 again, and stay in the lift"
    dropped, order = after(JourneyPhase.WHICH, here, cancelled=True)
    assert (dropped.phase, order.goal, order.switch) == (JourneyPhase.HELD, None, None)
    assert order.sentence.startswith("this is 2, of which there is no map: ride to another storey, or drive out")
    rides = go_on(dropped, 101 * S)
    assert step(rides, replace(here, now_ns=102 * S, chances=SURE))[0].phase is JourneyPhase.SWITCH


def test_uncertain_storeys_are_asked_for_with_the_door_held() -> None:
    journey, order = after(JourneyPhase.WHICH, view(door=OPEN, chances={"g": 0.0, "1": 0.5, "2": 0.5}), since_ns=95 * S)
    assert (journey.phase, order.ask, order.hold, order.switch) == (JourneyPhase.WHICH, ("g", "1", "2"), True, None)


def test_the_map_changes_only_at_rest() -> None:
    assert after(JourneyPhase.SWITCH, view(at_rest=False), to="1")[1].switch is None
    assert after(JourneyPhase.SWITCH, view(), to="1")[1].switch == "1"


def test_a_map_that_does_not_fit_is_asked_about() -> None:
    late = view(now_ns=round((100 + LOCALISES_WITHIN_S) * S), storey="1", door=OPEN, chances=SURE)
    journey, order = after(JourneyPhase.RELOCALISE, late, to="1")
    assert (journey.phase, journey.resume, order.ask) == (JourneyPhase.HELD, JourneyPhase.WHICH, tuple(SURE))
    assert order.goal is None


def test_a_car_that_is_called_away_before_the_chair_leaves_rides_again() -> None:
    assert after(JourneyPhase.RELOCALISE, view(storey="1", door=CLOSED, **INSIDE), to="1")[0].phase is JourneyPhase.RIDE


@pytest.mark.parametrize("away", [{"door": CLOSED}, {"door": OPEN, "riding": True}])
def test_a_car_that_is_called_away_while_the_chair_waits_to_leave_makes_the_storey_uncertain_again(
    away: dict[str, object],
) -> None:
    inside = {"storey": "1", **INSIDE}
    rides, order = after(JourneyPhase.LEAVE, view(**inside, **away), leg=1)
    assert (rides.phase, rides.here.lift, order.goal, order.call) == (JourneyPhase.RIDE, "A", None, "1")
    elsewhere = {"g": 0.0, "1": 0.001, "2": 0.999}
    at_another, order = step(rides, view(door=OPEN, **inside))
    assert at_another.phase is JourneyPhase.WHICH
    sent_on, order = step(at_another, view(door=OPEN, chances=elsewhere, **inside))
    assert (sent_on.phase, order.goal, order.call) == (JourneyPhase.RIDE, None, "1")

    held = at(JourneyPhase.HELD, resume=JourneyPhase.LEAVE, leg=1, why="Stop was pressed")
    held, order = step(held, view(**inside, **away))
    assert (held.phase, order.goal) == (JourneyPhase.HELD, None)
    again = go_on(held, 200 * S)
    assert (again.phase, again.here.lift) == (JourneyPhase.WHICH, "A")  # not out of the door of any storey


@pytest.mark.parametrize("phase", [JourneyPhase.DRIVE, JourneyPhase.ENTER])
def test_a_door_that_closes_on_a_chair_that_drives_in_the_cabin_begins_a_ride(phase: JourneyPhase) -> None:
    rides, order = after(phase, view(drive=DriveProgress.UNDER_WAY, door=CLOSED, **INSIDE), leg=0)
    assert (rides.phase, rides.leg, rides.closed, order.goal, order.call) == (JourneyPhase.RIDE, 0, True, None, "1")
    assert step(rides, view(door=OPEN, **INSIDE))[0].phase is JourneyPhase.WHICH
    last, _ = after(JourneyPhase.DRIVE, view(storey="1", drive=DriveProgress.UNDER_WAY, door=CLOSED, **INSIDE), leg=1)
    assert (last.phase, last.here.lift) == (JourneyPhase.RIDE, "A")


@pytest.mark.parametrize(
    ("chances", "without_map", "phases", "leg"),
    [
        ({"g": 1.0, "1": 0.0, "2": 0.0}, "", ("switch", "relocalise", "drive"), 0),  # out again where it got in
        (SURE, "", ("switch", "relocalise", "drive"), 1),
        ({"g": 0.0, "1": 0.0, "2": 1.0}, "", ("switch", "relocalise", "failed"), 0),
        ({"g": 0.0, "1": 0.0, "2": 1.0}, "2", ("held", "held", "held"), 0),
        ({"g": 0.5, "1": 0.0, "2": 0.5}, "", ("which storey", "which storey", "which storey"), 0),
    ],
)
def test_a_rider_who_drives_out_of_the_lift_by_the_joystick_is_on_the_storey_that_the_chair_finds_out(
    chances: dict[str, float], without_map: str, phases: tuple[str, ...], leg: int
) -> None:
    journey = at(JourneyPhase.HELD, resume=JourneyPhase.RIDE, why="you drive")
    journey, _ = step(journey, view(taken_over=True, door=OPEN))
    journey, order = step(go_on(journey, 100 * S), view(door=CLOSED, chances=chances))
    assert (journey.phase, order.goal, order.call) == (JourneyPhase.WHICH, None, None)
    found = []
    for seconds in range(3):
        storey = journey.to or "g"
        seen = view(
            now_ns=(103 + seconds) * S,
            storey=storey,
            door=CLOSED,  # of a lift that is gone
            chances=chances,
            localised=True,
            without_map=frozenset(without_map),
        )
        journey, order = step(journey, seen)
        found.append(journey.phase.value)
    assert (tuple(found), journey.leg) == (phases, leg)
    if phases[0] == "which storey":
        assert order.ask == ("g", "1", "2")


@pytest.mark.parametrize("leg", [0, 1])
def test_a_rider_who_drives_into_the_lift_by_the_joystick_rides_and_the_storey_is_found_out(leg: int) -> None:
    held = at(JourneyPhase.HELD, leg=leg, why="you drive")
    held, order = step(held, view(taken_over=True, door=OPEN, **INSIDE))
    assert (held.phase, held.resume, held.here.lift, order.goal) == (JourneyPhase.HELD, JourneyPhase.RIDE, "A", None)
    held, _ = step(held, view(door=CLOSED, **INSIDE))  # it leaves before the rider lets the journey go on
    which, order = step(go_on(held, 200 * S), view(door=OPEN, **INSIDE))
    assert (which.phase, order.goal) == (JourneyPhase.WHICH, None)


@pytest.mark.parametrize("phase", [JourneyPhase.DRIVE, JourneyPhase.HELD])
def test_a_journey_ends_once_the_chair_has_been_shut_in_another_lift(phase: JourneyPhase) -> None:
    ended, order = after(phase, view(drive=DriveProgress.UNDER_WAY, doubted=True))
    assert (ended.phase, order.goal) == (JourneyPhase.FAILED, None)
    assert "say which one it is" in order.sentence


def test_a_lift_that_opens_its_other_door_only_ends_at_rest_with_a_sentence() -> None:
    inside = INSIDE
    rides, order = after(JourneyPhase.RIDE, view(door=CLOSED, **inside), since_ns=0, closed=True)
    assert (rides.phase, order.goal) == (JourneyPhase.RIDE, None)
    late = view(now_ns=round((RIDES_WITHIN_S + 1.0) * S), door=CLOSED, **inside)
    held, order = step(replace(rides, since_ns=0), late)
    assert (held.phase, held.resume, order.goal) == (JourneyPhase.HELD, JourneyPhase.RIDE, None)
    assert "the lift has not gone to 1: press its button, then go on" in order.sentence


def test_a_door_that_closes_on_the_chair_does_not_stop_it_between_the_leaves() -> None:
    between = {"storey": "1", "drive": DriveProgress.UNDER_WAY, "door": MOVING, "standing": Standing.INSIDE}
    goes_on, order = after(JourneyPhase.LEAVE, view(**between), leg=1)
    assert (goes_on.phase, order.goal) == (JourneyPhase.LEAVE, BED)
    waits, _ = after(JourneyPhase.LEAVE, view(in_cabin=True, **between), leg=1)
    assert (waits.phase, waits.drives) == (
        JourneyPhase.LEAVE,
        goes_on.drives + 1,
    )  # this drive ends, with the chair in the cabin
    assert (
        step(waits, view(**{**between, "drive": DriveProgress.NONE, "in_cabin": True}))[1].goal is None
    )  # until the door rests


def test_a_chair_that_came_to_rest_in_the_doorway_before_a_closing_door_goes_back_to_the_lobby() -> None:
    brakes = view(door=MOVING, standing=Standing.DOORWAY, at_rest=False)
    assert after(JourneyPhase.WAIT, brakes, tries=1)[0].phase is JourneyPhase.WAIT
    back, order = after(JourneyPhase.WAIT, replace(brakes, at_rest=True), tries=1)
    assert (back.phase, back.tries, order.goal, order.hold) == (JourneyPhase.DRIVE, 1, LOBBY, True)


def test_a_chair_that_was_stopped_in_the_doorway_leaves_though_it_sees_no_door_from_there() -> None:
    between = {"storey": "1", "door": DoorView(), **INSIDE}
    assert after(JourneyPhase.LEAVE, view(**between), leg=1)[1].goal is None
    for standing in (Standing.DOORWAY, Standing.CLEAR):
        assert after(JourneyPhase.LEAVE, view(**between | {"standing": standing}), leg=1)[1].goal == BED


@pytest.mark.parametrize(
    "phase",
    [phase for phase in JourneyPhase if phase not in (JourneyPhase.ARRIVED, JourneyPhase.FAILED, JourneyPhase.HELD)],
)
def test_joystick_stop_and_faults_hold_a_journey_until_the_rider_goes_on(phase: JourneyPhase) -> None:
    for seen in (
        view(taken_over=True, why="Stop was pressed"),
        view(drive=DriveProgress.ENDED, why="the lidar is silent"),
    ):
        journey, order = after(phase, seen, to="1")
        assert journey.phase is JourneyPhase.HELD
        assert (order.goal, order.call, order.hold, order.switch) == (None, None, False, None)
        assert seen.why in order.sentence
        assert step(journey, view(door=OPEN))[0].phase is JourneyPhase.HELD
        again = go_on(journey, 200 * S)
        assert not again.ended
        assert again.drives == journey.drives + 1


@pytest.mark.parametrize("phase", [JourneyPhase.RIDE, JourneyPhase.WHICH, JourneyPhase.SWITCH, JourneyPhase.RELOCALISE])
def test_a_journey_cancelled_in_the_car_still_finds_out_the_storey(phase: JourneyPhase) -> None:
    journey = cancel(at(phase, to="1"), 100 * S)
    assert not journey.ended
    for storey, seen in (("g", CLOSED), ("g", OPEN), ("g", OPEN), ("1", OPEN), ("1", OPEN)):
        journey, order = step(journey, view(storey=storey, door=seen, chances=SURE, localised=storey == "1"))
        assert order.goal is None
    assert journey.phase is JourneyPhase.FAILED
    assert "cancelled" in journey.why


def test_a_journey_cancelled_elsewhere_ends() -> None:
    assert cancel(at(JourneyPhase.WAIT), 0).phase is JourneyPhase.FAILED
    assert cancel(at(JourneyPhase.ARRIVED), 0).phase is JourneyPhase.ARRIVED


SITE = LiftSite("A", "g", Pose2(9.0, 3.5, math.pi), 1.8, 1.8, 1.0, 1.1, Pose2(6.5, 3.5, 0.0))


def scan(opening: float, stamp_ns: int = 0, x: float = 2.0, y: float = 0.0) -> Scan:
    """Return a scan from (x, y) in the cabin's frame, facing it: leaves at x = 1 open by a width, the back wall at -0.9."""
    angles = np.linspace(-2.356, 2.356, 720)
    dx, dy = np.cos(math.pi + angles), np.sin(math.pi + angles)
    with np.errstate(divide="ignore"):
        way = (1.0 - x) / dx
        back = (-0.9 - x) / dx
    across = y + way * dy
    ranges = np.where((way > 0) & (np.abs(across) < opening / 2), back, np.where(way > 0, way, 9.0))
    return Scan(stamp_ns, ranges.astype(np.float32), -2.356, 4.712 / 719)


def looks(*openings: float) -> list[DoorView]:
    found = [DoorView()]
    for k, opening in enumerate(openings):
        found.append(seen_door(found[-1], scan(opening, k * S // 10), Pose2(2.0, 0.0, math.pi), SITE))
    return found[1:]


def test_a_door_is_seen_to_open_and_then_to_rest() -> None:
    seen = looks(0.0, 0.0, 0.3, 0.6, 0.9, 1.1, 1.1, 1.1)
    kinds = [each.door for each in seen]
    assert kinds == [Door.CLOSED, Door.CLOSED, Door.PART, Door.PART, Door.OPEN, Door.OPEN, Door.OPEN, Door.OPEN]
    assert seen[1].still_s(S // 10) == pytest.approx(0.1)
    assert seen[3].still_s(3 * S // 10) == 0.0
    assert seen[-1].open_s(7 * S // 10) == pytest.approx(0.3)


def test_a_slow_leaf_is_not_taken_for_one_at_rest() -> None:
    seen = looks(*(1.1 - 0.02 * k for k in range(30)))
    assert seen[-1].still_s(29 * S // 10) < 0.5


def test_a_door_out_of_sight_is_unknown() -> None:
    away = seen_door(DoorView(), scan(1.1), Pose2(2.0, 0.0, 0.0), SITE)
    assert away.door is Door.UNSEEN
    assert forgotten(looks(1.1)[0]).still_s(5 * S) == 0.0


def scan_in_cabin(opening: float, faces: float = 0.0) -> Scan:
    """Return a scan from the cabin's middle, turned by an angle from its door, whose leaves at x = 1 are open by a width."""
    angles = np.linspace(-2.356, 2.356, 720)
    dx, dy = np.cos(faces + angles), np.sin(faces + angles)
    with np.errstate(divide="ignore"):
        across = dy / dx
    at_door = (dx > 0.0) & (np.abs(across) < 0.55)
    ranges = np.where(at_door, np.where(np.abs(across) < opening / 2, 5.0, 1.0 / np.maximum(dx, 0.1)), 0.9)
    return Scan(0, ranges.astype(np.float32), -2.356, 4.712 / 719)


@pytest.mark.parametrize(
    ("opening", "storey", "x", "faces", "shut"),
    [
        (0.0, "g", 0.0, 0.0, True),
        (1.1, "g", 0.0, 0.0, False),
        (0.6, "g", 0.0, 0.0, False),  # a leaf moves, or somebody stands there
        (1.1, "g", 0.0, math.pi, True),  # nobody sees whether it is open
        (0.0, "1", 0.0, 0.0, False),
        (0.0, "g", 1.2, 0.0, False),
        (1.1, "g", 0.7, 0.0, False),  # its lidar has passed the doorway
    ],
)
def test_a_chair_is_shut_in_where_its_lifts_door_is_not_seen_open(
    opening: float, storey: str, x: float, faces: float, shut: bool
) -> None:
    pose = SITE.cabin @ Pose2(x, 0.0, faces)
    laser = Pose2(0.4, 0.0) if x == 0.7 else Pose2()
    assert is_shut_in(scan_in_cabin(opening, faces), (SITE,), storey, pose, laser) is shut


def test_a_chair_in_a_lift_stands_in_the_same_way_in_its_cabin_on_another_storeys_map() -> None:
    above = replace(SITE, storey="1", cabin=Pose2(2.0, 8.0, 0.5))
    inside, sites = Pose2(0.2, -0.1, 0.3), (SITE, above)
    found = pose_in_same_lift(sites, "g", SITE.cabin @ inside, "1")
    assert found is not None
    assert found.array() == pytest.approx((above.cabin @ inside).array())
    assert pose_in_same_lift(sites, "g", SITE.cabin @ inside, "2") is None  # it does not stop there
    assert pose_in_same_lift(sites, "g", Pose2(1.0, 1.0), "1") is None
