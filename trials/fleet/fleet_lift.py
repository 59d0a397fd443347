"""Three whole chairs share one lift between two storeys: two go up and one comes down, in the order of the warden.

The lift is one resource of the order, from the chair's departure to its coming out on the other storey, so that nobody stands in
the lobby in the way of a chair that leaves the cabin. Each ride is a journey (`control/journey`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import combinations
from types import MappingProxyType

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.journey.journey import JourneyPhase, Leg
from waychair.maps.traffic.traffic_graph import Refuge, Section, TrafficGraph, TrafficLift, TrafficNode
from waychair.planning.fleet.order import Order, Request, Turn, parked
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.warden import ChairReport, Heard, WardenState, decided
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.chair import Chair
from waychair.runtime.journeys import StoreyMap, Traveller, TravelState
from waychair.simulation.fleet import ChairPlan, FleetSimulator
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import load_levels
from waychair.simulation.scene.seeds import chair_seed
from waychair.topics import IMU
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import TICK_NS, DriveSetup, simulated_chair
from waychair.trials.fleet.fleet_drive import (
    AGAIN_AFTER_S,
    CLEARING_MS,
    MOST_TRIES,
    SPEED,
    STEPS_OF_ORDER,
    ChairRun,
    FleetRun,
    advance_tick,
    ticks,
)
from waychair.trials.travel.journeys import ToldRider, legs_between, lifts_between, sites_of
from waychair.types import Place, Pose2

WORLD, LIFT = "two_floors", "lift"
SCENE_S = 400.0
"""s; longest time of the scene."""

RIDE_S = 60.0
"""s that a chair takes from a hall into the lift, up or down, and out of it, as the warden foresees."""

PLACES: Mapping[str, tuple[str, Pose2]] = MappingProxyType(
    {
        "entrance": ("ground", Pose2(1.5, 2.0, 0.0)),
        "pillar": ("ground", Pose2(2.8, 3.9, 0.0)),
        "window": ("ground", Pose2(6.8, 6.1, math.pi / 2)),
        "office": ("upper", Pose2(2.9, 3.5, math.pi)),
        "shelf": ("upper", Pose2(5.4, 0.9, math.pi)),
        "gallery": ("upper", Pose2(6.8, 6.1, -math.pi / 2)),
    }
)
"""Storey and pose of all places: where the chairs start, and their goals."""

WAYS = (("entrance", "office"), ("pillar", "shelf"), ("gallery", "window"))
"""Start and goal of each chair."""


def hall_graph() -> TrafficGraph:
    """Return the traffic graph: a hall on each storey in which all chairs pass each other, its places, and the lift."""
    halls = {storey: TrafficNode(f"hall {storey}", 6.4, 3.5, storey, capacity=3) for storey in ("ground", "upper")}
    nodes = [TrafficNode(name, pose.x, pose.y, storey) for name, (storey, pose) in PLACES.items()]
    sections = [
        Section(f"to {node.name}", halls[node.storey].name, node.name, math.dist((node.x, node.y), (6.4, 3.5)), 1.0)
        for node in nodes
    ]
    below, above = (hall.name for hall in halls.values())
    ride = Section(LIFT, below, above, length=4.0, width=1.1, delay_s=RIDE_S, lift=LIFT)
    return TrafficGraph(
        WORLD,
        (*halls.values(), *nodes),
        (*sections, ride),
        tuple(Refuge(node.name, node.name) for node in nodes),
        (TrafficLift(LIFT, (below, above)),),
    )


class _Rider:
    """A chair that asks for the lift, travels when it is its turn, and says where it is in the order."""

    def __init__(self, number: int, chair: Chair, traveller: Traveller, legs: Sequence[Leg], run: ChairRun) -> None:
        self.number, self.chair, self.traveller, self.run = number, chair, traveller, run
        self.state: TravelState | None = None
        self.asked_ms: int | None = None
        self._legs = legs
        self._visit = self._behind = 0
        self._again_ms: int | None = None

    @property
    def done(self) -> bool:
        """Whether the chair is at its goal."""
        return self.run.reached == self.run.goals

    @property
    def waits(self) -> bool:
        """Whether the chair has asked for the lift and has not set off."""
        return self.asked_ms is not None and self.traveller.journey is None

    def wish(self, now_ms: int, numbers: Iterator[int]) -> Request | None:
        """Return the request for the goal, once."""
        if self.asked_ms is not None or self.state is None or not self.state.chair.localisation:
            return None
        self.asked_ms = now_ms
        return Request(next(numbers), self.number, WAYS[self.number][1], now_ms, Priority.ROUTINE)

    def step(self, order: Order, now_ms: int) -> ChairReport:
        """Set off, go on or arrive as the order and the journey allow; return where the chair is."""
        chain, journey = order.chains[self.number], self.traveller.journey
        if journey is None:
            ride = free_up_to_lift(order, self.number)
            if ride:
                self._visit, self._behind = self._visit + ride, ride
                self.traveller.go(self._legs, now_ms * 1_000_000)
        elif journey.phase is JourneyPhase.HELD:
            self._go_on(now_ms)
        elif journey.leg == len(self._legs) - 1 and journey.phase is not JourneyPhase.LEAVE and self._behind:
            self._visit, self._behind = chain.visit + 1, 0  # out of the lift, in the other hall
        elif journey.phase is JourneyPhase.ARRIVED and not self.done and self.asked_ms is not None:
            self._visit = chain.last
            self.run.reached = self.run.goals
            self.run.took_s.append((now_ms - self.asked_ms) / 1e3)
        ready_ms = (
            0 if journey is None or journey.phase is JourneyPhase.ARRIVED else round(1e3 * RIDE_S * (self._behind > 0))
        )
        return ChairReport(self.number, self._visit, self._behind, ready_ms)

    def _go_on(self, now_ms: int) -> None:
        """Let a journey that was held go on after a while, as its rider does."""
        journey = self.traveller.journey
        if self._again_ms is None and journey is not None:
            self.run.ends.append(journey.why)
            self._again_ms = now_ms + round(1e3 * AGAIN_AFTER_S)
        elif self._again_ms is not None and now_ms >= self._again_ms and self.run.again < MOST_TRIES:
            self.run.again, self._again_ms = self.run.again + 1, None
            self.traveller.go_on(now_ms * 1_000_000)


def share_lift(seed: int) -> FleetRun:
    """Let three chairs share the lift, for at most `SCENE_S`; people are about on both storeys.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    body, levels = CHAIR_A, load_levels(WORLD)
    lifts = Lifts(levels, seed)
    plans = [_plan(body, seed, k, *PLACES[start]) for k, (start, _) in enumerate(WAYS)]
    simulator = FleetSimulator(levels[0], plans, seed, lifts)
    run = FleetRun([ChairRun(1) for _ in WAYS])
    with ExitStack() as stack:
        riders = []
        for k, (start, _) in enumerate(WAYS):
            storeys = [_storey(lifts, level) for level in lifts.levels]
            here = next(each for each in storeys if each.storey == PLACES[start][0])
            setup = DriveSetup(here.grid, here.places, body, DEFAULT)
            chair = stack.enter_context(simulated_chair(setup, simulator.chairs[k]))
            riders.append(_rider(k, chair, body, lifts, storeys, run.chairs[k]))
        _travel(seed, simulator, riders, run)
    run.count_contacts(simulator)
    for own, simulated, (_, goal) in zip(run.chairs, simulator.chairs, WAYS, strict=True):
        if simulated.world.level == PLACES[goal][0]:
            own.note_end(PLACES[goal][1], simulated.truth())
    return run


def _plan(body: ChairBody, seed: int, number: int, storey: str, pose: Pose2) -> ChairPlan:
    settings = randomised_settings(chair_seed(seed, number))
    return ChairPlan(body, replace(settings, imu=replace(settings.imu, rate_hz=IMU.rate_hz)), pose, storey)


def _storey(lifts: Lifts, level: str) -> StoreyMap:
    places = {name: Place(name, pose) for name, (storey, pose) in PLACES.items() if storey == level}
    return StoreyMap(level, lifts.levels[level].grid, places, lifts.heights[level])


def _rider(
    number: int, chair: Chair, body: ChairBody, lifts: Lifts, storeys: Sequence[StoreyMap], run: ChairRun
) -> _Rider:
    """Return a chair's rider with its journey; the map of the other storey is prepared."""
    start, goal = WAYS[number]
    (here, _), (there, pose) = PLACES[start], PLACES[goal]
    sites = sites_of(lifts, body)
    legs = legs_between(sites, body, here, there, Place(goal, pose), lifts_between(lifts, here, there))
    traveller = Traveller(chair, body, storeys, sites, ToldRider(lifts), here)
    traveller.prepare(there)
    return _Rider(number, chair, traveller, legs, run)


def _travel(seed: int, simulator: FleetSimulator, riders: Sequence[_Rider], run: FleetRun) -> None:
    """Keep the order ten times a second, and let all chairs travel."""
    starts = {number: start for number, (start, _) in enumerate(WAYS)}
    district = WardenState(parked(ways_of(hall_graph(), SPEED), starts), CLEARING_MS, seed)
    numbers = iter(range(1, 1 << 30))
    for tick in ticks(simulator, run, SCENE_S, lambda: all(rider.done for rider in riders)):
        now_ms = simulator.now_ns // 1_000_000
        if tick % STEPS_OF_ORDER == 0 and tick:
            requests = tuple(wish for rider in riders if (wish := rider.wish(now_ms, numbers)) is not None)
            reports = tuple(rider.step(district.order, now_ms) for rider in riders)
            district, _, present = decided(district, Heard(reports, requests), now_ms)
            run.audit.note(present, now_ms)
            for rider, chair in zip(riders, simulator.chairs, strict=True):
                rider.run.note(now_ms / 1e3, chair, STEPS_OF_ORDER * TICK_NS * 1e-9 * rider.waits)
            run.nearest = min(run.nearest, *(simulator.between(a, b) for a, b in combinations(range(len(riders)), 2)))
        heard = advance_tick(simulator, [rider.chair for rider in riders])
        for rider, messages in zip(riders, heard, strict=True):
            rider.state = rider.traveller.step(simulator.now_ns, messages)


def free_up_to_lift(order: Order, number: int) -> int:
    """Return how many spots a chair enters to be in the lift, if all of them are free for it; else 0."""
    chain = order.chains[number]
    for k, spot in enumerate(chain.spots[1:], 1):
        resource = int(order.ways.resource[spot])
        if order.queues[resource][0] != Turn(number, chain.visit + k) or resource in order.closed:
            return 0
        if order.ways.names[spot] == LIFT:
            return k
    return 0
