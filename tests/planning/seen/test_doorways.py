"""A gap is believed to be a doorway only when range bears it out, and is wide enough only with a margin."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.planning.seen.doorway_gaps import Gap, JambSight
from waychair.planning.seen.doorways import NO_EVIDENCE, SPARE, DoorState, Doorway, GapEvidence, judge, weighted_median
from waychair.types import Pose2

AT = Pose2(3.0, 1.0, 0.5)


def _evidence(
    *,
    width: float = 0.9,
    walls: tuple[float, float] = (0.8, 0.9),
    depth: float = 2.0,
    stopped: int = 0,
    step: float = 0.4,
    left_doubt: float = 0.01,
    flanks: tuple[int, int, int, int] = (0, 0, 0, 0),
) -> GapEvidence:
    evidence = NO_EVIDENCE
    for k in range(6):
        seat = (-2.5 + step * k, 0.3)
        sight = JambSight((0.0, -width / 2), (0.0, width / 2), 0.01, left_doubt, 20, stopped, depth, seat, flanks)
        evidence = evidence.with_gap(Gap(AT, width, walls)).with_sight(sight, AT)
    return evidence


def test_a_gap_seen_through_from_places_apart_beside_a_wall_is_a_doorway() -> None:
    judged = judge(_evidence(), Pose2(3.05, 0.95, 0.45 + math.pi))
    assert (judged.against, judged.missing) == ("", "")
    assert judged.width == pytest.approx(0.9)
    assert math.hypot(judged.pose.x - 3.0, judged.pose.y - 1.0) < 1e-9
    assert abs(math.remainder(judged.pose.theta - 0.5, math.pi)) < 1e-9
    assert judged.error < 0.05


@pytest.mark.parametrize(
    ("against", "facts"),
    [
        ("its width is not a doorway's", {"width": 1.4}),
        ("it is a niche", {"depth": 0.45}),
        ("something stands in it", {"stopped": 20}),
        ("no wall stands beside it", {"walls": (0.3, 0.2)}),
        ("it is the mouth of a corridor", {"flanks": (0, 0xFFFF, 0, 0xFFFF)}),
        ("a wall runs through it", {"flanks": (0xFFFF, 0xFFFF, 0, 0)}),
    ],
)
def test_each_reason_against_a_gap_is_named(against: str, facts: dict) -> None:  # type: ignore[type-arg]
    assert judge(_evidence(**facts), AT).against == against


@pytest.mark.parametrize(
    ("missing", "facts"),
    [
        ("it was seen through from one place only", {"step": 0.01}),
        ("one of its jambs was not seen", {"left_doubt": math.inf}),
        ("the space behind it was not seen", {"depth": math.nan}),
    ],
)
def test_evidence_that_is_missing_is_named_and_leaves_a_candidate(missing: str, facts: dict) -> None:  # type: ignore[type-arg]
    judged = judge(_evidence(**facts), AT)
    assert (judged.against, judged.missing) == ("", missing)


def test_walls_seen_in_single_views_give_the_direction_unless_a_pilaster_turns_them() -> None:
    for turn, expected in ((0.02, 0.52), (0.2, 0.5)):
        evidence = _evidence()
        for k in range(6):
            seat = (-2.5 + 0.4 * k, 0.3)
            sight = JambSight((0.0, -0.45), (0.0, 0.45), 0.01, 0.01, 20, 0, 2.0, seat, (0, 0, 0, 0), (0.01, turn))
            evidence = evidence.with_sight(sight, AT)
        assert judge(evidence, AT).pose.theta == pytest.approx(expected)


def test_an_opening_with_a_wall_behind_one_jamb_and_a_leaf_behind_the_other_is_a_doorway() -> None:
    assert judge(_evidence(flanks=(0, 0xFFFF, 0, 0x7F)), AT).against == ""


def test_a_doorway_is_wide_enough_only_when_open_and_with_its_error_and_4_cm_to_spare() -> None:
    door = Doorway(1, AT, 0.90, 0.90, 0.03, DoorState.OPEN)
    assert door.margin(0.60) == pytest.approx(0.27)
    assert door.wide_enough(0.90 - 0.03 - SPARE - 1e-9)
    assert not door.wide_enough(0.90 - 0.03 - SPARE + 1e-3)
    assert not Doorway(1, AT, 0.90, 0.90, 0.03, DoorState.AJAR).wide_enough(0.5)
    assert not Doorway(1, AT, 0.90, 0.90, math.inf, DoorState.OPEN).wide_enough(0.5)
    assert not Doorway(1, AT, 0.90, 0.90, 0.03, DoorState.OPEN, validated=False).wide_enough(0.5)


def test_the_weighted_median_leaves_half_of_the_weight_on_either_side() -> None:
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.ones(3)) == 2.0
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([5.0, 1.0, 1.0])) == 3.0
