"""`waychair fleet solve`: paths for many agents, or one sentence with the remedy."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import refused, waychair
from waychair.maps.grid.moving_ai import load_free_cells
from waychair.planning.fleet.agents import fault, neighbours_of_cells, task_of_cells

_ROWS = ["......", ".@..@.", "......"]
_ENDS = [(0, 0, 5, 2), (5, 2, 0, 0), (2, 0, 2, 2)]
"""Start column and row, goal column and row of each agent."""


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    """Return a small map with its scenario beside it."""
    map = tmp_path / "small.map"
    map.write_text("\n".join(["type octile", "height 3", "width 6", "map", *_ROWS, ""]))
    _write_scenario(tmp_path / "small.scen", _ENDS)
    return map


def _write_scenario(path: Path, ends: list[tuple[int, int, int, int]]) -> Path:
    rows = ["\t".join(map(str, (0, "small.map", 6, 3, *each, 5.0))) for each in ends]
    path.write_text("\n".join(["version 1", *rows, ""]))
    return path


def test_agents_get_valid_paths_which_json_and_a_file_give(grid: Path, tmp_path: Path) -> None:
    scenario, out = grid.with_suffix(".scen"), tmp_path / "paths.json"
    done = waychair(
        "fleet", "solve", grid, scenario, "--agents", "3", "--seconds", "0.1", "--json", "--out", out, "--quiet"
    )
    assert (done.returncode, done.stdout) == (0, "")
    done = waychair("fleet", "solve", grid, scenario, "--agents", "3", "--seconds", "0.1", "--json", "--out", out)
    values = json.loads(done.stdout)
    assert set(values) == {"sum_of_costs", "bound", "first_ms", "valid"}
    assert values["valid"]
    assert values["bound"] == 16  # 7 + 7 + 2 steps alone
    assert 16 <= values["sum_of_costs"] <= 20
    free = load_free_cells(grid)
    _, numbers = neighbours_of_cells(free)
    task = task_of_cells(free, [(y, x) for x, y, _, _ in _ENDS], [(y, x) for _, _, x, y in _ENDS])
    paths = [[numbers[y, x] for x, y in path] for path in json.loads(out.read_text())["paths"]]
    assert fault(task, np.array(paths)) == ""


def test_impossible_orders_are_one_sentence(grid: Path, tmp_path: Path) -> None:
    scenario = grid.with_suffix(".scen")

    def said(*arguments: str | Path) -> str:
        return refused(waychair("fleet", "solve", *arguments))

    assert "has 3 queries, not 4: give --agents 3 or fewer" in said(grid, scenario, "--agents", "4")
    assert "--seconds must be a number above 0, not nan" in said(grid, scenario, "--agents", "2", "--seconds", "nan")
    assert "--seconds must be a number above 0, not 0" in said(grid, scenario, "--agents", "2", "--seconds", "0")
    assert "must be a Moving AI .map file" in said(tmp_path, scenario, "--agents", "2")
    assert "there is no scenario at" in said(grid, tmp_path / "no.scen", "--agents", "2")
    twice = _write_scenario(tmp_path / "twice.scen", [(0, 0, 5, 2), (0, 0, 5, 0)])
    assert "agents 1 and 2 have the same start, column 0, row 0" in said(grid, twice, "--agents", "2")
    goal = _write_scenario(tmp_path / "goal.scen", [(0, 0, 5, 2), (5, 0, 5, 2)])
    assert "agents 1 and 2 have the same goal, column 5, row 2" in said(grid, goal, "--agents", "2")
    solid = _write_scenario(tmp_path / "solid.scen", [(1, 1, 5, 2)])
    assert "its start in column 1, row 1 is occupied" in said(grid, solid, "--agents", "1")
    other = tmp_path / "other.map"
    other.write_text("type octile\nheight 1\nwidth 2\nmap\n..\n")
    assert "give the scenario of this map" in said(other, scenario, "--agents", "1")
