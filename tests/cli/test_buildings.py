"""`waychair building`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.command import refused, waychair
from tests.maps.building.buildings import two_storeys
from waychair.maps.building.hgraph import ArcRef
from waychair.maps.building.hgraph_edits import closed
from waychair.maps.building.hgraph_files import write_hgraph


@pytest.fixture
def clinic(tmp_path: Path) -> Path:
    """The folder of a small building."""
    write_hgraph(tmp_path / "clinic", two_storeys())
    return tmp_path / "clinic"


def test_a_new_building_gets_storeys_and_says_how_large_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "house"
    assert "made the building 'House'" in waychair("building", "new", folder, "--name", "House").stdout
    assert waychair("building", "add", folder, "g", "--name", "Ground").returncode == 0
    assert "there is a storey 'g' already" in refused(waychair("building", "add", folder, "g"))
    assert "there is no building in" in refused(waychair("building", "stats", tmp_path / "none"))
    stats = json.loads(waychair("building", "stats", folder, "--json").stdout)
    assert (stats["storeys"], stats["submaps"], stats["nodes"]) == (1, 2, 0)


def test_a_route_is_told_in_movements_with_and_without_kept_tables(clinic: Path) -> None:
    ends = ("--from", "Ground/Ward/Bed g", "--to", "First/Store/Bed 1")
    told = waychair("building", "route", clinic, *ends).stdout.splitlines()
    assert told[:3] == ["straight 3 m", "through the door", "turn right"]
    assert "Lift A to First" in told
    assert told[-1].startswith("25.5 m of driving, 1 lifts, about")
    assert "18 nodes, 7 sub-maps" in waychair("building", "tables", clinic).stdout
    for method in ("tables", "astar", "dijkstra", "brute-force", "tetranauta", "tetranauta-without-tables"):
        values = json.loads(waychair("building", "route", clinic, *ends, "--method", method, "--json").stdout)
        assert values["cost_m"] == pytest.approx(60.5)
    assert "choose tables" in waychair("building", "route", clinic, *ends, "--method", "bird").stderr


def test_a_route_past_a_closure_and_an_unknown_goal_are_refused_with_a_sentence(clinic: Path) -> None:
    write_hgraph(clinic, closed(two_storeys(), ArcRef("g", "c2", "c3"), "wet floor"))
    ends = ("--from", "Ground/Ward/Bed g", "--to", "Ground/Store/Bed g")
    assert "g:c2>c3 is closed (wet floor)" in refused(waychair("building", "route", clinic, *ends))
    assert "did you mean" in refused(waychair("building", "route", clinic, "--from", "Bath", "--to", "Bed g"))


def test_checks_are_printed_and_fail_on_errors(clinic: Path) -> None:
    values = json.loads(waychair("building", "check", clinic, "--json").stdout)
    assert values["errors"] == 0
    write_hgraph(clinic, closed(two_storeys(), ArcRef("g/ward", "d", "e"), "wet floor"))
    done = waychair("building", "check", clinic)
    assert "has 1 errors" in refused(done)
    assert "E11 error: the goal 'Bed g' cannot be reached" in done.stdout


def test_the_bench_compares_all_methods_with_dijkstra(clinic: Path) -> None:
    rows = json.loads(waychair("building", "bench", clinic, "--queries", "20", "--json").stdout)["methods"]
    assert {row["method"] for row in rows} >= {"dijkstra", "astar", "tables", "tetranauta"}
    assert {row["wrong"] for row in rows if row["method"] != "tetranauta"} == {0}
