from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.control.journey.ride_motion import RideMotion
from waychair.control.journey.which_storey import (
    StopEvidence,
    climb_from_pressure,
    decided,
    probabilities,
    seen_through_door,
    without_alike,
)
from waychair.types import ImuSample, OccupancyGrid, Pose2

STOPS = {"0": 0.0, "1": 3.3, "2": 6.6, "3": 9.9}


def evidence(**changes: object) -> StopEvidence:
    return StopEvidence(STOPS, began="0", asked="2", **changes)  # type: ignore[arg-type]


def test_a_wish_alone_never_decides() -> None:
    assert decided(probabilities(evidence())) is None


@pytest.mark.parametrize(("climb", "storey"), [(6.5, "2"), (3.4, "1"), (0.02, "0"), (9.8, "3")])
def test_a_felt_climb_decides_even_against_the_wish(climb: float, storey: str) -> None:
    assert decided(probabilities(evidence(climb=(climb, 0.25)))) == storey


@pytest.mark.parametrize("climb", [(4.95, 0.25), (6.6, 3.0)])
def test_a_climb_between_two_storeys_or_a_vague_one_asks(climb: tuple[float, float]) -> None:
    assert decided(probabilities(evidence(climb=climb))) is None


def test_storeys_that_look_alike_are_asked_for() -> None:
    match = {"0": -20.0, "1": -18.0, "2": -4.0, "3": -4.3}
    assert decided(probabilities(evidence(match=match))) is None
    assert without_alike(match)["3"] == without_alike(match)["2"] == 0.0
    assert decided(probabilities(evidence(match={**match, "3": -18.0}))) == "2"


def test_the_riders_word_decides_unless_the_ride_contradicts_it() -> None:
    alike = {"0": -20.0, "1": -18.0, "2": -4.0, "3": -4.3}
    assert decided(probabilities(evidence(match=alike, rider="3"))) == "3"
    assert decided(probabilities(evidence(climb=(3.3, 0.2), rider="3"))) is None


def test_a_climb_to_no_known_stop_asks_however_much_the_walls_look_like_the_storey_asked_for() -> None:
    """A lift that stops at a storey which the building does not list."""
    match = {"0": -20.0, "1": -18.0, "2": -4.0, "3": -19.0}
    assert decided(probabilities(evidence(match=match))) == "2"
    for measured in ({"climb": (4.95, 0.2)}, {"pressure": (5.0, 0.3)}, {"climb": (6.6, 0.2), "pressure": (4.9, 0.3)}):
        chances = probabilities(evidence(match=match, **measured))
        assert decided(chances) is None
        assert decided(probabilities(evidence(match=match, rider="1", **measured))) == "1"


def test_pressure_falls_by_twelve_pascal_a_metre() -> None:
    climb, sigma = climb_from_pressure(101_000.0, 101_000.0 - 12.0 * 6.6, 20.0)
    assert climb == pytest.approx(6.6)
    assert decided(probabilities(evidence(pressure=(climb, sigma)))) == "2"


def test_words_of_unknown_storeys_count_for_nothing() -> None:
    assert probabilities(evidence(rider="9", told="x")) == probabilities(evidence())


def ride(heights: list[float], seed: int = 0, bias: float = 0.08, drift: float = 0.00002) -> RideMotion:
    """Hear rides of these heights [m] one after the other, with a rest of 3 s before and after each."""
    motion, rng, now_ns = RideMotion(), np.random.default_rng(seed), 0
    accelerations = [0.0] * 600
    for height in heights:
        # a sine over the duration T climbs by a T^2 / (2 pi)
        seconds = math.sqrt(abs(height) * math.tau / 0.5)
        count = round(seconds * 200)
        peak = math.copysign(0.5, height)
        accelerations += [peak * math.sin(math.tau * k / count) for k in range(count)] + [0.0] * 600
    for k, a in enumerate(accelerations):
        now_ns += 5_000_000
        up = 9.81 + bias + drift * k * 0.005 + a + 0.025 * rng.standard_normal()
        motion.hear(ImuSample(now_ns, np.array([0.0, 0.0, up]), np.zeros(3)))
        if k == 300:
            motion.begin()
    return motion


@pytest.mark.parametrize("heights", [[3.3], [-6.6], [9.9], [3.3, 3.3], [6.6, -3.3], []])
def test_a_ride_is_measured_from_rest_to_rest(heights: list[float]) -> None:
    climb = ride(heights).climb()
    assert climb is not None
    assert climb[0] == pytest.approx(sum(heights), abs=0.25)
    assert abs(climb[0] - sum(heights)) < 2.5 * climb[1]


def test_a_gap_in_the_samples_makes_the_climb_unknown() -> None:
    motion = ride([])
    motion.hear(ImuSample(10**12, np.array([0.0, 0.0, 9.81]), np.zeros(3)))
    assert motion.climb() is None
    motion.hear(ImuSample(10**12 + 5_000_000, np.array([0.0, 0.0, math.nan]), np.zeros(3)))
    assert motion.climb() is None


def test_beams_agree_with_the_map_that_they_were_measured_in() -> None:
    cells = np.zeros((100, 200), np.int8)
    cells[:, 160:] = 100
    near, far = OccupancyGrid(cells.copy(), 0.05), OccupancyGrid(cells, 0.05)
    near.cells[:, 100:] = 100
    angles = np.linspace(-0.2, 0.2, 40)
    ranges = 3.0 / np.cos(angles)  # a wall at x = 8 m, seen from 5 m
    pose = Pose2(5.0, 2.5, 0.0)
    pose_near = Pose2(2.0, 2.5, 0.0)  # the near wall is 3 m from there
    assert seen_through_door(far, pose, angles, ranges) > seen_through_door(far, pose_near, angles, ranges) + 3.0
    assert seen_through_door(near, pose_near, angles, ranges) == seen_through_door(far, pose, angles, ranges)
    assert seen_through_door(far, pose, angles[:0], ranges[:0]) == 0.0


def test_a_ride_whose_speed_has_drifted_away_ends_at_the_open_door_and_its_climb_is_unknown() -> None:
    motion, now_ns = RideMotion(), 0

    def stay(seconds: float, up: float) -> None:
        nonlocal now_ns
        for _ in range(round(seconds * 200)):
            now_ns += 5_000_000
            motion.hear(ImuSample(now_ns, np.array([0.0, 0.0, up]), np.zeros(3)))

    stay(4.0, 9.81)
    motion.begin()
    stay(30.0, 9.95)  # its mean at rest has changed, as by a jolt
    assert motion.riding
    motion.stands()
    assert not motion.riding
    assert motion.climb() is None
    stay(5.0, 9.95)
    assert not motion.riding
    motion.begin()
    assert motion.climb() == (0.0, 0.1)
