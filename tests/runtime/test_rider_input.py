"""A request, a yes and Stop count as the rider means them, and the countdown belongs to a confirmed drive alone."""

from __future__ import annotations

import pytest

from waychair.control.drive.steering import SteeringSettings
from waychair.control.safety.supervisor import Situation, SupervisorSettings, SupervisorVerdict
from waychair.runtime.rider.rider_input import RiderInput
from waychair.types import DriveMode, JoystickInput

AT_REST = JoystickInput(0)
DRIVES = SupervisorVerdict(DriveMode.AUTONOMOUS)
RESTS = SupervisorVerdict(DriveMode.MANUAL)


def rider() -> RiderInput:
    return RiderInput(SupervisorSettings(countdown_s=2.0), SteeringSettings())


def situation(rider: RiderInput, now_ns: int = 0) -> Situation:
    return rider.situation(now_ns, AT_REST, taken_over=False, goal_active=True, halts=())


def test_a_request_and_a_yes_count_in_one_tick_only() -> None:
    person = rider()
    person.request()
    person.confirm()
    first, second = situation(person), situation(person)
    assert (first.requested, first.confirmed) == (True, True)
    assert (second.requested, second.confirmed) == (False, False)


def test_another_goal_takes_back_the_yes_to_the_one_before() -> None:
    person = rider()
    person.confirm()
    person.request()
    assert not situation(person).confirmed


def test_stop_holds_until_a_goal_is_asked_for() -> None:
    person = rider()
    person.stop()
    assert situation(person).stop_pressed
    assert situation(person).stop_pressed
    person.request()
    assert not situation(person).stop_pressed


def test_a_new_push_of_a_pages_joystick_ends_a_stop_and_an_interrupted_one_does_not() -> None:
    person = rider()
    assert person.steer(0.5, 0.0, 0)
    person.stop()
    assert not person.steer(0.5, 0.0, 100_000_000)
    assert situation(person, 100_000_000).stop_pressed
    person.steering.let_go(200_000_000)
    assert person.steer(0.5, 0.0, 300_000_000)
    assert not situation(person, 300_000_000).stop_pressed


def test_the_countdown_begins_with_the_confirmed_drive() -> None:
    person = rider()
    person.request()
    person.confirm()
    told = situation(person)
    assert person.countdown_s(0) is None
    person.obey(0, told, DRIVES)
    assert person.countdown_s(500_000_000) == pytest.approx(1.5)
    person.obey(500_000_000, situation(person), DRIVES)
    assert person.countdown_s(1_500_000_000) == pytest.approx(0.5)
    assert person.countdown_s(2_000_000_000) is None


def test_a_drive_that_ends_has_no_countdown() -> None:
    person = rider()
    person.confirm()
    person.obey(0, situation(person), DRIVES)
    person.obey(50_000_000, situation(person), RESTS)
    assert person.countdown_s(50_000_000) is None


def test_a_push_that_may_not_drive_counts_again_only_after_a_release() -> None:
    person = rider()
    person.steer(0.5, 0.0, 0)
    told = situation(person)
    assert told.steered
    person.obey(0, told, RESTS)
    assert not person.steer(0.5, 0.0, 100_000_000)
    assert not situation(person, 100_000_000).steered
