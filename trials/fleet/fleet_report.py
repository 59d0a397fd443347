"""Hours of chairs by the coordinator's order in a building, and what they say: which corridor costs most, where a bay helps."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from waychair.maps.traffic.single_file import Run, runs
from waychair.maps.traffic.traffic_graph import Refuge, RefugeKind, Section, TrafficGraph, TrafficNode
from waychair.planning.fleet.waits import Audit, jain
from waychair.simulation.graph_traffic.crowd import CrowdModel
from waychair.trials.fleet.fleet_graph import mean
from waychair.trials.fleet.fleet_ordered import OrderedChairs, Stops, chairs_on
from waychair.types import Json

BAY_DEPTH = 1.0
"""m from the middle of a corridor to a chair in a bay beside it."""


@dataclass(frozen=True, slots=True)
class OrderedHours:
    """The figures of one run.

    Attributes:
        hours: simulated [h], to the lock-up if there was one.
        delays: s of each task that was done.
        waited_s: how long chairs waited before each place, by its name.
        foreseen_right: share of waits foreseen within 5 s or a quarter; None without any.
        jain: index of fairness of the chairs' delays over their ways.
    """

    hours: float
    delays: tuple[float, ...]
    waited_s: Mapping[str, float]
    foreseen_right: float | None
    jain: float
    most_overtaken: int
    locked_up: bool


@dataclass(frozen=True, slots=True)
class BestBay:
    """The node beside which one bay saves most, the corridor, and the mean delay [s] without and with it."""

    node: str
    corridor: str
    before_s: float
    after_s: float

    @property
    def sentence(self) -> str:
        """The finding in words."""
        return (
            f"One bay beside {self.node}, in the corridor {self.corridor}, saves most: mean delay {self.before_s:.1f} s "
            f"without and {self.after_s:.1f} s with it"
        )

    def as_json(self) -> Json:
        """Return the finding for a report."""
        return {"beside": self.node, "corridor": self.corridor, "mean_delay_s": [self.before_s, self.after_s]}


def stops_by_people(graph: TrafficGraph, persons: int) -> Stops:
    """Return the stops of chairs that stand for people who come towards them, by the walkers of `CrowdModel`.

    Half of the people on a section come towards a chair that enters it; it stands until the person is past.
    """
    model = CrowdModel()
    lengths = [section.length for section in graph.sections if section.lift is None]
    if not lengths or persons == 0:
        return Stops()
    mean = float(np.mean(lengths))
    meetings = persons / 2 * mean / sum(lengths) * (1 + model.chair_speed / model.walking_speed)
    return Stops(1.0 - math.exp(-meetings), (mean / 2 + model.stand_distance) / model.walking_speed)


def ordered_hours(
    graph: TrafficGraph,
    *,
    chairs: int,
    hours: float,
    seed: int,
    stops: Stops,
    rounds: int = 30,
    top: int | None = None,
    log: Callable[[Json], None] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> OrderedHours:
    """Return what some chairs do for some hours that go from place to place by the coordinator's order.

    `top` is the chair of top priority, `log` hears every record for the audit, `progress` the share (0 to 1) that is done.

    Raises:
        TaskError: there are not more places than chairs.
    """
    audit = Audit()
    world = chairs_on(graph, chairs, seed, stops=stops, audit=audit, log=log, rounds=rounds, top=top)
    going = world.run(round(hours * 3.6e6), progress)
    waited: Counter[str] = Counter()
    for each in audit.ended:
        waited[each["place"]] += each["real_s"]
    return OrderedHours(
        hours if going else world.now_ms / 3.6e6,
        tuple(task.delay_s for task in world.done),
        dict(waited),
        audit.foreseen_right(),
        jain([delay_per_way(world, chair) for chair in world.order.chains if chair != top]),
        world.most_overtaken,
        not going,
    )


def delay_per_way(world: OrderedChairs, chair: int) -> float:
    """Return a chair's delay over the time that its ways take alone."""
    own = [task for task in world.done if task.chair == chair]
    return sum(task.took_ms - task.alone_ms for task in own) / max(sum(task.alone_ms for task in own), 1)


def waits_by_corridor(graph: TrafficGraph, waited_s: Mapping[str, float]) -> dict[str, float]:
    """Return how long chairs waited [s] for each corridor or lift, the most first.

    A corridor is a run, named by its ends; a wait for a node counts for the first run that has it.
    """
    corridor_of: dict[str, str] = {}
    for run in runs(graph):
        for part in (*run.sections, *run.nodes):
            corridor_of.setdefault(part, corridor_name(run))
    at = {refuge.name: refuge.node for refuge in graph.refuges}
    found: dict[str, float] = {}
    for place, seconds in waited_s.items():
        name = corridor_of.get(place) or corridor_of.get(at.get(place, ""), place)
        found[name] = found.get(name, 0.0) + seconds
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def corridor_sentence(graph: TrafficGraph, by_corridor: Mapping[str, float], hours: float) -> str | None:
    """Return which corridor costs most waiting, in words, by the waits [s] of some hours; None if nobody waited for one."""
    lifts = {lift.name for lift in graph.lifts}
    costly = next(((name, seconds) for name, seconds in by_corridor.items() if name not in lifts), None)
    if costly is None:
        return None
    share = costly[1] / sum(by_corridor.values())
    return (
        f"The corridor {costly[0]} costs most: chairs wait {costly[1] / hours:.0f} s an hour for it, "
        f"{share:.0%} of all waiting"
    )


def corridor_name(run: Run) -> str:
    """Return a run's name for people: its ends."""
    return f"{run.nodes[0]} to {run.nodes[-1]}"


def with_bay(graph: TrafficGraph, node: str) -> TrafficGraph:
    """Return the graph with a bay for one chair beside a node."""
    where = graph.node[node]
    name = f"bay beside {node}"
    width = min(section.width for section in graph.sections if node in (section.start, section.end))
    return replace(
        graph,
        nodes=(*graph.nodes, TrafficNode(name, where.x, where.y + BAY_DEPTH, where.storey)),
        sections=(*graph.sections, Section(f"way to {name}", node, name, BAY_DEPTH, width)),
        refuges=(*graph.refuges, Refuge(name, name, kind=RefugeKind.BAY, waiting=True)),
        revision=graph.revision + 1,
    )


def bay_that_helps(
    graph: TrafficGraph,
    *,
    chairs: int,
    hours: float,
    seed: int,
    stops: Stops,
    tries: int,
    top: int | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> BestBay | None:
    """Return where one bay saves most for some chairs in some hours, with the same tasks and stops; None if none saves any.

    `progress` is called with the share (0 to 1) of the runs that is done.

    Raises:
        TaskError: there are not more places than chairs.
    """

    runs_done = 0

    def run(other: TrafficGraph) -> OrderedHours:
        nonlocal runs_done
        before, runs_done = runs_done, runs_done + 1
        return ordered_hours(
            other,
            chairs=chairs,
            hours=hours,
            seed=seed,
            stops=stops,
            top=top,
            progress=lambda share: progress((before + share) / (tries + 1)),
        )

    before = run(graph)
    if not before.delays:
        return None
    return best_bay(graph, mean(before.delays), before.waited_s, tries, lambda other: mean(run(other).delays))


def best_bay(
    graph: TrafficGraph,
    before_s: float,
    waited_s: Mapping[str, float],
    tries: int,
    again: Callable[[TrafficGraph], float],
) -> BestBay | None:
    """Return where one bay saves most, of the middles of the corridors with the most waiting; None if none saves any.

    `again` returns the mean delay [s] in a graph with a bay, of the same chairs, tasks and people.
    """
    lifts = {lift.name for lift in graph.lifts}
    by_name = {corridor_name(run): run for run in runs(graph)}
    costly = [name for name in waits_by_corridor(graph, waited_s) if name not in lifts and name in by_name][:tries]
    found: list[BestBay] = []
    for name in costly:
        nodes = [node for node in by_name[name].nodes if node not in graph.refuge_at]
        if nodes:
            node = nodes[len(nodes) // 2]
            found.append(BestBay(node, name, before_s, again(with_bay(graph, node))))
    best = min(found, key=lambda bay: bay.after_s, default=None)
    return best if best is not None and best.after_s < before_s else None
