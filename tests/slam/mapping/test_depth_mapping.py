"""Pictures beside the scans: the table top, the low box and the stairwell are in the map; bad pictures are counted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from evaluation.scenes.maps.depth_drive import drive_with_pictures, with_hazards
from evaluation.scenes.maps.depth_score import depth_score

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import ConfigError, NoPictures, RecordingError
from waychair.geometry import transform_points
from waychair.maps.depth.depth_scan import DepthSettings
from waychair.maps.folders.depth_layer import drop_offs, load_depth_layer
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import cells_from_points, occupied
from waychair.offline.mapping import Mapping, MappingSettings, map_recording, save_mapping
from waychair.recordings.recording import Recording
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.slam.mapping.depth_mapping import DepthMapping, DepthMappingSettings
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.slam.odometry.tilt import Tilt
from waychair.slam.trajectory_errors import truth_errors
from waychair.types import FloatArray, RgbdFrame, SensorFrame, Trajectory

pytestmark = pytest.mark.skipif(renderer_problem() is not None, reason="this machine cannot render pictures")

Drive = tuple[list[SensorFrame | RgbdFrame], Trajectory]
Change = Callable[[list[RgbdFrame]], list[RgbdFrame]]


def place_of(world: str) -> World:
    """Return a shipped world; the basement has things beside the way that no lidar sees."""
    return with_hazards(load_world(world).without_people(), 0) if world == "basement" else load_world(world)


@cache
def drive(world: str, seconds: float) -> Drive:
    """The first seconds of a mapping drive, with few small pictures."""
    place, messages = place_of(world), list[SensorFrame | RgbdFrame]()
    truth = drive_with_pictures(
        place, place.route(), messages.append, camera_hz=3.0, size=(160, 120), until_ns=round(seconds * 1e9)
    )
    return messages, truth


def recording(drive: Drive, change: Change = lambda pictures: pictures, *, mounted: bool = True) -> Recording:
    frames = tuple(message for message in drive[0] if isinstance(message, SensorFrame))
    pictures = change([message for message in drive[0] if isinstance(message, RgbdFrame)])
    mount = CHAIR_A.base_from_camera if mounted else None
    return Recording(
        Path("drive"), frames, CHAIR_A.base_from_laser, "simulated",
        pictures=lambda: iter(pictures), camera_mount=lambda: mount,
    )  # fmt: skip


def mapped(source: Recording, use: str = "on") -> Mapping:
    depth = DepthMappingSettings(use=use, view=DepthSettings(step=1))
    return map_recording(source, MappingSettings(depth=depth, vision="off"))


def cells_at(mapping: Mapping, truth: Trajectory, points: list[tuple[float, float]]) -> FloatArray:
    map_from_world = truth_errors(mapping.result.trajectory, truth).truth_from_map.inverse()
    return cells_from_points(mapping.grid, transform_points(map_from_world, np.array(points)))


WELL = [(x, y) for x in (4.9, 5.3, 5.7, 6.1) for y in (1.7, 1.9)]


def test_a_stairwell_beside_the_way_is_lethal_in_the_saved_map_and_not_without_depth(tmp_path: Path) -> None:
    taken = drive("stairs", 12.0)
    both, lidar = mapped(recording(taken)), mapped(recording(taken), "off")
    save_mapping(tmp_path, both, MappingSettings())
    grid = load_map(tmp_path)
    layer = load_depth_layer(tmp_path, grid)
    well = tuple(cells_at(both, taken[1], WELL).T)
    assert layer is not None
    assert drop_offs(layer)[well].mean() > 0.7
    assert occupied(grid)[well].mean() > 0.7
    assert not occupied(lidar.grid)[tuple(cells_at(lidar, taken[1], WELL).T)].any()
    assert lidar.depth is None
    assert both.report["depth"]["drop_offs_m2"] > 0.5


def test_the_lidar_maps_the_legs_of_a_table_and_depth_its_top() -> None:
    world, taken = load_world("table"), drive("table", 9.0)
    shown = {}
    for use in ("off", "on"):
        mapping = mapped(recording(taken), use)
        errors = truth_errors(mapping.result.trajectory, taken[1])
        score = depth_score(mapping.grid, world, errors.truth_from_map, taken[1].poses, CHAIR_A)
        shown[use] = score.thing_share
        assert score.overhanging == 1
        assert score.false_cells <= 0.01 * score.cells
    assert shown["off"] < 0.2
    assert shown["on"] > 0.35, "the half that is nearer to the way"


@pytest.mark.nightly
def test_both_sensors_miss_none_of_the_things_beside_the_way_and_the_lidar_all() -> None:
    world, taken, scores = place_of("basement"), drive("basement", 20.0), {}
    for use in ("off", "on"):
        mapping = mapped(recording(taken), use)
        errors = truth_errors(mapping.result.trajectory, taken[1])
        scores[use] = depth_score(mapping.grid, world, errors.truth_from_map, taken[1].poses, CHAIR_A)
    lidar, both = scores["off"], scores["on"]
    things = both.low + both.overhanging
    assert things >= 3
    assert lidar.low_missed + lidar.overhanging_missed == things
    assert both.low_missed + both.overhanging_missed == 0
    assert both.false_cells <= 0.01 * both.cells


def test_depth_alone_makes_a_map_of_the_way() -> None:
    taken = drive("stairs", 12.0)
    mapping = mapped(recording(taken), "only")
    assert truth_errors(mapping.result.trajectory, taken[1]).rmse_m < 0.3
    assert mapping.depth is not None


def test_live_mapping_and_the_recording_give_the_same_grid() -> None:
    taken = drive("stairs", 6.0)
    settings = LiveMappingSettings(depth=DepthMappingSettings(view=DepthSettings(step=1)))
    live = LiveMapping(settings, CHAIR_A.base_from_laser)
    for message in taken[0]:
        if isinstance(message, RgbdFrame):
            live.see(message)
        else:
            live.process(message)
    live.settle()
    mapping = mapped(recording(taken))
    assert live.depth.counts["kept"] > 5
    agree = live.grid().cells.shape == mapping.grid.cells.shape and (live.grid().cells == mapping.grid.cells).mean()
    assert agree > 0.97, "except for a picture near the limit of kept ones"


def late(pictures: list[RgbdFrame]) -> list[RgbdFrame]:
    return [pictures[k ^ 1] if k ^ 1 < len(pictures) else pictures[k] for k in range(len(pictures))]


def without_depth(pictures: list[RgbdFrame]) -> list[RgbdFrame]:
    return [replace(each, depth=np.full_like(each.depth, math.nan)) for each in pictures]


def covered(pictures: list[RgbdFrame]) -> list[RgbdFrame]:
    return [replace(each, depth=np.full_like(each.depth, 0.1)) for each in pictures]


def of_another_day(pictures: list[RgbdFrame]) -> list[RgbdFrame]:
    return [replace(each, stamp_ns=each.stamp_ns + 10**15) for each in pictures]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (late, "not later than the one before"),
        (without_depth, "no depth at all"),
        (covered, "as if it were covered"),
        (of_another_day, "without a scan before and after"),
    ],
)
def test_bad_pictures_are_counted_and_reported_and_leave_the_lidar_map_complete(change: Change, reason: str) -> None:
    taken = drive("stairs", 6.0)
    mapping = mapped(recording(taken, change))
    assert any(reason in warning for warning in mapping.report["warnings"])
    assert any(reason in name for name in mapping.report["depth"]["left_out"])
    lidar = mapped(recording(taken), "off")
    np.testing.assert_array_equal(mapping.result.trajectory.poses, lidar.result.trajectory.poses)
    if mapping.depth is None:
        np.testing.assert_array_equal(mapping.grid.cells, lidar.grid.cells)


def test_pictures_of_a_camera_without_a_mount_are_not_used_and_depth_alone_is_refused() -> None:
    taken = drive("stairs", 6.0)
    mapping = mapped(recording(taken, mounted=False))
    assert any("the camera's mount is unknown" in warning for warning in mapping.report["warnings"])
    with pytest.raises(NoPictures, match="mount"):
        mapped(recording(taken, mounted=False), "only")
    with pytest.raises(NoPictures, match="no depth at all"):
        mapped(recording(taken, without_depth), "only")


def test_unreadable_pictures_change_nothing_else_in_the_map() -> None:
    taken = drive("stairs", 6.0)
    source = recording(taken)

    def broken() -> Iterator[RgbdFrame]:
        yield from list(source.pictures())[:3]
        raise RecordingError("the depth has 3 x 3 pixels")

    mapping = mapped(replace(source, pictures=broken))
    assert any("after 3: the depth has 3 x 3 pixels" in warning for warning in mapping.report["warnings"])
    assert mapping.report["frames"] == len(source.frames)


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(ConfigError, match="on, off or only"):
        DepthMappingSettings(use="maybe")
    with pytest.raises(ConfigError, match="five numbers"):
        DepthMappingSettings(mount=(0.0, 1.0))


def test_the_lean_at_a_picture_is_interpolated_between_imu_samples() -> None:
    mapping = DepthMapping(DepthMappingSettings(), CHAIR_A.base_from_camera, CHAIR_A.front)
    assert mapping.tilt_at(5) == Tilt(5)
    for tilt in (Tilt(10, 0.0, 0.02), None, Tilt(20, 0.04, 0.0), Tilt(15, 9.0, 9.0)):
        mapping.note_tilt(tilt)
    assert mapping.tilt_at(15) == Tilt(15, pytest.approx(0.02), pytest.approx(0.01))
    assert (mapping.tilt_at(1).pitch, mapping.tilt_at(99).roll) == (0.02, 0.04)
