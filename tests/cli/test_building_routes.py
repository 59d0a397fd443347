"""`waychair building route` from points, past arcs and zones; `bench` of other programs' files; `learn`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import refused, waychair
from tests.maps.building.buildings import two_storeys
from tests.planning.building.test_learnt_drives import drive
from waychair.maps.building.building import Building, save_with_map
from waychair.maps.drawn.zones import Rule, Zone, save_zones
from waychair.maps.folders.map_files import save_map
from waychair.recordings.recording import Trajectory, write_tum
from waychair.types import OccupancyGrid, Pose2


@pytest.fixture
def clinic(tmp_path: Path) -> Path:
    """The folder of the small building; its ground floor has a map with a wall beside the corridor."""
    cells = np.zeros((120, 200), np.int8)  # x from 0 to 20 m, y from -6 to 6 m
    cells[40, 40:135] = 100  # y = -2, x from 4 to 13.5
    save_map(tmp_path / "map", OccupancyGrid(cells, 0.1, Pose2(0.0, -6.0)))
    save_with_map(Building(tmp_path / "clinic", two_storeys()), "g", tmp_path / "map")
    return tmp_path / "clinic"


def route(folder: Path, start: str, goal: str, method: str = "astar") -> dict[str, object]:
    """Return the values that the command prints."""
    done = waychair("building", "route", folder, "--from", start, "--to", goal, "--json", "--method", method)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def test_a_point_joins_the_graph_at_the_node_that_is_nearest_by_driving(clinic: Path) -> None:
    values = route(clinic, "11,-3.5@g", "15,2@Ground")  # c2 is 3.6 m away by air line, behind the wall
    legs = values["legs"]
    assert isinstance(legs, list)
    assert legs[0]["nodes"][0] in ("g:c3", "g/store:d")
    assert legs[-1]["nodes"][-1] == "g/store:e"
    assert 5.0 < float(str(values["to_start_m"])) < 9.0
    assert float(str(values["from_goal_m"])) == pytest.approx(1.25, abs=0.3)
    told = waychair("building", "route", clinic, "--from", "8,-3.5@g", "--to", "First/Ward/Bed 1", "--method", "astar")
    assert told.stdout.splitlines()[0].startswith("drive to g")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("8,-3.5", "names no storey: write 8,-3.5@STOREY with one of g, 1"),
        ("8,-3.5@attic", "there is no storey 'attic'"),
        ("8,-3.5@1", "storey '1' has no map"),
        ("8,-3.5,400deg@g", "is no pose"),
        ("8,-2@g", "(8.00, -2.00)"),
        ("800,-2@g", "(800.00, -2.00)"),
    ],
)
def test_an_impossible_point_is_refused_with_a_sentence(clinic: Path, text: str, sentence: str) -> None:
    done = waychair("building", "route", clinic, "--from", text, "--to", "Ground/Ward/Bed g", "--method", "astar")
    assert sentence in refused(done)


def test_an_arc_given_in_either_direction_is_avoided(clinic: Path) -> None:
    ends = ("--from", "Ground/Ward/Bed g", "--to", "Ground/Store/Bed g", "--method", "astar")
    for arc in ("g:c2>c3", "g:c3>c2", "g:c3>store:d"):
        assert "is to be avoided" in refused(waychair("building", "route", clinic, *ends, "--avoid", arc))
    assert "there is no arc g:c2>c9" in refused(waychair("building", "route", clinic, *ends, "--avoid", "g:c2>c9"))


def test_a_zone_of_the_map_changes_the_route_and_makes_the_tables_stale(clinic: Path) -> None:
    ends = ("Ground/Ward/Bed g", "Ground/Store/Bed g")
    plain = route(clinic, *ends)["cost_m"]
    assert waychair("building", "tables", clinic).returncode == 0
    assert "E15" not in waychair("building", "check", clinic).stdout
    slow = Zone("wards", Rule.SLOW, np.array([(9.0, -1.0), (16.0, -1.0), (16.0, 0.1), (9.0, 0.1)]), 0.4)
    save_zones(clinic / "maps" / "g", [slow])

    assert route(clinic, *ends)["cost_m"] == pytest.approx(float(str(plain)) + 5.0, abs=0.2)
    assert route(clinic, *ends, "tables")["cost_m"] == route(clinic, *ends)["cost_m"]
    assert "E15 error: the tables are older than the graph" in waychair("building", "check", clinic).stdout


def test_a_closure_that_has_ended_is_open_with_and_without_tables(clinic: Path) -> None:
    ends = ("Ground/Ward/Bed g", "Ground/Store/Bed g")
    file = clinic / "submaps" / "g.txt"
    file.write_text(
        file.read_text().replace("arc from=c2 to=c3", "arc from=c2 to=c3 closed=paint until=2020-01-01T00:00:00Z")
    )
    assert route(clinic, *ends)["cost_m"] == route(clinic, *ends, "tables")["cost_m"]


@pytest.mark.nightly
def test_the_bench_times_the_graph_of_a_file(tmp_path: Path) -> None:
    rows = [f"N{k},{20 * k},0,1,B,CONF,Room {k},R{k}" for k in range(6)]
    head = "nodeID,xcoord,ycoord,floor,building,nodeType,longName,shortName"
    (tmp_path / "MapLnodes.csv").write_text("\n".join([head, *rows, ""]))
    edges = [f"E{k},N{k},N{k + 1}" for k in range(5)]
    (tmp_path / "MapLedges.csv").write_text("\n".join(["edgeID,startNode,endNode", *edges, ""]))

    done = waychair("building", "bench", tmp_path / "MapLnodes.csv", "--queries", "20", "--json")

    methods = {row["method"]: row for row in json.loads(done.stdout)["methods"]}
    assert methods["tables"]["wrong"] == methods["astar"]["wrong"] == 0
    assert set(methods["tables"]) == {
        "method", "mean_us", "path_us", "length_ratio", "cost_ratio", "wrong", "bytes_per_node", "build_s"
    }  # fmt: skip
    assert "there is no building in" in refused(waychair("building", "bench", tmp_path / "none"))


def test_drives_are_learnt_from_trajectories(clinic: Path, tmp_path: Path) -> None:
    stamps, points = drive((3.0, 0.0), (10.0, 0.0))
    write_tum(tmp_path / "drive.tum", Trajectory(stamps, np.c_[points, np.zeros(len(points))]))
    for _ in range(5):
        said = waychair("building", "learn", clinic, "g", tmp_path / "drive.tum").stdout
    assert said == "2 times of 2 arcs\n"
    text = (clinic / "submaps" / "g.txt").read_text()
    assert "arc from=c1 to=c2 drive_s=" in text
