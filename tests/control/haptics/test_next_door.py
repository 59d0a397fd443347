"""The next doorway on a side: where it leads counts, not where its middle is seen."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.next_door import BEYOND, DoorSide, door_words, next_door
from waychair.geometry import wrap_angle
from waychair.planning.seen.doorways import DoorState, Doorway
from waychair.types import Pose2

HERE = Pose2(4.0, 1.0, math.pi / 2)
"""The chair in odom."""


def door(x: float, y: float, leads_to: float, width: float = 0.9) -> Doorway:
    """A doorway by its middle [m] and way through [rad] in base."""
    return Doorway(1, HERE @ Pose2(x, y, leads_to), width, 0.6, 0.02, DoorState.OPEN)


IN_LEFT_WALL = door(3.0, 0.9, math.pi / 2)


@pytest.mark.parametrize(
    ("where", "side"),
    [
        ((3.0, 0.9, math.pi / 2), DoorSide.LEFT),
        ((3.0, 0.9, -math.pi / 2), DoorSide.LEFT),  # x may lead through it either way
        ((3.0, -0.9, math.pi / 2), DoorSide.RIGHT),
        ((-1.0, 0.9, math.pi / 2), DoorSide.LEFT),  # just passed
        ((2.0, 0.5, 0.3), DoorSide.AHEAD),
        ((2.0, 0.5, 0.3 - math.pi), DoorSide.AHEAD),
    ],
)
def test_a_door_is_on_the_side_to_which_it_leads(where: tuple[float, float, float], side: DoorSide) -> None:
    found = {each: next_door([door(*where)], HERE, each, CHAIR_A) for each in DoorSide}
    assert [each for each, place in found.items() if place is not None] == [side]


def test_the_place_is_behind_the_door_with_the_whole_chair_and_looks_on() -> None:
    place = next_door([IN_LEFT_WALL], HERE, DoorSide.LEFT, CHAIR_A)
    assert place is not None
    assert place.name == door_words(DoorSide.LEFT) == "the door on the left"
    seen = HERE.inverse() @ place.pose
    assert seen.array()[:2] == pytest.approx([3.0, 0.9 + CHAIR_A.axle_from_rear + BEYOND])
    assert wrap_angle(seen.theta - math.pi / 2) == pytest.approx(0.0)


def test_the_nearest_door_that_range_has_borne_out_comes_first() -> None:
    near, far, candidate = door(2.0, 0.9, math.pi / 2), door(4.0, 0.9, math.pi / 2), door(1.0, 0.9, math.pi / 2)
    candidate = replace(candidate, validated=False, state=DoorState.UNKNOWN)
    place = next_door([far, candidate, near], HERE, DoorSide.LEFT, CHAIR_A)
    assert place is not None
    assert (HERE.inverse() @ place.pose).x == pytest.approx(2.0)
    assert next_door([candidate], HERE, DoorSide.LEFT, CHAIR_A) is not None


@pytest.mark.parametrize(
    "no_way",
    [
        replace(IN_LEFT_WALL, width=0.63),
        replace(IN_LEFT_WALL, state=DoorState.CLOSED),
        replace(IN_LEFT_WALL, state=DoorState.AJAR),  # 0.6 m of it are free
        door(8.0, 0.9, math.pi / 2),
        door(-2.0, 0.9, math.pi / 2),
    ],
)
def test_a_door_that_is_narrow_shut_or_far_is_none(no_way: Doorway) -> None:
    assert next_door([no_way], HERE, DoorSide.LEFT, CHAIR_A) is None


def test_a_door_that_the_chair_has_come_through_leads_back() -> None:
    assert all(next_door([door(-0.8, 0.0, 0.0)], HERE, each, CHAIR_A) is None for each in DoorSide)
