"""Moving AI benchmark files: their content, and one sentence for each fault."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waychair.errors import MapError, MapNotFound
from waychair.maps.grid.moving_ai import ScenarioQuery, check_queries, load_free_cells, load_queries

MAP = "type octile\nheight 2\nwidth 3\nmap\n.G@\nTWS\n"


def written(path: Path, text: str) -> Path:
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize("text", [MAP, MAP.replace("\n", "\r\n"), MAP.removesuffix("\n"), MAP + "\n \n"])
def test_the_top_line_is_row_0_and_dots_g_and_s_are_free(tmp_path: Path, text: str) -> None:
    free = load_free_cells(written(tmp_path / "a.map", text))
    assert free.tolist() == [[True, True, False], [False, False, True]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no Moving AI map"),
        ("P5\n2 2\n255\nabcd", "no Moving AI map"),
        (MAP.replace("height 2", "height two"), "line 2: it must read `height N`"),
        (MAP.replace("width 3", "width 0"), "line 3"),
        (MAP.replace(".G@", ".G"), "line 5: 2 cells where 3"),
        (MAP.removesuffix("TWS\n"), "line 6: 0 cells where 3"),
        (MAP.replace("height 2", "height 9"), "where 3 cells were announced"),
        (MAP.replace("height 2", "height " + "9" * 6000), "line 2: it must read `height N`"),
        (MAP.replace("height 2", "height 12000").replace("width 3", "width 12000"), "use coarser cells"),
        (MAP.replace("height 2", "height 1"), "line 6: more rows than the 1 that were announced"),
        (MAP + "\n\n...\n", "line 9: more rows"),
        (MAP.replace("TWS", "TwS"), "line 6: 'w' in column 1 is none of"),
    ],
)
def test_an_invalid_map_is_refused_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(MapError, match=said):
        load_free_cells(written(tmp_path / "a.map", text))


def test_queries_have_row_column_and_optimal_cost(tmp_path: Path) -> None:
    path = written(tmp_path / "a.map.scen", "version 1\n0\ta b.map\t3\t2\t0\t1\t2\t0\t2.41421\n\n")
    queries = load_queries(path)
    assert queries == [ScenarioQuery((1, 0), (0, 2), 2.41421, (2, 3))]
    check_queries(queries, np.ones((2, 3), bool))
    with pytest.raises(MapError, match="query 1 of the scenario is of a map of 3 columns and 2 rows"):
        check_queries(queries, np.ones((3, 2), bool))
    with pytest.raises(MapError, match="query 1 of the scenario: its goal in column 2, row 0 is occupied"):
        check_queries(queries, np.array([[True, True, False], [True, True, True]]))
    outside = [*queries, ScenarioQuery((-1, 0), (0, 2), 2.0, (2, 3))]
    with pytest.raises(MapError, match="query 2 of the scenario: its start in column 0, row -1 lies outside"):
        check_queries(outside, np.ones((2, 3), bool))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no Moving AI scenario"),
        ("version 1\n\n", "holds no query"),
        ("version 1\n0\ta.map\t3\t2\t0\t1\t2\t0\n", "line 2: a query is nine fields"),
        ("version 1\n0\ta.map\t3\t2\t0\t1\t2\tx\t1\n", "line 2"),
        ("version 1\n0\ta.map\t3\t2\t0\t1\t2\t0\tinf\n", "line 2: inf is no cost"),
    ],
)
def test_an_invalid_scenario_is_refused_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(MapError, match=said):
        load_queries(written(tmp_path / "a.scen", text))


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(MapNotFound, match=r"a\.map"):
        load_free_cells(tmp_path / "a.map")
    with pytest.raises(MapNotFound, match=r"a\.scen"):
        load_queries(tmp_path / "a.scen")


def test_every_benchmark_map_and_scenario_is_read(data_dir: Path) -> None:
    count = 0
    for path in (data_dir / "movingai").glob("*.map"):
        free, queries = load_free_cells(path), load_queries(path.with_suffix(".map.scen"))
        check_queries(queries, free)
        assert all(free[query.start] and free[query.goal] for query in queries)
        count += len(queries)
    assert count == 16_763
