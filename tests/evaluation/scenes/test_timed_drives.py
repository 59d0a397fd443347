"""Drives beside their best: the frames, the ratio, and the figure's summary of several."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.figures.driving.drive_time import _summary
from evaluation.scenes.tight_places import map_of
from evaluation.scenes.timed_drives import MappedWorld, TimedDrive, drives, random_poses
from evaluation.scenes.way_manners import WayManners

from waychair.simulation.plan.floor_plan import FloorPlan, walls_round
from waychair.simulation.plan.world import World, world_from_plan
from waychair.types import OccupancyGrid, Place, Pose2


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep best drives out of the checkout."""
    monkeypatch.chdir(tmp_path)


def _room() -> World:
    """Return a room of 6 by 4 m."""
    walls = walls_round((6.0, 4.0), corner=(0.2, 0.2))
    return world_from_plan(FloorPlan("room", (6.4, 4.4), (1.2, 2.2, 0.0), walls=walls, resolution=0.01), "room")


def _ground() -> MappedWorld:
    """Return the room with a map whose frame is shifted and turned by a quarter, as maps begin where the chair stood."""
    world = _room()
    grid, map_from_world = map_of(world, 0.05), Pose2(2.0, -1.0, math.pi / 2)
    moved = OccupancyGrid(grid.cells, grid.resolution, map_from_world @ grid.map_from_grid)
    return MappedWorld("room", world, moved, map_from_world)


@pytest.mark.nightly
def test_random_poses_are_those_of_their_seed_and_lie_apart() -> None:
    ground = _ground()
    pairs = [random_poses(ground, seed) for seed in (1, 2, 1)]
    assert pairs[0] == pairs[2] != pairs[1]
    for start, goal in pairs:
        assert math.dist((start.x, start.y), (goal.x, goal.y)) >= 3.0
        assert all(0.8 < pose.x < 5.6 and 0.8 < pose.y < 3.6 for pose in (start, goal))


@pytest.mark.nightly
def test_a_drive_ahead_in_a_map_with_a_frame_of_its_own_is_reached_and_no_faster_than_the_best() -> None:
    ground = _ground()
    (found,) = drives(ground, Pose2(1.2, 2.2, 0.0), [Place("ahead", Pose2(4.2, 2.2, 0.0))], 0)
    assert (found.reached, found.contacts, found.no_best) == (True, 0, "")
    assert 3.0 / 0.8 < found.best_s < found.driven_s
    assert found.best_way_m == pytest.approx(3.0, abs=0.01)
    assert found.manners.stops == 0
    (armed,) = drives(ground, Pose2(1.2, 2.2, 0.0), [Place("ahead", Pose2(4.2, 2.2, 0.0))], 0, armed=True)
    assert armed.reached
    assert 1.5 < found.driven_s - armed.driven_s < 2.5, "the board's two seconds at rest"


def _drive(driven: float, best: float, **changes: object) -> TimedDrive:
    manners = WayManners(stops=0, swings=0, turned=1.0, slow_share=0.5, jerk=1.0)
    drive = TimedDrive("room", "goal", True, 0, "", driven, 5.0, best, 5.0, 0.4, "", manners)
    return replace(drive, **changes)  # type: ignore[arg-type]


def test_the_summary_counts_ratios_only_of_drives_that_arrived_and_have_a_best() -> None:
    found = [
        _drive(12.0, 10.0),
        _drive(14.0, 10.0),
        _drive(90.0, 10.0, reached=False),
        _drive(30.0, math.nan, best_way_m=math.nan, best_turned=math.nan, no_best="none"),
    ]
    told = _summary(found)
    assert told["ratio_median"] == pytest.approx(1.3)
    assert (told["drives"], told["reached"], told["without_best"]) == (4, 3, 1)
    assert told["turned_beyond_best_rad"] == pytest.approx(0.6)
    assert np.isnan(_summary(found[2:])["ratio_median"])
