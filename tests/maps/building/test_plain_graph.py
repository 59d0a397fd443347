"""The plain graph of a building in one file."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import BuildingError
from waychair.maps.building.hgraph import ArcRef, NodeRef
from waychair.maps.building.hgraph_edits import closed
from waychair.maps.building.indexed import indexed
from waychair.maps.building.plain_graph import (
    PlainArc,
    plain_from_text,
    plain_graph,
    plain_text,
    read_plain,
    trajectory,
    write_plain,
)


def test_a_plain_graph_with_trajectories_comes_back(tmp_path: Path) -> None:
    hgraph = closed(two_storeys(), ArcRef("g", "c2", "c3"), "wet")
    way = trajectory([NodeRef("g/ward", "e"), NodeRef("g/ward", "d"), NodeRef("g", "c2")], 5250)
    graph = plain_graph(hgraph, indexed(hgraph), [way])
    write_plain(tmp_path / "graph.txt", graph)
    assert read_plain(tmp_path / "graph.txt") == graph
    assert PlainArc("g/ward:d", "g/ward:e", 3000) in graph.arcs
    assert PlainArc("@A:g", "@A:1", 2400) in graph.arcs
    assert not any({arc.start, arc.end} == {"g:c2", "g:c3"} for arc in graph.arcs)
    assert next(node for node in graph.nodes if node.id == "g/ward:e").y == pytest.approx(3.25)


def test_a_broken_plain_graph_is_named_with_its_line() -> None:
    graph = plain_graph(two_storeys(), indexed(two_storeys()))
    lines = plain_text(graph).splitlines(keepends=True)
    for count in range(len(lines)):
        with pytest.raises(BuildingError, match="cut off"):
            plain_from_text(Path("graph.txt"), "".join(lines[:count]))
    with pytest.raises(BuildingError, match=r"graph.txt, line 2: there is no node 'a' above"):
        plain_from_text(Path("graph.txt"), "graph name=x\narc from=a to=b cost_mm=1\nend\n")
