"""AprilTags in the simulated camera's pictures: their numbers, and their places by depth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import BuildingError
from waychair.geometry import in_space, wrap_angle
from waychair.maps.building.april_tags import MOST, PARTS, tag_parts, tag_picture
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import Block, WallTag
from waychair.simulation.sensors.camera import CameraSettings, RgbdCamera
from waychair.simulation.sensors.renderer import Renderer, camera_matrix, renderer_problem
from waychair.slam.camera.seen_tags import seen_tags, tags_in_picture
from waychair.types import OccupancyGrid, Pose2, RgbdFrame, Twist

TAG = Pose2(6.0, 3.0, math.pi)
"""On a wall east of the chair, facing west."""

needs_renderer = pytest.mark.skipif(renderer_problem() is not None, reason=str(renderer_problem()))


def taken(*tags: WallTag, at: Pose2, noise: float = 1.0) -> RgbdFrame:
    """A frame of the camera of a chair that stands in a hall with tags on a wall."""
    wall = Block(Pose2(6.1, 3.0), 0.2, 6.0, 0.0, 2.5)
    world = World("hall", OccupancyGrid(np.zeros((120, 160), np.int8), 0.05), at, blocks=(wall,), tags=tags)
    settings = CameraSettings(rate_hz=10.0, noise=noise)
    renderer = Renderer(world, camera_matrix(640, 480, settings.field_of_view), 640, 480)
    camera = RgbdCamera(settings, CHAIR_A.base_from_camera, np.random.default_rng(3), renderer)
    frame = camera.frame(0, in_space(at), Twist())
    renderer.release()
    return frame


@needs_renderer
@pytest.mark.parametrize(
    ("number", "at"), [(0, Pose2(4.0, 3.0, 0.0)), (7, Pose2(4.2, 1.7, 0.6)), (586, Pose2(3.2, 4.0, -0.4))]
)
def test_a_tag_on_a_wall_tells_its_number_and_where_the_chair_is(number: int, at: Pose2) -> None:
    (seen,) = seen_tags(taken(WallTag(number, TAG, 1.2, 0.25), at=at), CHAIR_A.base_from_camera)
    assert seen.number == number
    assert seen.base_from_tag is not None
    found = TAG @ seen.base_from_tag.inverse()
    assert math.dist((found.x, found.y), (at.x, at.y)) < 0.08
    assert abs(wrap_angle(found.theta - at.theta)) < math.radians(3.0)


@needs_renderer
def test_a_far_tag_an_oblique_one_and_one_that_hangs_twice_tell_nothing_wrong() -> None:
    twice = (WallTag(7, Pose2(6.0, 2.6, math.pi), 1.2, 0.25), WallTag(7, Pose2(6.0, 3.4, math.pi), 1.2, 0.25))
    assert seen_tags(taken(*twice, at=Pose2(4.0, 3.0)), CHAIR_A.base_from_camera) == ()
    assert seen_tags(taken(at=Pose2(4.0, 3.0)), CHAIR_A.base_from_camera) == ()
    far = seen_tags(taken(WallTag(7, TAG, 1.2, 0.06), at=Pose2(1.0, 3.0)), CHAIR_A.base_from_camera)
    assert far == ()


@needs_renderer
def test_without_depth_only_the_number_is_known() -> None:
    frame = taken(WallTag(7, TAG, 1.2, 0.25), at=Pose2(4.0, 3.0))
    blind = RgbdFrame(0, frame.image, np.full_like(frame.depth, np.nan), frame.camera_matrix)
    (seen,) = seen_tags(blind, CHAIR_A.base_from_camera)
    assert (seen.number, seen.base_from_tag) == (7, None)


def test_a_printed_tag_is_read_again_and_no_number_of_another_family_is_made() -> None:
    picture = np.pad(tag_picture(123), 40, constant_values=255)
    corners, numbers = tags_in_picture(picture)
    assert numbers == [123]
    assert corners[0].shape == (4, 2)
    assert not tag_parts(123)[0].any()
    assert tag_parts(123)[1, 1 : PARTS - 1].all()
    with pytest.raises(BuildingError, match="there is no AprilTag 587: take a number from 0 to 586"):
        tag_parts(MOST)
