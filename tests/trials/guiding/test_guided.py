"""Whole guided drives with both boards' C in the loop."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import pytest
from evaluation.figures.guiding.blind_places import BlindRoute, drive_route
from evaluation.figures.guiding.blind_unmapped import NO_MAP
from evaluation.scenes.tight_places import door_scene, map_of

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.next_door import DoorSide, no_door
from waychair.control.safety.guard import SPOKEN
from waychair.trials.guiding.guided import GuidedSensors, GuidedSetup, guided_drive, guided_trial
from waychair.trials.guiding.guided_report import report, save_report
from waychair.trials.guiding.sound_track import SoundTrack, heard_figures
from waychair.types import HelpLevel, Place, Pose2


@pytest.mark.nightly
def test_a_driver_is_led_through_the_next_door_without_a_map() -> None:
    scene = door_scene(0.9, 60.0, CHAIR_A, 6)
    assert scene.door is not None
    setup = GuidedSetup(scene.world, NO_MAP, CHAIR_A, seed=6, sensors=GuidedSensors.WITH_DOORWAYS)
    with guided_trial(setup) as trial:
        found = trial.drive_through(DoorSide.LEFT, 180.0)
        assert found.reason == no_door(DoorSide.LEFT)  # none is found from one place
        trial.drive_by_odometry(Place("on", scene.world.start @ Pose2(0.7), 0.5, math.pi), 40.0)
        record = trial.drive_through(DoorSide.LEFT, 180.0)
    assert record.reason == "arrived"
    assert record.truth[-1, 0] - CHAIR_A.rear > scene.door.x
    assert record.contacts == ()


def test_a_chair_remembers_its_driver_from_drive_to_drive() -> None:
    scene = door_scene(0.9, 0.0, CHAIR_A, 107)
    known = {"lag_s": [1.0] * 6}
    setup = GuidedSetup(scene.world, map_of(scene.world), CHAIR_A, known=known)
    record = guided_drive(setup, scene.goal, 0.1)
    assert record.learnt.lag_s == 1.0
    assert record.remembered["lag_s"] == known["lag_s"]


def test_a_driver_on_whose_hand_the_glove_sits_the_wrong_way_round_is_led_no_longer_and_told_why() -> None:
    scene = door_scene(0.9, 60.0, CHAIR_A, 3)
    record = guided_drive(GuidedSetup(scene.world, map_of(scene.world), CHAIR_A, "opposite", seed=3), scene.goal, 60.0)
    assert record.reason.startswith("left and right were answered as each other")
    assert record.announced[-1] == f"You are no longer led: {record.reason}."
    assert record.contacts == ()


@pytest.mark.parametrize("driver", ["at_random", "opposite", "idle"])
def test_a_rider_who_cannot_be_led_touches_nothing_and_is_not_told_without_end(driver: str) -> None:
    scene = door_scene(0.9, 30.0, CHAIR_A, 3)
    setup = GuidedSetup(scene.world, map_of(scene.world), CHAIR_A, driver, seed=3)
    record = guided_drive(setup, scene.goal, 30.0)
    assert not record.reached
    assert record.contacts == ()
    assert 3 <= len(record.told) < 30


@pytest.mark.skipif(shutil.which("espeak-ng") is None, reason="espeak-ng is not installed")
def test_a_drive_is_heard_at_its_simulated_time() -> None:
    scene, track = door_scene(0.9, 0.0, CHAIR_A, 107), SoundTrack()
    record = guided_drive(GuidedSetup(scene.world, map_of(scene.world), CHAIR_A, track=track), scene.goal, 9.0)
    level, *advice = track.sounds
    assert level.words == SPOKEN[HelpLevel.GUIDE]
    assert level.begin_ns < 1_000_000_000
    assert 5_000_000_000 < level.end_ns < track.now_ns
    assert all(sound.begin_ns >= level.end_ns for sound in advice), (
        "the glove says it at once, the voice not at all when late"
    )
    assert record.told[0].stamp_ns < level.end_ns
    assert heard_figures(track, []).is_fit


@pytest.mark.nightly
def test_a_driver_who_feels_the_glove_alone_gets_through_a_door_untouched(tmp_path: Path) -> None:
    scene = door_scene(0.9, 0.0, CHAIR_A, 107)
    setup = GuidedSetup(scene.world, map_of(scene.world), CHAIR_A, level=HelpLevel.GUIDE, seed=107)
    record = guided_drive(setup, scene.goal, 180.0)
    assert record.reached, record.reason
    assert record.contacts == ()
    assert len(record.felt) >= 0.9 * len(record.told)
    save_report(record, setup, tmp_path)
    kept = json.loads((tmp_path / "guided.json").read_text())
    assert kept == json.loads(json.dumps(report(record, setup)))
    assert (tmp_path / "symbols.csv").read_text().count("said") == len(record.told)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("route", "arrives", "told"),
    [
        (BlindRoute("small_clinic", "ward", "bath", shut="bath"), False, "Wait: the door is shut"),
        (BlindRoute("apartment", "bath", "bedroom", shut="bedroom"), True, "Something is in the way"),
    ],
)
def test_a_driver_before_a_door_that_was_shut_meanwhile_is_told_so_and_waits_or_is_led_round(
    route: BlindRoute, arrives: bool, told: str
) -> None:
    run = drive_route(route, "guide", 1)
    assert (run.reached, run.contact_speeds) == (arrives, ())
    assert any(sentence.startswith(told) for sentence in run.announced)
    assert arrives or run.reason == "the door is shut, or something stands in it"
