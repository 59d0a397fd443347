"""A whole chair with glove, board and a driver who feels the glove alone, in lockstep."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.runtime.riding import LIDAR, coarse_arcs, hall
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.haptics.next_door import NO_DOORWAYS, DoorSide, no_door
from waychair.control.haptics.profile import HapticsProfile
from waychair.errors import ConfigError
from waychair.planning.seen.doorways import DoorState, Doorway
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.haptics.haptic_guide import OVERRIDE_BEGINS, OVERRIDE_WARNING
from waychair.runtime.haptics.session_log import SessionCounter, SessionLog
from waychair.runtime.perception import Perception
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import Block
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.drive import DriveSetup, advance_tick, simulated_chair
from waychair.trials.guiding.blind_route import blind_drive, waypoints
from waychair.trials.guiding.live_haptics import HapticOptions, HapticParts, open_haptics
from waychair.trials.record import drive_route
from waychair.types import HelpLevel, JoystickInput, Place, Pose2

DESK = Place("desk", Pose2(5.0, 2.5, 0.0), 0.3, 0.3)
SILENT_PROFILE = HapticsProfile(speech=False)


@dataclass
class Led:
    """The chair, its simulator and the parts on the rider."""

    chair: Chair
    simulator: Simulator
    parts: HapticParts

    def tick(self, count: int = 1) -> ChairState:
        """Run ticks; return the state after the last one."""
        for _ in range(count):
            messages = advance_tick(self.simulator, self.chair)
            state = self.chair.step(self.simulator.now_ns, messages)
            self.parts.beat(self.simulator)
        return state


@contextmanager
def led_in(world: World) -> Iterator[Led]:
    """Yield a chair whose driver feels the glove alone."""
    simulator = Simulator(world, CHAIR_A, SimulatorSettings(lidar=LIDAR), 0)
    setup = DriveSetup(world.grid, {"desk": DESK}, CHAIR_A, DEFAULT)
    options = HapticOptions(SILENT_PROFILE, driver="default")
    with (
        coarse_arcs(),
        open_haptics(options, CHAIR_A, world.grid, apart=False) as parts,
        simulated_chair(setup, simulator, haptics=parts.guide) as chair,
    ):
        made = Led(chair, simulator, parts)
        made.tick(8)
        yield made


@pytest.fixture
def led() -> Iterator[Led]:
    with led_in(hall()) as made:
        yield made


def test_a_driver_who_feels_the_glove_alone_sets_off_and_the_chairs_state_knows_the_glove(led: Led) -> None:
    led.chair.choose_level(HelpLevel.GUIDE)
    led.tick(50)
    assert led.chair.lead(DESK) == "You are led to desk."
    began = led.simulator.truth()
    state = led.tick(50)
    haptics = state.haptics
    assert haptics is not None
    assert haptics.glove is not None
    assert (haptics.glove.alive, haptics.glove.problem, haptics.goal) == (True, "", "desk")
    assert (haptics.level, state.telemetry is not None and state.telemetry.state) == (HelpLevel.GUIDE, "GUARD")
    assert led.parts.driver is not None
    assert [felt.symbol for felt in led.parts.driver.felt][-1:] == ["forward"]
    assert led.simulator.truth().x - began.x > 0.1


def test_a_glove_that_dies_on_the_way_is_named_and_the_board_still_guards(led: Led) -> None:
    led.chair.choose_level(HelpLevel.GUIDE)
    led.tick(50)
    led.chair.lead(DESK)
    led.tick(20)
    assert led.parts.glove is not None
    led.parts.glove.kill()
    state = led.tick(20)
    assert state.haptics is not None
    assert state.haptics.withheld.startswith("the glove cannot be reached")
    assert state.telemetry is not None
    assert (state.telemetry.state, state.verdict.guarded) == ("GUARD", True)
    led.chair.stop()
    state = led.tick(2)
    assert state.haptics is not None
    assert (state.haptics.goal, state.haptics.reason) == ("", "Stop was pressed")


@pytest.mark.nightly
def test_a_driver_led_by_the_running_chair_arrives_untouched_and_the_trainers_row_tells_of_it(
    led: Led, tmp_path: Path
) -> None:
    log = SessionLog(tmp_path / "drives.jsonl")
    log.say_yes()
    assert led.parts.guide is not None
    led.parts.guide.session = SessionCounter(log, lambda: led.simulator.contacts)
    led.chair.choose_level(HelpLevel.GUIDE)
    led.tick(50)
    led.chair.lead(DESK)
    for _ in range(60):
        state = led.tick(10)
        if state.haptics is not None and not state.haptics.goal:
            break
    assert state.haptics is not None
    assert state.haptics.arrived, state.haptics.reason
    here = led.simulator.truth()
    assert math.hypot(here.x - DESK.pose.x, here.y - DESK.pose.y) < 0.5
    (row,) = log.rows()
    assert (row.goal, row.level, row.arrived, row.touches) == ("desk", "guide", True, 0)
    assert 2.5 < row.distance_m < 4.0
    assert row.symbols >= 2


def test_a_rider_who_cannot_see_feels_a_warning_before_a_long_push_overrides_the_guard() -> None:
    world = hall()
    shelf = Block(world.start @ Pose2(CHAIR_A.front + 0.2), 0.2, 3.0, 0.0, 1.5)
    told, first_s = list[str](), dict[str, float]()
    with led_in(replace(world, blocks=(*world.blocks, shelf))) as led:
        led.chair.choose_level(HelpLevel.GUARD)
        led.tick(50)
        for tick in range(70):
            led.simulator.rider = JoystickInput(0, 1.0, 0.0)
            state, driver = led.tick(), led.parts.driver
            assert driver is not None
            assert state.haptics is not None
            assert state.telemetry is not None
            assert state.telemetry.guard is not None
            told += [state.haptics.text] if state.haptics.text not in told[-1:] else []
            if state.telemetry.guard.overridden:
                first_s.setdefault("override", 0.05 * tick)
            for felt in driver.felt:
                first_s.setdefault(felt.symbol, 0.05 * tick)
    assert told[-2:] == [f"stop the chair: {OVERRIDE_WARNING}", OVERRIDE_BEGINS]
    assert 1.9 < first_s["warning"] < first_s["override"], first_s


def test_who_is_guarded_and_asks_to_be_led_is_guided(led: Led) -> None:
    led.chair.choose_level(HelpLevel.GUARD)
    led.chair.lead(DESK)
    assert led.chair.level is HelpLevel.GUIDE


def test_a_rider_is_led_through_a_door_that_the_cells_have_found(led: Led, monkeypatch: pytest.MonkeyPatch) -> None:
    led.chair.choose_level(HelpLevel.GUARD)
    led.tick(50)
    assert led.chair.lead_through(DoorSide.AHEAD) == (False, NO_DOORWAYS)
    led.chair._perception = Perception(CHAIR_A)
    led.tick(4)
    assert led.chair.lead_through(DoorSide.AHEAD) == (False, no_door(DoorSide.AHEAD))
    found = Doorway(1, led.chair.odom_from_base @ Pose2(2.0), 0.9, 0.9, 0.02, DoorState.OPEN)
    monkeypatch.setattr(Perception, "doorways", (found,))
    assert led.chair.lead_through(DoorSide.AHEAD) == (True, "You are led through the door ahead.")
    haptics = led.tick(50).haptics
    assert haptics is not None
    assert (haptics.level, haptics.goal, haptics.symbol) == (HelpLevel.GUIDE, "the door ahead", "forward")


def test_an_unknown_driver_is_refused() -> None:
    with (
        pytest.raises(ConfigError, match="there is no simulated driver 'ghost'"),
        open_haptics(HapticOptions(SILENT_PROFILE, driver="ghost"), CHAIR_A, hall().grid),
    ):
        pass


def test_a_route_becomes_few_places_with_the_headings_of_their_arrivals() -> None:
    route = np.array([[2.0, 0.0], [2.5, 0.0], [2.0, 3.0], [2.0, 3.5]])
    found = waypoints(route, Pose2())
    assert [(each.name, each.pose.x, each.pose.y) for each in found] == [
        ("waypoint 1", 2.0, 0.0),
        ("waypoint 3", 2.0, 3.0),
        ("waypoint 4", 2.0, 3.5),
    ]
    assert [each.pose.theta for each in found] == pytest.approx([0.0, math.pi / 2, math.pi / 2])


@pytest.mark.nightly
def test_a_blind_driver_is_led_along_a_route_and_the_drive_is_recorded_like_any_other() -> None:
    world = hall()
    simulator = Simulator(world, CHAIR_A, SimulatorSettings(lidar=LIDAR), 0)
    route = np.array([[4.5, 2.5], [6.5, 2.5]])
    with coarse_arcs(), blind_drive(simulator, world, route) as messages:
        drive = drive_route(simulator, CHAIR_A, route, drive=messages)
    assert 4.0 < drive.distance_m < 5.5
    assert drive.scans > 100
    assert simulator.contacts == 0
