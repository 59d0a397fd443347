"""A seeded hospital as the model of a building, for its text files and its checks."""

from __future__ import annotations

from evaluation.scenes.buildings.hospital import Hospital
from waychair.maps.building.graph_arrays import NO_HEADING
from waychair.maps.building.hgraph import (
    ROOT,
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
    Way,
    child_path,
    parent_path,
)


def hgraph_of(made: Hospital) -> HGraph:
    """Return the model of a hospital, with the same costs as prices of its arcs; frames are the building's own."""
    graph = made.graph
    paths = _paths(graph.parent.tolist())
    goals, levels = set(made.goals.tolist()), graph.level.tolist()
    submap_of, parent = graph.node_submap.tolist(), graph.parent.tolist()
    cabins = {node for node in range(len(submap_of)) if submap_of[node] == 0}
    stops: list[tuple[int, int]] = []
    arcs: list[list[Arc]] = [[] for _ in paths]
    doorways: list[list[GraphDoorway]] = [[] for _ in paths]
    bridges: set[int] = set()
    columns = (graph.tail, graph.head, graph.cost, graph.reverse, graph.heading)
    rows = zip(range(len(graph.tail)), *(column.tolist() for column in columns), strict=True)
    for arc, tail, head, cost, reverse, heading in rows:
        if heading == NO_HEADING:
            if tail not in cabins:
                stops.append((head, tail))
            continue
        if 0 <= reverse < arc:
            continue
        one, other = submap_of[tail], submap_of[head]
        way = Way(price=cost / 1000.0, one_way=reverse < 0)
        if one == other:
            arcs[one].append(Arc(f"n{tail}", f"n{head}", way))
        elif parent[other] == one:
            bridges.add(head)
            doorways[one].append(GraphDoorway(f"n{tail}", paths[other].rpartition("/")[2], f"n{head}", way))
        else:
            bridges.add(tail)
            child = paths[one].rpartition("/")[2]
            doorways[other].append(GraphDoorway(f"n{head}", child, f"n{tail}", way, outwards=reverse < 0))
    at_lift = {floor for _, floor in stops}
    nodes: list[dict[str, Node]] = [{} for _ in paths]
    for node, (x, y) in enumerate(graph.xy.tolist()):
        if node in cabins:
            continue
        kind = NodeKind.LIFT if node in at_lift else NodeKind.BRIDGE if node in bridges else NodeKind.CROSS
        if node in goals and kind is NodeKind.CROSS:
            kind = NodeKind.END
        nodes[submap_of[node]][f"n{node}"] = Node(
            f"n{node}", kind, x, y, f"Place {node}" if kind is NodeKind.END else ""
        )
    submaps = {
        path: SubMap(
            path,
            storey=path if path and not parent_path(path) else "",
            nodes=each,
            arcs=tuple(own),
            doorways=tuple(out),
        )
        for path, each, own, out in zip(paths, nodes, arcs, doorways, strict=True)
    }
    storeys = tuple(Storey(path, f"Storey {path}", 3.6 * level) for level, path in enumerate(_children(paths)))
    return HGraph("Hospital", storeys, submaps, _lifts(stops, graph.xy[:, 1].tolist(), levels, submap_of, paths))


def _paths(parent: list[int]) -> list[str]:
    """Return a path for each sub-map: storeys by number, all others by their index."""
    paths, storeys = [ROOT], 0
    for index in range(1, len(parent)):
        if parent[index] == 0:
            paths.append(str(storeys))
            storeys += 1
        else:
            paths.append(child_path(paths[parent[index]], f"m{index}"))
    return paths


def _children(paths: list[str]) -> list[str]:
    return [path for path in paths if path and "/" not in path]


def _lifts(
    stops: list[tuple[int, int]], y: list[float], levels: list[int], submap_of: list[int], paths: list[str]
) -> dict[str, Lift]:
    """Return the lifts: cabins of one lift are numbered one after the other, from storey to storey."""
    lifts: dict[str, Lift] = {}
    last = -2
    for cabin, floor in sorted(stops):
        storey = paths[submap_of[floor]]
        if cabin != last + 1 or y[cabin] != y[last] or levels[cabin] != levels[last] + 1:
            lifts[f"L{len(lifts)}"] = Lift(f"L{len(lifts)}")
        key = f"L{len(lifts) - 1}"
        lift, last = lifts[key], cabin
        stop = Stop(storey, NodeRef(paths[submap_of[floor]], f"n{floor}"))
        lifts[key] = Lift(key, stops=(*lift.stops, stop))
    return lifts
