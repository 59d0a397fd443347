"""`waychair fleet`, as a user types it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import refused, waychair
from tests.maps.building.buildings import two_storeys
from waychair.maps.building.hgraph_files import write_hgraph
from waychair.maps.drawn.places import add_place
from waychair.maps.folders.map_files import save_map
from waychair.maps.traffic.traffic_files import read_traffic
from waychair.types import OccupancyGrid, Pose2


def test_chairs_among_people_are_simulated_and_their_delays_printed() -> None:
    done = waychair("fleet", "simulate", "T", "--chairs", 2, "--persons", 5, "--hours", 0.2, "--seeds", 2)
    assert done.returncode == 0, done.stderr
    assert "seed 1: " in done.stdout
    assert "mean delay" in done.stdout
    assert "0 lock-ups; with 95 %" in done.stdout
    assert "Chairs wait most at section" in done.stdout


@pytest.mark.parametrize("rule", ["humans", "flexible", "chairs"])
def test_the_figures_come_as_json_and_the_same_seed_gives_the_same_ones(rule: str) -> None:
    command = ("fleet", "simulate", "9cube", "--rule", rule, "--hours", 0.2, "--seeds", 1, "--json")
    first, again = (json.loads(waychair(*map(str, command)).stdout) for _ in range(2))
    assert first == again
    assert first["tasks"] > 5
    assert first["lockups"] == 0
    assert len(first["runs"][0]["delay_s_by_chair"]) == 3


def test_a_sound_plan_is_checked_and_its_graph_written(tmp_path: Path) -> None:
    done = waychair("fleet", "check", "4cross", "--out", tmp_path / "graph.txt")
    assert done.returncode == 0, done.stderr
    assert "28 refuges" in done.stdout
    assert len(read_traffic(tmp_path / "graph.txt").refuges) == 28
    assert json.loads(waychair("fleet", "check", tmp_path / "graph.txt", "--json").stdout)["shut_off"] == []


def test_a_map_with_places_is_checked(tmp_path: Path) -> None:
    cells = np.full((100, 200), 100, dtype=np.int8)
    cells[40:64, 10:190] = 0  # a corridor of 9 m by 1.2 m
    save_map(tmp_path / "floor", OccupancyGrid(cells, 0.05))
    add_place(tmp_path / "floor", "east", Pose2(8.9, 2.6))
    done = waychair("fleet", "check", tmp_path / "floor", "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["refuges"] == 1
    assert values["metres"] == pytest.approx(8.0, abs=1.5)


def test_a_place_that_shuts_off_others_is_named_and_fails(tmp_path: Path) -> None:
    (tmp_path / "graph.txt").write_text(
        "traffic-graph 1\ngraph ward chair_width 0.6 revision 0\n"
        "node hall g 0 0 1\nnode desk g 5 0 1\nnode bed g 9 0 1\n"
        "section a hall desk length 5 width 1.2 lanes 1 both delay 0 lift -\n"
        "section b desk bed length 4 width 1.2 lanes 1 both delay 0 lift -\n"
        "refuge hall hall slots 3 place own owner -\nrefuge desk desk slots 1 place own owner -\n"
        "refuge bed bed slots 1 place own owner -\n"
    )
    done = waychair("fleet", "check", tmp_path / "graph.txt")
    assert done.returncode != 0
    assert "A chair at desk shuts off" in done.stdout
    assert "not well formed" in done.stderr


def test_chairs_drive_by_the_order_and_their_log_is_audited(tmp_path: Path) -> None:
    log = tmp_path / "order.jsonl"
    done = waychair(
        *("fleet", "simulate", "T", "--planner", "order", "--rooms", "--chairs", 4, "--hours", 0.2, "--seeds", 1),
        *("--bays", 1, "--log", log),
    )
    assert done.returncode == 0, done.stderr
    assert "costs most: chairs wait" in done.stdout
    assert "One bay beside" in done.stdout or "No bay" in done.stdout
    audit = waychair("fleet", "audit", log, "--chair", 2)
    assert audit.returncode == 0, audit.stderr
    assert "0 rules broken" in audit.stdout
    values = json.loads(waychair("fleet", "audit", log, "--json").stdout)
    assert values["faults"] == []
    assert sum(values["arrivals"].values()) > 10
    lines = log.read_text().splitlines()
    entered = next(k for k, line in enumerate(lines) if '"entered"' in line)
    log.write_text("\n".join(lines[:entered] + lines[entered : entered + 1] * 2) + "\n")
    assert "breaks 1 rule(s)" in refused(waychair("fleet", "audit", log))
    log.write_text(lines[0] + "\nnonsense\n")
    assert "line 2 of" in refused(waychair("fleet", "audit", log))
    log.write_text("")
    assert "has no record" in refused(waychair("fleet", "audit", log))


def test_a_building_is_checked_and_simulated(tmp_path: Path) -> None:
    write_hgraph(tmp_path / "clinic", two_storeys())
    done = waychair("fleet", "check", tmp_path / "clinic", "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert (values["lifts"], values["refuges"], values["shut_off"]) == (1, 6, [])
    assert any("taken as single file" in note for note in values["notes"])
    run = waychair(
        *("fleet", "simulate", tmp_path / "clinic", "--planner", "order", "--chairs", 2, "--hours", 0.2, "--json")
    )
    values = json.loads(run.stdout)
    assert values["tasks"] > 10
    assert values["lockups"] == 0
    assert list(values["waited_s_per_hour_by_lift"]) == ["A"]
    assert "know no lifts" in refused(waychair("fleet", "simulate", tmp_path / "clinic"))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("simulate", "nowhere"), "no floor plan, map or building 'nowhere'"),
        (("check", "T", "--body", "B", "--width", "0.75"), "no room for a chair of 0.70 m"),
        (("simulate", "T", "--chairs", "9"), "places for 8 chairs"),
        (("simulate", "T", "--persons", "20000"), "people are impossible"),
        (("simulate", "T", "--hours", "5000"), "--hours 5000"),
        (("simulate", "T", "--width", "0.5"), "no room for a chair"),
        (("simulate", "T", "--bays", "2"), "--bays and --log need --planner order"),
        (("simulate", "T", "--planner", "order", "--rooms", "--chairs", "17"), "give 1 to 16 chairs"),
        (("simulate", "T", "--planner", "order", "--rooms", "--persons", "20000"), "people are impossible"),
        (("audit", "nowhere.jsonl"), "nowhere.jsonl"),
        (("check", "T", "--body", "Z"), "--body 'Z' is unknown"),
        (("demo", "--headless", "--chairs", "99"), "fleet simulate"),
        (("demo", "--headless", "--world", "nowhere"), "there is no floor plan 'nowhere'"),
        (("demo", "--headless", "--chairs", "12"), "not enough for 12 chairs"),
    ],
)
def test_bad_input_is_one_sentence(arguments: tuple[str, ...], told: str) -> None:
    assert told in refused(waychair("fleet", *arguments))


_WARD = """traffic-graph 1
graph ward chair_width 0.6 revision 0
node hall g 0 0 1
node desk g 5 0 1
node bed g 9 0 1
section a hall desk length 5 width 1.2 lanes 1 both delay 0 lift -
{more}refuge hall hall slots 3 place own owner -
refuge desk desk slots 1 place own owner -
refuge bed bed slots 1 place own owner -
"""
"""A graph with a bed to which no way leads, unless there is more."""

_TO_BED = "section b desk bed length 4 width 1.2 lanes 1 both delay 0 lift -\n"


@pytest.mark.parametrize(
    ("corridors", "told"),
    [
        ("[[3, 27, 33, 27]]", "corridor 3 27 33 27 leaves the plan of 30 x 30 m"),
        ("[[3, 27, 27, 20]]", "lies at an angle"),
        ("[[3, 27, 3, 27]]", "has no length"),
        ("[[3, 27, 27, 27], [3, 3, 27, 3]]", "is in 2 pieces: no way leads from n10 at 3 27 to n1 at 3 3 and back"),
        ("[[3, 3.4, 27, 3.4]]", "has 0 rooms, but chairs with goals need 4"),
        ("[]", "has no corridors"),
    ],
)
def test_a_demo_on_an_impossible_plan_is_one_sentence(tmp_path: Path, corridors: str, told: str) -> None:
    (tmp_path / "plan.yaml").write_text(f"name: plan\nsize: [30, 30]\ncorridors: {corridors}\n")
    assert told in refused(waychair("fleet", "demo", "--headless", "--world", tmp_path / "plan.yaml"))


def test_a_graph_in_pieces_and_one_with_a_place_in_the_way_are_refused_by_their_true_cause(tmp_path: Path) -> None:
    graph = tmp_path / "graph.txt"
    graph.write_text(_WARD.format(more=""))
    assert "some places are cut off from the others" in waychair("fleet", "check", graph).stderr
    assert "no way leads from" in refused(waychair("fleet", "simulate", graph))
    graph.write_text(_WARD.format(more=_TO_BED))
    told = refused(waychair("fleet", "simulate", graph, "--planner", "order"))
    assert "2 places in nobody's way (1 shut off others or are cut off" in told
    assert told.rstrip().endswith("give 1 chair")
    graph.write_text(_WARD.format(more=_TO_BED + "lift north hall\n"))
    assert "lift north has fewer than two stops" in refused(waychair("fleet", "check", graph))


def test_nobody_about_is_no_fault_and_too_many_to_move_is_one() -> None:
    alone = waychair("fleet", "simulate", "T", "--persons", 0, "--hours", 0.1, "--seeds", 1)
    assert alone.returncode == 0, alone.stderr
    crowd = waychair("fleet", "simulate", "T", "--persons", 10000, "--hours", 0.02, "--seeds", 1)
    assert crowd.returncode == 1
    assert "no chair has reached a goal; give more --hours, or fewer --persons" in crowd.stderr
