"""A lidar that tilts with the chair: 3D rays against plain geometry, and against the planar lidar."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import in_space
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.scene.scene import Block, Pit, Slope
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.rays import scenery_from_slice
from waychair.simulation.sensors.tilted_rays import (
    FLOOR,
    NOTHING,
    Terrain,
    nearest_face,
    row_from_pose,
    terrain_from_world,
)
from waychair.types import FloatArray, Pose2, Pose3

QUIET = LidarSettings(sigma=0.0, faults=False, beams=181)


def ramp_world() -> World:
    return load_world("ramp")


def terrain() -> Terrain:
    made = terrain_from_world(ramp_world())
    assert made is not None
    return made


def pitched(pose: Pose2, height: float, pitch: float) -> Pose3:
    """A base that leans nose down by `pitch` [rad]."""
    c, s = math.cos(pitch), math.sin(pitch)
    nose_down = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return Pose3(in_space(pose).rotation @ nose_down, np.array([pose.x, pose.y, height]))


def ranges(made: Terrain, base: Pose3) -> FloatArray:
    """Return the readings of a perfect lidar from there."""
    lidar = Lidar(QUIET, CHAIR_A, np.random.default_rng(0))
    scan = lidar.scan_in_space(made, np.array([0]), row_from_pose(base)[None], 0)
    return scan.ranges.astype(np.float64)


def test_levels_without_ramps_use_the_planar_lidar() -> None:
    assert terrain_from_world(load_world("corridor_t")) is None


@pytest.mark.parametrize("pose", [Pose2(1.0, 1.8, 0.0), Pose2(15.0, 4.0, 2.0), Pose2(8.0, 4.2, -1.0)])
def test_a_level_chair_has_the_same_scan_as_in_the_plane(pose: Pose2) -> None:
    world = ramp_world()
    lidar = Lidar(QUIET, CHAIR_A, np.random.default_rng(0))
    plane = lidar.scan_at_rest(scenery_from_slice(slice_at(world.blocks, CHAIR_A.laser_z)), pose, 0).ranges
    assert ranges(terrain(), in_space(pose)) == pytest.approx(plane, abs=1e-5)


def test_down_a_ramp_the_beams_end_on_the_floor_beyond_its_foot() -> None:
    slope = math.atan2(0.25, 3.0)
    ahead = ranges(terrain(), pitched(Pose2(11.0, 1.8, 0.0), 0.125, slope))[90]
    # from 0.3 m above the ramp, parallel to it, past the foot at x = 12.5, down to the floor
    laser = np.array([11.0, 0.125]) + 0.60 * np.array([math.cos(slope), -math.sin(slope)])
    laser += 0.30 * np.array([math.sin(slope), math.cos(slope)])
    assert ahead == pytest.approx(laser[1] / math.sin(slope), abs=1e-4)
    assert ahead == pytest.approx((12.5 - 11.6) + 3.6, abs=0.1)


def test_up_a_ramp_the_beams_run_along_it_to_the_far_wall() -> None:
    slope = -math.atan2(0.25, 3.0)
    ahead = ranges(terrain(), pitched(Pose2(5.5, 1.8, 0.0), 1.0 / 12.0, slope))[90]
    assert ahead == pytest.approx((17.0 - 0.05 - 6.1) / math.cos(slope), abs=0.1)


def test_from_level_ground_only_a_ramp_as_high_as_the_lidar_is_seen() -> None:
    world = ramp_world()
    high = Slope(Pose2(8.0, 1.8, 0.0), 6.0, 1.8, 0.0, 0.5)
    made = terrain_from_world(replace(world, slopes=(high,)))
    assert made is not None
    start = in_space(Pose2(2.0, 1.8, 0.0))
    assert ranges(made, start)[90] == pytest.approx(5.0 + 3.6 - 2.6, abs=1e-4)  # 3.6 m beyond its foot
    assert ranges(terrain(), start)[90] > 14.0


def _plainly(made: Terrain, start: FloatArray, ahead: FloatArray, reach: float) -> float:
    """Return the point at which a ray meets an obstacle, by small steps; to 2 mm."""
    for distance in np.arange(0.0, reach, 0.002):
        x, y, z = start + distance * ahead
        if z > made.ceiling or (z < 0.0 and not any(_inside_outline(pit, x, y) for pit in made.pits)):
            return float(distance)
        for solid in made.solids:
            u = solid[2] * (x - solid[0]) + solid[3] * (y - solid[1])
            if _inside_outline(solid, x, y) and solid[6] <= z <= solid[7] + solid[8] * u:
                return float(distance)
    return math.inf


def _inside_outline(row: FloatArray, x: float, y: float) -> bool:
    u, v = row[2] * (x - row[0]) + row[3] * (y - row[1]), row[2] * (y - row[1]) - row[3] * (x - row[0])
    return bool(abs(u) <= row[4] and abs(v) <= row[5])


@pytest.mark.nightly
def test_rays_meet_the_same_obstacles_as_small_steps_along_them() -> None:
    rng = np.random.default_rng(5)
    blocks = tuple(
        Block(Pose2(*rng.uniform(-4, 4, 2), rng.uniform(-3, 3)), *rng.uniform(0.3, 1.5, 2), low, low + 0.6)
        for low in (0.0, 0.0, 0.4, 0.9)
    )
    slopes = (Slope(Pose2(2.0, -2.0, 1.0), 3.0, 1.5, 0.0, 0.7), Slope(Pose2(-3.0, 2.0, -0.5), 2.0, 1.0, 0.5, 0.1))
    pit = Pit(Pose2(-2.0, -3.0, 0.0), 1.0, 1.0, 0.5)
    made = terrain_from_world(replace(ramp_world(), blocks=blocks, slopes=slopes, pits=(pit,)))
    assert made is not None
    hits = set()
    for _ in range(60):
        start = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(0.75, 0.85)])
        heading, dip = rng.uniform(-math.pi, math.pi), rng.uniform(-0.25, 0.15)
        ahead = np.array([math.cos(heading) * math.cos(dip), math.sin(heading) * math.cos(dip), math.sin(dip)])
        expected = _plainly(made, start, ahead, 6.0)
        distance, hit, *normal = nearest_face(made, *start, *ahead, 0.0, 6.0)
        hits.add(hit)
        if math.isinf(expected):
            assert hit == NOTHING or distance > 5.99
        else:
            assert distance == pytest.approx(expected, abs=0.0025)
            assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert FLOOR in hits
    assert len(hits) > 4
