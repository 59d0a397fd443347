"""`waychair plan` and `waychair navigate`: a way, or one sentence with the remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.cli.test_commands import refused, waychair
from waychair.maps.map_files import save_map
from waychair.maps.places import add_place
from waychair.types import OccupancyGrid, Pose2


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rooms with a door between them, and a closed cell in the corner."""
    cells = np.zeros((120, 200), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[:50, 100], cells[72:, 100] = 100, 100
    cells[80, 160:], cells[80:, 160] = 100, 100
    folder = tmp_path_factory.mktemp("flat")
    save_map(folder, OccupancyGrid(cells, 0.05, Pose2(-1.0, -1.0, 0.0)))
    add_place(folder, "kitchen", Pose2(6.5, 1.0, 0.0))
    add_place(folder, "nook", Pose2(0.0, 4.0, -1.57))  # room to turn in place: 0.95 m to the wall
    return folder


def test_a_path_leads_through_the_door_and_is_drawn(flat: Path, tmp_path: Path) -> None:
    done = waychair("plan", "--map", flat, "--start", "0,0", "--goal", "kitchen", "--png", tmp_path / "path.png")
    assert done.returncode == 0, done.stderr
    assert 6.5 < float(done.stdout.split()[0]) < 9.0
    assert (tmp_path / "path.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("start", "goal", "said"),
    [
        ("0,0", "4.02,0", "does not fit at the goal"),
        ("0,0", "-0.4,4,3.14", "turn the heading"),
        ("0,0", "90,0", "outside the map"),
        ("-90,0", "kitchen", "outside the map"),
        ("4.02,0", "kitchen", "does not fit at its start"),
        ("8,4", "kitchen", "no way"),
        ("0,0", "kichen", "did you mean kitchen"),
        ("0,0", "1,zwei", "X,Y"),
    ],
)
def test_an_impossible_plan_is_one_sentence(flat: Path, tmp_path: Path, start: str, goal: str, said: str) -> None:
    png = tmp_path / "path.png"
    assert said in refused(waychair("plan", "--map", flat, "--start", start, "--goal", goal, "--png", png))
    assert not png.exists()


def test_the_chair_navigates_to_two_places_in_turn(flat: Path) -> None:
    done = waychair("navigate", "--map", flat, "--goal", "kitchen", "--goal", "nook", "--seed", "3")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(" yes ") == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--goal", "4.02,0"), "does not fit at the goal"),
        (("--goal", "8,4,0"), "no way"),
        (("--goal", "kitchen", "--start", "4.02,0"), "start"),
        (("--goal", "kitchen", "--start", "50,50"), "outside"),
    ],
)
def test_an_impossible_drive_is_one_sentence(flat: Path, arguments: tuple[str, ...], said: str) -> None:
    assert said in refused(waychair("navigate", "--map", flat, *arguments))
