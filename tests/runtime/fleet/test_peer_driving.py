"""Chairs that drive along chains which their peers agreed on over a network."""

from __future__ import annotations

import numpy as np

from tests.runtime.fleet.test_fleet_member import PLAN
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.traffic.corridors import corridor_graph
from waychair.planning.fleet.order import Turn
from waychair.planning.fleet.peers.messages import building_of
from waychair.planning.fleet.peers.peer import Fleet, OwnWish, Peer
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.alone_driving import Seen
from waychair.runtime.fleet.chain_driving import ChainDriver
from waychair.runtime.fleet.chain_geometry import drivable, spot_places
from waychair.runtime.fleet.peer_driving import PeerDriver, PeerSteps, seen_order
from waychair.runtime.fleet.spot_sight import SpotSight
from waychair.simulation.network import NetworkFaults, SeededNetwork
from waychair.simulation.plan.corridor_world import corridor_world
from waychair.trials.fleet.fleet_scenes import places_in_rooms
from waychair.types import FloatArray, Pose2

GRAPH = corridor_graph(PLAN, 1.2, rooms=True, bays=True)
WAYS = drivable(ways_of(GRAPH, 0.5), CHAIR_A)
PLACES = dict(places_in_rooms(PLAN))
ROOMS = [refuge.name for refuge in GRAPH.refuges]
STEP_NS = 100_000_000
SPEED = 0.5


class _Points:
    """Chairs without mass that follow the polylines of their chains up to the stop lines, over a seeded network."""

    def __init__(self, starts: dict[int, str], faults: NetworkFaults) -> None:
        self.network = SeededNetwork(3, faults)
        fleet = Fleet(building_of(GRAPH), WAYS, frozenset(starts))
        self.chairs = {
            k: PeerDriver(WAYS, Peer(fleet, k, 100 + k), ChainDriver(WAYS, k, CHAIR_A, PLACES), start)
            for k, start in starts.items()
        }
        self.poses = {k: PLACES[start].pose for k, start in starts.items()}
        self.way = dict.fromkeys(starts, 0.0)
        self.wishes: dict[int, OwnWish | None] = dict.fromkeys(starts)
        self.steps: dict[int, PeerSteps] = {}
        self.sights: dict[int, SpotSight] = {}
        self.now_ns = 10**10

    def step(self) -> None:
        self.now_ns += STEP_NS
        for k, chair in self.chairs.items():
            heard = self.network.received(self.now_ns, k)
            left = len(chair.driver._goals) if not self._is_at_end(k) else 0
            self.steps[k] = chair.step(
                self.now_ns, self.poses[k], left, heard, self.wishes[k], sight=self.sights.get(k)
            )
            for to, _, data in self.steps[k].peer.send:
                others = [to] if to is not None else [other for other in self.chairs if other != k]
                self.network.send(self.now_ns, k, others, data)
            self._drive(k)
        used: dict[int, int] = {}
        for k, chair in self.chairs.items():
            for spot in chair.entered:
                assert used.setdefault(int(WAYS.resource[spot]), k) == k

    def _is_at_end(self, k: int) -> bool:
        chain = self.chairs[k].driver._chain
        return chain is not None and self.way[k] >= chain.along[-1] - 0.01

    def _drive(self, k: int) -> None:
        """Move along the chain until the front of the outline would cross the stop line."""
        driver = self.chairs[k].driver
        chain = driver._chain
        if chain is None or len(chain.along) < 2:
            return
        if self.steps[k].driven.goals is not None:
            rear, front = chain.reach_of(CHAIR_A, self.poses[k], driver.way, 0)
            self.way[k] = max((rear + front) / 2, 0.0)
        way = min(self.way[k] + SPEED * STEP_NS * 1e-9, float(chain.along[-1]))
        at, heading = chain.place_at(way)
        pose = Pose2(float(at[0]), float(at[1]), heading)
        if self.steps[k].driven.authority.way_left(CHAIR_A, pose, pose.array()[None]) > 0.0:
            self.way[k], self.poses[k] = way, pose


class _Eyes(SpotSight):
    """The sight of a chair to which a test shows things."""

    things: FloatArray = np.empty((0, 2))

    def seen(self, map_from_base: Pose2) -> Seen:
        """See `SpotSight`."""
        return Seen(map_from_base, self.taken_by(self.things), self.things, CHAIR_A.front)


def test_a_chair_knows_only_what_it_may_enter() -> None:
    chain = [int(each) for each in (WAYS.after[WAYS.first[0]], 2, 3)]
    order = seen_order(WAYS, 4, (0,), 7, chain, 1)
    assert order.may_enter(4)
    assert order.queues[int(WAYS.resource[2])][0] != Turn(4, 9)
    assert not seen_order(WAYS, 4, (0,), 7, chain, 0).may_enter(4)


def test_two_chairs_exchange_places_over_a_network_that_loses_and_delays() -> None:
    points = _Points({1: ROOMS[0], 2: ROOMS[-1]}, NetworkFaults(loss=0.1, doubled=0.1, delay_ms=20.0))
    for _ in range(60):
        points.step()
    points.wishes = {1: OwnWish(1, ROOMS[-1], 0, points.now_ns), 2: OwnWish(1, ROOMS[0], 0, points.now_ns)}
    for _ in range(3000):
        points.step()
        if all(points.chairs[k].entered == (WAYS.slots[ROOMS[end]][0],) for k, end in ((1, -1), (2, 0))):
            break
    assert points.chairs[1].entered == (WAYS.slots[ROOMS[-1]][0],)
    assert points.chairs[2].entered == (WAYS.slots[ROOMS[0]][0],)


def test_a_chair_with_nobody_about_leaves_its_room_at_once_and_stands_nowhere() -> None:
    points = _Points({1: ROOMS[0]}, NetworkFaults())
    points.step()
    points.wishes = {1: OwnWish(1, ROOMS[-1], 0, points.now_ns)}
    still = longest = 0
    while points.chairs[1].entered != (WAYS.slots[ROOMS[-1]][0],):
        before = points.poses[1]
        points.step()
        still = still + 1 if points.poses[1] == before else 0
        longest = max(longest, still)
    assert longest * STEP_NS <= 1e9


def test_a_chair_that_stands_for_another_one_says_for_whom_all_the_time() -> None:
    points = _Points({1: ROOMS[0], 2: ROOMS[1]}, NetworkFaults())
    for _ in range(60):
        points.step()
    points.wishes = {1: OwnWish(1, ROOMS[-1], 0, points.now_ns), 2: OwnWish(1, ROOMS[-2], 0, points.now_ns)}
    without, told = dict.fromkeys(points.chairs, 0), 0
    for _ in range(130):
        before = dict(points.poses)
        points.step()
        for k, chair in points.chairs.items():
            stands = points.poses[k] == before[k]
            says = chair.waits and f"chair {3 - k}" in chair.authority.sentence
            told += stands and says
            without[k] = without[k] + 1 if stands and not says else 0
            assert without[k] * STEP_NS <= 1e9
    assert told * STEP_NS >= 2e9


def test_a_chair_alone_gives_the_spots_that_it_has_not_reached_back_when_something_comes_there() -> None:
    """Its front is where it says, so that an order that is made from its words holds."""
    points = _Points({1: ROOMS[0], 2: ROOMS[-2]}, NetworkFaults())
    eyes = _Eyes(WAYS, corridor_world(PLAN, 1.2, rooms=True).grid, CHAIR_A)
    points.network.part([[1]])
    points.sights = {1: eyes}
    points.wishes[1] = OwnWish(1, ROOMS[-1], 0, points.now_ns)
    chair = points.chairs[1]
    while chair.driver.unreached < 2:
        points.step()
    assert chair.authority.alone
    entered, far = chair.entered, chair.driver.unreached
    x, y = (float(each) for each in spot_places(WAYS)[entered[-1]].at(0.5)[0])
    eyes.things = np.stack([np.full(9, x), y + np.linspace(-0.3, 0.3, 9)], axis=1)
    points.step()
    assert chair.entered == entered[:-far]
    for _ in range(50):
        points.step()
    assert chair.entered[-1] == entered[-far - 1]
    eyes.things = _Eyes.things
    for _ in range(1200):
        points.step()
    assert chair.entered == (WAYS.slots[ROOMS[-1]][0],)
