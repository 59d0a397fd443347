"""`waychair plan` and `waychair navigate`: a path, or one sentence with the remedy."""

from __future__ import annotations

import json
import os
import shutil
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.cli.command import refused, waychair
from waychair.cli.planning import plan_command
from waychair.errors import NoFreeSpace, NoPath, WaychairError, ZoneError
from waychair.maps.drawn.places import add_place
from waychair.maps.folders.map_files import save_map
from waychair.planning.grid.grid_search import GridPath
from waychair.planning.route.grid_planner import plan_on_cells
from waychair.types import Json, OccupancyGrid, Pose2


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a map of two rooms with a door between them, and a closed cell in the corner."""
    cells = np.zeros((120, 200), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[:50, 100], cells[72:, 100] = 100, 100
    cells[80, 160:], cells[80:, 160] = 100, 100
    folder = tmp_path_factory.mktemp("flat")
    save_map(folder, OccupancyGrid(cells, 0.05, Pose2(-1.0, -1.0, 0.0)))
    add_place(folder, "kitchen", Pose2(6.5, 1.0, 0.0))
    add_place(folder, "nook", Pose2(0.0, 4.0, -1.57))  # space to turn on the spot: 0.95 m to the wall
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
        ("8,4", "kitchen", "no path"),
        ("0,0", "kichen", "did you mean kitchen"),
        ("0,0", "1,zwei", "X,Y"),
        ("0,0", "1e19,0", "up to 1e+06 m"),
        ("-1e308,0", "kitchen", "up to 1e+06 m"),
        ("0,0,1e308", "kitchen", "more than a full turn"),
        ("-0.75,3", "kitchen", "does not fit at its start (-0.75, 3.00) with the heading"),
    ],
)
def test_an_impossible_plan_gives_one_sentence(flat: Path, tmp_path: Path, start: str, goal: str, said: str) -> None:
    png = tmp_path / "path.png"
    assert said in refused(waychair("plan", "--map", flat, "--start", start, "--goal", goal, "--png", png))
    assert not png.exists()


BENCHMARK = """type octile
height 4
width 5
map
.....
.@@@.
.....
@@@..
"""
SCENARIO = """version 1
0\tb.map\t5\t4\t0\t0\t0\t2\t2.0
1\tb.map\t5\t4\t0\t0\t4\t3\t6.41421356
1\tb.map\t5\t4\t1\t0\t2\t2\t5.0
"""


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("benchmark") / "b.map"
    path.write_text(BENCHMARK)
    path.with_suffix(".map.scen").write_text(SCENARIO)
    return path


def planned(capsys: pytest.CaptureFixture[str], map: Path, start: str, goal: str, planner: str = "dstar-lite") -> Json:
    """Return the command's JSON output."""
    plan_command(map=map, start=start, goal=goal, planner=planner, json=True)
    values: Json = json.loads(capsys.readouterr().out)
    return values


@pytest.mark.nightly
def test_the_harmonic_planner_draws_its_potential_and_counts_its_turns(flat: Path, tmp_path: Path) -> None:
    png = tmp_path / "potential.png"
    ways = ("--map", flat, "--start", "0,0", "--goal", "kitchen")
    said = waychair("plan", *ways, "--planner", "harmonic", "--png", png).stdout
    assert "turns at every 0.10 m, from degrees: 0: " in said
    assert png.read_bytes()[:4] == b"\x89PNG"
    bare = tmp_path / "bare.png"
    assert waychair("plan", *ways, "--png", bare).returncode == 0
    field, path = (cv2.imread(str(name)) for name in (png, bare))
    assert field is not None
    assert path is not None
    assert len(np.unique(field.reshape(-1, 3), axis=0)) > 2 * len(np.unique(path.reshape(-1, 3), axis=0)), "a field"


def test_a_door_passable_for_one_body_is_too_narrow_for_a_wider_one(tmp_path: Path) -> None:
    cells = np.zeros((120, 200), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[:50, 100], cells[65:, 100] = 100, 100  # 0.75 m
    save_map(tmp_path, OccupancyGrid(cells, 0.05))
    asked = ("plan", "--map", tmp_path, "--start", "2,2.9", "--goal", "8,2.9", "--body")
    assert waychair(*asked, "A").returncode == 0
    assert "no path" in refused(waychair(*asked, "B"))
    assert "--body 'C' is unknown: give one of A, B" in refused(waychair(*asked, "C"))


def test_a_map_without_free_space_is_named_before_its_start(tmp_path: Path) -> None:
    save_map(tmp_path, OccupancyGrid(np.full((60, 60), 100, np.int8), 0.05))
    asked = ("navigate", "--map", tmp_path, "--start", "1,1", "--goal", "2,2")
    assert "the map has no free space" in refused(waychair(*asked))


def test_a_picture_is_written_to_a_png_file_other_than_the_map_image(flat: Path, tmp_path: Path) -> None:
    folder = tmp_path / "map"
    folder.mkdir()
    pixels = np.full((80, 120), 254, np.uint8)
    cv2.imwrite(str(folder / "map.png"), pixels)
    (folder / "map.yaml").write_text((flat / "map.yaml").read_text().replace("map.pgm", "map.png"))
    before = (folder / "map.png").read_bytes()
    (tmp_path / "link.png").symlink_to(folder / "map.png")
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "circle.png").symlink_to(tmp_path / "circle.png")
    (tmp_path / "hard.png").hardlink_to(folder / "map.png")
    os.mkfifo(tmp_path / "pipe.png")
    ways = ("plan", "--map", folder, "--start", "1,1", "--goal", "3,1")
    for png, said in (
        (folder / "map.png", "a file of the map"),
        (tmp_path / "link.png", "a file of the map"),
        (tmp_path / "hard.png", "a file of the map"),
        (tmp_path / "circle.png", "its symbolic links form a loop"),
        (folder / "map.yaml", "must be a .png file"),
        (tmp_path / "path.jpg", "must be a .png file"),
        (tmp_path, "must be a .png file"),
        (tmp_path / "folder.png", "it is a folder"),
        (tmp_path / "pipe.png", "a device, pipe or socket"),
    ):
        assert said in refused(waychair(*ways, "--png", png))
    assert waychair(*ways, "--png", "").returncode != 0
    assert (folder / "map.png").read_bytes() == before
    assert (tmp_path / "pipe.png").is_fifo()
    there = ["circle.png", "folder.png", "hard.png", "link.png", "map", "pipe.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == there


@pytest.mark.parametrize("planner", ["dstar-lite", "astar", "dijkstra"])
def test_a_benchmark_query_is_column_and_row_with_row_0_on_top(
    benchmark: Path, planner: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = planned(capsys, benchmark, "4,0", "4,3", planner)
    assert found["cost"] == 3.0
    assert found["cells"] == [[4, 0], [4, 1], [4, 2], [4, 3]]
    assert found["ms"] > 0


def test_the_time_of_a_query_excludes_loading_the_kernels(
    benchmark: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[str] = []

    def slow_at_first(*arguments: Any) -> GridPath:
        if not loaded:
            loaded.append("kernels")
            begun = time.thread_time()
            while time.thread_time() < begun + 0.2:
                pass
        return plan_on_cells(*arguments)

    monkeypatch.setattr("waychair.planning.route.grid_planner.plan_on_cells", slow_at_first)
    assert planned(capsys, benchmark, "4,0", "4,3")["ms"] < 100


@pytest.mark.nightly
def test_a_scenario_gives_cost_optimum_and_time_of_every_query(benchmark: Path, tmp_path: Path) -> None:
    done = waychair("plan", "--map", benchmark, "--scen", f"{benchmark}.scen", "--json")
    rows = json.loads(done.stdout)["queries"]
    assert [row["cost"] for row in rows] == pytest.approx([2.0, 6.4142, 5.0])
    assert [row["optimal"] for row in rows] == [2.0, 6.41421356, 5.0]
    assert all(row["ms"] > 0 for row in rows)
    said = waychair("plan", "--map", benchmark, "--scen", f"{benchmark}.scen").stdout
    assert said.startswith("3 of 3 queries at their optimal cost")
    drawn = waychair("plan", "--map", benchmark, "--start", "0,0", "--goal", "4,3", "--png", tmp_path / "cells.png")
    assert drawn.stdout.startswith("6.4142 cells")
    assert (tmp_path / "cells.png").read_bytes().startswith(b"\x89PNG")
    ways = ("--map", benchmark, "--start", "0,0", "--goal", "4,3", "--planner", "harmonic")
    assert waychair("plan", *ways, "--png", tmp_path / "field.png").stdout.startswith("6.4142 cells")
    field, cells = (cv2.imread(str(tmp_path / name)) for name in ("field.png", "cells.png"))
    assert field is not None
    assert cells is not None
    assert len(np.unique(field.reshape(-1, 3), axis=0)) > 2 * len(np.unique(cells.reshape(-1, 3), axis=0)), "a field"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"start": "1,1", "goal": "0,0"}, "the start in column 1, row 1 is occupied"),
        ({"start": "0,0", "goal": "5,0"}, "the goal in column 5, row 0 lies outside"),
        ({"start": "0,0", "goal": "0.5,0"}, "the column and row of a cell"),
        ({"start": "0,0"}, "give --start and --goal"),
        ({"start": "0,0", "goal": "1,0", "planner": "best"}, "choose dstar-lite, astar, dijkstra"),
        ({"start": "0,0", "goal": "4,3", "png": Path("b.map")}, r"must be a \.png file"),
        ({"scen": Path("nowhere.scen")}, r"no scenario at nowhere\.scen"),
        ({"scen": Path("nowhere.scen"), "start": "0,0"}, "omit --start"),
    ],
)
def test_an_impossible_benchmark_query_is_named(benchmark: Path, arguments: Json, said: str) -> None:
    with pytest.raises(WaychairError, match=said):
        plan_command(map=benchmark, **arguments)


def test_queries_without_a_path_or_with_another_cost_are_named_and_fail(tmp_path: Path) -> None:
    map, scenario = tmp_path / "b.MAP", tmp_path / "b.scen"
    map.write_text("type octile\nheight 3\nwidth 3\nmap\n...\n@@@\n...\n")
    query = "0\tb.map\t3\t3\t"
    right, dearer, without = f"{query}0\t0\t2\t0\t2.0\n", f"{query}0\t0\t2\t0\t3.0\n", f"{query}0\t0\t0\t2\t2.0\n"
    for queries, said in (
        (right + dearer + without + without, "no path for queries 3, 4 of"),
        (right + dearer, "for query 2: give the scenario"),
        (right + dearer * 12, "queries 2, 3, 4, 5, 6, 7, 8, 9, 10, 11 and 2 more:"),
        (f"{query}0\t0\t0\t1\t2.0\n", "query 1 of the scenario: its goal in column 0, row 1 is occupied"),
        ("", "holds no query"),
    ):
        scenario.write_text("version 1\n" + queries)
        assert said in refused(waychair("plan", "--map", map, "--scen", scenario))
    scenario.write_text("version 1\n" + right + without)
    done = waychair("plan", "--map", map, "--scen", scenario, "--json")
    assert "no path for query 2 of" in refused(done)
    assert [row["cost"] for row in json.loads(done.stdout)["queries"]] == [2.0, None]
    scenario.write_text("version 1\n" + dearer)  # harmonic paths are not the cheapest
    assert waychair("plan", "--map", map, "--scen", scenario, "--planner", "harmonic").returncode == 0
    assert "from column 0, row 0 to column 2, row 2;" in refused(
        waychair("plan", "--map", map, "--start", "0,0", "--goal", "2,2")
    )


def test_a_map_folder_may_have_the_name_of_a_benchmark(flat: Path, tmp_path: Path) -> None:
    shutil.copytree(flat, tmp_path / "flat.map")
    done = waychair("plan", "--map", tmp_path / "flat.map", "--start", "0,0", "--goal", "kitchen")
    assert done.stdout.endswith("m from 0,0 to kitchen\n")


@pytest.mark.parametrize("name", ["a" * 400, "a" * 400 + ".map"])
def test_an_impossible_map_name_gives_one_sentence(name: str) -> None:
    assert "there is no map at" in refused(waychair("plan", "--map", name, "--start", "0,0", "--goal", "1,1"))


def test_a_scenario_of_another_map_or_for_a_map_folder_is_refused(benchmark: Path, flat: Path, tmp_path: Path) -> None:
    small = tmp_path / "small.map"
    small.write_text("type octile\nheight 1\nwidth 1\nmap\n.\n")
    scenario = f"{benchmark}.scen"
    assert "give the scenario of this map" in refused(waychair("plan", "--map", small, "--scen", scenario))
    assert "needs a Moving AI" in refused(waychair("plan", "--map", flat, "--scen", scenario))
    small.write_text("type octile\nheight 1\nwidth 1\nmap\n@\n")
    assert "no free cell" in refused(waychair("plan", "--map", small, "--start", "0,0", "--goal", "0,0"))


def test_the_plan_obeys_the_zones_of_the_map(flat: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "zoned"
    shutil.copytree(flat, folder)
    zones = folder / "zones.yaml"
    free = planned(capsys, folder, "0,0", "kitchen")
    zones.write_text("hall: {slow: 0.1, polygon: [[-1, -1], [9, -1], [9, 5], [-1, 5]]}\n")
    assert planned(capsys, folder, "0,0", "kitchen")["cost"] > 4 * free["cost"]
    for text, error, said in (
        (
            "door: {one_way: 3.1416, polygon: [[3.5, 0], [4.5, 0], [4.5, 4], [3.5, 4]]}",
            NoPath,
            "one-way zone 'door' bars",
        ),
        ("all: {keep_out: true, polygon: [[-1, -1], [9, -1], [9, 5], [-1, 5]]}", NoFreeSpace, "no free space"),
        ("far: {keep_out: true, polygon: [[90, 0], [91, 0], [91, 4]]}", ZoneError, r"'far', round \(90\.7, 1\.3\)"),
        ("\ndoor: {keep_out: true}", ZoneError, r"zones\.yaml line 2: 'door'"),
    ):
        zones.write_text(text)
        with pytest.raises(error, match=said):
            planned(capsys, folder, "0,0", "kitchen")


def test_the_chair_navigates_in_a_shipped_world_on_the_plan_of_the_world() -> None:
    done = waychair("navigate", "--world", "small_clinic", "--goal", "2.5,1,0")
    assert done.returncode == 0, done.stderr
    assert "2.5,1,0" in done.stdout


def test_navigating_without_a_goal_is_refused_with_advice() -> None:
    assert "--world" in refused(waychair("navigate", "--goal", "kitchen"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--goal", "1,1", "--seed", "-1"), "Must be >= 0"),
        (("--goal", "1,1", "--people", "-1"), "Must be >= 0"),
        (("--goal", "1,1", "--people", "1.5"), "not a whole number"),
        (("--empty-goal",), "--goal"),
        ((), "--goal"),
    ],
)
def test_unsuitable_inputs_of_a_drive_are_refused_before_it(arguments: tuple[str, ...], said: str) -> None:
    done = waychair("navigate", "--world", "small_clinic", *arguments)
    assert done.returncode != 0
    assert said in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", ["navigate", "places"])
def test_no_option_has_an_empty_form(command: str) -> None:
    assert "--empty-" not in waychair(command, "--help").stdout


def test_an_error_about_a_world_without_places_calls_it_a_world(tmp_path: Path) -> None:
    path = tmp_path / "cut.yaml"
    path.write_text("name: cut\nsize: [6, 4]\nstart: [1, 1, 0]\nwalls: []\n")
    said = refused(waychair("navigate", "--world", path, "--goal", "kitchen"))
    assert "the world 'cut' has no places yet" in said


@pytest.mark.nightly
def test_the_chair_navigates_to_two_places_in_turn(flat: Path) -> None:
    done = waychair("navigate", "--map", flat, "--goal", "kitchen", "--goal", "nook", "--seed", "3")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(" yes ") == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--goal", "4.02,0"), "does not fit at the goal"),
        (("--goal", "8,4,0"), "no path"),
        (("--goal", "kitchen", "--start", "4.02,0"), "start"),
        (("--goal", "kitchen", "--start", "50,50"), "the start (50, 50) is outside the map"),
        (("--goal", "kitchen", "--world", "small_clinic", "--start", "6,1"), "(6, 1, 0) on the map"),
    ],
)
def test_an_impossible_drive_gives_one_sentence(flat: Path, arguments: tuple[str, ...], said: str) -> None:
    assert said in refused(waychair("navigate", "--map", flat, *arguments))


def test_an_error_about_a_missing_start_says_how_to_give_one(flat: Path, tmp_path: Path) -> None:
    shutil.copytree(flat, tmp_path / "map")
    text = (tmp_path / "map" / "map.yaml").read_text()
    for origin in ("[1.0, 1.0, 0.0]", "[-5.03, -1.0, 0.0]"):
        (tmp_path / "map" / "map.yaml").write_text(text.replace("[-1.0, -1.0, 0.0]", origin))
        assert "the default start was used" in refused(waychair("navigate", "--map", tmp_path / "map", "--goal", "3,3"))
