"""All lifts of a building: cars, leaves on every level, passengers, and the chairs that ride.

    levels = load_levels("two_floors")
    lifts = Lifts(levels, seed=1, passengers=2)
    simulator = Simulator(levels[0], body, settings, seed=1, lifts=lifts)
    lifts.call("lift", "ground")

The simulators of one building's chairs share one object and step it; the first of them to reach a time moves the cars.
Same seed, same calls: same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import WorldError
from waychair.simulation.lifts.car import Car, DoorKind, LeafObstruction, LiftFault
from waychair.simulation.lifts.lift_doors import LiftDoor, door_of
from waychair.simulation.lifts.passengers import (
    CHAIR_GAP,
    PASSENGER_GAP,
    PASSES_S,
    PAUSE_S,
    RADIUS,
    SPOT_AHEAD,
    SPOT_ASIDE,
    Doing,
    Passenger,
    slots_of,
)
from waychair.simulation.plan.world import World
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.simulation.scene.moving import SlidingLeaf
from waychair.simulation.scene.scene import Block, LiftCabin, PersonState
from waychair.simulation.scene.seeds import random_stream
from waychair.types import FloatArray, Pose2

STEP_NS = 20_000_000
"""Step of cars, leaves and passengers; a ride's acceleration is exact at any time."""

SLAB = 0.3
"""m; thickness of a floor: levels lie a room's height and this above each other."""

_CHAIR_CIRCLES = ((0.0, 0.35), (0.3, 0.35), (0.6, 0.3))
"""m; places ahead of the axle and radii of the circles that passengers keep away from."""


@dataclass(frozen=True, slots=True)
class CallableLift:
    """A lift with its stops: the names of its levels from bottom to top, its cabin and doorway on each level's map."""

    cabins: Mapping[str, LiftCabin]
    stops: tuple[str, ...]
    doors: Mapping[str, LiftDoor]

    @property
    def name(self) -> str:
        """The lift's name."""
        return self.cabins[self.stops[0]].name

    def carried(self, pose: Pose2, here: str, there: str) -> Pose2:
        """Return where something that stands in the cabin on one level's map is on another's."""
        return self.cabins[there].middle @ self.cabins[here].middle.inverse() @ pose


@dataclass(slots=True)
class _Chair:
    """A chair: its level, pose in map and body; `rides` is the lift that carries it."""

    level: str
    pose: Pose2
    body: ChairBody
    rides: str = ""
    struck: bool = False


@dataclass(frozen=True, slots=True)
class LiftView:
    """A lift at one moment: the level at which its car is or to which it rides, and its door there.

    `opened`: part of the way, 0 to 1. `leaf_moved_ns`: stamp of a leaf's last motion.
    """

    level: str
    riding: bool
    opened: float
    leaf_moved_ns: int


class Lifts:
    """The lifts of a building."""

    def __init__(
        self,
        levels: Sequence[World],
        seed: int = 0,
        passengers: int = 0,
        kind: DoorKind = DoorKind.CURTAIN,
        faults: Mapping[str, LiftFault] = MappingProxyType({}),
        heights: Mapping[str, float] | None = None,
    ) -> None:
        """`levels` from bottom to top; `passengers` people travel all the time; `faults` by the lifts' names.

        `heights` [m] of the levels' floors; by default each is a room's height and a slab above the one below.

        Raises:
            WorldError: a lift has no door on one of its levels.
        """
        self.levels = {world.level: world for world in levels}
        heights = dict(heights or _heights(levels))
        self.lifts: dict[str, CallableLift] = {}
        self._cars: dict[str, Car] = {}
        for name, cabins in _lifts_of(levels).items():
            stops = tuple(cabins)
            doors = {stop: door_of(lift, self.levels[stop]) for stop, lift in cabins.items()}
            self.lifts[name] = CallableLift(cabins, stops, doors)
            width = min(door.width for door in doors.values())
            self._cars[name] = Car(
                tuple(heights[stop] for stop in stops), width, kind=kind, fault=faults.get(name, LiftFault.NONE)
            )
        self.heights = heights
        self._rng = random_stream(seed, 7)
        self._passengers = [self._new_passenger() for _ in range(passengers if self.lifts else 0)]
        self._chairs: dict[str, _Chair] = {}
        self._now_ns = 0

    def call(self, lift: str, level: str) -> None:
        """Press a button: that of the hall at a level, or that of the cabin for a level.

        Raises:
            WorldError: there is no such lift, or it does not stop there.
        """
        self._car(lift).call(self._stop(lift, level), self._now_ns)

    def hold(self, lift: str, who: str, held: bool = True) -> None:
        """Hold the door open, as an assistant at the button or a building's adapter does, or no longer.

        Raises:
            WorldError: there is no such lift.
        """
        car = self._car(lift)
        (car.holds.add if held else car.holds.discard)(who)

    def view(self, lift: str) -> LiftView:
        """Return a lift now.

        Raises:
            WorldError: there is no such lift.
        """
        car = self._car(lift)
        return LiftView(self.lifts[lift].stops[car.at], car.ride is not None, car.opened, car.leaf_moved_ns)

    def came_from(self, lift: str) -> str:
        """Return the level at which a lift's last ride, or its present one, began.

        Raises:
            WorldError: there is no such lift.
        """
        return self.lifts[lift].stops[self._car(lift).came_from]

    def note_chair(self, key: str, level: str, pose: Pose2, body: ChairBody) -> None:
        """Take in where a chair is; `key` is its own."""
        before = self._chairs.get(key)
        if before is None:
            self._chairs[key] = _Chair(level, pose, body)
        else:
            before.level, before.pose = level, pose

    def is_struck(self, key: str) -> bool:
        """Return whether a leaf presses on a chair."""
        return self._chairs[key].struck

    def level_of(self, key: str) -> str:
        """Return the level of a chair, which a ride changes as it begins: nobody sees it behind closed leaves."""
        return self._chairs[key].level

    def pose_of(self, key: str) -> Pose2:
        """Return the pose of a chair on its level's map."""
        return self._chairs[key].pose

    def acceleration(self, key: str, now_ns: int) -> float:
        """Return the vertical acceleration [m/s^2] of a chair."""
        rides = self._chairs[key].rides
        return self._cars[rides].acceleration(now_ns) if rides else 0.0

    def height(self, key: str, now_ns: int) -> float:
        """Return the height [m] of the floor below a chair, above that of the lowest level."""
        chair = self._chairs[key]
        return self._cars[chair.rides].height(now_ns) if chair.rides else self.heights[chair.level]

    def sliding_leaves(self, level: str) -> tuple[SlidingLeaf, ...]:
        """Return all leaves on a level, in the order of `leaves`."""
        return tuple(leaf for each in self._on(level) for leaf in each.doors[level].leaves)

    def leaves(self, level: str) -> tuple[Block, ...]:
        """Return the leaves on a level as they are now."""
        return tuple(
            leaf.block(self._opened(each.name, level)) for each in self._on(level) for leaf in each.doors[level].leaves
        )

    def moving(self, level: str) -> bool:
        """Return whether a leaf on a level may have moved in the last step."""
        return any(
            self._cars[each.name].moves != 0 or self._now_ns - self._cars[each.name].leaf_moved_ns <= 2 * STEP_NS
            for each in self._on(level)
        )

    def people(self, level: str) -> tuple[PersonState, ...]:
        """Return the passengers on a level."""
        return tuple(each.state() for each in self._passengers if each.here and self._level_of(each) == level)

    def step(self, now_ns: int) -> None:
        """Let time pass up to a stamp; a time already reached changes nothing."""
        while self._now_ns + STEP_NS <= now_ns:
            self._now_ns += STEP_NS
            for name in self._cars:
                self._step_car(name)
            for passenger in self._passengers:
                self._step_passenger(passenger)

    def _step_car(self, name: str) -> None:
        car, known, now_ns = self._cars[name], self.lifts[name], self._now_ns
        level = known.stops[car.at]
        closes = car.opened > 0.0
        struck = self._obstruction(known, level, car) if closes else LeafObstruction.NONE
        begins = car.step(now_ns, STEP_NS * 1e-9, struck)
        if begins:
            here, there = known.stops[car.came_from], known.stops[car.at]
            for chair in self._chairs.values():
                if chair.level == here and known.cabins[here].holds(chair.pose):
                    chair.level, chair.rides, chair.pose = there, name, known.carried(chair.pose, here, there)
            for who in self._passengers:
                if self._name_of(who) == name and self._is_aboard(who, known, here):
                    pose = known.carried(Pose2(who.x, who.y, who.heading), here, there)
                    who.x, who.y, who.heading, who.doing, who.way = pose.x, pose.y, pose.theta, Doing.RIDES, []
        elif car.ride is None:
            for chair in self._chairs.values():
                chair.rides = "" if chair.rides == name else chair.rides

    def _is_aboard(self, who: Passenger, known: CallableLift, level: str) -> bool:
        """Return whether a passenger is in the cabin at a level: also one that had not reached its place, or not got out."""
        if who.doing is Doing.RIDES:
            return True
        return who.here and known.stops[who.stop] == level and known.cabins[level].holds(Pose2(who.x, who.y))

    def _obstruction(self, known: CallableLift, level: str, car: Car) -> LeafObstruction:
        """Return what is in the way of the leaves' next step, and note the chairs that they press on."""
        door = known.doors[level]
        after = max(0.0, car.opened - 0.3 * STEP_NS * 1e-9 / (door.width / 2))
        leaves = solid_from_blocks([leaf.block(after) for leaf in door.leaves])
        between = solid_from_blocks([Block(door.middle @ Pose2(0.0, 0.0, math.pi / 2), door.width, 0.1, 0.0, 2.0)])
        found = LeafObstruction.NONE
        for chair in self._chairs.values():
            chair.struck = False
            if chair.level != level or chair.rides:
                continue
            if car.moves < 0 and in_contact(leaves, chair.body, chair.pose):
                chair.struck, found = True, LeafObstruction.TOUCHED
            elif found is LeafObstruction.NONE and in_contact(between, chair.body, chair.pose):
                found = LeafObstruction.BETWEEN
        for each in self._passengers:
            if found is not LeafObstruction.NONE or not each.here or self._level_of(each) != level:
                continue
            at = door.middle.inverse() @ Pose2(each.x, each.y)
            if abs(at.x) < RADIUS and abs(at.y) < door.width / 2:
                shown = door.width / 2 * (1.0 - after)
                touches = door.width / 2 - abs(at.y) < shown + RADIUS
                found = LeafObstruction.TOUCHED if touches and car.moves < 0 else LeafObstruction.BETWEEN
        return found

    def _new_passenger(self) -> Passenger:
        names = list(self.lifts)
        until = self._rng.uniform(0.0, PAUSE_S[1])
        return Passenger(
            lift=int(self._rng.integers(len(names))), until_ns=round(until * 1e9), seed=int(self._rng.integers(2**31))
        )

    def _step_passenger(self, who: Passenger) -> None:
        name = self._name_of(who)
        known, car, now_ns = self.lifts[name], self._cars[name], self._now_ns
        actions: Mapping[Doing, Callable[[], None]] = {
            Doing.AWAY: lambda: self._appear(who, known, now_ns),
            Doing.WAITS: lambda: self._wait(who, known, car),
            Doing.ENTERS: lambda: self._enter(who, known, car),
            Doing.RIDES: lambda: self._ride(who, known, car),
            Doing.LEAVES: lambda: self._leave(who, known, car),
        }
        actions[who.doing]()

    def _appear(self, who: Passenger, known: CallableLift, now_ns: int) -> None:
        if now_ns < who.until_ns:
            return
        stop, wants = (int(k) for k in self._rng.choice(len(known.stops), 2, replace=False))
        spot = known.doors[known.stops[stop]].middle @ Pose2(SPOT_AHEAD, -SPOT_ASIDE)
        crowd = self._others(who, known.stops[stop])
        who.until_ns = now_ns + 2_000_000_000  # tried again then, if somebody stands there
        if len(crowd) and (np.hypot(crowd[:, 0] - spot.x, crowd[:, 1] - spot.y) < crowd[:, 2] + 1.0).any():
            return
        who.stop, who.wants, who.x, who.y = stop, wants, spot.x, spot.y
        who.heading, who.doing, who.way = spot.theta + math.pi, Doing.WAITS, []

    def _wait(self, who: Passenger, known: CallableLift, car: Car) -> None:
        who.speed = 0.0
        if car.at != who.stop or car.ride is not None:
            car.call(who.stop, self._now_ns)
            return
        if car.opened < 1.0:
            if car.opened == 0.0 and not car.calls:  # nobody else wants to set off
                car.call(who.stop, self._now_ns)
            return
        slot = self._free_slot(who, known)
        if slot is None or self._busy_doorway(who, known):
            return
        who.slot, who.doing = slot, Doing.ENTERS
        level = known.stops[who.stop]
        cabin, door = known.cabins[level], known.doors[level].middle
        inside = cabin.middle @ Pose2(*slots_of(cabin.length, cabin.width)[slot])
        ahead, behind = door @ Pose2(0.6, 0.0), door @ Pose2(-0.4, 0.0)
        who.way = [(ahead.x, ahead.y), (behind.x, behind.y), (inside.x, inside.y)]

    def _enter(self, who: Passenger, known: CallableLift, car: Car) -> None:
        if who.walk(STEP_NS * 1e-9, self._others(who, known.stops[who.stop])):
            who.doing, who.heading = Doing.RIDES, known.cabins[known.stops[who.stop]].middle.theta
            car.call(who.wants, self._now_ns)

    def _ride(self, who: Passenger, known: CallableLift, car: Car) -> None:
        who.speed = 0.0
        if car.ride is None and car.opened >= 1.0 and car.at == who.wants:
            door = known.doors[known.stops[car.at]].middle
            who.stop, who.doing = car.at, Doing.LEAVES
            points = (door @ Pose2(-0.4, 0.0), door @ Pose2(0.6, 0.0), door @ Pose2(SPOT_AHEAD, SPOT_ASIDE))
            who.way = [(point.x, point.y) for point in points]
        elif car.ride is None and car.at != who.wants and car.opened == 0.0:
            car.call(who.wants, self._now_ns)

    def _leave(self, who: Passenger, known: CallableLift, car: Car) -> None:
        there = who.walk(STEP_NS * 1e-9, self._others(who, known.stops[who.stop], behind=False))
        if who.speed > 0.0 or len(who.way) > 1:
            who.until_ns = self._now_ns + round(PASSES_S * 1e9)
        if there or self._now_ns >= who.until_ns:
            pause = self._rng.uniform(*PAUSE_S)
            who.doing, who.until_ns = Doing.AWAY, self._now_ns + round(pause * 1e9)
            who.lift = int(self._rng.integers(len(self.lifts)))

    def _free_slot(self, who: Passenger, known: CallableLift) -> int | None:
        """Return a place in the cabin with room, None without one."""
        crowd = self._others(who, known.stops[who.stop])
        taken = {
            each.slot
            for each in self._passengers
            if each.doing in (Doing.ENTERS, Doing.RIDES) and each.lift == who.lift
        }
        cabin = known.cabins[known.stops[who.stop]]
        for number, (x, y) in enumerate(slots_of(cabin.length, cabin.width)):
            at = cabin.middle @ Pose2(x, y)
            away = np.hypot(crowd[:, 0] - at.x, crowd[:, 1] - at.y) - crowd[:, 2] if len(crowd) else np.array([9.0])
            if number not in taken and away.min() > RADIUS + 0.35:
                return number
        return None

    def _busy_doorway(self, who: Passenger, known: CallableLift) -> bool:
        """Return whether a chair is near the doorway, or somebody leaves or is about to, so that others wait."""
        others = [each for each in self._passengers if each.lift == who.lift]
        leave = any(each.doing is Doing.LEAVES and each.stop == who.stop for each in others)
        if leave or any(each.doing is Doing.RIDES and each.wants == who.stop for each in others):
            return True
        door = known.doors[known.stops[who.stop]].middle
        crowd = self._others(who, known.stops[who.stop], waiting=False)
        return bool(len(crowd) and (np.hypot(crowd[:, 0] - door.x, crowd[:, 1] - door.y) < 1.9).any())

    def _others(self, who: Passenger, level: str, waiting: bool = True, behind: bool = True) -> FloatArray:
        """Return chairs and other passengers on a level as (N, 4) x, y [map], radius and gap that a passenger keeps [m].

        Without those `behind`: they leave the same lift and have farther to go, so that of two one always goes first.
        """
        found = [
            (each.x, each.y, RADIUS, PASSENGER_GAP)
            for each in self._passengers
            if each is not who
            and each.here
            and (waiting or each.doing is Doing.LEAVES)
            and (behind or not each.is_behind(who))
            and self._level_of(each) == level
        ]
        for chair in self._chairs.values():
            if chair.level == level:
                for ahead, radius in _CHAIR_CIRCLES:
                    at = chair.pose @ Pose2(ahead, 0.0)
                    found.append((at.x, at.y, radius, CHAIR_GAP))
        return np.array(found).reshape(-1, 4)

    def _level_of(self, who: Passenger) -> str:
        name = self._name_of(who)
        stop = self._cars[name].at if who.doing is Doing.RIDES else who.stop
        return self.lifts[name].stops[stop]

    def _name_of(self, who: Passenger) -> str:
        return list(self.lifts)[who.lift]

    def _opened(self, name: str, level: str) -> float:
        car = self._cars[name]
        return car.opened if car.ride is None and self.lifts[name].stops[car.at] == level else 0.0

    def _on(self, level: str) -> Iterator[CallableLift]:
        return (each for each in self.lifts.values() if level in each.doors)

    def _car(self, lift: str) -> Car:
        if lift not in self._cars:
            raise WorldError(f"there is no lift '{lift}': take {', '.join(self._cars) or 'a building that has one'}")
        return self._cars[lift]

    def _stop(self, lift: str, level: str) -> int:
        self._car(lift)
        stops = self.lifts[lift].stops
        if level not in stops:
            raise WorldError(f"the lift '{lift}' does not stop at '{level}': take one of {', '.join(stops)}")
        return stops.index(level)


def _heights(levels: Sequence[World]) -> dict[str, float]:
    """Return the heights [m] of the levels' floors above the lowest."""
    heights, height = {}, 0.0
    for world in levels:
        heights[world.level] = height
        height += world.finish.height + SLAB
    return heights


def _lifts_of(levels: Sequence[World]) -> dict[str, dict[str, LiftCabin]]:
    """Return each lift by its name, and by the levels at which it stops."""
    known: dict[str, dict[str, LiftCabin]] = {}
    for world in levels:
        for lift in world.lifts:
            known.setdefault(lift.name, {})[world.level] = lift
    return known
