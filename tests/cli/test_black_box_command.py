"""`waychair why` and `--box`: from a drive to its explanation, and one sentence per error."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from tests.cli.command import refused, waychair
from tests.runtime.boxes import driven, logged
from tests.runtime.riding import START, Ride, hall
from tests.runtime.test_chair_faults import only
from waychair.cli.black_box_command import why_command
from waychair.cli.main import app
from waychair.cli.options.arguments import BadArgument
from waychair.errors import BoxError
from waychair.maps.folders.map_files import load_map
from waychair.runtime.black_box.box_store import parts_of
from waychair.trials.navigate import navigate
from waychair.types import Place, Pose2, WheelTicks


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Path:
    def wheels_only(ride: Ride) -> None:
        ride.drive(110)
        ride.change = only(WheelTicks)
        ride.tick(20)

    folder = tmp_path_factory.mktemp("box")
    logged(folder, [driven(wheels_only)])
    return folder


def test_why_explains_the_last_stop_and_marks_it_as_read(box: Path) -> None:
    done = waychair("why", "--box", box)
    assert done.returncode == 0, done.stderr
    assert "lidar_stale" in done.stdout
    assert "What to do: check its cable and power." in done.stdout
    assert parts_of(box)[-1].read


def test_why_gives_the_same_as_json(box: Path, capsys: pytest.CaptureFixture[str]) -> None:
    why_command(box=box, last=3, json=True)
    (stop,) = json.loads(capsys.readouterr().out)["stops"]
    assert stop["id"] == "lidar_stale"
    assert {"doing", "first", "evidence", "followed", "remedy", "look_at", "board", "calibration_hash"} <= set(stop)


def test_the_default_box_is_the_one_written_last(
    box: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BoxError, match=r"out/up/box does not exist; give the folder that --box named"):
        why_command()
    for name, stamp_s in (("out/up/box", 1000), ("out/box", 2000), ("out/up/box", 3000)):
        shutil.copytree(box, name, dirs_exist_ok=True)
        for file in Path(name, "ring").iterdir():
            os.utime(file, (stamp_s, stamp_s))
        why_command()
        assert f"  Source: {name}/parts/" in capsys.readouterr().out


def test_a_stop_can_be_mapped(box: Path, tmp_path: Path) -> None:
    why_command(box=box, bag=tmp_path / "stop.mcap")
    done = waychair("map", tmp_path / "stop.mcap", "--out", tmp_path / "map", "--quiet")
    assert done.returncode == 0, done.stderr
    assert (load_map(tmp_path / "map").cells == 100).sum() > 100


def test_why_explains_a_drive_with_a_box(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    in_the_wall = Place("cupboard", Pose2(2.0, 4.95, 0.0))
    (leg,) = navigate(hall().grid, START, [in_the_wall], box=tmp_path / "box")
    assert not leg.reached
    why_command(box=tmp_path / "box")
    told = capsys.readouterr().out
    assert "drive_failed" in told
    assert "to cupboard" in told


@pytest.mark.parametrize("command", ["navigate", "demo"])
def test_commands_that_drive_take_a_box(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    app([command, "--help"], exit_on_error=False)
    assert "--box" in capsys.readouterr().out


def test_an_impossible_explanation_gives_one_sentence(tmp_path: Path) -> None:
    assert "does not exist" in refused(waychair("why", "--box", tmp_path / "none"))
    with pytest.raises(BadArgument, match="give 1 or more"):
        why_command(box=tmp_path, last=0)
    with pytest.raises(BoxError, match="no black box"):
        why_command(box=tmp_path)
