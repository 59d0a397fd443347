"""Tags to print, and the start of a chair by the name of a place."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from waychair.cli.building.building_tags import tag_command
from waychair.cli.options.arguments import BadArgument
from waychair.cli.running.starting import _start_pose
from waychair.errors import BuildingError, UnknownPlace
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.slam.camera.seen_tags import tags_in_picture
from waychair.types import OccupancyGrid, Place, Pose2


def test_a_tag_to_print_is_read_by_its_number(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tag_command(42, out=tmp_path / "tag.png")
    assert "wrote AprilTag 42" in capsys.readouterr().out
    picture = cv2.imread(str(tmp_path / "tag.png"), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    assert tags_in_picture(np.pad(picture, 30, constant_values=255))[1] == [42]
    with pytest.raises(BuildingError, match="there is no AprilTag 600"):
        tag_command(600, out=tmp_path / "none.png")
    with pytest.raises(BadArgument, match=r"--out must be a \.png file"):
        tag_command(1, out=tmp_path / "tag.pdf")


def test_a_chair_starts_at_a_place_of_its_map_or_at_a_pose(tmp_path: Path) -> None:
    save_map(tmp_path, OccupancyGrid(np.zeros((40, 40), np.int8), 0.1))
    save_places(tmp_path, {"bed": Place("bed", Pose2(1.0, 2.0, 0.5))})
    assert _start_pose("bed", tmp_path) == Pose2(1.0, 2.0, 0.5)
    assert _start_pose("3,1,0.2", tmp_path) == _start_pose("3,1,0.2", None) == Pose2(3.0, 1.0, 0.2)
    with pytest.raises(UnknownPlace, match="did you mean bed"):
        _start_pose("bad", tmp_path)
    with pytest.raises(BadArgument, match="--start must be"):
        _start_pose("bed", None)
