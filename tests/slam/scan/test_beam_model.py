"""Beam model: people who hide walls are no evidence about a pose; missing walls and walls that beams cross are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.slam.scan.beam_model import (
    CLASSES,
    IN_FREE,
    IN_UNKNOWN,
    NEAR_WALL,
    ON_FAR_WALL,
    ON_OBJECT,
    ON_WALL,
    THROUGH_WALL,
    BeamMap,
    beam_classes,
    beam_map,
    place_log_odds,
    pose_probability,
)
from waychair.types import FloatArray, OccupancyGrid, Pose2


def hall() -> BeamMap:
    """6 x 4 m in cells of 0.1 m: a wall from x = 3 to 3.1, another from 4.5 to 4.6, unknown from 5 on."""
    cells = np.zeros((40, 60), np.int8)
    cells[:, 30], cells[:, 45], cells[:, 50:] = 100, 100, -1
    return beam_map(OccupancyGrid(cells, 0.1))


MIDDLE = Pose2(1.0, 2.05, 0.0)


def shares_of(ends: FloatArray, pose: Pose2 = MIDDLE) -> FloatArray:
    return beam_classes(ends, np.zeros(ends.shape), pose.array(), hall())[0]


@pytest.mark.parametrize(
    ("end", "expected"),
    [
        ((2.05, 0.0), ON_WALL),
        ((1.85, 0.0), NEAR_WALL),
        ((1.0, 0.0), ON_OBJECT),
        ((2.8, 0.0), THROUGH_WALL),
        ((3.55, 0.0), ON_FAR_WALL),
        ((-3.0, 0.0), IN_UNKNOWN),
    ],
)
def test_beams_are_classified_by_the_cells_they_cross_and_their_end(end: tuple[float, float], expected: int) -> None:
    assert shares_of(np.array([end])).argmax() == expected


def test_the_unmapped_side_of_a_thing_that_was_seen_from_one_side_is_unknown_and_no_wall_out_of_place() -> None:
    cells = np.zeros((40, 60), np.int8)
    cells[:, 30], cells[:, 31:36] = 100, -1  # a cupboard whose front alone was seen
    beams = beam_map(OccupancyGrid(cells, 0.1))

    def found(x: float, heading: float, length: float) -> int:
        shares = beam_classes(np.array([[length, 0.0]]), np.zeros((1, 2)), Pose2(x, 2.05, heading).array(), beams)
        return int(shares[0].argmax())

    assert found(5.5, math.pi, 2.25) == IN_UNKNOWN  # its other side, 0.2 m behind the front
    assert found(1.0, 0.0, 2.25) == NEAR_WALL  # through its front: the pose is off


def test_no_beams_have_no_shares() -> None:
    assert not shares_of(np.empty((0, 2))).any()


@pytest.mark.parametrize(("width", "expected"), [(0.3, ON_OBJECT), (0.99, ON_OBJECT), (1.01, IN_FREE), (3.0, IN_FREE)])
def test_a_surface_on_free_ground_is_a_person_up_to_a_metre_of_width_and_a_wall_beyond(
    width: float, expected: int
) -> None:
    ends = np.column_stack([np.full(40, 1.0), np.linspace(-width / 2, width / 2, 40)])
    assert shares_of(ends)[expected] == pytest.approx(1.0)


def test_people_side_by_side_at_different_distances_are_not_a_wall() -> None:
    y = np.linspace(-1.5, 1.5, 60)
    crowd = np.column_stack([np.where(np.floor((y + 1.5) / 0.5) % 2 > 0, 1.6, 1.0), y])
    assert shares_of(crowd)[ON_OBJECT] == pytest.approx(1.0)


def plain_shares(ends: FloatArray, pose: Pose2) -> FloatArray:
    """A plain version of the kernel: the class of each beam, then the runs in free space by their width."""
    alone = [int(shares_of(end[None], pose).argmax()) for end in ends]
    result, k = np.zeros(CLASSES), 0
    while k < len(ends):
        last = k + 1
        if alone[k] == ON_OBJECT:
            while last < len(ends) and alone[last] == ON_OBJECT:
                if math.dist(ends[last], ends[last - 1]) > max(0.1, 0.1 * math.hypot(*ends[last])):
                    break
                last += 1
            width = max(math.dist(end, ends[k]) for end in ends[k:last])
            alone[k:last] = [ON_OBJECT if width <= 1.0 else IN_FREE] * (last - k)
        k = last
    for found in alone:
        result[found] += 1.0 / len(ends)
    return result


@given(st.integers(0, 10_000))
def test_the_kernel_groups_beams_as_the_plain_reference_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bearings = np.linspace(-math.pi, math.pi, 60)
    ranges = np.repeat(rng.uniform(0.3, 4.0, 12), 5) + rng.normal(0, 0.02, 60)
    ends = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])
    pose = Pose2(rng.uniform(0.5, 2.5), rng.uniform(0.5, 3.5), rng.uniform(-3, 3))
    assert shares_of(ends, pose) == pytest.approx(plain_shares(ends, pose))


def shares(**of: float) -> FloatArray:
    names = {"on": ON_WALL, "near": NEAR_WALL, "free": IN_FREE, "through": THROUGH_WALL, "unknown": IN_UNKNOWN}
    names |= {"object": ON_OBJECT, "far": ON_FAR_WALL}
    result = np.zeros((1, CLASSES))
    for name, share in of.items():
        result[0, names[name]] = share
    return result


def health(**of: float) -> float:
    return float(pose_probability(shares(**of))[0])


def test_a_scan_of_people_alone_gives_even_odds() -> None:
    assert health(object=1.0) == 0.5


def test_health_falls_with_contradictions_of_the_map_and_little_with_occlusion() -> None:
    assert health(on=1.0) > health(on=0.6, object=0.4) > 0.8
    assert health(on=0.8, far=0.2) > 0.8
    assert health(on=0.8, free=0.2) < health(on=0.8, object=0.2)
    assert health(on=0.8, through=0.2) < 0.31
    assert health(on=0.5, near=0.5) < 0.31
    assert health(unknown=1.0) < 0.31


def test_a_place_found_without_a_guess_must_explain_people_and_walls_behind_walls_too() -> None:
    def odds(**of: float) -> float:
        return float(place_log_odds(shares(**of))[0])

    assert odds(on=0.7, object=0.3) == odds(on=0.7, free=0.3) < 0.0
    assert odds(on=0.7, far=0.3) == odds(on=0.7, through=0.3) < odds(on=1.0)
