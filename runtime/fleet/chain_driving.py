"""A chair drives along the chain that it was granted: it enters spots in turn, leaves them, and stops before the others.

Pure: `step` goes from the order and the chair's pose to its report, its authority and its goals. A spot is entered as soon
as the chair is so near that it could not stop before it any more, so that nobody else is let in. It waits where it
disturbs nobody: never in a door, nor at a node where others turn, unless it has to move on from worse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.authority import Authority
from waychair.maps.drawn.zones import Zone
from waychair.maps.traffic.traffic_graph import LONGEST_SECTION
from waychair.planning.fleet.order import Order, Turn
from waychair.planning.fleet.warden import ChairReport
from waychair.planning.fleet.ways import Ways
from waychair.runtime.fleet.chain_geometry import (
    ChainLine,
    SpotPlace,
    bars_off,
    chain_of,
    node_rooms,
    ring_sections,
    spot_places,
)
from waychair.types import Goal, Place, Pose2

CLAIMED_BEFORE = 1.6
"""m; a chair that is so near to a free spot enters it: it stops from its speed within less."""

AT_LINE = 0.30
"""m; a chair so near to the end of its spot is ready to leave it."""

_ANSWERS_S, _BRAKES = 0.9, 0.6
"""s and m/s²; the way to a stop that a chair is told now is that of its speed for so long, and that of so comfortable braking: its
eyes, its step and its command are 0.45 s late, and braking with the rider's jerk is half in force for 0.9 s.
"""

_SPEED_OVER_MS = 80
"""ms; the speed is measured over so long at least: two steps may be closer, with one pose."""

LEFT_BEYOND = 0.02
"""m; a spot is left when the rear is so far beyond its end."""

PATIENCE_MS = 20_000
"""ms; a chair that has waited so long before several spots that are free one after the other enters the first one."""


@dataclass(frozen=True, slots=True)
class Steps:
    """The results of a step: the report to the warden, the authority to drive, and, with a new chain, its goals.

    `bars` are zones that keep the chair on a new chain where other ways lead round it.
    """

    report: ChairReport
    authority: Authority
    goals: tuple[Goal, ...] | None = None
    bars: tuple[Zone, ...] = ()


@dataclass(frozen=True, slots=True)
class _Reach:
    """How far a chair's rear and front were along its chain [m] at its last step; its speed [m/s] since a pose at some ms."""

    rear: float = 0.0
    front: float = 0.0
    speed: float = 0.0
    pose: Pose2 | None = None
    at_ms: int = 0

    def at(self, rear: float, front: float, pose: Pose2, now_ms: int) -> _Reach:
        """Return the reach of a step at a time."""
        if self.pose is None:
            return _Reach(rear, front, 0.0, pose, now_ms)
        passed_ms = now_ms - self.at_ms
        if 0 <= passed_ms < _SPEED_OVER_MS:
            return replace(self, rear=rear, front=front)
        metres = math.dist((pose.x, pose.y), (self.pose.x, self.pose.y))
        speed = 1e3 * metres / passed_ms if passed_ms > 0 else self.speed
        return _Reach(rear, front, speed, pose, now_ms)

    @property
    def stops_at(self) -> float:
        """Where the front comes to rest [m] if the chair is told to stop now."""
        return self.front + self.speed * _ANSWERS_S + self.speed**2 / (2 * _BRAKES)


def withdrawn(order: Order, chair: int) -> Order:
    """Return the order with the spot that a chair entered last given back; it is still in the one before.

    Raises:
        ValueError: its rear has left the spot before.
    """
    chain = order.chains[chair]
    if not chain.behind:
        raise ValueError(f"chair {chair} has left the spot before, and cannot go back")
    visit, spot = chain.behind[-1]
    back = replace(chain, spots=(spot, *chain.spots), visit=visit, behind=chain.behind[:-1])
    return replace(order, chains={**order.chains, chair: back})


class ChainDriver:
    """One chair's drive along its chains, with its progress from step to step."""

    def __init__(self, ways: Ways, number: int, body: ChairBody, places: dict[str, Place]) -> None:
        """`places`: the goals in the refuges, by name."""
        self._ways, self._number, self._body, self._places = ways, number, body, places
        self._spot_places: tuple[SpotPlace, ...] = spot_places(ways)
        self._rooms = node_rooms(ways.graph)
        self._rings = ring_sections(ways.graph)
        self._visit = 0  # of the spot that the chair has entered last
        self._behind: list[int] = []  # spots that its rear has not left, the earliest first
        self._ahead: tuple[int, ...] = ()  # the spots of the present chain from the entered one on
        self._chain: ChainLine | None = None
        self._first = 0  # place of the entered spot in that chain
        self._reach = _Reach()
        self._goals: tuple[Goal, ...] = ()
        self._waits_since_ms: int | None = None

    def stand_in(self, spots: Sequence[int], visit: int | None = None) -> None:
        """Begin with a chair that is in these spots, from its rear to its front, and has no chain yet.

        `visit`: number of the front one among all that it has entered; by default they are the first ones.
        """
        self._visit, self._behind = len(spots) - 1 if visit is None else visit, list(spots[:-1])
        self._ahead = ()
        self.start_anew()

    def start_anew(self) -> None:
        """Give the goals of all that is left of the chain at the next step, as those before do not hold any more."""
        self._chain, self._goals = None, ()

    @property
    def chain(self) -> ChainLine | None:
        """The chair's chain on the floor, from the spots in which it is; None before the first step."""
        return self._chain

    @property
    def way(self) -> float:
        """The way [m] of the chair's middle along its chain."""
        return (self._reach.rear + self._reach.front) / 2

    @property
    def arrived(self) -> bool:
        """Whether the chair has entered all its spots and left all others."""
        return len(self._ahead) < 2 and not self._behind

    @property
    def unreached(self) -> int:
        """How many of the last entered spots the chair has not reached, so that it could still stop before them."""
        if self._chain is None:
            return 0
        begins = self._chain.until[self._first - len(self._behind) : self._first]
        return int(np.count_nonzero(begins > self._reach.stops_at))

    @property
    def wanted(self) -> int:
        """How many of the next spots lead to the first one in which the chair disturbs nobody by waiting; 0: no way ahead."""
        return next((k for k in range(1, len(self._ahead)) if self._may_wait_in(k)), 0)

    def arrived_at(self, refuge: str) -> bool:
        """Return whether the chair has arrived at a refuge, not at another one where it waits for its way."""
        return self.arrived and bool(self._ahead) and self._ways.names[self._ahead[0]] == refuge

    def has_way_round(self, section: str) -> bool:
        """Return whether a way round a section is known, by which the chair could go if the section were shut."""
        return section in self._rings

    def step(self, order: Order, pose: Pose2, now_ms: int, goals_left: int = 0, reason: str = "") -> Steps:
        """Return the report, authority and goals of this moment from the order and `map_from_base`.

        `goals_left` of the last goals given are still to be reached, as the navigator says.
        """
        spots = order.chains[self._number].spots
        goals = None
        if spots != self._ahead or self._chain is None:
            goals = self._take(spots, goals_left)
            goals_left = len(goals)
        assert self._chain is not None
        piece = max(len(self._chain.folds) - max(goals_left - 1, 0), 0) if self._goals else 0
        rear, front = self._chain.reach_of(self._body, pose, self.way, piece)
        self._reach = self._reach.at(rear, front, pose, now_ms)
        if self._enter(order, front, now_ms):
            self._waits_since_ms = None
        self._leave(rear, piece, goals_left)
        last = self._first + self._returns(order)
        until = float(self._chain.until[last])
        line = None if until > self._chain.ends_at(piece) or until == math.inf else self._chain.stop_line(last)
        if line is None and self._backs_out():
            here = self._spot_places[self._ahead[0]]
            beyond = self._ways.graph.section[here.section or ""].other(self._start_of(here))
            room = self._rooms[beyond, here.section or ""]
            line = self._chain.line_at(self._chain.ends_at(piece) - room, here.at(here.length - room)[2])
        left = float(self._chain.along[-1]) - self.way if until == math.inf else until - front
        ready_in_ms = 0 if left < AT_LINE or self.arrived else round(1e3 * left / self._ways.speed)
        leaves_in_ms = self._leaves_in_ms(rear, front, until, piece)
        report = ChairReport(self._number, self._visit, len(self._behind), ready_in_ms, leaves_in_ms)
        bars: tuple[Zone, ...] = ()
        if goals:
            bars = bars_off(self._ways, self._spot_places, self._rings, (*self._behind, *self._ahead))
        # a chair that was stopped on its way, in no refuge, moves only by its next chain
        stopped = len(self._ahead) == 1 and not self._ways.at_home[self._ahead[0]]
        stands = stopped or (line is not None and self._waits_at_home(front, until))
        return Steps(report, Authority(line, reason or "the chair waits for its turn", stands), goals, bars)

    def report(self) -> ChairReport:
        """Return the report of a chair that is ready to go on."""
        return ChairReport(self._number, self._visit, len(self._behind), 0)

    def withdraw(self, order: Order) -> Order:
        """Give back the section that the chair is not wholly in yet, as its way there is blocked; return the order.

        The section has to be closed for all meanwhile, as the chair's front may be in it.
        """
        if self._spot_places[self._ahead[0]].section is None or not self._behind:
            return order
        self.give_back(1)
        return withdrawn(order, self._number)

    def give_back(self, spots: int) -> None:
        """Be in the spot before so many of the last entered ones again."""
        for _ in range(spots):
            self._visit, self._first = self._visit - 1, self._first - 1
            self._ahead = (self._behind.pop(), *self._ahead)

    def section_ahead(self) -> str | None:
        """Return the name of the section that the chair is in or comes to next; None at the end of its chain."""
        for spot in self._ahead[:-1]:
            section = self._spot_places[spot].section
            if section is not None:
                return self._ways.graph.section[section].resource
        return None

    def _take(self, spots: tuple[int, ...], goals_left: int) -> tuple[Goal, ...]:
        """Follow another chain from the entered spot on; return the goals of it.

        A chair that was started again on its way into a refuge goes on into it.
        """
        name = self._ways.names[spots[0]]
        goes_in = self._chain is None and bool(self._behind) and len(spots) == 1 and name in self._places
        self._ahead = spots
        self._chain = chain_of(self._ways, self._spot_places, self._rooms, (*self._behind, *spots))
        self._first = len(self._behind)
        begins = float(self._chain.until[self._first - 1]) if self._first else 0.0
        self._reach = replace(self._reach, rear=begins, front=begins)
        bay = Goal(name)
        still = bay in self._goals[len(self._goals) - goals_left :] and self._chain.folds and len(spots) > 1
        self._goals = (*((bay,) if still or goes_in else ()), *self._goals_of(spots))
        return self._goals

    def _waits_at_home(self, front: float, until: float) -> bool:
        """Return whether the chair's rear is in a refuge at whose end its line lies, at a way [m], with its front near: it waits
        there as it is. In a hall it could turn over its line, or drive round the end of it.
        """
        assert self._chain is not None
        rearmost = (*self._behind, self._ahead[0])[0]
        own_end = float(self._chain.until[self._first - len(self._behind)])
        return bool(self._ways.at_home[rearmost]) and until - own_end < AT_LINE and until - front < CLAIMED_BEFORE

    def _leave(self, rear: float, piece: int, goals_left: int) -> None:
        """Leave the spots that the rear has passed, and all before a goal that the chair has reached."""
        assert self._chain is not None
        begins_at = self._chain.ends_at(piece - 1) if piece else -math.inf
        while self._behind:
            until = float(self._chain.until[self._first - len(self._behind)])
            arrived = self._goals and goals_left == 0 and len(self._ahead) == 1
            if not arrived and rear < until + LEFT_BEYOND and until > begins_at:
                break
            self._behind.pop(0)

    def _leaves_in_ms(self, rear: float, front: float, until: float, piece: int) -> tuple[int, ...]:
        """Return the time until the rear has left each spot behind, as far as it leaves them before it stops at a way [m] or folds."""
        assert self._chain is not None
        arrives = until == math.inf
        stops = float(self._chain.along[-1]) if arrives else until - (front - rear) / 2
        folds = self._chain.ends_at(piece)
        found = []
        for k in range(self._first - len(self._behind), self._first):
            end = float(self._chain.until[k])
            left, most = end + LEFT_BEYOND - rear, min(stops, folds) - self.way
            if end > folds or (left > most and not arrives and folds > stops):
                break
            found.append(round(1e3 * max(min(left, most), 0.0) / self._ways.speed))
        return tuple(found)

    def _backs_out(self) -> bool:
        """Return whether the entered spot is a section that the chair leaves where it came in."""
        if len(self._ahead) < 2 or self._spot_places[self._ahead[0]].section is None:
            return False
        return self._spot_places[self._ahead[1]].node == self._start_of(self._spot_places[self._ahead[0]])

    def _returns(self, order: Order) -> int:
        """Return 1 if the chain turns back at the entered node, into the section that the chair's rear is in; else 0.

        That section is the chair's own as long as nobody else comes before in its queue.
        """
        assert self._chain is not None
        if len(self._ahead) < 2 or self._first == 0 or self._ways.at_home[self._ahead[0]]:
            return 0
        begins, ends = self._chain.until[self._first - 1 : self._first + 1].tolist()
        if not any(begins <= self._chain.along[fold] <= ends for fold in self._chain.folds):
            return 0
        queue = order.queues.get(int(self._ways.resource[self._ahead[1]]), ())
        return int(bool(queue) and queue[0].chair == self._number)

    def _enter(self, order: Order, front: float, now_ms: int) -> bool:
        """Enter the next spots that are free and near, as far as the chair may wait; return whether it has."""
        assert self._chain is not None
        if front < self._chain.until[self._first] - CLAIMED_BEFORE or len(self._ahead) < 2:
            return False
        free, wanted = self._free_ahead(order), self.wanted
        if free == 0:
            return False
        if wanted > free and self._is_own(order, free + 1):
            wanted = free  # from there it can turn back to where it is
        elif wanted > free:
            self._waits_since_ms = now_ms if self._waits_since_ms is None else self._waits_since_ms
            if now_ms - self._waits_since_ms < PATIENCE_MS and self._may_wait_in(0):
                return False
            wanted = 1
        for _ in range(wanted):
            self._behind.append(self._ahead[0])
            self._ahead = self._ahead[1:]
            self._visit += 1
            self._first += 1
        return True

    def _free_ahead(self, order: Order) -> int:
        """Return how many of the next spots are free for this chair, one after the other."""
        count = 0
        for k, spot in enumerate(self._ahead[1:], 1):
            resource = int(self._ways.resource[spot])
            own = [turn for turn in order.queues[resource][:1] if turn == Turn(self._number, self._visit + k)]
            if not own or resource in order.closed:
                break
            count = k
        return count

    def _is_own(self, order: Order, k: int) -> bool:
        """Return whether spot k of those ahead is of a resource in which the chair is, and nobody else comes there before."""
        resource = int(self._ways.resource[self._ahead[k]])
        queue = order.queues[resource]
        before = queue[: queue.index(Turn(self._number, self._visit + k))]
        return bool(before) and all(turn.chair == self._number and turn.visit <= self._visit for turn in before)

    def _may_wait_in(self, k: int) -> bool:
        """Return whether the chair disturbs nobody by waiting in spot k of those ahead: in a refuge, or a section with room."""
        spot = self._ahead[k]
        if self._ways.at_home[spot] or k == len(self._ahead) - 1:
            return True
        place = self._spot_places[spot]
        if place.section is None:
            return False
        section = self._ways.graph.section[place.section]
        door = not self._ways.dead_ends.isdisjoint((section.start, section.end))
        rooms = sum(self._rooms[end, section.name] for end in (section.start, section.end))
        return not door and section.length - rooms >= self._body.length

    def _goals_of(self, spots: tuple[int, ...]) -> tuple[Goal, ...]:
        """Return the goals: refuges and nodes on the way at which the chair turns about, places to back out of, and the last."""
        goals: list[Goal] = []
        if self._behind and self._backs_out():  # its rear is still on its way in
            goals.append(Goal(self._aside(self._spot_places[spots[0]])))
        for k in range(1, len(spots) - 1):
            before, here, after = (self._spot_places[spots[each]] for each in (k - 1, k, k + 1))
            if self._ways.at_home[spots[k]] and before.section == after.section:
                goals.append(Goal(self._ways.names[spots[k]]))
            elif here.node is not None and before.section == after.section:
                goals.append(Goal(_turned(before)))
            elif here.section is not None and before.node == after.node:
                goals.append(Goal(self._aside(here)))
        if len(spots) > 1:
            goals.append(self._end_of(spots))
        return tuple(goals)

    def _end_of(self, spots: tuple[int, ...]) -> Goal:
        """Return the goal at the end of a chain: a refuge's place, else the last pose within a section or at a node.

        An order that a warden has made from the chairs' own words ends where a chair may still enter.
        """
        before, last = (self._spot_places[spot] for spot in spots[-2:])
        if self._ways.names[spots[-1]] in self._places:
            return Goal(self._ways.names[spots[-1]])
        if last.section is None:
            at, heading, _ = before.at(before.length)
        else:
            end = self._ways.graph.section[last.section].other(self._start_of(last))
            at, heading, _ = last.at(max(0.0, last.length - self._rooms[end, last.section] - self._body.front))
        return Goal(Pose2(float(at[0]), float(at[1]), heading))

    def _aside(self, place: SpotPlace) -> Pose2:
        """Return where a chair stands aside in a section: backed in, so that it faces the node by which it leaves again.

        It then does not have to turn there beside the chair that it has let pass.
        """
        length = min(place.length, LONGEST_SECTION)
        room = self._rooms[self._start_of(place), place.section or ""]
        at, inwards, _ = place.at(min(room + self._body.front + 2 * LEFT_BEYOND, length - self._body.rear))
        return Pose2(float(at[0]), float(at[1]), math.remainder(inwards + math.pi, math.tau))

    def _start_of(self, place: SpotPlace) -> str:
        section = self._ways.graph.section[place.section or ""]
        start = self._ways.graph.node[section.start]
        return section.start if math.dist((start.x, start.y), place.points[0]) < 1e-9 else section.end


def _turned(section: SpotPlace) -> Pose2:
    """Return the pose of a chair at the end of a section, turned about to go back."""
    (x0, y0), (x1, y1) = section.points[-2:].tolist()
    return Pose2(x1, y1, math.atan2(y0 - y1, x0 - x1))
