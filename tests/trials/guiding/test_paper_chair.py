"""Drives of a simulated chair that has the paper's sensors alone: sonars, and a camera with a laser's line on servos."""

from __future__ import annotations

import math

import pytest
from evaluation.figures.guiding.blind_unmapped import NO_MAP
from evaluation.scenes.tight_places import door_scene

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.next_door import DoorSide
from waychair.errors import ConfigError
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.trials.guiding.guided import GuidedSensors, GuidedSetup, RiderTold, guided_drive, guided_trial
from waychair.types import HelpLevel

if renderer_problem():
    pytest.skip(str(renderer_problem()), allow_module_level=True)


def test_a_driver_is_led_through_a_door_by_the_papers_sensors_alone() -> None:
    scene = door_scene(0.9, 0.0, CHAIR_A, 3)
    assert scene.door is not None
    setup = GuidedSetup(scene.world, NO_MAP, CHAIR_A, level=HelpLevel.INFORM, seed=3, sensors=GuidedSensors.PAPER)
    record = guided_drive(setup, DoorSide.AHEAD, 60.0)
    assert record.reason == "arrived"
    assert record.reached
    assert record.truth[-1, 0] - CHAIR_A.rear > scene.door.x
    assert (record.caps == 1.0).all()  # nobody guards
    assert {each.symbol for each in record.told} >= {"forward", "arrived"}


def test_the_papers_own_signals_lead_by_the_papers_network_and_the_camera_looks_at_the_door() -> None:
    scene = door_scene(0.9, 0.0, CHAIR_A, 3)
    assert scene.door is not None
    setup = GuidedSetup(
        scene.world, NO_MAP, CHAIR_A, level=HelpLevel.INFORM, seed=3, sensors=GuidedSensors.PAPER, told=RiderTold.PAPER
    )
    with guided_trial(setup) as trial:
        trial.chair.want_door(True)
        errors, signals = [], set()
        for _ in range(160):
            _, state = trial._helped.tick()
            assert state.perceived is not None
            tracked = state.perceived.done.ports["Object tracker"]
            signals.add(state.perceived.signal)
            if tracked.ab:
                true = trial.simulator.truth().inverse() @ scene.door
                errors.append(math.dist(tracked.eo.door.middle, (true.x, true.y)))
        told = trial._helped.parts.guide
        assert told is not None
        assert told.state.count > 0
    assert len(errors) > 40
    assert max(errors) < 0.3
    assert any("swivel" in each or each.startswith("go ") for each in signals)


def test_a_chair_with_the_papers_sensors_has_no_guard() -> None:
    scene = door_scene(0.9, 0.0, CHAIR_A, 3)
    setup = GuidedSetup(scene.world, NO_MAP, CHAIR_A, seed=3, sensors=GuidedSensors.PAPER)
    with pytest.raises(ConfigError, match="choose the level inform"), guided_trial(setup):
        pass
