"""A pose kept from the last run is not driven by when the scans contradict it, whether or not the chair moves."""

from __future__ import annotations

import math

import pytest

from tests.runtime.riding import FAR, START, Ride
from waychair.control.drive.navigator import Stage
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import Pose2


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "kept",
    [Pose2(9.5, 3.9, 2.2), Pose2(6.0, 2.5, 1.2), Pose2(2.0, 2.5, 1.5)],
    ids=["other end", "middle", "turned on the spot"],
)
def test_a_kept_pose_that_the_scans_contradict_is_not_ready_and_no_drive_begins(kept: Pose2) -> None:
    with Ride() as ride:
        ride.chair.relocalise(kept)
        for state in (ride.tick() for _ in range(12)):
            assert not ride.chair.ready or state.localisation is None
        ride.chair.go(FAR)
        ride.chair.confirm()
        state = ride.tick(60)
        assert state.navigation.stage is Stage.FAILED
        assert state.localisation is not None
        assert state.localisation.state is LocalisationState.LOST
        (named,) = state.halts
        assert named.stop.id == "unplaced"
        assert "may have been moved while it was switched off" in named.text
        assert ride.stands


def test_it_looks_over_the_whole_map_while_it_stands_and_shows_the_places_where_it_may_be() -> None:
    with Ride() as ride:
        ride.chair.relocalise(Pose2(9.5, 3.9, 2.2))
        state = ride.tick(20)
        assert state.localisation is not None
        near = [math.hypot(c.pose.x - START.x, c.pose.y - START.y) for c in state.localisation.candidates]
        assert min(near) < 0.3


def test_the_rider_may_set_the_right_pose_instead() -> None:
    with Ride() as ride:
        ride.chair.relocalise(Pose2(9.5, 3.9, 2.2))
        ride.tick(12)
        assert not ride.chair.ready
        ride.chair.relocalise(Pose2(START.x + 0.3, START.y - 0.2, 0.1))
        ride.tick(4)
        assert ride.chair.ready


def test_a_kept_pose_that_is_a_little_off_is_corrected_and_ready() -> None:
    with Ride() as ride:
        ride.chair.relocalise(Pose2(START.x - 0.4, START.y + 0.2, -0.15))
        state = ride.tick(12)
        assert ride.chair.ready
        assert math.hypot(state.map_from_base.x - START.x, state.map_from_base.y - START.y) < 0.05
