"""The obstacles of the local planner: walls, zones, and all sensors, now and a moment ago."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tests.maps.depth_rooms import picture
from waychair.calibration.chair_body import CHAIR_A, BodyLayer, sonar_mounts
from waychair.control.drive.local_obstacles import Surroundings, SurroundingsSettings, without_mixed_pixels
from waychair.maps.drawn.zones import Rule, Zone
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import DROP_OFF
from waychair.planning.body.footprint import fits
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.slam.odometry.tilt import Tilt
from waychair.types import FloatArray, OccupancyGrid, Pose2, RgbdFrame, SonarReadings

SECOND = 10**9
HERE = Pose2(4.0, 3.0, 0.0)
LASER = (HERE @ CHAIR_A.base_from_laser).array()[:2]


def hall() -> OccupancyGrid:
    cells = np.zeros((120, 160), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    return OccupancyGrid(cells, 0.05)


def around(*zones: Zone) -> Surroundings:
    return Surroundings(DrawnMap(hall(), CHAIR_A, zones), CHAIR_A, SurroundingsSettings())


def wall_behind(extent: float = 0.6) -> FloatArray:
    """The east wall of the hall, as the lidar sees it every quarter of a degree."""
    return np.stack([np.full(400, 7.97), LASER[1] + np.linspace(-extent, extent, 400)], axis=-1)


def someone(x: float) -> FloatArray:
    return np.stack([np.full(9, x), np.linspace(2.9, 3.1, 9)], axis=-1)


def echoes(stamp_ns: int, ahead: float) -> SonarReadings:
    """Readings of eight sonars; only the first, on the left in front, may have an echo."""
    return SonarReadings(stamp_ns, np.array([ahead, *[np.inf] * 7], np.float32))


def at(field: DistanceField, x: float, y: float) -> float:
    column, row = ((p - o) / field.resolution for p, o in zip((x, y), field.map_from_grid.array()[:2], strict=True))
    return float(field.metres[int(row), int(column)])


def news(seen: Surroundings) -> FloatArray:
    """Return all seen points that the map does not explain."""
    return np.concatenate([seen.full_height(), *(points for _, points in seen.layered())])


def test_the_window_holds_walls_keep_out_zones_and_seen_obstacles() -> None:
    square = np.array([[5.0, 4.0], [5.5, 4.0], [5.5, 4.5], [5.0, 4.5]])
    seen = around(Zone("stairs", Rule.KEEP_OUT, square))
    seen.see(0, HERE, someone(6.0))
    window = seen.window(HERE)
    assert at(window, 5.25, 4.25) == at(window, 6.0, 3.0) == at(window, 0.02, 3.0) == 0.0
    assert at(window, 4.0, 3.0) > 1.0


def test_a_wall_of_the_map_is_explained_and_a_person_in_front_of_it_is_not() -> None:
    seen = around()
    seen.see(0, HERE, wall_behind())
    assert len(news(seen)) == 0
    seen.see(SECOND, HERE, np.concatenate([wall_behind(), someone(6.0)]))
    assert news(seen)[:, 0].tolist() == pytest.approx([6.0] * len(news(seen)))
    assert len(news(seen)) >= 8


def test_a_person_who_left_is_cleared_when_the_wall_behind_is_seen() -> None:
    seen = around()
    seen.see(0, HERE, someone(6.0))
    seen.see(SECOND // 10, HERE, wall_behind())
    assert len(news(seen)) == 0
    assert at(seen.window(HERE), 6.0, 3.0) > 0.5


def test_beams_without_a_return_clear_too_when_they_are_given() -> None:
    seen = around()
    seen.see(0, HERE, someone(6.0))
    seen.see(1, HERE, np.empty((0, 2)))
    assert len(news(seen)) > 0
    seen.see(2, HERE, np.empty((0, 2)), beyond=wall_behind() - (0.5, 0.0))
    assert len(news(seen)) == 0


def test_obstacles_out_of_sight_are_remembered_and_then_forgotten() -> None:
    seen = around()
    seen.see(0, HERE, someone(6.0))
    for k in range(1, 5):
        seen.see(k * SECOND, Pose2(4.0, 3.0, math.pi), np.array([[0.03, 3.0]]))
        assert at(seen.window(HERE), 6.0, 3.0) == 0.0
    seen.see(6 * SECOND, Pose2(4.0, 3.0, math.pi), np.array([[0.03, 3.0]]))
    assert at(seen.window(HERE), 6.0, 3.0) > 0.5


def test_what_has_stood_is_known_to_the_guard_for_a_while_out_of_sight_and_people_who_walk_are_not() -> None:
    seen = around()
    seen.set_personal_space(np.empty((0, 2)), np.array([[5.5, 3.0]]))
    seen.see(0, HERE, np.concatenate([someone(5.5), someone(6.5) + np.array([0.0, 1.0])]))
    for seconds in (8, 19):
        seen.see(seconds * SECOND, HERE, np.empty((0, 2)))
        assert seen.stood()[:, 0].tolist() == pytest.approx([6.5] * len(seen.stood()))
        assert len(seen.stood()) > 3
    seen.see(21 * SECOND, HERE, np.empty((0, 2)))
    assert len(seen.stood()) == 0
    seen.see(22 * SECOND, HERE, someone(6.5))
    seen.see(23 * SECOND, HERE, wall_behind())
    assert len(seen.stood()) == 0, "the lidar looks through the place"
    seen.see(24 * SECOND, HERE, someone(6.5))
    seen.redraw(DrawnMap(hall(), CHAIR_A))
    assert len(seen.stood()) == 0, "another storey's map has other places"


def test_glass_heard_by_a_sonar_is_not_cleared_by_the_lidar_that_looks_through_it() -> None:
    seen = around()
    seen.hear(echoes(0, 1.0), HERE)
    for k in range(5):
        seen.see(k, HERE, wall_behind())
    ahead = HERE @ sonar_mounts(CHAIR_A)[0] @ Pose2(1.0, 0.0, 0.0)
    assert at(seen.window(HERE), ahead.x, ahead.y) < 0.05
    assert len(seen.full_height()) > 5
    np.testing.assert_array_equal(seen.unscanned(), seen.full_height())
    seen.hear(echoes(9, np.inf), HERE)
    assert len(seen.full_height()) == 0


def test_an_echo_from_a_wall_of_the_map_or_a_lidar_obstacle_adds_nothing() -> None:
    seen, near_wall = around(), Pose2(6.6, 3.0, 0.0)
    seen.hear(echoes(0, 7.95 - 6.6 - CHAIR_A.front), near_wall)
    assert len(seen.full_height()) == 0
    seen.see(0, HERE, someone(6.0))
    seen.hear(echoes(1, 6.0 - HERE.x - CHAIR_A.front), HERE)
    assert len(seen.unscanned()) == 0


@pytest.mark.parametrize("stands_out", [0.10, 0.13, 0.20])
def test_the_chair_keeps_clear_of_a_shelf_on_a_mapped_wall_that_only_the_camera_sees(stands_out: float) -> None:
    """The chair passes so near to the wall that it would brush the shelf."""
    shelf, wall = (1.3, 1.8), hall()
    wall.cells[:20] = 100  # its face at y = 1.0
    seen = Surroundings(DrawnMap(wall, CHAIR_A), CHAIR_A, SurroundingsSettings())
    pose = Pose2(3.0, 1.0 + CHAIR_A.width / 2 + 0.06, 0.0)
    face = 1.0 - pose.y
    boxes = [(*shelf, face, face + stands_out, 0.65, 0.72), (-1.0, 5.0, face - 0.1, face, 0.0, 2.0)]
    for _ in range(3):
        seen.look(picture(boxes), pose)
    there = Pose2(pose.x + shelf[0] - CHAIR_A.front + 0.2, pose.y, 0.0)
    assert len(seen.unscanned()) > 5
    assert not fits(CHAIR_A, 0.0, seen.window(there), there)
    np.testing.assert_array_less(pose.x + shelf[0] - 0.05, seen.unscanned()[:, 0], "the wall itself is no news")


def test_a_person_who_comes_out_of_a_keep_out_zone_is_tracked_like_any_other() -> None:
    square = np.array([[5.0, 2.0], [7.0, 2.0], [7.0, 4.0], [5.0, 4.0]])
    seen = around(Zone("stairs", Rule.KEEP_OUT, square))
    assert seen.is_unmapped(someone(6.0)).sum() == 9
    assert seen.is_unmapped(wall_behind()).sum() == 0


def test_returns_from_glass_inside_of_a_drawn_zone_are_not_a_person() -> None:
    pane = np.array([[5.9, 1.0], [6.2, 1.0], [6.2, 5.0], [5.9, 5.0]])
    seen = around(Zone("glass", Rule.KEEP_OUT, pane))
    assert seen.is_unmapped(someone(6.05)).sum() == 0
    assert seen.is_unmapped(someone(5.5)).sum() == 9
    assert not DrawnMap(hall(), CHAIR_A, [Zone("glass", Rule.KEEP_OUT, pane)]).is_mapped(someone(6.05), 0.1).any()


def floor(edge: float, depth: float, slope: float = 0.0) -> RgbdFrame:
    """Return the depth image of chair A's camera on a floor that drops by `depth` [m], or slopes down, at x = `edge`
    [m]."""
    f = 465.0
    camera = np.array([[f, 0.0, 320.0], [0.0, f, 240.0], [0.0, 0.0, 1.0]])
    mount = CHAIR_A.base_from_camera
    rows, columns = np.indices((480, 640))
    rays = np.stack([(columns - 320) / f, (rows - 240) / f, np.ones(rows.shape)], axis=-1) @ mount.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = -mount.translation[2] / rays[..., 2]
        beyond = mount.translation[0] + ends * rays[..., 0] > edge
        # z = -slope (x - edge) - depth
        lower = (mount.translation[2] + slope * (mount.translation[0] - edge) + depth) / (
            -rays[..., 2] - slope * rays[..., 0]
        )
    ranges = np.where(beyond, lower, ends)
    ranges = np.where((ranges > 0.3) & (ranges < 8.0), ranges, np.nan)  # the ray's z is 1 in the camera
    noise = np.random.default_rng(0).standard_normal(ranges.shape)
    return RgbdFrame(
        0, np.zeros((480, 640), np.uint8), (ranges + 0.0012 * ranges**2 * noise).astype(np.float32), camera
    )


@pytest.mark.parametrize("edge", [2.3, 3.2, pytest.param(2.7, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("depth", [0.12, 1.0, pytest.param(0.17, marks=pytest.mark.nightly)])
def test_a_drop_off_is_an_obstacle_from_its_edge_on_and_stays_one_out_of_sight(edge: float, depth: float) -> None:
    seen = around()
    seen.look(floor(edge, depth), HERE)
    margin = DROP_OFF
    found = seen.unscanned()[:, 0] - HERE.x
    assert len(found) > 20
    assert edge - 0.25 < np.quantile(found, 0.01) + margin <= edge + 0.03
    assert at(seen.window(HERE), HERE.x + edge + 0.02, 3.0) < 0.05
    for k in range(1, 60):
        seen.look(floor(1.0, depth), Pose2(HERE.x + edge - 1.0, HERE.y, 0.0))  # the edge is below the picture now
        seen.see(k * SECOND, HERE, wall_behind())
    assert len(seen.unscanned()) > 10


def test_expected_floor_counts_as_missing_until_it_is_seen() -> None:
    frame = floor(20.0, 0.0)
    dark = dataclasses.replace(frame, depth=frame.depth.copy())
    dark.depth[330:420, 200:440] = np.nan
    seen = around()
    seen.look(frame, HERE)
    assert len(seen.unscanned()) == 0
    seen.look(dark, HERE)
    assert len(seen.unscanned()) > 20
    seen.look(frame, HERE)
    assert len(seen.unscanned()) == 0


@pytest.mark.parametrize("slope", [0.0, 1 / 20, 1 / 12, -1 / 20, -1 / 12])
def test_a_level_floor_and_ramps_down_and_up_are_neither_drop_offs_nor_obstacles(slope: float) -> None:
    seen = around()
    for k in range(5):
        seen.look(floor(2.5 - 0.3 * k, 0.0, slope), Pose2(4.0 + 0.3 * k, 3.0, 0.0))
    assert len(seen.unscanned()) == len(news(seen)) == 0


@pytest.mark.parametrize("pitch", [-0.15, 0.15])
def test_a_chair_that_leans_more_than_any_ramp_sees_a_level_floor_if_the_lean_is_known(
    pitch: float,
) -> None:
    lean, seen, misled = Tilt(0, 0.0, pitch), around(), around()
    seen.look(picture(tilt=lean), HERE, lean.level_from_base())
    misled.look(picture(tilt=lean), HERE)
    assert len(seen.unscanned()) == 0
    assert len(misled.unscanned()) > 10


def test_a_board_at_the_height_of_the_arm_rests_counts_for_that_layer_only() -> None:
    layers = (BodyLayer(0.0, 0.5, 0.75, 0.25, 0.25), BodyLayer(0.5, 1.4, 0.7, 0.25, 0.3))
    body = dataclasses.replace(CHAIR_A, camera_y=0.0, camera_pitch=0.0, layers=layers)
    seen = Surroundings(DrawnMap(hall(), body), body, SurroundingsSettings())
    depth = np.full((120, 160), np.nan, np.float32)
    depth[70:75] = 1.5  # 0.95 m - 1.5 m * (10 ... 15) / 200: 0.84 to 0.88 m high
    camera = np.array([[200.0, 0.0, 80.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]])
    seen.look(RgbdFrame(0, np.zeros((120, 160), np.uint8), depth, camera), HERE)
    by_layer = {layer.bottom: len(points) for layer, points in seen.layered()}
    assert by_layer[0.0] == 0
    assert by_layer[0.5] > 10
    there = 4.0 + body.camera_x + 1.5
    window = seen.window(HERE)
    ((layer, metres),) = window.layers
    assert layer == layers[1]
    assert at(dataclasses.replace(window, metres=metres), there, 3.0) < 0.05
    assert at(window, there, 3.0) > 1.0
    assert at(dataclasses.replace(window, metres=window.to_anything()), there, 3.0) < 0.05
    assert len(seen.full_height()) == len(seen.unscanned()) == 0
    assert [layer for layer, _ in seen.in_narrow_layers()] == [layers[1]]


def test_a_walking_person_is_seen_by_the_local_planner_and_no_path_is_planned_round() -> None:
    seen = around()
    seen.see(0, HERE, np.concatenate([someone(6.0), someone(5.0)]))
    seen.set_personal_space(np.array([[6.0, 3.4], [5.0, 3.4]]), np.array([[6.0, 3.0]]))
    upright, _ = seen.stationary()
    assert len(upright) < len(seen.full_height())
    assert set(np.round(upright[:, 0])) == {5.0}
    assert at(seen.window(HERE), 6.0, 3.0) == at(seen.window(HERE), 6.0, 3.4) == 0.0
    seen.set_personal_space(np.empty((0, 2)))
    assert len(seen.stationary()[0]) == len(seen.full_height())


def beams(*ranges: float, step: float = math.radians(1.0)) -> FloatArray:
    """Return the ends of neighbouring beams, from a laser at the origin."""
    turns = step * np.arange(len(ranges))
    return np.array(ranges)[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=-1)


def test_a_beam_split_by_an_edge_gives_a_mixed_pixel_and_a_slim_post_does_not() -> None:
    laser = Pose2()
    veil = beams(2.0, 2.0, 3.1, 4.0, 4.0)
    np.testing.assert_array_equal(without_mixed_pixels(veil, laser, 0.1), veil[[0, 1, 3, 4]])
    post = beams(4.0, 4.0, 2.0, 4.0, 4.0)
    np.testing.assert_array_equal(without_mixed_pixels(post, laser, 0.1), post)
    post_with_veil = beams(4.0, 4.0, 2.0, 3.0, 4.0, 4.0)
    np.testing.assert_array_equal(without_mixed_pixels(post_with_veil, laser, 0.1), post_with_veil[[0, 1, 2, 4, 5]])
    np.testing.assert_array_equal(without_mixed_pixels(post + 1.0, Pose2(1.0, 1.0), 0.1), post + 1.0)
