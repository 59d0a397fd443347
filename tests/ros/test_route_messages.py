"""Messages about a building's graph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import BuildingError
from waychair.maps.building.hgraph import ArcRef, NodeRef, SubmapFrame
from waychair.maps.building.hgraph_edits import closed, with_submap
from waychair.maps.building.indexed import IndexedGraph, indexed
from waychair.planning.building.hierarchical import Method, RoutePlanner
from waychair.ros.messages.routes import graph_markers, require_ids, route, route_path
from waychair.ros.messages.wire import deserialised, serialised


def test_a_route_over_storeys_names_all_nodes_and_its_path_ends_at_the_lift() -> None:
    planner = RoutePlanner(two_storeys(), Method.ASTAR)
    start, goal = NodeRef("g/ward", "e"), NodeRef("1/ward", "e")
    way, first = planner.way(start, goal), planner.built.index[start]

    sent = route(5_000_000_000, planner.built, SubmapFrame(), first, way.arcs, way.cost)
    message = deserialised(serialised(sent), "nav2_msgs/msg/Route")

    assert [planner.built.refs[node.nodeid] for node in message.nodes][:3] == [
        start,
        NodeRef("g/ward", "d"),
        NodeRef("g", "c2"),
    ]
    assert planner.built.refs[message.nodes[-1].nodeid] == goal
    assert len(message.edges) == len(message.nodes) - 1 == len(way.arcs)
    assert (message.edges[0].start.y, message.edges[0].end.y) == (3.25, 0.25)
    assert message.route_cost == pytest.approx(way.cost / 1000.0)
    poses = route_path(planner.built, SubmapFrame(), first, way.arcs).poses
    assert poses[0] == pytest.approx([10.0, 3.25, -np.pi / 2])
    assert poses[-1] == pytest.approx([3.0, 0.0, np.pi])
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() <= 0.0501


def test_a_storey_that_is_turned_in_the_building_is_shown_as_in_its_map() -> None:
    hgraph = two_storeys()
    turned = with_submap(hgraph, replace(hgraph.submaps["g"], frame=SubmapFrame(2.0, 30.0, np.pi / 2)))
    built = indexed(turned)
    nodes = next(each for each in graph_markers(0, turned, built, "g").markers if each.ns == "nodes").points
    assert (10.0, 3.25) in {(round(each.x, 9), round(each.y, 9)) for each in nodes}
    frame, start = turned.storey_frame("g"), built.index[NodeRef("g/ward", "e")]
    assert route_path(built, frame, start, np.empty(0, np.int32)).poses[0, :2] == pytest.approx([10.0, 3.25])


def test_a_route_to_the_node_itself_is_one_pose() -> None:
    built = indexed(two_storeys())
    assert route_path(built, SubmapFrame(), 3, np.empty(0, np.int32)).poses.shape == (1, 3)
    assert len(route(0, built, SubmapFrame(), 3, np.empty(0, np.int32), 0).nodes) == 1


def test_the_graph_of_one_storey_is_shown_with_its_closed_arcs_and_names() -> None:
    hgraph = closed(two_storeys(), ArcRef("g", "c2", "c3"), "wet floor")
    sent = graph_markers(0, hgraph, indexed(hgraph), "g")
    markers = deserialised(serialised(sent), "visualization_msgs/msg/MarkerArray").markers
    by_name = {marker.ns: marker for marker in markers}
    assert markers[0].action == 3  # all older ones go
    assert len(by_name["nodes"].points) == 8
    assert len(by_name["arcs"].points) == 2 * 2 * 6
    assert len(by_name["closed"].points) == 2 * 2
    assert [marker.text for marker in markers if marker.ns == "names"] == ["Bed g", "Bed g"]
    assert {(marker.pose.position.x, marker.pose.position.y) for marker in markers if marker.ns == "names"} == {
        (10.0, 3.25),
        (15.0, 3.25),
    }


def test_a_graph_with_more_numbers_than_nav2_has_ids_is_refused_with_a_sentence() -> None:
    built = indexed(two_storeys())
    require_ids(built)
    many = IndexedGraph(
        built.graph, built.refs * 4000, built.index, built.paths, built.arcs, built.open_cost, built.owners
    )
    with pytest.raises(BuildingError, match=r"has 72000 nodes and .* the ids of nav2_msgs end at 65535"):
        require_ids(many)
