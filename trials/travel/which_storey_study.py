"""Simulated rides in which only the storey is to be found out: right by itself, asked, or wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.journey.door_view import beams_through
from waychair.control.journey.lift_site import stand_in
from waychair.control.journey.ride_motion import RideMotion
from waychair.control.journey.which_storey import StopEvidence, decided, probabilities, seen_through_door
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.lifts.ride_profile import ride_profile
from waychair.simulation.plan.world import World
from waychair.simulation.plant.plant import GRAVITY
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.imu import Imu, ImuSettings
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.rays import Scenery, scenery_from_slice
from waychair.topics import IMU
from waychair.trials.travel.journeys import sites_of
from waychair.types import FloatArray, Pose2, Scan

REST_S, DOORS_S = 4.0, (3.0, 12.0)
"""s; rest before and after a ride, and the least and longest stay with a closed door."""

ELSEWHERE = 0.2
"""Share of the rides that end at another stop than the one asked for."""

PEOPLE = 3
"""Largest number of people before the door; the scan shows nothing behind them."""


@dataclass(frozen=True, slots=True)
class RideDecision:
    """A ride: where it began, the stop asked for, the true one, and the one decided on; None: the rider is asked."""

    lift: str
    began: str
    asked: str
    true: str
    decided: str | None


def rides(
    levels: Sequence[World], count: int, seed: int = 0, *, imu: bool = True, see: bool = True
) -> list[RideDecision]:
    """Return rides between random stops; `imu`, `see`: the chair has an IMU, and its lidar sees through the open door."""
    lifts = Lifts(levels)
    sites = {(site.lift, site.storey): site for site in sites_of(lifts, CHAIR_A)}
    sceneries = {
        world.level: scenery_from_slice(slice_at(world.blocks, CHAIR_A.laser_z)) for world in levels
    }  # their lifts' doors are open
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        lift = str(rng.choice(list(lifts.lifts)))
        stops = lifts.lifts[lift].stops
        began, asked = (str(each) for each in rng.choice(stops, 2, replace=False))
        others = [stop for stop in stops if stop not in (began, asked)]
        true = str(rng.choice(others)) if others and rng.random() < ELSEWHERE else asked
        climb = _felt(lifts.heights[true] - lifts.heights[began], seed * 100_000 + number) if imu else None
        match = {}
        if see:
            site = sites[lift, true]
            jitter = Pose2(*rng.normal(0.0, (0.03, 0.03, 0.01)))
            stand = stand_in(site, CHAIR_A)
            scan = _scan(sceneries[true], site.cabin @ stand @ jitter, site.door, rng)
            angles, ranges = beams_through(scan, stand @ CHAIR_A.base_from_laser, site)
            match = {
                stop: seen_through_door(
                    lifts.levels[stop].grid, sites[lift, stop].cabin @ stand @ CHAIR_A.base_from_laser, angles, ranges
                )
                for stop in stops
            }
        heights = {stop: lifts.heights[stop] for stop in stops}
        chances = probabilities(StopEvidence(heights, began, asked, climb=climb, match=match))
        found.append(RideDecision(lift, began, asked, true, decided(chances)))
    return found


def _felt(height: float, seed: int) -> tuple[float, float] | None:
    """Return the climb and its deviation that a chair's IMU measures of a ride."""
    rng = np.random.default_rng(seed)
    sensor, motion = Imu(replace(ImuSettings(), rate_hz=IMU.rate_hz), rng), RideMotion()
    profile, now_ns = ride_profile(height), 0
    step_ns = round(1e9 / IMU.rate_hz)
    before = REST_S + rng.uniform(*DOORS_S)
    for k in range(round((before + profile.seconds + REST_S) * IMU.rate_hz)):
        now_ns += step_ns
        up = GRAVITY + profile.at(k / IMU.rate_hz - before)[2]
        motion.hear(sensor.sample(now_ns, np.array([0.0, 0.0, up]), np.zeros(3)))
        if k == round(REST_S * IMU.rate_hz):
            motion.begin()
    return motion.climb()


def _scan(scenery: Scenery, map_from_base: Pose2, door: Pose2, rng: np.random.Generator) -> Scan:
    """Return a scan out of the open door, past people in the hall."""
    people = [
        (*_spot(door, float(rng.uniform(1.0, 4.0)), float(rng.uniform(-2.0, 2.0))), 0.15)
        for _ in range(int(rng.integers(PEOPLE + 1)))
    ]
    circles: FloatArray = np.array(people).reshape(-1, 3)
    return Lidar(LidarSettings(), CHAIR_A, rng).scan_at_rest(scenery, map_from_base, 0, circles)


def _spot(door: Pose2, ahead: float, aside: float) -> tuple[float, float]:
    spot = door @ Pose2(ahead, aside)
    return spot.x, spot.y


def counts(found: Sequence[RideDecision]) -> dict[str, int]:
    """Return how many rides were right by itself, asked about, and wrong."""
    return {
        "rides": len(found),
        "right": sum(each.decided == each.true for each in found),
        "asked": sum(each.decided is None for each in found),
        "wrong": sum(each.decided not in (None, each.true) for each in found),
    }


def alike_counts(found: Sequence[RideDecision], alike: Sequence[str]) -> dict[str, int]:
    """Return the counts of the rides that truly ended on one of the storeys that look alike."""
    return counts([each for each in found if each.true in alike])
