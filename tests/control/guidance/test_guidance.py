"""Step guidance: one movement at a time, other ways, prompts that fade, lifts, and what makes it fall silent."""

from __future__ import annotations

import math

import pytest

from tests.control.guidance.walks import kinds, spoken, walk
from waychair.control.guidance.guidance import GuidanceTrouble, begun
from waychair.control.guidance.practice import BEFORE, Practice, RiderDecision, practised
from waychair.control.guidance.telling import Cue
from waychair.planning.movements import MovementKind
from waychair.types import Pose2

WARD, STORE = (10.0, 3.25), (15.0, 3.25)


def test_a_rider_is_told_one_movement_at_a_time_to_the_door_and_the_bed() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    told = ride.drive((10.0, 0.1), WARD)
    assert kinds(told) == ["straight", "left", "door", "straight", "arrived"]
    assert told[0].movement is not None
    assert told[0].movement.landmark == "to the next door on the left"
    assert [each.decided.decision for each in told if each.decided] == [
        RiderDecision.FOLLOWED
    ] * 2  # the corner and the bed
    assert told[-1].arrived


def test_a_chair_that_faces_away_is_told_to_turn_first() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(6.0, 0.0, math.pi))
    assert ride.look().movement.kind is MovementKind.TURN_ROUND  # type: ignore[union-attr]
    told = ride.turn(0.0)
    assert told[-1].movement is not None
    assert told[-1].movement.kind is MovementKind.STRAIGHT


def test_a_chair_before_a_junction_turns_where_it_is_and_not_at_the_junction_to_come_back() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.7, 0.0, math.pi))
    movement = ride.look().movement
    assert movement is not None
    assert movement.kind is MovementKind.TURN_ROUND
    assert ride.state.plan is not None
    passed = ride.state.plan.parts[0].junctions
    assert len(set(passed)) == len(passed)


def test_a_turn_right_behind_a_door_is_told_before_its_corner() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(10.0, 3.0, -math.pi / 2))
    ride.state = begun(ride.ways.node("Ground/Store/Bed g"))
    told = ride.drive((10.0, 0.0))
    left = next(k for k, each in enumerate(told) if each.movement and each.movement.kind is MovementKind.LEFT)
    assert 0.6 <= 3.0 - 0.04 * (left + 1) <= 1.0  # m before the corner


def test_the_second_door_is_named_where_one_is_passed_before() -> None:
    ride = walk("Ground/Store/Bed g", Pose2(5.0, 0.0, 0.0))
    movement = ride.look().movement
    assert movement is not None
    assert movement.landmark == "to the second door on the left"


def test_another_way_is_recognised_half_a_metre_beyond_and_planned_from_in_the_same_tick() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    ride.drive((10.0, 0.0))
    told = ride.drive((11.5, 0.0))
    decided = [(k, each) for k, each in enumerate(told) if each.decided is not None]
    assert [each.decided.decision for _, each in decided if each.decided] == [RiderDecision.OTHER]
    k, each = decided[0]
    beyond_s = k * 0.05 - 0.5 / 0.8
    assert 0.0 <= beyond_s <= 0.6
    assert each.movement is not None
    assert each.movement.kind is MovementKind.TURN_ROUND  # the new plan's movement, in the same tick
    assert each.cue is Cue.NOW


def test_guidance_names_the_way_that_was_taken_not_the_one_proposed() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    told = ride.drive((15.0, 0.0), (15.0, 3.0))
    assert [each.decided.decision for each in told if each.decided] == [RiderDecision.OTHER, RiderDecision.OTHER]
    ride.drive((15.0, 0.0), (10.0, 0.0))
    assert ride.drive(WARD)[-1].arrived


def test_a_rider_who_goes_on_where_going_on_becomes_cheaper_is_no_longer_sent_back() -> None:
    ride = walk("Ground/Store/Bed g", Pose2(9.0, 0.0, math.pi))
    assert ride.look().movement.kind is MovementKind.TURN_ROUND  # type: ignore[union-attr]
    told = ride.drive((10.0, 0.0), (15.0, 0.0), STORE)
    assert told[-1].arrived
    assert all(each.decided is None or each.decided.decision is RiderDecision.FOLLOWED for each in told)


def test_turning_back_is_noticed_and_planned_from() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    ride.drive((8.5, 0.0))
    told = ride.drive((7.0, 0.0))
    assert [each.decided.decision for each in told if each.decided] == [RiderDecision.TURNED_BACK]
    assert kinds(told)[-1] == "turn round"


def test_an_overshoot_before_the_corner_is_no_other_way() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    told = ride.drive((10.4, 0.0), WARD)
    assert [each.decided.decision for each in told if each.decided] == [
        RiderDecision.FOLLOWED
    ] * 2  # the corner and the bed


def test_no_sentence_is_repeated_within_four_seconds_while_nothing_changes() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    said: list[tuple[int, str]] = []
    for k in range(400):  # the heading swings about the limit of facing away
        ride.pose = Pose2(6.0 + 0.001 * k, 0.0, 1.3 if k % 20 < 10 else 0.6)
        guiding = ride.look(at_rest=k % 3 == 0)
        if guiding.cue is not None and guiding.movement is not None:
            said.append((ride.now_ns, f"{guiding.movement.kind}{guiding.movement.landmark}"))
    for k, (at, words) in enumerate(said):
        assert all(at - before >= 4_000_000_000 for before, same in said[:k] if same == words)


def test_a_rider_who_rests_is_told_again_after_four_seconds_and_the_hesitation_is_noted_once() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    ride.drive((7.0, 0.0))
    told = ride.rest(14.0)
    assert spoken(told) == ["again straight", "again straight"]  # after 4 s, and 8 s later
    made = [each.decided for each in told if each.decided]
    assert [each.decision for each in made] == [RiderDecision.HESITATED]


def test_prompts_fade_with_right_decisions_and_come_back_after_an_error() -> None:
    practice: dict[str, Practice] = {}
    counts = []
    for _ in range(8):
        ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0), practice=practice)
        counts.append(len(spoken(ride.drive((10.0, 0.1), WARD))))
        practice = dict(ride.state.practice)
    assert counts[-1] < counts[0]
    assert counts == sorted(counts, reverse=True)
    corner = next(place for place, known in practice.items() if known.level == 0)
    astray = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0), practice=practice)
    told = astray.drive((12.0, 0.0))
    assert any(each.cue is not None for each in told)
    assert astray.state.practice[corner].level == 1


def test_prompts_fade_at_goals_and_lifts_too_and_another_storey_brings_them_back() -> None:
    practice: dict[str, Practice] = {}
    counts = []
    for _ in range(7):
        ride = walk("First/Store/Bed 1", Pose2(3.4, 0.0, math.pi), practice=practice)
        told = [*ride.drive((1.0, 0.0)), *ride.rest(5.0)]  # in the lift, which is no hesitation
        ride.storey = "1"
        told += [ride.look(), *ride.drive((3.0, 0.0), (15.0, 0.1), STORE)]
        assert told[-1].arrived
        counts.append(len(spoken(told)))
        practice = dict(ride.state.practice)
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 1  # to have arrived is said at every level but the lowest
    assert practice["Lift A"].level == practice["First/Store/Bed 1"].level == 0
    ride = walk("First/Store/Bed 1", Pose2(3.4, 0.0, math.pi), practice=practice)
    ride.drive((1.0, 0.0))
    ride.state = begun(ride.ways.node("Ground/Store/Bed g"), practice=practice)
    ride.look()
    ride.storey = "1"  # another button was pressed
    told = [ride.look()]
    assert [each.decided.decision for each in told if each.decided] == [RiderDecision.OTHER]
    assert spoken(told) == ["now press"]
    assert ride.state.practice["Lift A"].level == 1


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_each_level_says_no_less_than_the_one_below(level: int) -> None:
    def said(at: int) -> list[str]:
        ride = walk("Ground/Store/Bed g", Pose2(5.0, 0.0, 0.0), at)
        return spoken(ride.drive((15.0, 0.1), STORE))

    assert len(said(level)) >= len(said(max(level - 1, 0)))
    assert said(0) == []
    assert {each.split()[1] for each in said(1)} == {"left", "arrived"}
    assert "soon straight" in said(2)
    assert walk("Ground/Store/Bed g", Pose2(5.0, 0.0, 0.0), level).look().offers == (level == 3)


def test_a_level_is_no_practice_after_three_right_decisions_and_never_above_two() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    made = next(each.decided for each in ride.drive((10.0, 0.1), WARD) if each.decided)
    known = Practice(BEFORE)
    for _ in range(6):
        known = practised(known, made)
    assert known == Practice(0)
    assert begun(ride.state.goal, 9).level == 3


def test_a_lost_pose_silences_guidance_and_nothing_is_decided_by_it() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    ride.drive((9.0, 0.0))
    before = ride.state
    guiding = ride.look(localised=False)
    assert guiding.trouble is GuidanceTrouble.NO_POSE
    assert guiding.movement is None
    assert guiding.cue is None
    assert ride.state == before
    ride.pose = Pose2(math.nan, 0.0, 0.0)
    assert ride.look().trouble is GuidanceTrouble.NO_POSE


def test_no_way_and_no_graph_are_sentences_and_end_when_their_cause_does() -> None:
    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    ride.storey = "cellar"
    assert ride.look().trouble is GuidanceTrouble.NO_GRAPH
    ride.storey = "g"
    assert ride.look().movement is not None


def test_the_lift_is_called_entered_and_told_its_storey_and_another_storey_is_planned_from() -> None:
    ride = walk("First/Store/Bed 1", Pose2(8.0, 0.0, math.pi))
    told = ride.drive((3.4, 0.0))
    assert kinds(told)[-1] == "wait"
    assert told[-1].movement is not None
    assert (told[-1].movement.lift, told[-1].movement.storey) == ("Lift A", "First")
    assert ride.look(lift_open=True).movement.kind is MovementKind.INTO_LIFT  # type: ignore[union-attr]
    told = ride.drive((1.0, 0.0))
    assert kinds(told)[-1] == "press"
    assert told[-1].at_stops == ("g", "1")
    ride.storey = "1"
    assert kinds([ride.look()]) == ["leave the lift"]
    told = ride.drive((3.0, 0.0), (15.0, 0.0), STORE)
    assert told[-1].arrived


def test_a_drive_by_the_computer_is_no_decision_of_the_rider() -> None:
    from waychair.control.guidance.guidance import GuidanceView, step

    ride = walk("Ground/Ward/Bed g", Pose2(5.0, 0.0, 0.0))
    ride.look()
    for k in range(80):
        pose = Pose2(8.0 + 0.05 * k, 0.0, 0.0)
        view = GuidanceView(10**9 + k * 50_000_000, "g", pose, computer_drives=True)
        ride.state, guiding = step(ride.state, view, ride.ways)
        assert guiding.cue is None
        assert guiding.decided is None
    assert ride.state.practice == {}
