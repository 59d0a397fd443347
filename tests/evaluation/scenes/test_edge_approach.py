"""Drop-offs are in the grid before the wheels reach them."""

from __future__ import annotations

import numpy as np
import pytest
from evaluation.scenes.hazards import DROP_OFFS
from evaluation.scenes.maps.edge_approach import approach_edge

from waychair.simulation.sensors.renderer import renderer_problem

pytestmark = pytest.mark.skipif(renderer_problem() is not None, reason=f"no camera: {renderer_problem()}")


@pytest.mark.parametrize("where", DROP_OFFS)
@pytest.mark.nightly
def test_an_edge_is_in_the_grid_before_the_wheels_are_near_it(where: str) -> None:
    drive = approach_edge(where, seed=int(np.random.default_rng(len(where)).integers(1000)))
    assert drive.known == drive.points > 15
    assert drive.nearest_m < 0.3


def test_a_lidar_alone_maps_no_edge() -> None:
    assert approach_edge("ahead", seed=3, camera=False).known == 0
