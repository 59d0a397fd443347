"""The sentences of step guidance."""

from __future__ import annotations

import pytest

from waychair.control.guidance.guidance import GuidanceTrouble, Guiding
from waychair.control.guidance.telling import Cue
from waychair.planning.movements import Movement, MovementKind
from waychair.runtime.rider.sentences import guiding_sentence, movement_sentence, spoken_sentence


@pytest.mark.parametrize("kind", list(MovementKind))
def test_every_kind_of_movement_has_a_sentence(kind: MovementKind) -> None:
    said = movement_sentence(Movement(kind, lift="Lift A", storey="First"), 3.0)
    assert said[0].isupper()
    assert said.endswith(".")


def test_a_straight_part_is_told_with_its_length_and_landmark() -> None:
    movement = Movement(MovementKind.STRAIGHT, distance=12.0, landmark="to the second door on the left")
    assert movement_sentence(movement, 12.0) == "Straight on, 12 m, to the second door on the left."


def test_a_turn_in_time_before_is_the_following_movement() -> None:
    straight, left = Movement(MovementKind.STRAIGHT, distance=9.0), Movement(MovementKind.LEFT)
    assert spoken_sentence(Guiding(straight, 2.0, left, cue=Cue.SOON)) == "Soon turn left."
    assert spoken_sentence(Guiding(straight, 2.0, left)) == ""


def test_a_lost_pose_and_a_missing_way_are_told_with_their_remedy() -> None:
    assert "choose its place on the map" in guiding_sentence(Guiding(trouble=GuidanceTrouble.NO_POSE))
    assert (
        guiding_sentence(Guiding(trouble=GuidanceTrouble.NO_WAY, why="there is no way to Ward"))
        == "There is no way to Ward."
    )
