"""A simulated chair masks its rider's legs, and few other beams."""

from __future__ import annotations

import pytest
from evaluation.scenes.maps.mask_score import score_mask

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.calibration.fits.self_mask import learn_self_mask
from waychair.simulation.plan.world import load_world
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.slam.scan.scan_points import scan_points
from waychair.trials.open_hall import open_hall
from waychair.trials.simulated_calibration import MASK_HALL, scans_while_turning, with_legs


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("body", "seed"), [(CHAIR_A, 0), (CHAIR_A, 1), (CHAIR_B, 2)])
def test_beams_on_legs_are_masked_and_few_others(body: ChairBody, seed: int) -> None:
    settings = with_legs(SimulatorSettings())
    learnt = scans_while_turning(Simulator(open_hall(MASK_HALL, 0.05), body, settings, seed))
    mask = learn_self_mask(learnt, body)
    elsewhere = Simulator(load_world("second_floor").without_people(), body, settings, seed + 100)
    fresh = scans_while_turning(elsewhere, 1.0) if seed == 0 else learnt
    score = score_mask(mask, fresh, elsewhere)
    assert score.leg_hits > 10_000
    assert score.leg_hits_left == 0
    assert score.others_lost < 0.02
    near = min(float((points**2).sum(axis=1).min()) for points in (
        scan_points(scan, body.base_from_laser, 20.0, mask=mask).points - (body.laser_x, body.laser_y) for scan in fresh
    ))  # fmt: skip
    assert near**0.5 > 0.3


def test_without_legs_nothing_is_masked() -> None:
    simulator = Simulator(open_hall(MASK_HALL, 0.05), CHAIR_A, SimulatorSettings(), 3)
    assert learn_self_mask(scans_while_turning(simulator), CHAIR_A).begins == ()
