"""Sentences for the rider: the next action, obstacles and remedies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.control.drive.navigator import Stage
from waychair.control.safety.stops import STOPS, halt, halt_as_told
from waychair.errors import ZoneError
from waychair.maps.drawn.zones import Rule, Zone
from waychair.runtime.pages.chair_port import Hindrance
from waychair.runtime.pages.chair_story import DriveFacts, check_zone, next_action, obstacle_of, obstacles_of
from waychair.runtime.rider.sentences import driving_sentence, next_turn, path_ahead, sentence
from waychair.types import DriveMode, Pose2

STRAIGHT = np.stack([np.arange(0.0, 10.0, 0.1), np.zeros(100)], axis=1)
LEFT = np.concatenate([STRAIGHT[:31], np.stack([np.full(50, 3.0), np.arange(0.1, 5.05, 0.1)], axis=1)])
HERE = Pose2()
FACTS = DriveFacts(DriveMode.AUTONOMOUS, False, "lift", False, None, Stage.DRIVING, "", HERE, LEFT)


@pytest.mark.parametrize(
    ("way", "pose", "said"),
    [
        (STRAIGHT, HERE, "Driving straight on, 10 m to lift."),
        (LEFT, HERE, "Turning left in 2 m, 8 m to lift."),
        (LEFT * [1, -1], Pose2(2.8, 0.0), "Turning right, 5 m to lift."),
        (LEFT, Pose2(3.0, 4.5), "Driving straight on, less than 1 m to lift."),
        (LEFT[:1], HERE, "Driving to lift."),
    ],
)
def test_the_next_move_is_told_with_its_distance(way: np.ndarray, pose: Pose2, said: str) -> None:
    assert driving_sentence("lift", way, pose) == said


@given(st.integers(0, 80), st.floats(-3.0, 3.0))
def test_a_rotated_path_has_the_same_turns(first: int, angle: float) -> None:
    turned = LEFT @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    before, after = next_turn(LEFT[first:]), next_turn(turned[first:])
    assert (before is None) == (after is None)
    if before is not None and after is not None:
        assert after == (
            pytest.approx(before[0], abs=0.11),
            before[1],
        )  # the next point may be the first beyond the angle


def test_repeated_points_are_no_turn() -> None:
    assert next_turn(np.repeat(STRAIGHT, 3, axis=0)) is None
    assert next_turn(np.zeros((5, 2))) is None
    assert len(path_ahead(np.empty((0, 2)), HERE)) == 0


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        (replace(FACTS, countdown_s=2.0), "About to drive to lift."),
        (replace(FACTS, way=np.empty((0, 2))), "Looking for a path to lift."),
        (
            replace(FACTS, holds_lines=False),
            "Waiting until the joystick has been at rest for two seconds: let go of it. Then the drive to lift goes on.",
        ),
        (
            replace(FACTS, stage=Stage.WAITING, reason="something is in the way; waiting"),
            "Waiting: something is in the way. The chair goes on by itself once there is a path.",
        ),
        (
            replace(FACTS, stage=Stage.OFFERING, reason="the door is shut: the chair waits for it up to 12 s"),
            "The door is shut: the chair waits for it up to 12 s.",
        ),
        (
            replace(FACTS, obstacles=obstacles_of([halt("obstacle")])),
            "Waiting: something is close ahead. The chair goes on by itself once the way is free.",
        ),
        (replace(FACTS, mode=DriveMode.MANUAL, waits=True), "Waiting for your yes to drive to lift."),
        (replace(FACTS, mode=DriveMode.STOPPED, goal=""), "Stopped. Choose a place to drive to."),
        (replace(FACTS, mode=DriveMode.MANUAL, goal=""), "The joystick is yours. Choose a place to drive to."),
        (
            replace(FACTS, mode=DriveMode.MANUAL, goal="", obstacles=obstacles_of([halt("lidar_stale")])),
            "The joystick is yours. The lidar is silent: check its cable and power.",
        ),
        (
            replace(FACTS, mode=DriveMode.ASSISTED, steered=True, goal=""),
            "A page steers. The chair stops when its joystick is let go.",
        ),
        (
            replace(FACTS, mode=DriveMode.ASSISTED, steered=True, goal="", holds_lines=False),
            "A page steers. The chair responds once it has stood for two seconds.",
        ),
    ],
)
def test_the_next_action_is_one_plain_sentence(facts: DriveFacts, said: str) -> None:
    assert next_action(facts) == said


@pytest.mark.parametrize("stop_id", sorted(STOPS))
def test_every_stop_is_separated_from_its_remedy(stop_id: str) -> None:
    (told,) = obstacles_of([halt(stop_id, "0.3 m")])
    assert told.remedy == STOPS[stop_id].remedy
    assert told.sentence == (STOPS[stop_id].sentence + " (0.3 m)")


def test_a_stop_of_another_version_keeps_its_own_text() -> None:
    assert obstacle_of("new_stop", "the seat is up: lower it") == Hindrance("new_stop", "the seat is up", "lower it")
    assert "new_stop" in obstacle_of("new_stop", "").sentence


def test_a_sentence_of_another_part_is_split_before_its_advice() -> None:
    (told,) = obstacles_of([halt_as_told("disobeys", "the chair moves at neutral: -0.2 m/s; calibrate again")])
    assert (told.sentence, told.remedy) == ("the chair moves at neutral: -0.2 m/s", "calibrate again")


def test_sentences_begin_with_a_capital_and_end_with_a_full_stop() -> None:
    assert [sentence(text) for text in ("", " no goal ", "Done.")] == ["", "No goal.", "Done."]


def test_a_keep_out_zone_under_the_chair_is_refused() -> None:
    outline = np.array([[0.75, 0.3], [-0.25, 0.3], [-0.25, -0.3], [0.75, -0.3]])
    here = Zone("here", Rule.KEEP_OUT, np.array([[0.5, -1.0], [2.0, -1.0], [2.0, 1.0], [0.5, 1.0]]))
    with pytest.raises(ZoneError, match="stands in this zone"):
        check_zone(here, HERE, outline)
    check_zone(here, Pose2(-1.0), outline)
    check_zone(here, None, outline)
    check_zone(replace(here, rule=Rule.SLOW, value=0.2), HERE, outline)


@pytest.mark.parametrize("stop_id", ["stick_touched", "near_parts", "lidar_late"])
def test_a_drive_that_waits_for_another_reason_than_an_obstacle_tells_it_with_its_remedy(stop_id: str) -> None:
    stop = STOPS[stop_id]
    said = next_action(replace(FACTS, obstacles=obstacles_of([halt(stop_id)])))
    assert said == f"Waiting: {stop.sentence}. {sentence(stop.remedy)}"
