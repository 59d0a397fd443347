"""Driving times learnt from finished drives."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import BuildingError
from waychair.maps.building.building import Building
from waychair.maps.building.hgraph import ArcRef, NodeRef
from waychair.maps.building.hgraph_files import read_hgraph, write_hgraph
from waychair.planning.building.hierarchical import Method, RoutePlanner
from waychair.planning.building.learnt_drives import DRIVES, arcs_driven, building_of_map, learn_drive
from waychair.types import FloatArray, IntArray

ALONG = {ArcRef("g", "v", "c1"): 4.0, ArcRef("g", "c1", "c2"): 10.0}


def drive(
    *corners: tuple[float, float], speed: float = 0.5, rest_s: float = 3.0, rate: float = 20.0
) -> tuple[IntArray, FloatArray]:
    """Return the stamps and poses of a drive along corners [m] at one speed [m/s], with a rest before and after it."""
    rows: list[tuple[float, float]] = [corners[0]] * round(rest_s * rate)
    for one, other in pairwise(corners):
        count = max(1, round(np.hypot(other[0] - one[0], other[1] - one[1]) / speed * rate))
        rows += [
            (one[0] + (other[0] - one[0]) * k / count, one[1] + (other[1] - one[1]) * k / count) for k in range(count)
        ]
    rows += [corners[-1]] * round(rest_s * rate)
    return np.arange(len(rows), dtype=np.int64) * round(1e9 / rate) + 10**18, np.array(rows)


def test_a_drive_tells_the_times_of_the_arcs_that_it_drove_without_its_rests() -> None:
    found = arcs_driven(two_storeys(), "g", *drive((3.0, 0.0), (10.0, 0.0)))
    assert {ref: [pytest.approx(seconds, abs=0.2)] for ref, seconds in ALONG.items()} == found
    assert arcs_driven(two_storeys(), "1", *drive((3.0, 30.0), (10.0, 30.0))) == {}


def test_there_and_back_are_two_times_and_half_an_arc_is_none() -> None:
    found = arcs_driven(two_storeys(), "g", *drive((5.0, 0.0), (10.0, 0.0), (5.0, 0.0), (7.0, 0.0)))
    assert {ref: len(seconds) for ref, seconds in found.items()} == {ArcRef("g", "c1", "c2"): 2}


def test_a_long_way_round_between_the_ends_of_an_arc_is_no_drive_along_it() -> None:
    found = arcs_driven(two_storeys(), "g", *drive((5.0, 0.0), (5.0, 6.0), (10.0, 6.0), (10.0, 0.0)))
    assert list(found) == [ArcRef("g/ward", "d", "e")]


def test_a_chair_that_never_moved_tells_nothing_and_impossible_drives_are_refused() -> None:
    assert arcs_driven(two_storeys(), "g", *drive((5.0, 0.0), (5.02, 0.0))) == {}
    stamps, poses = drive((3.0, 0.0), (10.0, 0.0))
    with pytest.raises(BuildingError, match="must ascend"):
        arcs_driven(two_storeys(), "g", stamps[::-1], poses)
    with pytest.raises(BuildingError, match="must be numbers"):
        arcs_driven(two_storeys(), "g", stamps, np.full_like(poses, np.nan))


def test_the_fifth_drive_replaces_the_estimate_by_the_median(tmp_path: Path) -> None:
    hgraph = two_storeys()
    storeys = tuple(replace(each, map=f"maps/{each.id}") for each in hgraph.storeys)
    write_hgraph(tmp_path, replace(hgraph, storeys=storeys))
    ends = NodeRef("g", "c1"), NodeRef("g", "c2")
    for speed in (0.5, 0.5, 0.25, 0.5):
        learn_drive(Building(tmp_path, read_hgraph(tmp_path)), "g", *drive((3.0, 0.0), (10.0, 0.0), speed=speed))
    assert RoutePlanner(read_hgraph(tmp_path), Method.ASTAR).cost(*ends) == 5000

    found = building_of_map(tmp_path / "maps" / "g")
    assert found is not None
    assert found[1] == "g"
    learn_drive(found[0], "g", *drive((3.0, 0.0), (10.0, 0.0), speed=1.0))

    assert RoutePlanner(read_hgraph(tmp_path), Method.ASTAR).cost(*ends) == pytest.approx(8000, abs=150)  # 10 s
    assert len(json.loads((tmp_path / DRIVES).read_text())["g:c1>c2"]) == 5
    assert building_of_map(tmp_path) is None


def test_a_damaged_record_of_drives_is_named(tmp_path: Path) -> None:
    write_hgraph(tmp_path, two_storeys())
    (tmp_path / DRIVES).write_text('{"g:c1>c2": [1, "soon"]}')
    building = Building(tmp_path, read_hgraph(tmp_path))
    with pytest.raises(BuildingError, match=r"drives\.json is damaged"):
        learn_drive(building, "g", *drive((3.0, 0.0), (10.0, 0.0)))
    with pytest.raises(BuildingError, match="no storey 'attic'"):
        learn_drive(building, "attic", *drive((3.0, 0.0), (10.0, 0.0)))
