"""All of it, in simulation: a small world is driven, recorded, mapped, and the chair drives to places by that map."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from waychair.control.navigator import Stage
from waychair.runtime.chair import Chair, ChairState
from waychair.simulation.simulator import Simulator
from waychair.trials.demo import Demo, chair_of, run_demo
from waychair.trials.demo_report import write_report
from waychair.trials.drive import TICK_NS
from waychair.types import DriveMode, Goal, JoystickInput, Pose2


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("demo")


@pytest.fixture(scope="module")
def demo(out: Path) -> Demo:
    return run_demo(out, seed=1)


def test_three_of_three_places_are_reached_without_a_contact(demo: Demo) -> None:
    assert [leg.place for leg in demo.legs if not leg.reached] == []
    assert len(demo.legs) == 3
    assert sum(leg.contacts for leg in demo.legs) == 0


def test_the_chair_knew_where_it_was_all_along(demo: Demo) -> None:
    assert max(leg.localisation_error_m for leg in demo.legs) < 0.10


def test_the_drive_was_made_of_joystick_volts_within_their_range(demo: Demo) -> None:
    volts = np.concatenate([leg.volts for leg in demo.legs])
    assert volts.min() >= 0.0
    assert volts.max() <= 3.3
    assert np.ptp(volts, axis=0).min() > 0.3


def test_report_holds_what_was_driven(demo: Demo, out: Path) -> None:
    write_report(out, demo)
    report = json.loads((out / "report.json").read_text())
    assert (report["goals"], report["goals_reached"], report["contacts"]) == (3, 3, 0)
    assert {"record", "read", "map", "drive"} <= set(report["stages"])
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 4
    assert "http" not in page
    for leg in demo.legs:
        assert leg.place in page
    assert {path.name for path in (out / "map").iterdir()} >= {"map.yaml", "map.pgm", "places.yaml", "report.json"}


class Ride:
    """A chair under way in the small world, on the map the demo made."""

    def __init__(self, demo: Demo, goal: str = "bath") -> None:
        from waychair.simulation.world import load_world

        setting = demo.setting
        self.simulator = Simulator(load_world("small_clinic"), setting.body, chair_of(1), 1)
        self.chair = Chair(
            setting.grid, setting.places, setting.body, setting.calibration, self.simulator, Pose2(), setting.chair
        )
        self.chair.go(Goal(goal))
        self.deaf = False

    def tick(self, count: int = 1) -> ChairState:
        for _ in range(count):
            messages = self.simulator.advance(TICK_NS)
            heard = () if self.deaf else (*messages, self.simulator.rider)
            state = self.chair.step(self.simulator.now_ns, heard)
        return state


def test_joystick_overrides_autonomous_within_one_tick_and_nothing_resumes(demo: Demo) -> None:
    ride = Ride(demo)
    assert ride.tick(60).verdict.mode is DriveMode.AUTONOMOUS
    ride.simulator.rider = JoystickInput(ride.simulator.now_ns, 0.0, 0.8)
    state = ride.tick()
    assert state.verdict.mode is DriveMode.MANUAL
    assert not state.sent.active
    ride.tick(20)
    assert ride.simulator.twist().omega > 0.2  # the rider really turns the chair
    ride.simulator.rider = JoystickInput(ride.simulator.now_ns)
    state = ride.tick(100)
    assert not state.sent.active
    assert abs(ride.simulator.twist().v) < 1e-3


def test_stop_lets_go_at_once_and_a_new_goal_drives_on(demo: Demo) -> None:
    ride = Ride(demo)
    ride.tick(60)
    ride.chair.stop()
    state = ride.tick()
    assert (state.verdict.mode, state.sent.active) == (DriveMode.STOPPED, False)
    assert ride.tick(100).verdict.mode is DriveMode.STOPPED
    assert abs(ride.simulator.twist().v) < 1e-3
    ride.chair.go(Goal("bath"))
    assert ride.tick(40).sent.active


def test_silent_sensors_make_the_computer_let_go(demo: Demo) -> None:
    ride = Ride(demo)
    assert ride.tick(60).sent.active
    ride.deaf = True
    states = [ride.tick() for _ in range(8)]
    assert not states[-1].sent.active
    assert "silent" in states[-1].verdict.reason
    assert states[-1].navigation.stage is Stage.FAILED
    ride.deaf = False
    assert not ride.tick(40).sent.active  # back, but nothing resumes by itself


def test_an_unreachable_place_is_refused_with_a_reason_and_the_chair_stands(demo: Demo) -> None:
    ride = Ride(demo)
    ride.chair.go(Goal(Pose2(500.0, 0.0, 0.0)))
    state = ride.tick(10)
    assert state.navigation.stage is Stage.FAILED
    assert "outside the map" in state.navigation.reason
    assert not state.sent.active


def test_same_seed_drives_the_same_volts(demo: Demo) -> None:
    first, second = Ride(demo), Ride(demo)
    a = [first.tick().sent for _ in range(100)]
    b = [second.tick().sent for _ in range(100)]
    assert a == b
