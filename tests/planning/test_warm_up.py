"""After warming up, a chair's first steps load no kernel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waychair.calibration.chair_body import CHAIR_B, BodyLayer
from waychair.maps.depth import ground
from waychair.maps.grid.distance_field import DistanceField, distances
from waychair.planning.body import footprint
from waychair.planning.route import leaving_a_wall as way_out
from waychair.planning.route import multi_point_turn as manoeuvre
from waychair.planning.seen import glass_gaps, obstacle_layer
from waychair.planning.warm_up import warm_up
from waychair.planning.window import dwa_kernels
from waychair.planning.window.dwa import choose
from waychair.types import Path, Pose2, Twist

KERNELS = (
    dwa_kernels.measure,
    dwa_kernels.meetings_with_people,
    dwa_kernels.fits_after,
    footprint.free_time,
    footprint.room,
    manoeuvre._search,
    manoeuvre._distances_to,
    manoeuvre._chain,
    ground._beams,
    ground.follow_ground,
    obstacle_layer.any_nearer,
    obstacle_layer.between_heights,
    obstacle_layer.on_ground,
    obstacle_layer.passed_points,
    glass_gaps._chords,
    way_out._shortest,
)


def test_every_kernel_of_the_local_planners_is_loaded_and_stays_loaded() -> None:
    warm_up()
    before = [len(kernel.signatures) for kernel in KERNELS]
    assert min(before) >= 1
    mask = np.zeros((160, 160), np.bool_)
    mask[[0, -1]], mask[:, [0, -1]] = True, True
    field = DistanceField(distances(mask, 0.025), 0.025)
    path = Path(np.array([[1.0, 2.0, 0.0], [3.0, 2.0, 0.0]]))
    choose(Pose2(1.5, 2.0, 0.0), Twist(0.2, 0.0), path, field, CHAIR_B)
    feet = BodyLayer(0.0, 0.3, 0.5, 0.2, 0.2)
    layered = replace(field, layers=((feet, field.metres),))
    choose(Pose2(1.5, 2.0, 0.0), Twist(0.2, 0.0), path, layered, replace(CHAIR_B, layers=(feet,)))
    warm_up()
    assert [len(kernel.signatures) for kernel in KERNELS] == before, "a chair's own fields need no other kernels"
