"""The goals of a building for menus: where each is, and how long the way there takes from here, with how many lifts."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.calibration.chair_body import ChairBody
from waychair.control.journey.building_legs import legs_of_route
from waychair.control.journey.journey import Leg
from waychair.control.journey.lift_site import LiftSite
from waychair.maps.building.building import goals
from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import NO_HEADING
from waychair.maps.building.hgraph import HGraph, NodeRef, ancestors
from waychair.planning.building.graph_search import ArcWay
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.runtime.pages.chair_port import GoalView
from waychair.types import Goal, Place


def goal_views(planner: RoutePlanner, start: NodeRef | None = None, aside_m: float = 0.0) -> tuple[GoalView, ...]:
    """Return the building's goals by storey, from bottom to top, each with its way from a node.

    Args:
        planner: of the building; its costs, over the building's usual speed, are the driving times.
        start: the node next to the chair; None: the times are unknown.
        aside_m: cost [m of straight driving] from the chair to that node.

    Times and lifts of a goal to which there is no way are None.
    """
    hgraph = planner.hgraph
    order = {storey.id: number for number, storey in enumerate(hgraph.storeys)}
    known = sorted(goals(hgraph).items(), key=lambda named: order.get(hgraph.storey_of(named[1].submap), len(order)))
    costs = {} if start is None else planner.costs_from(start, [ref for _, ref in known])
    found = []
    for name, ref in known:
        seconds = lifts = None
        if start is not None and costs[ref] < CLOSED_MM:
            seconds = (costs[ref] * 1e-3 + aside_m) / hgraph.costs.speed_mps
            lifts = rides_of(planner, planner.way(start, ref))
        found.append(GoalView(name, menu_path(hgraph, ref), seconds, lifts))
    return tuple(found)


def legs_to(
    planner: RoutePlanner, sites: Sequence[LiftSite], body: ChairBody, start: NodeRef, goal: NodeRef, place: Place
) -> tuple[Leg, ...]:
    """Return the legs from a node to the place of a goal's node.

    Raises:
        BuildingError: a lift on the way has no cabin.
        NoPath: there is no way.
    """
    end = Goal(place.pose, place.tolerance_m, place.tolerance_rad)
    return legs_of_route(planner.hgraph, planner.route(start, goal), sites, body, end)


def menu_path(hgraph: HGraph, ref: NodeRef) -> tuple[str, ...]:
    """Return the menus that lead to a goal, and its name; a room with the goal's own name is no menu of its own."""
    node = hgraph.node(ref)
    own = ref.node if node is None else node.name or node.id
    titles = [hgraph.submaps[path].title for path in ancestors(ref.submap)[1:] if path in hgraph.submaps]
    return (*(titles[:-1] if len(titles) > 1 and titles[-1] == own else titles), own)


def rides_of(planner: RoutePlanner, way: ArcWay) -> int:
    """Return the number of lifts that a way takes."""
    graph, refs = planner.built.graph, planner.built.refs
    taken = []
    for arc in way.arcs.tolist():
        ends = (refs[graph.tail[arc]].submap, refs[graph.head[arc]].submap)
        taken.append("" if graph.heading[arc] != NO_HEADING else next(each for each in ends if each.startswith("@")))
    return sum(lift != "" and (k == 0 or taken[k - 1] != lift) for k, lift in enumerate(taken))
