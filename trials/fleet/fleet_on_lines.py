"""Chairs without mass on the corridors of a floor plan. Their members of a fleet are real: goals, waits, and words for riders.

Each chair follows the line of its chain up to its stop line at an even speed, with no network between them that loses anything. It
goes from place to place.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.traffic.corridors import CorridorPlan, corridor_graph
from waychair.planning.fleet.peers.messages import building_of
from waychair.planning.fleet.peers.peer import Fleet
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.chain_driving import ChainDriver
from waychair.runtime.fleet.chain_geometry import drivable
from waychair.runtime.fleet.desk.desk_messages import GIVEN, TOLD
from waychair.runtime.fleet.fleet_member import FleetMember, MemberStep
from waychair.trials.fleet.fleet_scenes import places_in_rooms
from waychair.types import Pose2

SPEED = 0.45
"""m/s."""

STEP_NS = 100_000_000

_FIRST_BOOT = 1_000

_REACHED = 0.01
"""m; a goal so near is reached."""


class CarriedMessages:
    """A network that brings everything by the next step."""

    def __init__(self, numbers: Iterable[int]) -> None:
        self._boxes = {number: (deque[tuple[int, bytes]](), deque[tuple[int, bytes]]()) for number in numbers}

    def carry(self, sender: int, to: int | None, kind: str, data: bytes) -> None:
        """Bring bytes to one peer or all others; what is beside the peers' own messages is apart."""
        for number, boxes in self._boxes.items():
            if number != sender and to in (None, number):
                boxes[kind in (TOLD, GIVEN)].append((sender, data))

    def emptied(self, number: int, aside: bool) -> list[tuple[int, bytes]]:
        """Return what has come to a peer since the last time."""
        box = self._boxes[number][aside]
        return [box.popleft() for _ in range(len(box))]


class CarriedEnd:
    """One peer's end of it; see `FleetTransport`."""

    def __init__(self, messages: CarriedMessages, number: int) -> None:
        self._messages, self._number = messages, number

    def send(self, to: int | None, kind: str, data: bytes) -> None:
        """See `PeerTransport`."""
        self._messages.carry(self._number, to, kind, data)

    def received(self) -> list[tuple[int, bytes]]:
        """See `PeerTransport`."""
        return self._messages.emptied(self._number, aside=False)

    def received_aside(self) -> list[tuple[int, bytes]]:
        """See `FleetTransport`."""
        return self._messages.emptied(self._number, aside=True)

    def close(self) -> None:
        """See `PeerTransport`."""


class ChairOnLine:
    """One chair: its member of the fleet, its pose and way [m] along its chain, its goal, and when [ns] it wants the next one."""

    def __init__(self, member: FleetMember, driver: ChainDriver, pose: Pose2) -> None:
        self.member, self.driver, self.pose = member, driver, pose
        self.way = 0.0
        self.goal: str | None = None
        self.rests_ns = 0
        self._goals = 0

    def step(self, now_ns: int) -> MemberStep:
        """Run a step of the member, and follow its chain."""
        step = self.member.step(now_ns, self.pose, self._goals_left())
        chain = self.driver.chain
        if step.driven.goals is not None:
            self._goals = len(step.driven.goals)
            if chain is not None:
                self.way = max(sum(chain.reach_of(CHAIR_A, self.pose, self.driver.way, 0)) / 2, 0.0)
        if chain is None or self.goal is None:
            return step
        way = min(self.way + SPEED * STEP_NS * 1e-9, float(chain.along[-1]))
        at, heading = chain.place_at(way)
        pose = Pose2(float(at[0]), float(at[1]), heading)
        if step.driven.authority.way_left(CHAIR_A, pose, pose.array()[None]) > 0.0:
            self.way, self.pose = way, pose
        return step

    def _goals_left(self) -> int:
        """Return how many goals of the chain are left: there is one at each fold of it, and one at its end."""
        chain = self.driver.chain
        if chain is None:
            return self._goals
        ends: list[float] = [*chain.along[list(chain.folds)].tolist(), float(chain.along[-1])]
        return min(self._goals, sum(self.way < end - _REACHED for end in ends))


class ChairsOnLines:
    """Chairs 1 to n of a plan, from random rooms to random rooms in which nobody is, and to which nobody goes."""

    def __init__(self, plan: CorridorPlan, chairs: int, seed: int) -> None:
        graph = corridor_graph(plan, rooms=True, bays=True)
        ways = drivable(ways_of(graph, SPEED), CHAIR_A)
        places = dict(places_in_rooms(plan))
        numbers = range(1, chairs + 1)
        fleet = Fleet(building_of(graph), ways, frozenset(numbers))
        messages = CarriedMessages(numbers)
        self._rng = np.random.default_rng([seed, 0x11E5])
        self._rooms = sorted(places)
        self.chairs: dict[int, ChairOnLine] = {}
        for number, start in zip(numbers, self._rng.permutation(self._rooms).tolist(), strict=False):
            driver = ChainDriver(ways, number, CHAIR_A, places)
            member = FleetMember(fleet, number, _FIRST_BOOT + number, driver, start, CarriedEnd(messages, number))
            self.chairs[number] = ChairOnLine(member, driver, places[start].pose)
        self._names = ways.names

    def step(self, now_ns: int) -> dict[int, MemberStep]:
        """Let a tenth of a second pass; return the members' steps."""
        found = {}
        for number, chair in self.chairs.items():
            if chair.goal is not None and chair.driver.arrived_at(chair.goal):
                chair.goal, chair.rests_ns = None, now_ns + int(self._rng.integers(1, 5)) * 10**9
                chair.member.want(None, now_ns)
            if chair.goal is None and now_ns >= chair.rests_ns:
                taken = {self._names[other.member.entered[-1]] for other in self.chairs.values()}
                taken |= {other.goal for other in self.chairs.values() if other.goal is not None}
                chair.goal = str(self._rng.choice([room for room in self._rooms if room not in taken]))
                chair.member.want(chair.goal, now_ns)
            found[number] = chair.step(now_ns)
        return found
