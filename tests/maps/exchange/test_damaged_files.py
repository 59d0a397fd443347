"""Files of other programs with one value or part of a wrong kind: a sentence each, never another error."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from waychair.errors import BuildingError
from waychair.maps.building.building import load_building
from waychair.maps.building.checks.hgraph_checks import check
from waychair.maps.drawn.places import load_places
from waychair.maps.exchange.flat_graph import write_imported
from waychair.maps.exchange.open_rmf import building_from_open_rmf
from waychair.maps.exchange.route_graph import building_from_route_graph
from waychair.planning.building.surroundings import surroundings

WRONG: tuple[Any, ...] = (None, float("nan"), 1e300, -5, "x", "", [], {}, True, 10**400, "é\n", [1], {"a": 1}, 0)

RMF: dict[str, Any] = {
    "name": "house",
    "levels": {
        "L1": {
            "elevation": 0.0,
            "vertices": [
                [0, 0, 0, "a"],
                [100, 0, 0, "b"],
                [100, 80, 0, ""],
                [0, 80, 0, "lift", {"lift_cabin": [1, "A"]}],
            ],
            "measurements": [[0, 1, {"distance": [3, 10.0]}]],
            "lanes": [[0, 1, {"bidirectional": [4, True], "graph_idx": [2, 0]}], [1, 3, {"graph_idx": [2, 0]}]],
            "walls": [[0, 1, {}], [1, 2, {}]],
            "doors": [[1, 2, {"name": [1, "d"], "type": [1, "hinged"]}]],
            "floors": [{"vertices": [0, 1, 2]}],
            "fiducials": [[0, 0, "f"], [100, 0, "g"]],
        },
        "L2": {
            "elevation": 3.0,
            "vertices": [[0, 0, 0, "c"], [50, 0, 0, "lift", {"lift_cabin": [1, "A"]}]],
            "lanes": [[0, 1, {"graph_idx": [2, 0]}]],
            "fiducials": [[0, 0, "f"], [50, 0, "g"]],
        },
    },
    "lifts": {"A": {"level_doors": {"L1": ["d"], "L2": ["e"]}, "width": 1.4, "depth": 1.4, "x": 1.0, "y": 2.0}},
}
NAV2: dict[str, Any] = {
    "type": "FeatureCollection",
    "features": [
        *(
            {
                "type": "Feature",
                "geometry": {"type": "Point", "coordinates": [float(k), 0.0]},
                "properties": {"id": k, "frame": "map", "metadata": {"storey": "g", "name": f"n{k}"}},
            }
            for k in range(3)
        ),
        {
            "type": "Feature",
            "geometry": {"type": "MultiLineString", "coordinates": [[[0.0, 0.0], [1.0, 0.0]]]},
            "properties": {"id": 7, "startid": 0, "endid": 1, "metadata": {"abs_speed_limit": 0.4}, "operations": {}},
        },
    ],
}


def paths(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the keys to each part of nested lists and dictionaries."""
    if at:
        yield at
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield from paths(part, (*at, key))


def damaged(value: Any) -> Iterator[Any]:
    """Yield copies in which one part is missing, doubled or another value, for each part; seeded."""
    rng = random.Random(4)
    for *before, last in paths(value):
        for wrong in (*rng.sample(WRONG, 3), "missing"):
            new = copy.deepcopy(value)
            part = new
            for key in before:
                part = part[key]
            if wrong == "missing":
                del part[last]
            else:
                part[last] = wrong
            yield new


def test_the_undamaged_buildings_are_read() -> None:
    assert len(building_from_open_rmf(yaml.safe_dump(RMF).encode(), "a.building.yaml", None).hgraph.lifts) == 1
    assert len(building_from_route_graph(json.dumps(NAV2).encode(), "a.geojson").hgraph.submaps["g"].nodes) == 3


def refusals(value: Any, read: Callable[[Any], object]) -> list[str]:
    """Return the sentences with which damaged copies are refused; any other error is raised."""
    found = []
    for values in damaged(value):
        try:
            read(values)
        except BuildingError as error:
            found.append(str(error))
    return found


def test_an_open_rmf_building_with_one_wrong_part_is_read_or_refused_with_a_sentence() -> None:
    found = refusals(RMF, lambda values: building_from_open_rmf(yaml.safe_dump(values).encode(), "a.yaml", None))
    assert len(found) > 50
    assert [each for each in found if "\n" in each or len(each) > 300] == []


def test_a_route_graph_with_one_wrong_part_is_read_or_refused_with_a_sentence() -> None:
    found = refusals(NAV2, lambda values: building_from_route_graph(json.dumps(values).encode(), "a.geojson"))
    assert len(found) > 50
    assert [each for each in found if "\n" in each or len(each) > 300] == []


@pytest.mark.parametrize("size", [1e300, float("nan"), -1.0, "wide", True])
def test_an_impossible_width_of_a_lift_is_left_out(size: Any) -> None:
    values = copy.deepcopy(RMF)
    values["lifts"]["A"] |= {"width": size, "doors": {"d": {"width": size}}}
    lift = building_from_open_rmf(yaml.safe_dump(values).encode(), "a.yaml", None).hgraph.lifts["A"]
    assert (lift.cabin_width, lift.door_width, lift.cabin_depth) == (None, None, 1.4)


@pytest.mark.parametrize("part", ["vertices", "lanes", "walls", "doors", "floors", "measurements", "fiducials"])
def test_a_part_of_a_level_that_is_no_list_is_named(part: str) -> None:
    values = copy.deepcopy(RMF)
    values["levels"]["L2"][part] = 5
    with pytest.raises(BuildingError, match=f"the {part} of level 'L2' of a.building.yaml are no list"):
        building_from_open_rmf(yaml.safe_dump(values).encode(), "a.building.yaml", None)


def test_the_goals_of_an_imported_building_with_walls_are_places_of_its_map(tmp_path: Path) -> None:
    write_imported(tmp_path / "house", building_from_open_rmf(yaml.safe_dump(RMF).encode(), "a.yaml", None))
    found = check(load_building(tmp_path / "house").hgraph, surroundings(load_building(tmp_path / "house")))
    assert [each.sentence for each in found if "is no place" in each.sentence] == []
    assert set(load_places(tmp_path / "house" / "maps" / "L1")) == {"a", "b"}
