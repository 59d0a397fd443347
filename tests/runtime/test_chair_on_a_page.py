"""A page's requests to a chair with the shipped firmware: steering, countdown, drawing; and pushing by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.riding import FAR, START, Ride
from waychair.control.safety.supervisor import SupervisorSettings
from waychair.firmware_bridge.protocol import Holder
from waychair.maps.drawn.zones import Rule, Zone, zone_contains
from waychair.runtime.chair import ChairSettings
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.pages.chair_story import obstacles_of
from waychair.runtime.pages.page_watch import GONE_NS, PageWatch
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.drive import BEAT_NS
from waychair.types import DriveMode, JoystickInput, Twist

ARMING = 46  # ticks: two seconds at rest, and the board's word


def steered(ride: Ride, ticks: int, forward: float = 1.0, turn: float = 0.0) -> None:
    for _ in range(ticks):
        ride.chair.steer(forward, turn, ride.simulator.now_ns)
        ride.tick()


def test_a_page_steers_at_walking_speed_and_a_release_stops_the_chair() -> None:
    with Ride() as ride:
        ride.tick(10)
        steered(ride, ARMING + 60)
        assert ride.states[-1].verdict.mode is DriveMode.ASSISTED
        assert 0.5 < ride.speed < 0.65
        at = ride.simulator.truth().x
        ride.tick(30)  # without a message, as if the page were closed
        assert ride.stands
        assert ride.simulator.truth().x - at < 0.6
        assert ride.states[-1].sent.active  # held at rest, so that the next push acts at once
        ride.tick(200)
        assert ride.states[-1].verdict.mode is DriveMode.MANUAL
        assert ride.simulator.lines is not None
        assert ride.simulator.lines.holder == Holder.JOYSTICK


def test_a_page_cannot_steer_into_a_wall() -> None:
    with Ride() as ride:
        ride.tick(10)
        for _ in range(400):
            ride.chair.steer(1.0, 0.0, ride.simulator.now_ns)
            ride.tick()
        assert ride.simulator.contacts == 0
        assert ride.simulator.truth().x > 9.0
        assert abs(ride.speed) < 0.02


@pytest.mark.parametrize("interrupts", ["the rider's joystick", "Stop"])
def test_joystick_and_stop_end_steering_by_a_page_until_the_page_releases_its_stick(interrupts: str) -> None:
    with Ride() as ride:
        ride.tick(10)
        steered(ride, ARMING + 40)
        if interrupts == "Stop":
            ride.chair.stop()
        else:
            ride.simulator.rider = JoystickInput(0, 0.0, 0.5)
        steered(ride, 2)
        assert not ride.states[-1].sent.active
        ride.simulator.rider = JoystickInput(0)
        steered(ride, 100)  # still held on the page
        assert not ride.states[-1].verdict.computer_drives
        assert ride.stands
        ride.chair.let_go(ride.simulator.now_ns)
        steered(ride, ARMING + 20)
        assert ride.speed > 0.1


def test_steering_after_a_release_of_the_board_counts_again_once_the_page_has_released_its_stick() -> None:
    """The control loop hangs for a quarter of a second; the heartbeat lives."""
    with Ride() as ride:
        ride.tick(10)
        steered(ride, ARMING + 40)
        assert ride.states[-1].sent.active
        messages: tuple[ChairMessage, ...] = ()
        for _ in range(25):
            ride.chair.beat(ride.simulator.now_ns)
            messages += ride.simulator.advance(BEAT_NS)
        ride.chair.step(ride.simulator.now_ns, messages)
        steered(ride, 40)  # still held on the page
        assert not ride.states[-1].sent.active
        ride.chair.let_go(ride.simulator.now_ns)
        ride.tick(10)
        steered(ride, ARMING + 40)
        assert ride.states[-1].sent.active
        assert ride.speed > 0.3


def test_steering_ends_a_drive_without_releasing_the_lines_and_it_does_not_resume() -> None:
    with Ride() as ride:
        ride.drive()
        steered(ride, 20, 0.5)
        assert all(state.sent.active for state in ride.states[-20:])
        assert not ride.chair.navigator.active
        ride.chair.let_go(ride.simulator.now_ns)
        ride.tick(260)
        assert ride.stands
        assert ride.states[-1].verdict.mode is DriveMode.MANUAL


def test_a_lost_chair_may_be_steered() -> None:
    with Ride() as ride:
        ride.tick(10)
        ride.chair.relocalise(None)
        ride.tick(3)
        lost = [halted.stop.id for halted in ride.states[-1].halts]
        assert "lost" in lost
        steered(ride, 3)
        assert ride.states[-1].verdict.steered


COUNTING = replace(ChairSettings(), supervisor=SupervisorSettings(countdown_s=3.0))


def test_nothing_moves_before_the_end_of_the_countdown_and_the_chair_drives_after_it() -> None:
    with Ride(COUNTING) as ride:
        ride.tick(10)
        ride.chair.go(FAR)
        ride.tick(5)
        ride.chair.confirm()
        left = []
        for _ in range(59):
            state = ride.tick()
            left.append(ride.chair.countdown_s(state.stamp_ns))
            assert state.verdict.mode is DriveMode.AUTONOMOUS
            assert abs(ride.speed) < 1e-3
        assert left[0] == pytest.approx(3.0)
        assert left == sorted((each for each in left if each is not None), reverse=True)
        ride.tick(20)
        assert ride.chair.countdown_s(ride.simulator.now_ns) is None
        assert ride.speed > 0.05  # the board was armed meanwhile


@pytest.mark.parametrize("prevents", ["stop", "cancel", "joystick"])
@pytest.mark.parametrize("ticks", [30, *(pytest.param(k, marks=pytest.mark.nightly) for k in (1, 58))])
def test_stop_cancel_and_the_joystick_end_a_countdown(prevents: str, ticks: int) -> None:
    with Ride(COUNTING) as ride:
        ride.tick(10)
        ride.chair.go(FAR)
        ride.chair.confirm()
        ride.tick(ticks)
        if prevents == "joystick":
            ride.simulator.rider = JoystickInput(0, 0.0, 0.3)
            ride.tick(2)
            ride.simulator.rider = JoystickInput(0)
        else:
            getattr(ride.chair, prevents)()
        ride.tick(100)
        turned = ride.simulator.truth()
        assert not ride.states[-1].verdict.computer_drives
        assert abs(turned.x - START.x) < 0.01
        assert ride.chair.countdown_s(ride.simulator.now_ns) is None


def test_a_zone_drawn_during_a_drive_is_avoided_at_once() -> None:
    with Ride() as ride:
        ride.drive()
        zone = Zone("wet", Rule.KEEP_OUT, np.array([[4.5, 1.6], [5.5, 1.6], [5.5, 3.0], [4.5, 3.0]]))
        grid = ride.setup.grid
        ride.chair.redraw(ride.chair.drawn(grid, (zone,)), (zone,), {})
        outline = []
        for _ in range(500):
            ride.tick()
            pose = ride.simulator.truth()
            outline.append([pose.x, pose.y])
            if not ride.chair.navigator.active:
                break
        assert ride.chair.navigator.reason == "arrived"
        assert not zone_contains(zone, np.array(outline)).any()


def test_a_zone_over_the_goal_ends_the_drive_and_undoing_the_zone_does_not_resume_it() -> None:
    with Ride() as ride:
        ride.drive()
        zone = Zone("wet", Rule.KEEP_OUT, np.array([[9.0, 1.5], [11.0, 1.5], [11.0, 3.5], [9.0, 3.5]]))
        grid = ride.setup.grid
        ride.chair.redraw(ride.chair.drawn(grid, (zone,)), (zone,), {})
        ride.tick(60)
        assert ride.stands
        assert "goal" in ride.chair.navigator.reason
        ride.chair.redraw(ride.chair.drawn(grid, ()), (), {})
        ride.tick(60)
        assert ride.stands
        assert not ride.states[-1].verdict.computer_drives


def test_a_new_slow_zone_slows_the_present_drive() -> None:
    with Ride() as ride:
        ride.drive(110)
        assert ride.speed > 0.4
        zone = Zone("ward", Rule.SLOW, np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 5.0], [0.0, 5.0]]), 0.25)
        ride.chair.redraw(ride.chair.drawn(ride.setup.grid, (zone,)), (zone,), {})
        ride.tick(60)
        assert 0.1 < ride.speed < 0.3


def test_a_pushed_chair_says_so_and_drops_a_waiting_goal() -> None:
    with Ride() as ride:
        ride.tick(40)
        ride.chair.go(FAR)
        ride.tick(5)
        ride.simulator.pushed = Twist(-0.3, 0.2)
        ride.tick(30)
        assert "pushed" in {halted.stop.id for halted in ride.states[-1].halts}
        assert not ride.chair.waits
        assert not ride.chair.ready
        assert obstacles_of(ride.states[-1].halts)[0].sentence == "the chair is being pushed by hand"
        ride.simulator.pushed = None
        ride.tick(60)
        assert not ride.states[-1].halts
        assert not ride.states[-1].verdict.computer_drives
        state, truth = ride.states[-1], ride.simulator.truth()
        assert np.hypot(state.map_from_base.x - truth.x, state.map_from_base.y - truth.y) < 0.1
        assert ride.chair.ready


def test_a_chair_that_was_carried_away_is_searched_for_and_does_not_drive_until_found() -> None:
    with Ride(simulator=SimulatorSettings()) as ride:
        ride.drive()
        ride.chair.stop()
        ride.tick(40)
        here = ride.simulator.truth()
        ride.simulator.place(ride.simulator.world, replace(here, x=here.x + 4.0, y=here.y - 0.6))
        ride.tick(60)
        states = {state.localisation.state.value for state in ride.states[-60:] if state.localisation is not None}
        assert states & {"lost", "degraded"}
        assert not any(state.verdict.computer_drives for state in ride.states[-60:])


def test_a_drive_of_a_page_ends_with_the_last_page_and_one_of_another_caller_does_not() -> None:
    watch, second = PageWatch(), 1_000_000_000
    assert not watch.halts(0)
    watch.began(5 * second)
    watch.seen(["a"], 6 * second)
    watch.seen([], 6 * second + GONE_NS // 2)
    assert not watch.halts(6 * second + GONE_NS)
    assert [halted.stop.id for halted in watch.halts(6 * second + GONE_NS + 1)] == ["page_gone"]
    watch.seen(["b"], 8 * second)  # a reloaded page, or another one
    assert not watch.halts(8 * second)
    watch.over()
    assert not watch.halts(100 * second)


def test_a_halt_of_the_caller_stops_a_drive_comfortably() -> None:
    with Ride() as ride:
        ride.drive(110)
        watch = PageWatch()
        watch.began(0)
        began = ride.speed
        for _ in range(60):
            messages = tuple(ride.simulator.advance(50_000_000))
            ride.states.append(ride.chair.step(ride.simulator.now_ns, messages, watch.halts(GONE_NS + 1)))
        assert began > 0.3
        assert ride.stands
        assert ride.chair.navigator.reason.startswith("no page with a Stop button answers any more")
