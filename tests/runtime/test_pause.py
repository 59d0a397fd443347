"""A paused drive stands with its goal, and continues only when a person asks for it."""

from __future__ import annotations

from itertools import pairwise

import pytest

from tests.control.drive.navigator_hall import TICK_NS, drive, hall, segment
from tests.runtime.riding import FAR, Ride
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.navigator import Stage
from waychair.planning.window.motion_limits import DwaSettings
from waychair.runtime.chair import ChairSettings
from waychair.runtime.pilot import Pilot
from waychair.types import Goal, JoystickInput, Pose2

TICK_S = 0.05


def rests(ride: Ride) -> None:
    for _ in range(100):
        if ride.stands and ride.tick().navigation.twist.v == 0.0:
            return
        ride.tick()
    raise AssertionError("it does not come to rest")


def test_a_paused_drive_stops_comfortably_and_reaches_its_goal_after_it_continues() -> None:
    with Ride() as ride:
        ride.drive()
        assert ride.speed > 0.5
        first = len(ride.states)
        assert ride.chair.pause()
        rests(ride)
        told = [state.navigation.twist.v for state in ride.states[first:]]
        falls = [before - after for before, after in pairwise(told)]
        assert max(falls) <= DwaSettings().braking * TICK_S + 1e-9
        at = ride.simulator.truth().x
        ride.tick(200)
        assert ride.simulator.truth().x == pytest.approx(at, abs=0.01)
        assert ride.states[-1].navigation.stage is Stage.PAUSED
        assert ride.states[-1].sent.active
        assert ride.chair.go_on()
        for _ in range(600):
            if ride.tick().navigation.stage is Stage.ARRIVED:
                break
        assert ride.states[-1].navigation.stage is Stage.ARRIVED
        assert ride.simulator.contacts == 0


def test_without_a_drive_there_is_nothing_to_pause_and_without_a_pause_nothing_to_continue() -> None:
    with Ride() as ride:
        ride.tick(10)
        assert not ride.chair.pause()
        assert not ride.chair.go_on()
        ride.chair.go(FAR)
        assert not ride.chair.pause()  # it waits for a confirmation, and keeps waiting
        assert ride.chair.waits
        ride.chair.cancel()
        ride.drive()
        assert not ride.chair.go_on()
        assert ride.tick().navigation.stage is Stage.DRIVING


@pytest.mark.sampled(1)
@pytest.mark.parametrize("ends", ["the rider's joystick", "Stop", "cancel"])
def test_stop_joystick_and_cancel_end_a_paused_drive_for_good(ends: str) -> None:
    with Ride() as ride:
        ride.drive()
        ride.chair.pause()
        rests(ride)
        if ends == "Stop":
            ride.chair.stop()
        elif ends == "cancel":
            ride.chair.cancel()
        else:
            ride.simulator.rider = JoystickInput(0, 0.0, 0.6)
        ride.tick(2)
        ride.simulator.rider = JoystickInput(0)
        ride.tick(40)
        assert not ride.chair.navigator.active
        assert not ride.chair.go_on()
        at = ride.simulator.truth()
        ride.tick(100)
        assert ride.simulator.truth().x == pytest.approx(at.x, abs=0.02)


def test_a_drive_paused_for_too_long_is_given_up_with_a_reason() -> None:
    with Ride(ChairSettings(max_pause_s=5.0)) as ride:
        ride.drive()
        ride.chair.pause()
        ride.tick(90)
        assert ride.chair.navigator.active
        ride.tick(20)
        assert ride.chair.navigator.reason == "the drive was paused for too long: ask for the goal again"
        assert not ride.chair.go_on()


def test_a_second_pause_has_the_full_time_again() -> None:
    with Ride(ChairSettings(max_pause_s=5.0)) as ride:
        ride.drive()
        for _ in range(2):
            assert ride.chair.pause()
            ride.tick(80)
            assert ride.chair.go_on()
            ride.tick(5)
        assert ride.chair.navigator.active


def test_go_on_takes_another_way_that_is_offered_and_nothing_else() -> None:
    wall = ((6.0, 0.0, 6.15, 1.5), (6.0, 2.5, 6.15, 6.0), (6.0, 7.0, 6.15, 8.0))
    pilot = Pilot(hall(*wall), {}, CHAIR_A)
    pilot.navigator.go(Goal(Pose2(8.5, 2.0, 0.0)))
    shut = segment(6.07, 1.5, 6.07, 2.5)
    states, poses = drive(pilot.navigator, Pose2(3.7, 2.0, 0.0), 1, shut)
    assert states[-1].stage is Stage.OFFERING
    assert pilot.go_on()
    on, _ = drive(pilot.navigator, poses[-1], 1, shut, len(states) * TICK_NS)
    assert on[-1].stage is Stage.DRIVING
    assert not pilot.go_on()
