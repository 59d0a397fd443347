"""The four planners that the paper compares with: RaSelP, RaSelP + Plan-Break, BFSP + FWoutP and BFSP + Plan-FWP.

The paper that defines them was not to be had; this is our reading. RaSelP goes from node to node, to a random one among
those that the filters allow, and never straight back. Plan-Break cuts a branch on which a conflict is predicted; where
every way is cut, as on a tree, it goes as RaSelP does.
BFSP + FWoutP is the search without penalty, and BFSP + Plan-FWP that with penalties among chairs of equal priority.
"""

from __future__ import annotations

import enum

from waychair.errors import TrafficError
from waychair.maps.traffic.traffic_graph import Section
from waychair.planning.fleet.paper.admission import Dice
from waychair.planning.fleet.paper.messages import Command, Query
from waychair.planning.fleet.paper.network import FoundRoute, NetworkNode, NodeNetwork
from waychair.planning.fleet.paper.plan_fwpp import Conflicts

TRIES = 50
"""A random way that ends or runs in circles begins anew; after so many tries there is none."""


class PaperPreset(enum.Enum):
    """The planners of the paper by name."""

    RASELP = "raselp"
    PLAN_BREAK = "raselp+plan-break"
    FWOUTP = "bfsp+fwoutp"
    PLAN_FWP = "bfsp+plan-fwp"
    PRINTED = "fwpp-printed"
    READ = "fwpp-read"
    EXACT = "fwpp-exact"


_CONFLICTS = {
    PaperPreset.RASELP: Conflicts.NONE,
    PaperPreset.PLAN_BREAK: Conflicts.READ,
    PaperPreset.FWOUTP: Conflicts.NONE,
    PaperPreset.PLAN_FWP: Conflicts.READ,
    PaperPreset.PRINTED: Conflicts.PRINTED,
    PaperPreset.READ: Conflicts.READ,
    PaperPreset.EXACT: Conflicts.EXACT,
}


def reading_of(preset: PaperPreset) -> Conflicts:
    """Return the reading of the conflict condition that a preset's network needs."""
    return _CONFLICTS[preset]


def preset_route(
    preset: PaperPreset,
    network: NodeNetwork,
    chair: int,
    source: str,
    target: str,
    *,
    start_s: float,
    speed: float,
    dice: Dice,
    priority: int = 0,
) -> FoundRoute:
    """Return a chair's route by one of the planners and commit the network's nodes to it.

    Raises:
        TrafficError: no way is found.
    """
    if preset not in (PaperPreset.RASELP, PaperPreset.PLAN_BREAK):
        level = 0 if preset is PaperPreset.PLAN_FWP else priority
        return network.search(chair, source, target, start_s=start_s, speed=speed, priority=level)
    command = Command(chair, target, priority, speed, start_s)
    network.cancel(chair)
    cuts = (True, False) if preset is PaperPreset.PLAN_BREAK else (False,)
    for cut in cuts:
        for _ in range(TRIES):
            way = _random_way(network, source, command, dice, cut=cut)
            if way is not None:
                return network.follow(command, source, way)
    raise TrafficError(f"no random way from {source} to {target} was found in {TRIES} tries; give another planner")


def _random_way(
    network: NodeNetwork, source: str, command: Command, dice: Dice, *, cut: bool
) -> list[tuple[Section, str]] | None:
    """Return sections and nodes of a random way, or None where it ends or has more hops than there are nodes."""
    here, before, label = source, "", 0.0
    way: list[tuple[Section, str]] = []
    while here != command.target:
        node = network.nodes[here]
        node.work += 1
        options = [
            (section, neighbour, cost)
            for section, neighbour in node.neighbours
            if section.name not in network.closed
            and section.name != before
            and (neighbour == command.target or command.target in node.filters.get(neighbour, ()))
            and (cost := _predicted(network, node, section, neighbour, command, label, len(way))) is not None
        ]
        if cut:
            options = [each for each in options if each[2] <= each[0].seconds(command.speed)]
        if not options or len(way) >= len(network.nodes):
            return None
        section, here, _ = options[dice.randrange(len(options))]
        network.messages["Query"] += 1
        before, label = section.name, label + section.seconds(command.speed)
        way.append((section, here))
    return way


def _predicted(
    network: NodeNetwork, node: NetworkNode, section: Section, neighbour: str, command: Command, label: float, hops: int
) -> float:
    query = Query(0, command, node.name, section.name, label, hops, network.stops.timer_s)
    return network.cost_at(neighbour, section, query)
