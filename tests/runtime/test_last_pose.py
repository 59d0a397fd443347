"""The chair's last pose, from one run to the next."""

from __future__ import annotations

from pathlib import Path

import pytest

from waychair.errors import ConfigError
from waychair.runtime.last_pose import remember_pose, remembered_pose
from waychair.types import Pose2

POSE = Pose2(1.25, -3.5, 0.7)


def test_a_saved_pose_is_found_by_any_path_of_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    remember_pose(tmp_path / "pose.json", tmp_path / "ward", POSE)
    monkeypatch.chdir(tmp_path)
    assert remembered_pose(Path("pose.json"), Path("ward")) == POSE


def test_a_pose_on_another_map_does_not_count(tmp_path: Path) -> None:
    remember_pose(tmp_path / "pose.json", tmp_path / "ward", POSE)
    assert remembered_pose(tmp_path / "pose.json", tmp_path / "lobby") is None


def test_without_a_saved_pose_there_is_none(tmp_path: Path) -> None:
    assert remembered_pose(tmp_path / "pose.json", tmp_path) is None


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", '{"map": "MAP"}', '{"map": "MAP", "pose": [1, 2]}', '{"map": "MAP", "pose": "abc"}']
)
def test_a_damaged_file_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "pose.json"
    path.write_text(text.replace("MAP", str(tmp_path)))
    with pytest.raises(ConfigError, match=r"pose\.json holds no pose .*: delete it"):
        remembered_pose(path, tmp_path)


@pytest.mark.parametrize("number", ["NaN", "Infinity"])
def test_a_pose_that_is_not_a_number_is_named(tmp_path: Path, number: str) -> None:
    path = tmp_path / "pose.json"
    path.write_text(f'{{"map": "{tmp_path}", "pose": [0, {number}, 0]}}')
    with pytest.raises(ConfigError, match="holds no pose"):
        remembered_pose(path, tmp_path)
