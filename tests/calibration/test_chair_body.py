"""The built-in bodies and their mounts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import yaml

from waychair.calibration.chair_body import BODIES, CHAIR_A, CHAIR_B, DRIVES, BodyLayer, ChairBody
from waychair.config import dump, from_mapping
from waychair.errors import ConfigError


def test_bodies_have_their_own_names_and_cover_every_drive() -> None:
    assert all(name == body.chair_id for name, body in BODIES.items())
    assert {body.drive for body in BODIES.values()} == set(DRIVES)
    assert BODIES["A"] == CHAIR_A == ChairBody()
    assert (CHAIR_A.length, CHAIR_A.width) == (1.00, 0.60)
    assert (CHAIR_B.length, CHAIR_B.width) == (1.10, 0.70)


@pytest.mark.parametrize("name", BODIES)
def test_wheels_and_sensors_are_within_the_outline_of_every_body(name: str) -> None:
    body = BODIES[name]
    assert body.wheel_radius <= body.rear
    assert body.wheel_radius <= body.front
    assert body.track < body.width
    for x, y in ((body.laser_x, body.laser_y), (body.camera_x, body.camera_y), (body.imu_x, body.imu_y)):
        assert -body.rear <= x <= body.front
        assert abs(y) <= body.width / 2


@pytest.mark.parametrize("name", ["A_mid", "A_front"])
def test_other_drives_keep_the_outline_and_the_sensors_relative_to_the_rider(name: str) -> None:
    body = BODIES[name]
    for mount in ("laser_x", "camera_x", "imu_x"):
        assert getattr(body, mount) + body.rear == pytest.approx(getattr(CHAIR_A, mount) + CHAIR_A.rear)
    moved = {"chair_id", "drive", "axle_from_rear", "laser_x", "camera_x", "imu_x"}
    same = [entry.name for entry in dataclasses.fields(body) if entry.name not in moved]
    assert all(getattr(body, key) == getattr(CHAIR_A, key) for key in same)


def test_the_outline_is_counter_clockwise_and_as_long_and_wide_as_the_body() -> None:
    for body in BODIES.values():
        x, y = body.outline().T
        assert (np.ptp(x), np.ptp(y)) == pytest.approx((body.length, body.width))
        assert 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() == pytest.approx(body.length * body.width)
        assert body.circumscribed_radius == pytest.approx(np.hypot(x, y).max())


def test_the_camera_looks_ahead_and_a_little_down_with_an_upright_image() -> None:
    pose = dataclasses.replace(CHAIR_A, camera_pitch=0.1, camera_yaw=0.3).base_from_camera
    assert pose.rotation @ pose.rotation.T == pytest.approx(np.eye(3))
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
    ahead, down = pose.rotation[:, 2], pose.rotation[:, 1]
    assert math.atan2(ahead[1], ahead[0]) == pytest.approx(0.3)
    assert math.asin(-ahead[2]) == pytest.approx(0.1)
    assert down[2] < -0.99
    assert pose.translation.tolist() == [CHAIR_A.camera_x, CHAIR_A.camera_y, CHAIR_A.camera_z]


def test_an_unknown_drive_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="drive = 'rail' is unknown: take rear, mid or front"):
        ChairBody(drive="rail")


FEET = BodyLayer(0.0, 0.3, 0.75, 0.2, 0.25)
ARMS = BodyLayer(0.3, 1.3, 0.6, 0.25, 0.3)


def test_outlines_by_height_are_read_back_as_they_were_written() -> None:
    body = dataclasses.replace(CHAIR_A, layers=(FEET, ARMS))
    assert from_mapping(ChairBody, yaml.safe_load(dump(body))) == body
    assert body.height_layers() == (FEET, ARMS)


def test_a_body_without_layers_has_the_same_outline_at_all_heights() -> None:
    (layer,) = CHAIR_A.height_layers()
    assert (layer.bottom, layer.front, layer.rear, layer.half_width) == (0.0, 0.75, 0.25, 0.3)
    assert layer.top > 1.2


@pytest.mark.parametrize(
    ("layers", "said"),
    [
        ((ARMS,), "leaves a gap above 0.0 m"),
        ((FEET, ARMS._replace(bottom=0.4)), "leaves a gap above 0.3 m"),
        ((FEET._replace(top=0.0),), "leaves a gap"),
        ((FEET._replace(half_width=0.31),), "does not lie within the outline"),
        ((FEET._replace(front=0.0),), "does not lie within the outline"),
        ((FEET._replace(rear=float("nan")),), "does not lie within the outline"),
    ],
)
def test_impossible_layers_are_refused(layers: tuple[BodyLayer, ...], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        ChairBody(layers=layers)
