"""`waychair plan` and `waychair navigate`: a way, or one sentence with the remedy."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.command import refused, waychair
from waychair.cli.planning import plan_command
from waychair.errors import NoFreeSpace, NoPath, WaychairError, ZoneError
from waychair.maps.map_files import save_map
from waychair.maps.places import add_place
from waychair.types import Json, OccupancyGrid, Pose2


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
    """What the command prints as JSON."""
    plan_command(map=map, start=start, goal=goal, planner=planner, json=True)
    values: Json = json.loads(capsys.readouterr().out)
    return values


def test_the_harmonic_planner_draws_its_potential_and_counts_its_turns(flat: Path, tmp_path: Path) -> None:
    png = tmp_path / "potential.png"
    ways = ("--map", flat, "--start", "0,0", "--goal", "kitchen")
    said = waychair("plan", *ways, "--planner", "harmonic", "--png", png).stdout
    assert "turns at every 0.10 m, from degrees: 0: " in said
    assert png.read_bytes()[:4] == b"\x89PNG"
    assert "choose auto, taut, band, none" in refused(waychair("plan", *ways, "--smooth", "rope"))


@pytest.mark.parametrize("planner", ["dstar-lite", "astar", "dijkstra"])
def test_a_benchmark_query_is_column_and_row_with_row_0_on_top(
    benchmark: Path, planner: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = planned(capsys, benchmark, "4,0", "4,3", planner)
    assert found["cost"] == 3.0
    assert found["cells"] == [[4, 0], [4, 1], [4, 2], [4, 3]]
    assert found["ms"] > 0


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
        ({"start": "0,0", "goal": "1,0", "smooth": "band"}, "leave it out"),
        ({"scen": Path("nowhere.scen")}, r"no scenario at nowhere\.scen"),
        ({"scen": Path("nowhere.scen"), "start": "0,0"}, "leave --start"),
    ],
)
def test_an_impossible_benchmark_query_is_named(benchmark: Path, arguments: Json, said: str) -> None:
    with pytest.raises(WaychairError, match=said):
        plan_command(map=benchmark, **arguments)


def test_a_scenario_of_another_map_or_for_a_map_folder_is_refused(benchmark: Path, flat: Path, tmp_path: Path) -> None:
    small = tmp_path / "small.map"
    small.write_text("type octile\nheight 1\nwidth 1\nmap\n.\n")
    scenario = f"{benchmark}.scen"
    assert "give the scenario of this map" in refused(waychair("plan", "--map", small, "--scen", scenario))
    assert "belongs to a Moving AI" in refused(waychair("plan", "--map", flat, "--scen", scenario))
    small.write_text("type octile\nheight 1\nwidth 1\nmap\n@\n")
    assert "no free cell" in refused(waychair("plan", "--map", small, "--start", "0,0", "--goal", "0,0"))


def test_zones_of_the_map_bind_the_plan(flat: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "zoned"
    shutil.copytree(flat, folder)
    zones = folder / "zones.yaml"
    free = planned(capsys, folder, "0,0", "kitchen")
    zones.write_text("hall: {slow: 0.1, polygon: [[-1, -1], [9, -1], [9, 5], [-1, 5]]}\n")
    assert planned(capsys, folder, "0,0", "kitchen")["cost"] > 4 * free["cost"]
    for text, error, said in (
        ("door: {one_way: 3.1416, polygon: [[3.5, 0], [4.5, 0], [4.5, 4], [3.5, 4]]}", NoPath, "no way"),
        ("all: {keep_out: true, polygon: [[-1, -1], [9, -1], [9, 5], [-1, 5]]}", NoFreeSpace, "no free space"),
        ("\ndoor: {keep_out: true}", ZoneError, r"zones\.yaml line 2: 'door'"),
    ):
        zones.write_text(text)
        with pytest.raises(error, match=said):
            planned(capsys, folder, "0,0", "kitchen")


def test_the_chair_navigates_in_a_world_that_ships_on_its_own_plan() -> None:
    done = waychair("navigate", "--world", "small_clinic", "--goal", "2.5,1,0")
    assert done.returncode == 0, done.stderr
    assert "2.5,1,0" in done.stdout


def test_navigating_nowhere_is_refused_with_advice() -> None:
    assert "--world" in refused(waychair("navigate", "--goal", "kitchen"))


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
