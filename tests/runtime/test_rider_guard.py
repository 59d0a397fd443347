"""A rider who drives within the guard: the whole chair with the shipped firmware, and the rider's hand on its own stick."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from tests.runtime.riding import Ride
from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.guide_types import StickHold
from waychair.control.safety.guard import SPOKEN, UNCALIBRATED
from waychair.errors import TransportError
from waychair.firmware_bridge.caps import STALE_CAP
from waychair.firmware_bridge.transports import Reconnecting, Transport
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import ChairMessage, DriveBase
from waychair.runtime.rider.rider_guard import NOTHING_HELD, OVERRIDES
from waychair.simulation.plan.plan_blocks import fill_rectangle
from waychair.simulation.scene.scene import Block, PersonBehaviour, PersonPlan, Pit
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.simulator import SimulatorSettings
from waychair.types import DriveMode, HelpLevel, JoystickInput, Pose2, Scan

PUSH, REST = JoystickInput(0, 1.0, 0.0), JoystickInput(0)
SHELF = Block(Pose2(5.0, 2.5), 0.2, 3.0, 0.0, 1.5)
"""Three metres ahead of the chair, and not on its map."""


@pytest.fixture
def ride() -> Iterator[Ride]:
    with Ride(blocks=(SHELF,)) as guarded:
        yield guarded


def _guarded(ride: Ride) -> ChairState:
    """The rider has chosen the guard and let go of the stick for two seconds."""
    ride.tick(4)
    assert ride.chair.choose_level(HelpLevel.GUARD) == SPOKEN[HelpLevel.GUARD]
    state = ride.tick(60)
    assert state.telemetry is not None
    assert (state.telemetry.state, state.verdict.mode, state.sent.active) == ("GUARD", DriveMode.GUARDED, False)
    return state


def test_a_push_towards_a_shelf_is_slowed_and_stopped_free_of_it(ride: Ride) -> None:
    _guarded(ride)
    ride.simulator.rider = PUSH
    speeds = []
    while len(speeds) < 20 or ride.speed > 0.02:
        state = ride.tick()
        speeds.append(ride.speed)
        assert len(speeds) < 140  # before the push counts as an override
    assert max(speeds) > 0.5
    assert ride.simulator.contacts == 0
    assert state.telemetry is not None
    assert state.telemetry.guard is not None
    assert state.telemetry.guard.capped
    assert state.telemetry.guard.caps[0] < 0.1
    gap = SHELF.middle.x - 0.1 - ride.simulator.truth().x - CHAIR_A.front
    assert 0.05 < gap < 0.3
    ride.simulator.rider = JoystickInput(0, -0.6, 0.0)  # and the rider backs out
    ride.tick(30)
    assert -0.2 < ride.speed < -0.1


def test_no_cap_is_wide_while_it_is_not_known_what_no_scan_shows(ride: Ride, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ride.chair, "_unscanned", lambda pose: None)
    _guarded(ride)
    ride.simulator.rider = PUSH
    state = ride.tick(20)
    assert state.telemetry is not None
    assert state.telemetry.guard is not None
    assert max(state.telemetry.guard.caps) <= STALE_CAP
    assert 0.1 < ride.speed < 0.35


def test_a_table_that_only_the_map_shows_stops_a_push_and_lets_go_once_it_is_erased() -> None:
    top = Block(Pose2(4.0, 2.5), 0.8, 2.4, 0.66, 0.72)
    with Ride(tops=(top,)) as ride:
        _guarded(ride)
        ride.simulator.rider = PUSH
        state = ride.tick(90)
        assert ride.simulator.contacts == 0
        assert ride.speed < 0.02
        assert 0.0 < 3.6 - ride.simulator.truth().x - CHAIR_A.front < 0.3
        assert state.telemetry is not None
        assert state.telemetry.guard is not None
        assert not state.telemetry.guard.overridden
        scanned = ride.setup.scanned
        assert scanned is not None
        ride.chair.redraw(ride.chair.drawn(scanned, ()), (), {}, ride.chair.known(scanned))
        state = ride.tick(12)
        assert state.telemetry is not None
        assert state.telemetry.guard is not None
        assert state.telemetry.guard.caps[0] > 0.3


def test_a_push_waits_until_somebody_who_walks_across_is_out_of_reach() -> None:
    x = 2.0 + CHAIR_A.front + 0.75
    person = PersonPlan(PersonBehaviour.PATH, np.array([[x, 0.9], [x, 4.1]]), speed=0.8, yields=False)
    with Ride(people=(person,)) as ride:
        _guarded(ride)
        caps = {}
        ride.simulator.rider = JoystickInput(0, 0.3, 0.0)
        while (aside := ride.simulator.people[0].pose.y - 2.5) < 1.5:
            state = ride.tick()
            assert state.telemetry is not None
            assert state.telemetry.guard is not None
            caps[aside] = state.telemetry.guard.caps[0]
        assert max(cap for aside, cap in caps.items() if aside < 0.9) < 0.2, "not before the chair, but in reach of it"
        assert caps[max(caps)] > 0.5


def test_a_press_lets_the_rider_creep_against_a_shelf_until_the_stick_is_let_go() -> None:
    near = Block(Pose2(2.0 + CHAIR_A.front + 0.35, 2.5), 0.2, 3.0, 0.0, 1.5)
    with Ride(blocks=(near,)) as ride:
        assert ride.chair.override_guard(ride.simulator.now_ns) == (False, NOTHING_HELD)
        _guarded(ride)
        ride.simulator.rider = PUSH
        ride.tick(10)
        assert ride.chair.override_guard(ride.simulator.now_ns) == (True, OVERRIDES)
        speeds = []
        while len(speeds) < 24:  # the board's own override needs longer
            ride.tick()
            speeds.append(ride.speed)
        assert 0.03 < speeds[-1] < 0.12
        ride.simulator.rider = REST
        ride.tick(2)
        ride.simulator.rider = PUSH
        state = ride.tick(12)
        assert ride.speed < 0.02
        assert state.telemetry is not None
        assert state.telemetry.guard is not None
        assert state.telemetry.guard.caps[0] < 0.05
        assert not state.telemetry.guard.overridden


def test_guidance_slows_the_stick_ahead_while_it_speaks_and_only_at_its_own_level(ride: Ride) -> None:
    _guarded(ride)
    ahead = []
    for level in (HelpLevel.GUARD, HelpLevel.GUIDE):
        ride.chair.choose_level(level)
        for cap in (0.2, math.nan):
            ahead.append(_caps_under(ride, StickHold(cap))[0])
    assert ahead[2] == 0.2
    assert min(ahead[0], ahead[1]) > 0.5
    assert ahead[3] > 0.2  # it rises again, as slowly as every cap
    ride.chair.hold_stick(StickHold(0.2), ride.simulator.now_ns)
    state = ride.tick(24)  # a guide that fell silent
    assert state.telemetry is not None
    assert state.telemetry.guard is not None
    assert state.telemetry.guard.caps[0] > 0.5


def test_guidance_holds_a_push_back_that_was_not_asked_for_until_the_rider_overrides(ride: Ride) -> None:
    _guarded(ride)
    ride.chair.choose_level(HelpLevel.GUIDE)
    ride.simulator.rider = JoystickInput(0, -0.3, 0.0)
    assert _caps_under(ride, StickHold(rear=0.0))[1] == 0.0
    assert _caps_under(ride, StickHold(rear=math.nan))[1] > 0.1
    assert _caps_under(ride, StickHold(rear=0.0))[1] == 0.0
    assert ride.chair.guard_view(None).own_caps[1] == 1.0  # nobody guards
    assert ride.chair.guard_view(ride.tick().telemetry).own_caps[1] > 0.1, "the guard's own, without the hold"
    assert ride.chair.override_guard(ride.simulator.now_ns) == (True, OVERRIDES)
    assert _caps_under(ride, StickHold(rear=0.0))[1] > 0.1


def test_guidance_holds_a_drift_of_the_hand_but_no_turn_that_is_meant(ride: Ride) -> None:
    _guarded(ride)
    ride.chair.choose_level(HelpLevel.GUIDE)
    held = {}
    for turn in (0.1, -0.1, 0.2):
        ride.simulator.rider = JoystickInput(0, 0.2, turn)
        ride.tick(12)
        held[turn] = _caps_under(ride, StickHold(left=0.12))[2] == 0.0
    assert held == {0.1: True, -0.1: True, 0.2: False}
    assert _caps_under(ride, StickHold(left=math.nan))[2] > 0.0


def test_a_drift_that_is_held_is_not_judged_as_a_turn_into_the_wall_beside_the_chair() -> None:
    wall = Block(Pose2(3.0, 2.5 - CHAIR_A.width / 2 - 0.2), 2.0, 0.2, 0.0, 1.5)
    with Ride(blocks=(wall,)) as ride:
        _guarded(ride)
        ride.chair.choose_level(HelpLevel.GUIDE)
        ride.simulator.rider = JoystickInput(0, 0.15, -0.06)
        ride.tick(6)
        judged = _caps_under(ride, StickHold())[0]  # as a full push to the front and the right
        assert _caps_under(ride, StickHold(right=0.2))[0] > 1.5 * judged


def test_a_wall_of_the_map_behind_the_chair_stops_it_and_only_the_map_tells_of_it() -> None:
    behind = Block(Pose2(2.0 - CHAIR_A.rear - 0.3, 2.5), 0.2, 2.0, 0.0, 1.5)
    with Ride(blocks=(behind,)) as ride:
        grid = ride.setup.grid
        fill_rectangle(grid.cells, grid, behind.middle, behind.length, behind.width)
        _guarded(ride)
        ride.chair.redraw(ride.chair.drawn(grid, ()), (), {})
        ride.simulator.rider = JoystickInput(0, -0.8, 0.0)
        state = ride.tick(60)
        assert ride.simulator.contacts == 0
        assert ride.speed == pytest.approx(0.0, abs=0.02)
        assert 0.0 < ride.simulator.truth().x - CHAIR_A.rear - behind.middle.x - 0.1 < 0.1
        assert state.telemetry is not None
        assert state.telemetry.guard is not None
        assert state.telemetry.guard.capped


def test_a_box_that_was_passed_stops_a_turn_into_it_where_the_lidar_does_not_look_any_more() -> None:
    box = Block(Pose2(3.2, 2.5 + CHAIR_A.width / 2 + 0.2), 0.3, 0.3, 0.0, 1.0)  # 5 cm beside the chair's way
    with Ride(blocks=(box,)) as ride:
        _guarded(ride)
        ride.simulator.rider = JoystickInput(0, 0.4, 0.0)
        while ride.simulator.truth().x < box.middle.x + 0.1:
            ride.tick()
        ride.simulator.rider = REST
        ride.tick(20)
        assert ride.simulator.contacts == 0
        ride.simulator.rider = JoystickInput(0, 0.0, -0.8)  # the rear would swing into the box
        ride.tick(60)
        assert ride.simulator.contacts == 0
        assert 0.0 < ride.simulator.clearance() < 0.08


def _caps_under(ride: Ride, hold: StickHold) -> tuple[float, float, float, float]:
    """Return the board's caps after three ticks in which the guidance holds the stick."""
    for _ in range(3):
        ride.chair.hold_stick(hold, ride.simulator.now_ns)
        state = ride.tick()
    assert state.telemetry is not None
    assert state.telemetry.guard is not None
    return state.telemetry.guard.caps


def test_f1_the_computer_dies_and_the_chair_is_slow_until_the_rider_lets_go(ride: Ride) -> None:
    _guarded(ride)
    ride.simulator.rider = JoystickInput(0, 1.0, 1.0)
    ride.tick(15)
    ride.simulator.advance(1_000_000_000)
    assert abs(ride.speed) < 0.35
    ride.simulator.rider = REST
    ride.simulator.advance(2_200_000_000)
    assert ride.simulator.lines is not None
    assert ride.simulator.lines.holder.name == "JOYSTICK"


def test_a_blind_lidar_narrows_the_caps_and_keeps_the_guard(ride: Ride) -> None:
    _guarded(ride)

    def without_scans(messages: tuple[ChairMessage, ...]) -> tuple[ChairMessage, ...]:
        return tuple(message for message in messages if not isinstance(message, Scan))

    ride.change = without_scans
    ride.simulator.rider = JoystickInput(0, -1.0, 0.0)
    state = ride.tick(30)
    assert state.verdict.guarded
    assert state.telemetry is not None
    assert state.telemetry.guard is not None
    assert max(state.telemetry.guard.caps) < 0.3
    assert ride.speed > -0.2


def test_the_rider_ends_the_guard_at_once_and_no_level_begins_by_itself(ride: Ride) -> None:
    assert ride.tick(70).verdict.mode is DriveMode.MANUAL
    _guarded(ride)
    assert ride.chair.choose_level(HelpLevel.INFORM) == SPOKEN[HelpLevel.INFORM]
    state = ride.tick(3)
    assert state.telemetry is not None
    assert (state.telemetry.state, state.verdict.mode) == ("SILENT", DriveMode.MANUAL)
    assert state.telemetry.guard is None


def test_a_guard_that_the_board_ends_is_told_and_must_be_chosen_again(ride: Ride) -> None:
    _guarded(ride)
    ride.chair.bridge._session._cable.write(b"\1\0" * 6)  # a noisy cable
    ride.tick(5)
    assert ride.chair.level is HelpLevel.INFORM
    assert "noisy" in ride.chair.level_told
    assert ride.tick(80).verdict.mode is DriveMode.MANUAL
    _guarded(ride)


def test_a_chair_whose_joystick_was_never_measured_informs_only() -> None:
    base = DriveBase(ChairCalibration("A", "2026-11-26"), Reconnecting(_no_cable), Pose2())
    assert base.choose_level(HelpLevel.GUIDE) == UNCALIBRATED
    assert base.guard.level is HelpLevel.INFORM
    assert not base.guard.wanted


def _no_cable() -> Transport:
    raise TransportError("no board is here")


@pytest.mark.nightly
@pytest.mark.skipif(renderer_problem() is not None, reason="no pictures can be drawn here")
def test_a_rider_who_pushes_without_a_pause_does_not_override_a_drop_off() -> None:
    camera = CameraSettings(rate_hz=10.0, width=320, height=240)
    pit = Pit(Pose2(6.0, 2.5, 0.0), 2.0, 4.0, 0.5)
    with Ride(simulator=SimulatorSettings(camera=camera), pits=(pit,)) as ride:
        _guarded(ride)
        ride.simulator.rider = PUSH
        state = ride.tick(400)
        assert ride.simulator.contacts == 0
        assert ride.simulator.truth().x + CHAIR_A.front < 5.0
        assert state.telemetry is not None
        assert state.telemetry.guard is not None
        assert not state.telemetry.guard.overridden
