"""A small building for tests: two storeys, a ward with two rooms on each, one lift."""

from __future__ import annotations

from waychair.maps.building.hgraph import (
    Arc,
    GraphDoorway,
    HGraph,
    Lift,
    Node,
    NodeKind,
    NodeRef,
    Stop,
    Storey,
    SubMap,
    SubmapFrame,
    Way,
)


def two_storeys() -> HGraph:
    """Return the building: on each storey the corridor c1, c2, c3 along x, 5 m apart, with a lift before c1 and rooms."""
    submaps = {"": SubMap("")}
    for storey in ("g", "1"):
        corridor = [Node(f"c{i}", NodeKind.CROSS, 5.0 * i, 0.0) for i in (1, 2, 3)]
        lobby = Node("v", NodeKind.LIFT, 3.0, 0.0)
        arcs = (Arc("v", "c1"), Arc("c1", "c2"), Arc("c2", "c3"))
        doorways = (GraphDoorway("c2", "ward", "d", Way(width=0.9)), GraphDoorway("c3", "store", "d", Way(width=0.8)))
        submaps[storey] = SubMap(
            storey,
            "Ground" if storey == "g" else "First",
            storey=storey,
            nodes={node.id: node for node in (*corridor, lobby)},
            arcs=arcs,
            doorways=doorways,
        )
        for room, x in (("ward", 10.0), ("store", 15.0)):
            nodes = (Node("d", NodeKind.BRIDGE, 0.0, 0.0), Node("e", NodeKind.END, 0.0, 3.0, f"Bed {storey}"))
            submaps[f"{storey}/{room}"] = SubMap(
                f"{storey}/{room}",
                room.title(),
                SubmapFrame(x, 0.25),
                nodes={node.id: node for node in nodes},
                arcs=(Arc("d", "e"),),
            )
    lift = Lift("A", "Lift A", (Stop("g", NodeRef("g", "v")), Stop("1", NodeRef("1", "v"))))
    return HGraph("Clinic", (Storey("g", "Ground"), Storey("1", "First", 3.6)), submaps, {"A": lift})
