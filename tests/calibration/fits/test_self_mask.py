"""Things that move with the chair are masked; a hand, a wall and a person beside the chair are not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.self_mask import SelfMask, learn_self_mask
from waychair.errors import CalibrationError, ConfigError, ThinData
from waychair.types import BoolArray, FloatArray, Scan

ANGLES = np.linspace(-2.35, 2.35, 471)
STEP = float(ANGLES[1] - ANGLES[0])
LEG: BoolArray = (ANGLES > 1.5) & (ANGLES < 2.0)
TUBE: BoolArray = (ANGLES > -1.4) & (ANGLES < -1.3)
HALL = 6.0


def walls(heading: float, angles: FloatArray = ANGLES) -> FloatArray:
    """Ranges in the middle of a square hall, from a chair that looks this way."""
    x, y = np.abs(np.cos(angles + heading)), np.abs(np.sin(angles + heading))
    return np.asarray(0.5 * HALL / np.maximum(x, y) + 0.5 * np.sin(3 * (angles + heading)))


def turning(scans: int = 120, seed: int = 0, noise: float = 0.01) -> FloatArray:
    """(S, N) ranges of a chair that turns once round, with a leg and a tube in the way."""
    rng = np.random.default_rng(seed)
    ranges = np.array([walls(math.tau * k / scans) for k in range(scans)])
    ranges[:, LEG], ranges[:, TUBE] = 0.15, 0.25
    ranges += noise * rng.standard_normal(ranges.shape)
    ranges[rng.random(ranges.shape) < 0.005] = np.nan
    return ranges


def as_scans(ranges: FloatArray) -> list[Scan]:
    """Yield the scans of a turn, one after the other."""
    return [Scan(k, row.astype(np.float32), float(ANGLES[0]), STEP, range_max=30.0) for k, row in enumerate(ranges)]


def hidden_share(mask: SelfMask, scans: list[Scan], beams: BoolArray) -> float:
    """Return the share of these beams that the mask hides."""
    return float(np.mean([mask.hides(scan)[beams].mean() for scan in scans]))


def test_only_the_leg_and_the_tube_are_masked() -> None:
    scans = as_scans(turning())
    mask = learn_self_mask(scans, CHAIR_A)
    assert len(mask.begins) == 2
    assert hidden_share(mask, scans, LEG | TUBE) == 1.0
    assert hidden_share(mask, scans, ~(LEG | TUBE)) == 0.0


def test_fluttering_trousers_are_masked_to_their_farthest_reach() -> None:
    ranges = turning()
    flap: BoolArray = (ANGLES >= 2.0) & (ANGLES < 2.05)
    ranges[::3, flap] = 0.17
    ranges[::2, LEG] += 0.03
    scans = as_scans(ranges)
    mask = learn_self_mask(scans, CHAIR_A)
    assert hidden_share(mask, scans, LEG | TUBE | flap) == 1.0
    assert hidden_share(mask, scans, ~(LEG | TUBE | flap)) == 0.0


def test_a_passing_hand_is_not_masked() -> None:
    ranges = turning()
    hand: BoolArray = (ANGLES > -0.2) & (ANGLES < 0.2)
    ranges[10:60, hand] = 0.12
    mask = learn_self_mask(as_scans(ranges), CHAIR_A)
    assert hidden_share(mask, as_scans(turning()), hand) == 0.0


def test_a_person_who_walks_beside_the_chair_is_not_masked() -> None:
    ranges = turning()
    beside: BoolArray = (ANGLES > -2.1) & (ANGLES < -1.8)
    ranges[:, beside] = 0.7  # beyond the outline and a hand's breadth
    mask = learn_self_mask(as_scans(ranges), CHAIR_A)
    assert hidden_share(mask, as_scans(ranges), beside) == 0.0


def test_beams_below_the_measuring_range_belong_to_the_chair() -> None:
    ranges = turning()
    ranges[:, LEG] = -math.inf
    scans = as_scans(ranges)
    mask = learn_self_mask(scans, CHAIR_A)
    assert hidden_share(mask, scans, LEG) == 1.0


def test_a_knee_moved_beside_its_sector_is_masked_and_the_wall_behind_is_not() -> None:
    mask = SelfMask(begins=(1.0,), ends=(1.2,), reaches=(0.3,), margin=0.1)
    angles = [0.85, 0.95, 1.05, 1.15, 1.25, 1.35]
    near, far = (Scan(0, np.full(6, r, np.float32), angles[0], 0.1) for r in (0.25, 2.0))
    assert mask.hides(near).tolist() == [False, True, True, True, True, False]
    assert mask.hides(far).tolist() == [False, False, True, True, False, False]


@given(beams=st.integers(100, 2000))
def test_a_mask_holds_for_any_number_of_beams(beams: int) -> None:
    mask = SelfMask(begins=(-1.4, 1.5), ends=(-1.3, 2.0), reaches=(0.3, 0.2), margin=0.0)
    step = 4.7 / (beams - 1)
    scan = Scan(0, np.full(beams, 2.0, np.float32), -2.35, step)
    assert mask.hides(scan).sum() * step == pytest.approx(0.6, abs=2 * step)


def test_scans_with_different_numbers_of_beams_give_the_same_mask() -> None:
    scans = as_scans(turning())
    mixed = [
        Scan(s.stamp_ns, s.ranges[::2], s.angle_min, 2 * s.angle_step, range_max=30.0) if k % 3 == 0 else s
        for k, s in enumerate(scans)
    ]
    full, found = learn_self_mask(scans, CHAIR_A), learn_self_mask(mixed, CHAIR_A)
    assert np.abs(np.subtract(full.begins + full.ends, found.begins + found.ends)).max() <= 2 * STEP


def test_a_chair_that_stands_still_gives_no_mask() -> None:
    ranges = turning()
    parked = np.repeat(ranges[:1], 120, axis=0)
    with pytest.raises(ThinData, match="turn the chair a full circle"):
        learn_self_mask(as_scans(parked), CHAIR_A)


def test_too_few_scans_and_a_covered_lidar_are_refused() -> None:
    with pytest.raises(ThinData, match="3 scans are too few"):
        learn_self_mask(as_scans(turning(3)), CHAIR_A)
    ranges = turning()
    ranges[:, ANGLES < 1.5] = 0.1
    with pytest.raises(CalibrationError, match="mount it where it sees more"):
        learn_self_mask(as_scans(ranges), CHAIR_A)
    with pytest.raises(ThinData, match="nothing but the chair"):
        learn_self_mask(as_scans(np.full((120, 471), np.nan)), CHAIR_A)


@pytest.mark.parametrize(
    ("begins", "ends", "reaches"),
    [
        ((1.0,), (0.5,), (0.3,)),
        ((1.0, 0.0), (1.2, 0.2), (0.3, 0.3)),
        ((1.0,), (), (0.3,)),
        ((1.0,), (1.2,), (0.0,)),
        ((math.nan,), (1.2,), (0.3,)),
    ],
)
def test_impossible_sectors_are_refused(
    begins: tuple[float, ...], ends: tuple[float, ...], reaches: tuple[float, ...]
) -> None:
    with pytest.raises(ConfigError, match="self-mask"):
        SelfMask(begins=begins, ends=ends, reaches=reaches)
