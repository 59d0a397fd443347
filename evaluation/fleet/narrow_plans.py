"""The paper's floor plans by cells in which nobody can pass, and one task each beside the proven best ways."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.maps.traffic.corridors import corridor_cells, load_corridors, room_doors
from waychair.maps.traffic.traffic_graph import Refuge, RefugeKind, Section, TrafficGraph, TrafficNode
from waychair.planning.fleet.cbs import Constraint, barred_entries, barred_uses, best_ways
from waychair.planning.fleet.granting import CBS_STEPS, granted
from waychair.planning.fleet.order import Request, Turn, asked, foreseen, parked
from waychair.planning.fleet.sipp import Stay, earliest, gaps_between
from waychair.planning.fleet.ways import Ways
from waychair.trials.fleet.fleet_ordered import CLEARING_MS


def cell_traffic(name: str, bays: bool) -> TrafficGraph:
    """Return a floor plan by cells of 1 m in which nobody can pass, with rooms beside the corridors as refuges.

    With `bays`, any chair may step aside into any room.
    """
    plan = load_corridors(name)
    cells = sorted(corridor_cells(plan))
    nodes = [TrafficNode(f"{x},{y}", x, y) for x, y in cells]
    sections = [
        Section(f"{x},{y}-{x + dx},{y + dy}", f"{x},{y}", f"{x + dx},{y + dy}", 1.0, 1.2)
        for x, y in cells
        for dx, dy in ((1, 0), (0, 1))
        if (x + dx, y + dy) in set(cells)
    ]
    refuges = []
    for room, (door, place) in room_doors(plan).items():
        nodes.append(TrafficNode(room, *place))
        sections.append(Section(f"door of {room}", f"{round(door[0])},{round(door[1])}", room, 1.0, 1.2))
        refuges.append(Refuge(room, room, waiting=bays, kind=RefugeKind.BAY if bays else RefugeKind.PLACE))
    return TrafficGraph(name, tuple(nodes), tuple(sections), tuple(refuges))


@dataclass(frozen=True, slots=True)
class OneTask:
    """The delay a chair [s] of one task each, all at once: by the proven best ways (None without proof), by rounds of large
    neighbourhood search alone, and as the coordinator grants them."""

    best_s: float | None
    rounds_s: float
    granted_s: float


def one_task(ways: Ways, chairs: int, seed: int, steps: int = 2000, rounds: int = 60) -> OneTask:
    """Return the delays of chairs that go from random rooms to random rooms of others or free ones."""
    rng = np.random.default_rng([seed, chairs])
    rooms, goals = (rng.permutation(sorted(ways.slots))[:chairs].tolist() for _ in range(2))
    order = parked(ways, dict(enumerate(rooms)))
    for chair, goal in enumerate(goals):
        order = asked(order, Request(chair, chair, goal, 0))
    starts = [order.chains[chair].spots[0] for chair in range(chairs)]
    alone = sum(int(ways.least_ms(goal)[start]) for start, goal in zip(starts, goals, strict=True))
    alone -= sum(start not in ways.slots[goal] for start, goal in zip(starts, goals, strict=True))

    def way_of(chair: int, constraints: tuple[Constraint, ...]) -> tuple[Stay, ...]:
        gaps = gaps_between(ways, barred_uses(ways, constraints), 0)
        return earliest(ways, gaps, starts[chair], 0, goals[chair], CLEARING_MS, barred=barred_entries(constraints))

    best = best_ways(ways, dict.fromkeys(range(chairs), 1.0), way_of, CLEARING_MS, steps)

    def delay_s(arrivals: float) -> float:
        return 1e-3 * (arrivals - alone) / chairs

    def by(proof_steps: int) -> float:
        new = granted(order, 0, CLEARING_MS, np.random.default_rng(seed), rounds, proof_steps)
        times = foreseen(new, 0, CLEARING_MS)
        if times is None or new.waiting:
            return math.inf
        return delay_s(sum(times[Turn(chair, chain.last)].from_ms for chair, chain in new.chains.items()))

    return OneTask(None if best is None else delay_s(best.price), by(0), by(CBS_STEPS))
