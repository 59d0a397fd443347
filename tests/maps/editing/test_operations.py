"""Edits of a building as data: what each makes, and what it refuses."""

from __future__ import annotations

import math

import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import WaychairError
from waychair.maps.building.checks.hgraph_checks import check
from waychair.maps.building.hgraph import Arc, ArcRef, HGraph, NodeKind, NodeRef
from waychair.maps.building.hgraph_edits import arc_ref
from waychair.maps.editing.draft import Draft
from waychair.maps.editing.edit_log import History
from waychair.maps.editing.map_edits import patch_between
from waychair.maps.editing.operations import applied, operation_of, words
from waychair.types import Json, Place, Pose2


def draft() -> Draft:
    """Return the small building with a place on each storey."""
    places = {storey: {f"Bed {storey}": Place(f"Bed {storey}", Pose2(10.0, 3.25, 1.0))} for storey in ("g", "1")}
    return Draft(two_storeys(), places, {"g": (), "1": ()})


def after(*edits: Json) -> Draft:
    """Return the draft after edits."""
    found = draft()
    for asked in edits:
        found = applied(found, operation_of(asked))
    return found


def arcs(hgraph: HGraph, path: str) -> set[frozenset[str]]:
    """Return the pairs of nodes that arcs of a sub-map join."""
    return {frozenset((arc.start, arc.end)) for arc in hgraph.submaps[path].arcs}


def test_a_goal_takes_its_place_with_it_wherever_it_goes() -> None:
    moved = after({"do": "move_nodes", "nodes": ["g/ward:e"], "x": 1.0, "y": -0.5})
    place = moved.places["g"]["Bed g"]
    assert (place.pose.x, place.pose.y, place.pose.theta) == pytest.approx((11.0, 2.75, 1.0))
    renamed = after({"do": "change_node", "node": "g/ward:e", "name": "Window"})
    assert list(renamed.places["g"]) == ["Window"]
    assert renamed.places["g"]["Window"].pose.theta == 1.0
    assert after({"do": "delete_nodes", "nodes": ["g/ward:e"]}).places["g"] == {}


def test_a_new_goal_has_a_place_and_a_free_name() -> None:
    found = after({"do": "add_node", "submap": "g/ward", "kind": "end", "x": 11.0, "y": 1.25, "joined": ["g/ward:d"]})
    node = found.hgraph.submaps["g/ward"].nodes["e1"]
    assert (node.name, node.x, node.y) == ("Place 1", 1.0, 1.0)
    assert found.places["g"]["Place 1"].pose == Pose2(11.0, 1.25)
    assert frozenset(("d", "e1")) in arcs(found.hgraph, "g/ward")


def test_two_rooms_are_joined_through_their_corridor() -> None:
    found = after({"do": "join", "one": "g/ward:e", "other": "g/store:e"})
    doors = {door.child: door for door in found.hgraph.submaps["g"].doorways if door.start == "c4"}
    assert set(doors) == {"ward", "store"}
    for child, door in doors.items():
        room = found.hgraph.submaps[f"g/{child}"]
        assert room.nodes[door.node].kind is NodeKind.BRIDGE
        assert frozenset((door.node, "e")) in arcs(found.hgraph, f"g/{child}")
    assert not [each for each in check(found.hgraph) if each.code == "E7"]


def test_a_one_way_doorway_leads_in_the_direction_of_its_edit() -> None:
    out = after({"do": "change_arc", "arc": "g:c2>ward:d", "direction": "back"})
    assert out.hgraph.submaps["g"].doorways[0].outwards
    assert out.hgraph.submaps["g"].doorways[0].way.one_way
    turned = after({"do": "change_arc", "arc": "g:c1>c2", "direction": "back", "speed": 0.3})
    arc = next(each for each in turned.hgraph.submaps["g"].arcs if {each.start, each.end} == {"c1", "c2"})
    assert (arc.start, arc.end, arc.way.one_way, arc.way.speed) == ("c2", "c1", True, 0.3)
    named_backwards = after({"do": "change_arc", "arc": "g:c2>c1", "direction": "there"})
    again = next(each for each in named_backwards.hgraph.submaps["g"].arcs if {each.start, each.end} == {"c1", "c2"})
    assert (again.start, again.end) == ("c2", "c1")


def test_a_split_node_keeps_all_its_ways_and_none_has_more_than_four() -> None:
    edits: list[Json] = [
        {"do": "add_node", "submap": "g", "x": 10.0 + 3 * math.cos(turn), "y": 3 * math.sin(turn), "joined": ["g:c2"]}
        for turn in (0.8, -0.9, -2.0)
    ]
    crowded = after(*edits)
    assert [each.place for each in check(crowded.hgraph) if each.code == "E2"] == ["g:c2"]
    split = applied(crowded, operation_of({"do": "split_node", "node": "g:c2"}))
    assert not [each for each in check(split.hgraph) if each.code in ("E1", "E2", "E11")]
    assert len(split.hgraph.submaps["g"].arcs) == len(crowded.hgraph.submaps["g"].arcs) + 1


def test_merged_nodes_have_the_arcs_of_both_and_none_twice() -> None:
    found = after({"do": "join", "one": "g:v", "other": "g:c2"}, {"do": "merge_nodes", "kept": "g:c1", "gone": "g:c2"})
    assert arcs(found.hgraph, "g") == {frozenset(("v", "c1")), frozenset(("c1", "c3"))}
    assert {door.start for door in found.hgraph.submaps["g"].doorways} == {"c1", "c3"}


def test_arcs_that_cross_share_a_node_afterwards() -> None:
    found = after(
        {"do": "add_node", "submap": "g", "x": 12.0, "y": 2.0},
        {"do": "add_node", "submap": "g", "x": 12.0, "y": -2.0, "joined": ["g:c4"]},
        {"do": "cross_arcs", "one": "g:c2>c3", "other": "g:c4>c5"},
    )
    node = found.hgraph.submaps["g"].nodes["c6"]
    assert (node.x, node.y) == pytest.approx((12.0, 0.0))
    assert {each for pair in arcs(found.hgraph, "g") if "c6" in pair for each in pair} == {"c2", "c3", "c4", "c5", "c6"}


def test_a_room_made_of_nodes_and_dissolved_again_has_the_same_ways() -> None:
    room = after({"do": "split_submap", "nodes": ["1/ward:e"], "id": "bay", "name": "Bay"})
    assert room.hgraph.node(NodeRef("1/ward/bay", "e")) is not None
    assert not [each for each in check(room.hgraph) if each.code in ("E1", "E7", "E10", "E11")]
    back = applied(room, operation_of({"do": "merge_submap", "path": "1/ward/bay"}))
    assert "1/ward/bay" not in back.hgraph.submaps
    assert not [each for each in check(back.hgraph) if each.code in ("E1", "E11")]


def test_a_moved_room_stays_where_it_is_in_the_building() -> None:
    found = after(
        {"do": "add_submap", "parent": "g", "id": "wing", "name": "Wing", "x": 4.0, "y": -1.0},
        {"do": "change_submap", "path": "g/wing", "name": "Wing", "x": 4.0, "y": -1.0, "theta": 0.5, "scale": 1.0},
        {"do": "move_submap", "path": "g/store", "to": "g/wing/store"},
    )
    assert found.map_point(NodeRef("g/wing/store", "e")) == pytest.approx((15.0, 3.25), abs=1e-3)
    with pytest.raises(WaychairError, match="below itself"):
        applied(found, operation_of({"do": "move_submap", "path": "g/wing", "to": "g/wing/x"}))


def test_a_renamed_node_keeps_its_ways_and_its_stop() -> None:
    found = after({"do": "change_node", "node": "g:v", "id": "lobby"})
    assert found.hgraph.lifts["A"].stops[0].at == NodeRef("g", "lobby")
    assert frozenset(("lobby", "c1")) in arcs(found.hgraph, "g")
    assert "v" not in found.hgraph.submaps["g"].nodes


def test_a_lift_has_one_stop_a_storey_and_its_nodes_are_free_without_it() -> None:
    found = after({"do": "set_stop", "lift": "A", "at": "1:c3", "cabin": [16.0, 0.0, 3.1], "closed": "repair"})
    stops = {stop.storey: stop for stop in found.hgraph.lifts["A"].stops}
    assert stops["1"].at == NodeRef("1", "c3")
    assert stops["1"].cabin == Pose2(16.0, 0.0, 3.1)
    assert found.hgraph.submaps["1"].nodes["v"].kind is NodeKind.CROSS
    none = applied(found, operation_of({"do": "delete_lift", "id": "A"}))
    assert not none.hgraph.lifts
    assert none.hgraph.submaps["1"].nodes["c3"].kind is NodeKind.CROSS


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"do": "dance"}, "is no edit"),
        ({"do": "add_node", "submap": "g"}, "missing required field"),
        ({"do": "add_node", "submap": "attic", "x": 0, "y": 0}, "no sub-map 'attic'"),
        ({"do": "add_node", "submap": "g", "x": 1e9, "y": 0}, "it must lie in"),
        ({"do": "add_node", "submap": "g", "x": 0, "y": 0, "kind": "stairs"}, "no kind of node"),
        ({"do": "change_node", "node": "g:c1", "id": "c 1"}, "use letters"),
        ({"do": "change_node", "node": "g:c1", "id": "c2"}, "already"),
        ({"do": "change_node", "node": "g:c1", "name": "a\nb"}, "line break"),
        ({"do": "join", "one": "g:c1", "other": "g:c1"}, "two nodes"),
        ({"do": "join", "one": "g:c1", "other": "g:c2"}, "joined already"),
        ({"do": "join", "one": "g:c1", "other": "1/ward:e"}, "cannot be joined"),
        ({"do": "change_arc", "arc": "g:c1>c2", "price": -1.0}, "it must lie in"),
        ({"do": "change_arc", "arc": "g:c1>c2", "closed": "wet", "until": "soon"}, "is no time"),
        ({"do": "split_arc", "arc": "g:c2>ward:d"}, "doorway"),
        ({"do": "cross_arcs", "one": "g:c1>c2", "other": "g:c2>c3"}, "do not cross"),
        ({"do": "delete_submap", "path": "g"}, "delete the storey instead"),
        ({"do": "change_storey", "id": "g", "name": "", "height": 1e6}, "impossible"),
        ({"do": "set_place", "storey": "g", "name": " ", "x": 0, "y": 0, "theta": 0}, "cannot be the name"),
        ({"do": "set_zone", "storey": "g", "name": "z", "rule": "slow", "polygon": [[0, 0], [1, 1]]}, "polygon"),
    ],
)
def test_an_impossible_edit_is_refused_with_its_cause(asked: Json, sentence: str) -> None:
    with pytest.raises(WaychairError, match=sentence):
        after(asked)


def test_undo_and_redo_go_through_more_than_a_hundred_steps_exactly() -> None:
    history = History(draft())
    drafts = [history.draft]
    for k in range(150):
        history = history.after(operation_of({"do": "move_nodes", "nodes": ["g:c3"], "x": 0.01 * k, "y": 0.0}))
        drafts.append(history.draft)
    for expected in reversed(drafts[:-1]):
        history = history.undone()
        assert history.draft is expected
    assert history.undone() == history
    for expected in drafts[1:]:
        history = history.redone()
        assert history.draft is expected
    assert history.undoes == "move g:c3"


def test_a_patch_holds_all_that_edits_changed() -> None:
    edits: tuple[Json, ...] = (
        {"do": "add_submap", "parent": "g", "id": "x", "name": "Cupboard"},
        {
            "do": "set_zone",
            "storey": "g",
            "name": "wet",
            "rule": "slow",
            "polygon": [[0, 0], [2, 0], [2, 2]],
            "value": 0.3,
        },
        {"do": "delete_submap", "path": "1/store"},
        {"do": "set_place", "storey": "1", "name": "Bed 1", "x": 1.0, "y": 2.0, "theta": 0.5},
    )
    before, changed = draft(), after(*edits)
    again = applied(before, patch_between("all of it", before, changed))
    assert again.hgraph == changed.hgraph
    assert again.places == changed.places
    assert [zone.name for zone in again.zones["g"]] == ["wet"]
    assert words(patch_between("all of it", before, changed)) == "all of it"


def test_an_arc_keeps_its_rules_when_a_node_is_put_on_it() -> None:
    found = after(
        {"do": "change_arc", "arc": "g:c1>c2", "direction": "there", "speed": 0.3, "length": 5.2},
        {"do": "split_arc", "arc": "g:c1>c2"},
    )
    submap = found.hgraph.submaps["g"]
    halves = [each for each in submap.arcs if "c4" in (each.start, each.end)]
    assert [(each.start, each.end) for each in halves] == [("c1", "c4"), ("c4", "c2")]
    assert all(each.way.one_way and each.way.speed == 0.3 and each.way.length is None for each in halves)
    assert isinstance(halves[0], Arc)
    assert arc_ref(submap, halves[0]) == ArcRef("g", "c1", "c4")
