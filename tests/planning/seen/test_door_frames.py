"""Door frames are proposed in pictures, and a box shows a doorway only if its columns are those of the jambs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from waychair.planning.seen.door_frames import door_frames, overlap, shows, uprights
from waychair.types import Bytes, Pose3

CAMERA = np.array([[400.0, 0.0, 256.0], [0.0, 400.0, 192.0], [0.0, 0.0, 1.0]])
DOOR = (200.0, 70.0, 300.0, 310.0)


def _room(*, door: bool) -> Bytes:
    picture = np.full((384, 512, 3), (205, 210, 215), np.uint8)
    picture[320:] = (90, 110, 130)
    if door:
        x0, y0, x1, y1 = (int(value) for value in DOOR)
        picture[y0 - 8 : 320, x0 - 8 : x1 + 8] = (240, 240, 240)
        picture[y0:y1, x0:x1] = (60, 90, 140)
    noise = np.random.default_rng(3).normal(0.0, 3.0, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def test_a_plain_door_in_a_plain_wall_is_the_best_proposal() -> None:
    found = door_frames(_room(door=True))
    assert found
    assert overlap(found[0].box, DOOR) > 0.7


def test_a_bare_wall_gives_no_proposal() -> None:
    assert door_frames(_room(door=False)) == []


def test_pieces_of_one_upright_edge_are_joined_and_slanted_edges_left_out() -> None:
    edges = np.array([[100.0, 50.0, 101.0, 150.0], [102.0, 280.0, 101.0, 170.0], [20.0, 50.0, 90.0, 120.0]])
    (post,) = uprights(edges, 384)
    assert post[2:4] == pytest.approx([50.0, 280.0])
    assert post[4] == pytest.approx(210.0)


def test_a_box_shows_the_doorway_whose_jambs_are_in_its_columns_and_no_other() -> None:
    # the door's x (through it) is the camera's z, its y (left) the camera's -x, its z (up) the camera's -y
    facing = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    ahead = Pose3(facing, np.array([0.0, 0.5, 3.6]))
    assert shows((206.0, 70.0, 306.0, 310.0), CAMERA, ahead, 0.9)
    assert not shows((330.0, 70.0, 430.0, 310.0), CAMERA, ahead, 0.9)
    assert not shows((206.0, 70.0, 306.0, 310.0), CAMERA, Pose3(facing, np.array([0.0, 0.5, -3.6])), 0.9)
