"""The chair's own footrests or the rider's legs in the lidar's view, without a self-mask, are named as such."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.riding import FAR, Ride
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.self_mask import SelfMask, outline_reach
from waychair.control.drive.navigator import Stage
from waychair.control.safety.own_parts import OwnParts
from waychair.runtime.drive_base import ChairMessage
from waychair.types import FloatArray, JoystickInput, Pose2, Scan

ANGLES = np.linspace(-2.0, 2.0, 401)
STEP = float(ANGLES[1] - ANGLES[0])


def footrests(beyond: float) -> Callable[[tuple[ChairMessage, ...]], tuple[ChairMessage, ...]]:
    """Let the beams at 15 to 22 degrees on both sides end this far [m] beyond the outline."""

    def change(message: ChairMessage) -> ChairMessage:
        if not isinstance(message, Scan):
            return message
        angles = message.angles()
        blocked = (np.abs(angles) > math.radians(15.0)) & (np.abs(angles) < math.radians(22.0))
        edge = outline_reach(angles, CHAIR_A, beyond).astype(np.float32)
        return replace(message, ranges=np.where(blocked, edge, message.ranges))

    return lambda messages: tuple(map(change, messages))


def stops(ride: Ride) -> set[str]:
    return {halted.stop.id for halted in ride.states[-1].halts}


def test_footrests_within_the_outline_refuse_the_drive_and_offer_the_mask() -> None:
    with Ride() as ride:
        ride.change = footrests(-0.03)
        ride.tick(50)
        assert not ride.chair.ready
        ride.chair.go(FAR)
        ride.chair.confirm()
        state = ride.tick(2)
        assert state.navigation.stage is Stage.FAILED
        (named,) = state.halts
        assert named.stop.id == "own_parts"
        assert "`waychair calibrate mask`" in named.text
        assert "on the right and the left" in named.text or "on the left and the right" in named.text


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("beyond", "stop_ids"), [(0.02, {"near_parts_stay", "own_parts"}), (0.05, {"own_parts"})])
def test_footrests_just_outside_it_are_told_of_while_the_drive_waits_and_proven_by_the_first_motion(
    beyond: float, stop_ids: set[str]
) -> None:
    with Ride() as ride:
        ride.change = footrests(beyond)
        start = ride.simulator.truth()
        ride.tick(10)
        ride.chair.go(FAR)
        ride.chair.confirm()
        told = None
        for k in range(500):  # what stays is told of after 15 s
            state = ride.tick()
            told = k if told is None and "near_parts" in stops(ride) else told
            if not state.verdict.computer_drives:
                break
        assert told is not None
        assert told < 60
        assert state.verdict.halt is not None
        assert state.verdict.halt.stop.id in stop_ids
        assert "`waychair calibrate mask`" in state.verdict.reason
        there = ride.simulator.truth()
        assert math.hypot(there.x - start.x, there.y - start.y) < 0.4
        # pushed away by hand, as for any other cause, the chair knows them for its own
        ride.simulator.rider = JoystickInput(0, 0.6, 0.0)
        ride.tick(60)
        assert (stops(ride), ride.chair.ready) == ({"own_parts"}, False)


def test_masked_footrests_are_not_told_of() -> None:
    edges = [math.radians(degrees) for degrees in (-24.0, -13.0, 13.0, 24.0)]
    mask = SelfMask((edges[0], edges[2]), (edges[1], edges[3]), (0.4, 0.4))
    own = OwnParts(CHAIR_A)
    for k in range(60):
        scan = scan_of(np.full(401, 3.0), 0.1 * k)
        blocked = (np.abs(ANGLES) > math.radians(15.0)) & (np.abs(ANGLES) < math.radians(22.0))
        edge = outline_reach(ANGLES, CHAIR_A, -0.06)
        scan = replace(scan, ranges=np.where(blocked, edge, scan.ranges).astype(np.float32))
        own.see(mask.applied(scan), Pose2(0.02 * k))
    assert own.halts(0, waits=True) == ()


def scan_of(ranges: FloatArray, seconds: float) -> Scan:
    return Scan(round(1e9 * seconds), ranges.astype(np.float32), float(ANGLES[0]), STEP, 0.0, 0.05, 25.0)


def ranges_to(walls: tuple[float, ...], posts: tuple[tuple[float, float, float], ...], base: Pose2) -> FloatArray:
    """Return the ranges from the lidar at a pose to walls y = const and to discs (x, y, radius)."""
    eye = base @ CHAIR_A.base_from_laser
    c, s = np.cos(ANGLES + eye.theta), np.sin(ANGLES + eye.theta)
    ranges = np.full(len(ANGLES), 20.0)
    with np.errstate(divide="ignore"):
        for y in walls:
            along = (y - eye.y) / s
            ranges = np.minimum(ranges, np.where(along > 0.0, along, np.inf))
    for x, y, radius in posts:
        ahead = (x - eye.x) * c + (y - eye.y) * s
        off = np.abs((x - eye.x) * s - (y - eye.y) * c)
        hit = (off < radius) & (ahead > 0.0)
        ranges = np.where(hit, np.minimum(ranges, ahead - np.sqrt(np.maximum(radius**2 - off**2, 0.0))), ranges)
    return ranges


@pytest.mark.parametrize(
    ("walls", "posts"),
    [
        ((-0.40, 1.5), ()),
        ((-0.36, 0.36), ()),
        ((2.0,), tuple((0.4 * k, 0.42, 0.05) for k in range(40))),
        ((2.0,), ((1.2, 0.40, 0.06), (2.0, -0.40, 0.06))),
    ],
    ids=["along a wall", "through a narrow corridor", "past a row of posts", "between two posts"],
)
def test_walls_and_posts_that_the_chair_passes_are_not_taken_for_its_own(
    walls: tuple[float, ...], posts: tuple[tuple[float, float, float], ...]
) -> None:
    own, noise = OwnParts(CHAIR_A), np.random.default_rng(3)
    for k in range(80):
        pose = Pose2(0.04 * k)
        own.see(scan_of(ranges_to(walls, posts, pose) + noise.normal(0.0, 0.01, 401), 0.1 * k), pose)
        assert "own_parts" not in {halted.stop.id for halted in own.halts(0, waits=True)}


def test_a_post_close_ahead_of_a_standing_chair_is_not_called_its_own() -> None:
    own = OwnParts(CHAIR_A)
    for k in range(60):
        own.see(scan_of(ranges_to((), ((CHAIR_A.front + 0.10, 0.1, 0.05),), Pose2()), 0.1 * k), Pose2())
    assert {halted.stop.id for halted in own.halts(0, waits=True)} == {"near_parts"}
    assert own.halts(0, waits=False) == ()


def test_a_bag_that_hangs_beside_the_chair_is_found_while_it_turns() -> None:
    own = OwnParts(CHAIR_A)
    for k in range(40):
        pose = Pose2(0.0, 0.0, 0.03 * k)
        ranges = np.full(401, 2.0 + 0.5 * math.sin(0.2 * k))
        ranges[250:262] = outline_reach(ANGLES, CHAIR_A, 0.08)[250:262]
        own.see(scan_of(ranges, 0.1 * k), pose)
    assert [halted.stop.id for halted in own.halts(0, waits=False)] == ["own_parts"]
