"""A chair with delay, and a dead band that swallows small commands, still turns by small angles."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.footprint import along_arc
from waychair.planning.window.dwa import rotate_to_heading
from waychair.planning.window.motion_limits import DwaSettings, GoalTolerances
from waychair.types import Pose2, Twist

OPEN = DistanceField(np.full((300, 300), 5.0, np.float32), 0.02, Pose2(-3.0, -3.0, 0.0))


@pytest.mark.parametrize("off", [0.025, -0.03, 0.05, 0.2])
def test_a_chair_with_delay_and_a_dead_band_makes_small_turns(off: float) -> None:
    limits = DwaSettings(tolerances=GoalTolerances(heading=0.02), reaction_time=0.3)
    pose, command, told = Pose2(), Twist(), [Twist()] * 5
    for _ in range(200):
        choice = rotate_to_heading(pose, command, off, OPEN, CHAIR_A, limits)
        if choice.arrived:
            break
        command = choice.twist
        told = [*told[1:], command]
        felt = told[0].omega if abs(told[0].omega) > 0.09 else 0.0
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, 0.0, felt, 0.05))
    assert choice.arrived
    assert abs(wrap_angle(pose.theta - off)) <= 0.02 + 0.01
