"""`waychair places`: add, move, rename and remove, with a question or a refusal before a place is replaced."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import refused, waychair
from waychair.maps.drawn.places import load_places
from waychair.maps.folders.map_files import save_map
from waychair.types import OccupancyGrid


@pytest.fixture
def flat(tmp_path: Path) -> Path:
    """A flat of 10 m by 8 m with walls all round and two places; the desk has tolerances of its own."""
    cells = np.zeros((160, 200), np.int8)
    cells[:2] = cells[-2:] = 100
    cells[:, :2] = cells[:, -2:] = 100
    save_map(tmp_path / "flat", OccupancyGrid(cells, 0.05))
    (tmp_path / "flat" / "places.yaml").write_text("bed: [2, 2, 0]\ndesk: [6, 4, 90deg, 0.05, 3deg]\n")
    return tmp_path / "flat"


def typed(monkeypatch: pytest.MonkeyPatch, answer: str) -> None:
    """Let a user at a terminal type this answer."""
    terminal = io.StringIO(answer)
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", terminal)


def test_a_place_is_removed(flat: Path) -> None:
    assert waychair("places", "--map", flat, "--remove", "bed").stdout == "desk: 6.00, 4.00, 1.57\n"
    assert list(load_places(flat)) == ["desk"]
    assert "add one with" in waychair("places", "--map", flat, "--remove", "desk").stdout
    assert load_places(flat) == {}


def test_a_place_is_renamed_and_keeps_its_turn_and_tolerances(flat: Path) -> None:
    done = waychair("places", "--map", flat, "--rename", "bed", "2nd bed")
    assert done.stdout.splitlines() == ["2nd bed: 2.00, 2.00, 0.00", "desk: 6.00, 4.00, 1.57"]
    waychair("places", "--map", flat, "--rename", "desk", "table")
    assert load_places(flat)["table"].tolerance_m == 0.05


def test_a_place_is_moved_and_keeps_its_tolerances(flat: Path) -> None:
    done = waychair("places", "--map", flat / "map.yaml", "--move", "desk", "7,3,-90deg")
    assert done.stdout.splitlines()[1] == "desk: 7.00, 3.00, -1.57"
    assert load_places(flat)["desk"].tolerance_m == 0.05


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("--remove", "dsk"), "there is no place 'dsk'; did you mean desk"),
        (("--rename", "bad", "sofa"), "there is no place 'bad'; did you mean bed"),
        (("--move", "bet", "1,1"), "there is no place 'bet'; did you mean bed"),
        (("--rename", "bed", "desk"), "there is a place 'desk' already, at 6.00, 4.00, 1.57: give another name"),
        (("--rename", "bed", "1,2"), "'1,2' cannot be the name of a place, as it reads as coordinates"),
        (("--move", "bed", "20,1"), "outside the map"),
        (("--move", "bed", "0.02,1"), "lies in a wall"),
        (("--move", "bed", "1,1,90"), "--move is '1,1,90': 90 rad is 5157 degrees"),
        (("--remove", "bed", "--rename", "desk", "table"), "--rename and --remove are given: give one at a time"),
        (
            ("--add", "bed", "1,1"),
            "there is a place 'bed' already, at 2.00, 2.00, 0.00: give another name, or replace it",
        ),
    ],
)
def test_what_is_refused_is_one_sentence_and_changes_nothing(flat: Path, change: tuple[str, ...], said: str) -> None:
    before = (flat / "places.yaml").read_bytes()
    assert said in refused(waychair("places", "--map", flat, *change))
    assert (flat / "places.yaml").read_bytes() == before


def test_a_place_is_replaced_with_yes(flat: Path) -> None:
    done = waychair("places", "--map", flat, "--add", "bed", "1,1,180deg", "--yes")
    assert done.stdout.splitlines()[0] == "bed: 1.00, 1.00, 3.14"


@pytest.mark.parametrize(("answer", "replaced"), [("y\n", True), ("Yes\n", True), ("n\n", False), ("\n", False)])
def test_in_a_terminal_the_user_is_asked_before_a_place_is_replaced(
    flat: Path, monkeypatch: pytest.MonkeyPatch, answer: str, replaced: bool
) -> None:
    typed(monkeypatch, answer)
    done = waychair("places", "--map", flat, "--add", "bed", "1,1")
    assert "there is a place 'bed' already, at 2.00, 2.00, 0.00. Replace it? [y/N]" in done.stderr
    assert done.returncode == (0 if replaced else 1)
    assert load_places(flat)["bed"].pose.x == (1.0 if replaced else 2.0)


@pytest.mark.parametrize(
    "change", [("--add", "a", "1,1"), ("--remove", "a"), ("--move", "a", "1,1"), ("--rename", "a", "b")]
)
def test_the_places_of_a_running_chair_are_not_changed_by_this_command(change: tuple[str, ...]) -> None:
    assert f"{change[0]} needs the --map whose places to change" in refused(waychair("places", *change))
