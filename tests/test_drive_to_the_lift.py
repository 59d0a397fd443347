"""The complete product in simulation: a small world is driven and mapped, and the chair drives to places on that
map."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from waychair.control.drive.navigator import Stage
from waychair.control.safety.supervisor import SupervisorSettings
from waychair.firmware_bridge.board import Defect
from waychair.offline.mapping import MappingSettings, map_recording
from waychair.recordings.recording import read_recording
from waychair.runtime.chair import ChairSettings, ChairState
from waychair.simulation.plan.world import WORLDS, load_world
from waychair.simulation.simulator import Simulator
from waychair.trials.demo.demo import SMALL_WORLD, Demo, randomised_settings, run_demo
from waychair.trials.demo.demo_report import write_report
from waychair.trials.drive import advance_tick, simulated_chair, start_drive
from waychair.types import DriveMode, Goal, JoystickInput, OccupancyGrid, Pose2


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("demo")


@pytest.fixture(scope="module")
def demo(out: Path) -> Demo:
    return run_demo(out, seed=1, world=near_places_first(out), surprises=False)


def near_places_first(folder: Path) -> Path:
    """Write the small clinic's plan with places near each other first, which become the three goals."""
    plan = yaml.safe_load((WORLDS / f"{SMALL_WORLD}.yaml").read_text(encoding="utf-8"))
    near = ("lift", "entrance", "reception")
    plan["places"] = {name: plan["places"][name] for name in (*near, *sorted(set(plan["places"]) - set(near)))}
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(plan, sort_keys=False), encoding="utf-8")
    return path


def test_all_three_places_are_reached_without_a_contact(demo: Demo) -> None:
    assert [leg.place for leg in demo.legs if not leg.reached] == []
    assert len(demo.legs) == 3
    assert sum(leg.contacts for leg in demo.legs) == 0


def test_the_pose_of_the_chair_was_correct_all_the_time(demo: Demo) -> None:
    assert max(leg.localisation_error_m for leg in demo.legs) < 0.10


def test_the_drive_was_made_of_joystick_volts_within_their_range(demo: Demo) -> None:
    volts = np.concatenate([leg.volts for leg in demo.legs])
    assert volts.min() >= 0.0
    assert volts.max() <= 3.3
    assert np.ptp(volts, axis=0).min() > 0.3


def test_the_report_holds_the_figures_of_the_drive(demo: Demo, out: Path) -> None:
    write_report(out, demo)
    report = json.loads((out / "report.json").read_text())
    assert (report["goals"], report["goals_reached"], report["contacts"]) == (3, 3, 0)
    assert {"map", "save", "drive"} <= set(report["stages"])
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 4
    assert "http" not in re.sub('base64,[^"]*', "", page)  # four letters happen in pictures
    for leg in demo.legs:
        assert leg.place in page
    assert {path.name for path in (out / "map").iterdir()} >= {"map.yaml", "map.pgm", "places.yaml", "report.json"}


def differing(a: OccupancyGrid, b: OccupancyGrid) -> float:
    """Return the share of different cells where two grids overlap that begin within a cell of each other."""
    shift = a.map_from_grid.inverse() @ b.map_from_grid
    column, row = round(shift.x / a.resolution), round(shift.y / a.resolution)
    assert max(abs(column), abs(row)) <= 1, "only the outermost beam may fall into the next cell"
    first, second = a.cells[max(row, 0) :, max(column, 0) :], b.cells[max(-row, 0) :, max(-column, 0) :]
    height, width = np.minimum(first.shape, second.shape)
    return float((first[:height, :width] != second[:height, :width]).mean())


@pytest.mark.nightly
def test_the_live_map_equals_that_of_the_recording(demo: Demo, out: Path) -> None:
    """The bag rounds a scan's angles to single precision: beams fall into other cells, and matches differ a little."""
    offline = map_recording(read_recording(out / "drive.mcap"), MappingSettings())
    live = demo.mapping
    apart = offline.result.trajectory.poses - live.result.trajectory.poses
    assert np.abs(apart[:, :2]).max() < 0.02
    assert differing(live.grid, offline.grid) < 0.02
    assert (offline.grid.cells >= 65).sum() > 1000


class Ride:
    """A chair under way in the small world, on the map the demo made, with the shipped firmware on its lines."""

    def __init__(self, demo: Demo, stack: ExitStack, goal: str = "bath", chair: ChairSettings | None = None) -> None:
        setup = demo.setup if chair is None else replace(demo.setup, chair=chair)
        world = load_world("small_clinic")
        self.simulator = Simulator(world, setup.body, randomised_settings(1), 1)
        self.chair = stack.enter_context(
            simulated_chair(replace(setup, map_from_world=world.start.inverse()), self.simulator)
        )
        self.deaf = False
        self.go(Goal(goal))

    def go(self, goal: Goal) -> None:
        """Asks for a goal and confirms it, once the chair is ready."""
        start_drive(self.simulator, self.chair, goal)

    def tick(self, count: int = 1) -> ChairState:
        for _ in range(count):
            messages = advance_tick(self.simulator, self.chair)
            state = self.chair.step(self.simulator.now_ns, () if self.deaf else messages)
        return state

    def under_way(self) -> ChairState:
        """Past greeting and the two seconds of rest."""
        state = self.tick(90)
        assert (state.verdict.mode, state.sent.active) == (DriveMode.AUTONOMOUS, True)
        assert state.telemetry is not None
        assert (state.telemetry.state, state.telemetry.holder) == ("DRIVE", "BOARD")
        return state


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_f19_the_joystick_overrides_a_drive_within_one_tick_and_nothing_resumes(demo: Demo, stack: ExitStack) -> None:
    ride = Ride(demo, stack)
    ride.under_way()
    ride.simulator.rider = JoystickInput(ride.simulator.now_ns, 0.0, 0.8)
    state = ride.tick()
    assert state.verdict.mode is DriveMode.MANUAL
    assert not state.sent.active
    assert state.telemetry is not None
    assert state.telemetry.holder == "JOYSTICK"
    ride.tick(20)
    assert ride.simulator.twist().omega > 0.2  # the rider really turns the chair
    ride.simulator.rider = JoystickInput(ride.simulator.now_ns)
    state = ride.tick(100)
    assert not state.sent.active
    assert abs(ride.simulator.twist().v) < 1e-3


def test_stop_releases_the_lines_at_once_and_a_new_goal_drives_on(demo: Demo, stack: ExitStack) -> None:
    ride = Ride(demo, stack)
    ride.under_way()
    ride.chair.stop()
    state = ride.tick()
    assert (state.verdict.mode, state.sent.active) == (DriveMode.STOPPED, False)
    assert ride.tick(100).verdict.mode is DriveMode.STOPPED
    assert abs(ride.simulator.twist().v) < 1e-3
    ride.go(Goal("bath"))
    assert ride.tick(60).sent.active


def test_silent_sensors_make_the_computer_release_the_lines(demo: Demo, stack: ExitStack) -> None:
    ride = Ride(demo, stack)
    ride.under_way()
    ride.deaf = True
    states = [ride.tick() for _ in range(14)]
    assert not states[-1].sent.active
    assert "silent" in states[-1].verdict.reason
    assert states[-1].navigation.stage is Stage.FAILED
    ride.deaf = False
    assert not ride.tick(60).sent.active  # back, but nothing resumes by itself


def test_f1_a_dead_board_ends_the_drive_with_a_remedy(demo: Demo, stack: ExitStack) -> None:
    ride = Ride(demo, stack)
    ride.under_way()
    ride.simulator.board_inputs = replace(ride.simulator.board_inputs, defect=Defect.FROZEN)
    state = ride.tick(4)
    assert (state.verdict.mode, state.sent.active, state.telemetry) == (DriveMode.MANUAL, False, None)
    assert "check its cable" in state.verdict.reason
    ride.tick(60)
    assert abs(ride.simulator.twist().v) < 1e-3


def test_f17_a_control_loop_that_hangs_behind_its_heartbeat_ends_the_drive_for_good(
    demo: Demo, stack: ExitStack
) -> None:
    ride = Ride(demo, stack)
    ride.under_way()
    for _ in range(4):
        advance_tick(ride.simulator, ride.chair)
    state = ride.tick()
    assert not state.sent.active
    assert "no command" in state.sent.reason or "old" in state.sent.reason
    assert ride.tick().navigation.stage is Stage.FAILED
    assert not ride.tick(60).sent.active


def test_f18_the_e_stop_is_named_and_needs_a_deliberate_reset(demo: Demo, stack: ExitStack) -> None:
    ride = Ride(demo, stack)
    ride.under_way()
    ride.simulator.board_inputs = replace(ride.simulator.board_inputs, estop_released=False)
    assert "emergency stop" in ride.tick(2).verdict.reason
    ride.simulator.board_inputs = replace(ride.simulator.board_inputs, estop_released=True)
    ride.go(Goal("bath"))
    assert "emergency stop" in ride.tick(60).verdict.reason
    ride.chair.reset()
    ride.tick(10)
    ride.go(Goal("bath"))
    assert ride.tick(60).sent.active


def test_a_hand_on_the_stick_slows_an_assisted_drive_and_a_push_ends_it(demo: Demo, stack: ExitStack) -> None:
    chair = ChairSettings(supervisor=SupervisorSettings(override=0.6, override_ms=100, assist=True))
    ride = Ride(demo, stack, chair=chair)
    ride.under_way()
    ride.tick(20)
    before = ride.simulator.twist().v
    assert before > 0.3
    ride.simulator.rider = JoystickInput(0, 0.5, 0.0)
    state = ride.tick(30)
    assert (state.verdict.mode, state.sent.active) == (DriveMode.ASSISTED, True)
    assert 0.0 < ride.simulator.twist().v < 0.5 * before
    ride.simulator.rider = JoystickInput(0, 0.7, 0.0)
    assert ride.tick(5).verdict.mode is DriveMode.MANUAL


def test_f20_a_chair_that_does_not_follow_is_stopped_until_a_person_resets_it(
    demo: Demo, stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    ride = Ride(demo, stack)
    ride.under_way()
    ride.tick(20)
    assert ride.simulator.twist().v > 0.4
    monkeypatch.setattr(ride.simulator._contacts, "is_free", lambda pose: False)  # an unseen obstacle holds it
    state = ride.tick(30)
    assert (state.verdict.mode, state.sent.active) == (DriveMode.MANUAL, False)
    assert "follow" in state.verdict.reason or "stands" in state.verdict.reason, state.verdict.reason
    monkeypatch.undo()
    ride.go(Goal("bath"))
    assert not ride.tick(60).sent.active
    ride.chair.reset()
    assert not ride.tick(60).sent.active  # to reset is not to drive on
    ride.go(Goal("bath"))
    assert ride.tick(60).sent.active


def test_an_unreachable_place_is_refused_with_a_reason_and_the_chair_stands(demo: Demo, stack: ExitStack) -> None:
    ride = Ride(demo, stack)
    ride.go(Goal(Pose2(500.0, 0.0, 0.0)))
    state = ride.tick(10)
    assert state.navigation.stage is Stage.FAILED
    assert "outside the map" in state.navigation.reason
    assert not state.sent.active


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_volts(demo: Demo, stack: ExitStack) -> None:
    first, second = Ride(demo, stack), Ride(demo, stack)
    a = [first.tick().sent for _ in range(100)]
    b = [second.tick().sent for _ in range(100)]
    assert a == b
