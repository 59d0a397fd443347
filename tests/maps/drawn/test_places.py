"""Named places: names as written, the nearest names to an unknown one, and errors with the line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import PlaceError, UnknownPlace
from waychair.maps.drawn.places import add_place, check_place, find, load_places, save_places
from waychair.pose_text import is_like_pose
from waychair.types import OccupancyGrid, Place, Pose2

printable = st.text(st.characters(categories=("L", "N", "P", "S", "Zs")), min_size=1, max_size=20)
names = printable.map(str.strip).filter(lambda name: bool(name) and name.isprintable() and not is_like_pose(name))
numbers = st.floats(-1e4, 1e4)
angles = st.floats(-3.14159, 3.14159)
tolerances = st.floats(0.02, 6.28)


def write(folder: Path, text: str) -> Path:
    (folder / "places.yaml").write_text(text, encoding="utf-8")
    return folder


def test_places_are_read_with_their_tolerances_in_order(tmp_path: Path) -> None:
    write(tmp_path, "lift: [12.4, 3.1, 1.5]\n# by the window\ndesk: [2, 5.5, 4.0, 0.05, 0.02]\n")
    places = load_places(tmp_path)
    assert list(places) == ["lift", "desk"]
    assert places["lift"] == Place("lift", Pose2(12.4, 3.1, 1.5))
    assert places["desk"].pose.theta == pytest.approx(4.0 - 2 * math.pi)
    assert (places["desk"].tolerance_m, places["desk"].tolerance_rad) == (0.05, 0.02)


def test_names_stay_as_written(tmp_path: Path) -> None:
    text = "007: [0, 0, 0]\nno: [1, 0, 0]\n1.50: [2, 0, 0]\nKüche: [3, 0, 0]\n'the lift': [4, 0, 0]\n"
    assert list(load_places(write(tmp_path, text))) == ["007", "no", "1.50", "Küche", "the lift"]


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(names, st.tuples(numbers, numbers, angles, tolerances, tolerances), max_size=6))
def test_places_survive_writing_and_reading(
    tmp_path_factory: pytest.TempPathFactory, rows: dict[str, tuple[float, float, float, float, float]]
) -> None:
    folder = tmp_path_factory.mktemp("map")
    places = {name: Place(name, Pose2(*row[:3]), *row[3:]) for name, row in rows.items()}
    save_places(folder, places)
    back = load_places(folder)
    assert list(back) == list(places)
    for name, place in places.items():
        assert (back[name].pose.x, back[name].pose.y) == (place.pose.x, place.pose.y)
        assert back[name].pose.theta == pytest.approx(place.pose.theta, abs=1e-15)
        assert (back[name].tolerance_m, back[name].tolerance_rad) == (place.tolerance_m, place.tolerance_rad)


def test_a_map_without_places_has_none(tmp_path: Path) -> None:
    assert load_places(tmp_path) == {}
    assert load_places(write(tmp_path, "# none yet\n")) == {}
    save_places(tmp_path, {})
    assert load_places(tmp_path) == {}


def test_the_path_of_the_maps_yaml_is_accepted_for_its_folder(tmp_path: Path) -> None:
    write(tmp_path, "lift: [1, 2, 3]\n")
    assert load_places(tmp_path / "map.yaml") == load_places(tmp_path)


def test_a_place_is_added_and_replaced_only_on_request(tmp_path: Path) -> None:
    add_place(tmp_path / "office", "lift", Pose2(1.0, 2.0, 0.5))
    add_place(tmp_path / "office", " desk ", Pose2(3.0, 4.0, 0.0))
    with pytest.raises(PlaceError, match="place 'lift' already"):
        add_place(tmp_path / "office", "lift", Pose2())
    assert load_places(tmp_path / "office")["lift"].pose == Pose2(1.0, 2.0, 0.5)
    add_place(tmp_path / "office", "lift", Pose2(9.0, 9.0, 0.0), replace=True)
    places = load_places(tmp_path / "office")
    assert list(places) == ["lift", "desk"]
    assert places["lift"].pose == Pose2(9.0, 9.0, 0.0)


@pytest.mark.parametrize(
    ("name", "pose"),
    [("", Pose2()), ("  ", Pose2()), ("a\nb", Pose2()), ("lift", Pose2(math.nan)), ("lift", Pose2(0.0, math.inf))],
)
def test_an_impossible_place_is_not_added(tmp_path: Path, name: str, pose: Pose2) -> None:
    with pytest.raises(PlaceError):
        add_place(tmp_path, name, pose)
    assert not (tmp_path / "places.yaml").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lift: [1, 2, 3]\ndesk: [1, 2]\n", "line 2: 'desk' must be"),
        ("lift: [1, 2, 3, 4]\n", "line 1: 'lift' must be"),
        ("\nlift: [1, two, 3]\n", "line 2: 'lift' must be .*numbers"),
        ("lift: [1, [2], 3]\n", "numbers"),
        ("lift:\n  x: 1\n", r"\[x, y, yaw\]"),
        ("lift: 5\n", r"\[x, y, yaw\]"),
        ("lift: [1, .nan, 3]\n", "line 1"),
        ("lift: [1, nan, 3]\n", "no pose on a map"),
        ("lift: [1, 2, inf]\n", "all numbers"),
        ("lift: [1, 2, 3, 0, 1]\n", "at least 0.02 m and 0.02 rad"),
        ("lift: [1, 2, 3, 1, 0.019]\n", "at least 0.02 m and 0.02 rad"),
        ("lift: [1, 2, 3]\na: [1, 2, 3]\nlift: [1, 2, 3]\n", "line 3: 'lift' is given twice"),
        ("[1, 2]: [1, 2, 3]\n", "name must be a word"),
        ("'': [1, 2, 3]\n", "cannot be the name"),
        ("lift: [1, 2\n", "correct the YAML"),
        ("lift: [1.0e+19, 2, 3]\n", r"no pose on a map \(x 1e\+19, "),
        ("lift: [1, 2, 1e9]\n", "more than a full turn"),
        ("[" * 3000, "more than 50 nested lists or mappings"),
        ("- lift\n", "must hold `name"),
        ("just words\n", "must hold `name"),
        ("a: \x07\n", "is not YAML"),
    ],
)
def test_an_invalid_file_is_refused_in_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(PlaceError, match=message) as caught:
        load_places(write(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_bytes_that_are_not_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "places.yaml").write_bytes(b"lift: \xff\xfe")
    with pytest.raises(PlaceError, match="cannot read"):
        load_places(tmp_path)


def test_an_unknown_place_is_answered_with_the_nearest_names() -> None:
    places = {name: Place(name, Pose2()) for name in ("Lift", "kitchen", "library", "desk", "door")}
    assert find(places, "desk") is places["desk"]
    with pytest.raises(UnknownPlace, match="no place 'lift'; did you mean Lift, "):
        find(places, "lift")
    with pytest.raises(UnknownPlace, match="did you mean kitchen,"):
        find(places, "kichen")
    with pytest.raises(UnknownPlace, match="has no places yet"):
        find({}, "lift")


def test_a_place_outside_the_map_or_in_a_wall_is_refused() -> None:
    cells = np.zeros((40, 60), np.int8)
    cells[10, 20] = 65
    cells[11, 20] = 64
    cells[12, 20] = -1
    grid = OccupancyGrid(cells, 0.1, Pose2(-1.0, -2.0, 0.0))
    check_place(grid, Place("free", Pose2(0.0, 0.0, 0.0)))
    check_place(grid, Place("perhaps", Pose2(1.05, -0.85, 0.0)))
    check_place(grid, Place("unknown", Pose2(1.05, -0.75, 0.0)))
    with pytest.raises(PlaceError, match=r"'wall' at \(1.05, -0.95\) lies in a wall"):
        check_place(grid, Place("wall", Pose2(1.05, -0.95, 0.0)))
    for x, y in ((-1.01, 0.0), (5.01, 0.0), (0.0, -2.01), (0.0, 2.01)):
        with pytest.raises(PlaceError, match=r"outside the map of 6.0 x 4.0 m"):
            check_place(grid, Place("far", Pose2(x, y, 0.0)))
