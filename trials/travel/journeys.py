"""Journeys of a complete chair over the storeys of a simulated building: the shipped firmware, moving lifts, passengers.

The rider in these trials presses the lift's buttons when told to, and says yes once. Scores are by the simulator's truth:
contacts, motions of leaves round entries and exits, and whether the chair ever drove on the map of another storey.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.journey.building_legs import leg_to_lift
from waychair.control.journey.journey import JourneyPhase, Leg
from waychair.control.journey.lift_site import LOBBY_AHEAD, LOBBY_ASIDE, LiftSite
from waychair.errors import UnknownPlace
from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.maps.grid.distance_field import distance_field
from waychair.runtime.chair import ChairSettings
from waychair.runtime.journeys import StoreyMap, Traveller, TravelState
from waychair.simulation.lifts.car import DoorKind, LiftFault
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import World
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.topics import IMU
from waychair.trials.demo.demo import DemoWatcher, randomised_settings
from waychair.trials.drive import READY_S, TICK_NS, DriveSetup, advance_tick, black_box, simulated_chair
from waychair.types import FloatArray, Goal, Place, Pose2

QUIET_NS = 2_000_000_000
"""A chair must not enter or leave so near in time to a leaf's motion."""

TIME_LIMIT_S = 900.0
"""s; a journey that takes longer has not arrived."""


@dataclass(frozen=True, slots=True)
class JourneyRecord:
    """The record of one journey.

    `arrived` without help: the chair reports it and truly stands at the goal, on its level. `why` is its last sentence.
    `near_leaf`: entries and exits within 2 s of a leaf's motion, `wrong_map_s`: time in which the computer drove on
    the map of another level. `ok_s`: from each open door to a certain pose on the new map. `phases`: seconds in each phase.
    """

    start: str
    goal: str
    arrived: bool
    why: str
    seconds: float
    contacts: int
    near_leaf: int
    wrong_map_s: float
    asked: int
    rides: int
    ok_s: tuple[float, ...]
    error_m: float
    phases: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))


class ToldRider:
    """A `LiftPort` of simulated lifts: somebody presses the buttons and holds the door as the chair says."""

    def __init__(self, lifts: Lifts) -> None:
        self._lifts = lifts

    def call(self, lift: str, storey: str) -> None:
        """See `LiftPort`."""
        self._lifts.call(lift, storey)

    def hold(self, lift: str, held: bool) -> None:
        """See `LiftPort`."""
        self._lifts.hold(lift, "chair", held)

    def said(self, lift: str) -> str | None:
        """Return None: these lifts say nothing."""
        return None


def sites_of(lifts: Lifts, body: ChairBody) -> tuple[LiftSite, ...]:
    """Return every lift on every level where it stops, with a lobby that lies on free ground there."""
    found = []
    for name, known in lifts.lifts.items():
        for stop in known.stops:
            door = known.doors[stop]
            cabin = known.cabins[stop]
            ahead = (cabin.middle.inverse() @ door.middle).x
            lobby = _lobby(lifts.levels[stop], door.middle, body)
            found.append(LiftSite(name, stop, cabin.middle, cabin.length, cabin.width, ahead, door.width, lobby))
    return tuple(found)


def _lobby(world: World, door: Pose2, body: ChairBody) -> Pose2:
    """Return where the chair waits before a door, facing it, on the side with more room; straight before it if need be."""
    room = distance_field(world.grid).metres
    spots = [door @ Pose2(LOBBY_AHEAD, side * LOBBY_ASIDE) for side in (1, -1)]
    spots += [door @ Pose2(LOBBY_AHEAD + 0.4, side * 0.6) for side in (1, -1)] + [door @ Pose2(LOBBY_AHEAD + 0.6, 0.0)]
    best, most = spots[-1], -1.0
    for spot in spots:
        cell = cells_from_points(world.grid, np.array([[spot.x, spot.y]]))
        free = float(room[tuple(cell[0])]) if inside(world.grid, cell)[0] else -1.0
        if free > body.circumscribed_radius + 0.1:
            best = spot
            break
        if free > most:
            best, most = spot, free
    theta = math.atan2(door.y - best.y, door.x - best.x)
    return Pose2(best.x, best.y, theta)


def legs_between(
    sites: Sequence[LiftSite], body: ChairBody, start: str, goal: str, place: Place, lifts: Sequence[tuple[str, str]]
) -> tuple[Leg, ...]:
    """Return the legs from storey `start` to a place on storey `goal` by `lifts`, pairs of a lift and the storey it leads to."""
    known = {(site.lift, site.storey): site for site in sites}
    legs, storey = [], start
    for lift, to in lifts:
        site = known[lift, storey]
        legs.append(leg_to_lift(site, body))
        storey = to
    legs.append(Leg(goal, Goal(place.pose, place.tolerance_m, place.tolerance_rad)))
    return tuple(legs)


def lifts_between(lifts: Lifts, start: str, goal: str) -> tuple[tuple[str, str], ...]:
    """Return the fewest rides from level to level, pairs of a lift and the level it leads to; () on one level.

    Raises:
        UnknownPlace: no lifts lead there.
    """
    ways: dict[str, tuple[tuple[str, str], ...]] = {start: ()}
    front = [start]
    while front and goal not in ways:
        reached = []
        for level in front:
            for name, known in lifts.lifts.items():
                for stop in known.stops if level in known.stops else ():
                    if stop not in ways:
                        ways[stop] = (*ways[level], (name, stop))
                        reached.append(stop)
        front = reached
    if goal not in ways:
        raise UnknownPlace(f"no lift leads from '{start}' to '{goal}': choose a goal on another level")
    return ways[goal]


def journey(
    levels: Sequence[World],
    start: tuple[str, str],
    goal: tuple[str, str],
    seed: int = 0,
    passengers: int = 0,
    *,
    people: bool = True,
    imu: bool = True,
    kind: DoorKind = DoorKind.CURTAIN,
    faults: Mapping[str, LiftFault] = MappingProxyType({}),
    settings: ChairSettings | None = None,
    on_tick: Callable[[TravelState, Simulator], None] = lambda state, simulator: None,
    time_limit_s: float = TIME_LIMIT_S,
) -> JourneyRecord:
    """Travel from a place to a place, each given as level and name, on maps that are the levels' plans.

    Raises:
        UnknownPlace: there is no such place, or no lift leads there.
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    body = CHAIR_A
    worlds = {world.level: world if people else world.without_people() for world in levels}
    begin, end = (_place(worlds, *which) for which in (start, goal))
    worlds[start[0]] = replace(worlds[start[0]], start=begin.pose)
    lifts = Lifts(tuple(worlds[world.level] for world in levels), seed, passengers, kind, faults)
    simulated: SimulatorSettings = randomised_settings(seed)
    if imu:
        simulated = replace(simulated, imu=replace(simulated.imu, rate_hz=IMU.rate_hz))
    simulator = Simulator(worlds[start[0]], body, simulated, seed, lifts=lifts)
    storeys = [
        StoreyMap(level, world.grid, {place.name: place for place in world.places}, lifts.heights[level])
        for level, world in worlds.items()
    ]
    sites = sites_of(lifts, body)
    legs = legs_between(sites, body, start[0], goal[0], end, lifts_between(lifts, start[0], goal[0]))
    return travel(simulator, storeys, sites, legs, (start, goal), end, settings, on_tick, time_limit_s)


def travel(
    simulator: Simulator,
    storeys: Sequence[StoreyMap],
    sites: Sequence[LiftSite],
    legs: Sequence[Leg],
    names: tuple[tuple[str, str], tuple[str, str]],
    end: Place,
    settings: ChairSettings | None = None,
    on_tick: Callable[[TravelState, Simulator], None] = lambda state, simulator: None,
    time_limit_s: float = TIME_LIMIT_S,
    frames: Mapping[str, Pose2] = MappingProxyType({}),
    watcher: DemoWatcher | None = None,
    box: Path | None = None,
) -> JourneyRecord:
    """Travel along legs with the shipped firmware; `names` are level and place of both ends, `end` is the last place.

    `frames`: the pose of the world in each storey's map, where they differ. `watcher` sees each tick, and each change of map.
    `box`: folder of a black box.

    Raises:
        BoxError: the black box cannot be written, or another program writes it.
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    (start, _), (goal, _) = names
    body, lifts = simulator.body, simulator.lifts
    assert lifts is not None
    setups = {each.storey: _setup(each, body, settings, frames.get(each.storey, Pose2())) for each in storeys}
    watcher = watcher or DemoWatcher()
    with black_box(setups[start], box) as log, simulated_chair(setups[start], simulator, log) as chair:
        traveller = Traveller(chair, body, storeys, sites, ToldRider(lifts), start)
        watch = _Watch(simulator, lifts, [_in_world(site, frames) for site in sites])
        until_ns = simulator.now_ns + round(READY_S * 1e9)
        while simulator.now_ns < until_ns and not chair.ready:
            messages = advance_tick(simulator, chair)
            traveller.step(simulator.now_ns, messages)
        began_ns = simulator.now_ns
        traveller.go(legs, began_ns)
        for storey in {leg.storey for leg in legs} - {start}:
            traveller.prepare(storey)
        watcher.drive_began(setups[start], chair)
        watcher.goal_chosen(end.name)
        while simulator.now_ns - began_ns < time_limit_s * 1e9:
            messages, before = advance_tick(simulator, chair), traveller.storey
            state = traveller.step(simulator.now_ns, messages)
            watch.tick(state)
            on_tick(state, simulator)
            if state.storey != before:
                watcher.drive_began(setups[state.storey], chair)
                watcher.goal_chosen(end.name)
            watcher.tick_ended(messages, state.chair)
            if state.journey is None or state.journey.ended or state.journey.phase is JourneyPhase.HELD:
                break
    truth, phase = (
        setups[goal].map_from_world @ simulator.truth(),
        None if state.journey is None else state.journey.phase,
    )
    error = math.hypot(truth.x - end.pose.x, truth.y - end.pose.y)
    there = simulator.world.level == goal and error <= end.tolerance_m
    return JourneyRecord(
        start="/".join(names[0]),
        goal="/".join(names[1]),
        arrived=phase is JourneyPhase.ARRIVED and there and not watch.asked,
        why=state.order.sentence
        if phase is None or phase in (JourneyPhase.ARRIVED, JourneyPhase.HELD, JourneyPhase.FAILED)
        else f"{phase}: {state.order.sentence} ({state.chair.navigation.reason or state.chair.verdict.reason})",
        seconds=(simulator.now_ns - began_ns) * 1e-9,
        contacts=simulator.contacts,
        near_leaf=watch.near_leaf,
        wrong_map_s=watch.wrong_ticks * TICK_NS * 1e-9,
        asked=watch.asked,
        rides=watch.rides,
        ok_s=tuple(watch.ok_s),
        error_m=error,
        phases=dict(watch.phases),
    )


def _setup(storey: StoreyMap, body: ChairBody, settings: ChairSettings | None, map_from_world: Pose2) -> DriveSetup:
    return DriveSetup(
        grid=storey.grid,
        places=storey.places,
        body=body,
        calibration=DEFAULT,
        map_from_world=map_from_world,
        chair=settings or ChairSettings(),
        zones=storey.zones,
        scanned=storey.scanned,
    )


def _in_world(site: LiftSite, frames: Mapping[str, Pose2]) -> LiftSite:
    """Return a site in the world's frame instead of its storey's map."""
    world_from_map = frames.get(site.storey, Pose2()).inverse()
    return replace(site, cabin=world_from_map @ site.cabin, lobby=world_from_map @ site.lobby)


class _Watch:
    """Scores a journey, tick by tick, by the truth."""

    def __init__(self, simulator: Simulator, lifts: Lifts, sites: Sequence[LiftSite]) -> None:
        self._simulator, self._lifts = simulator, lifts
        self._sites = sites
        self.near_leaf = self.wrong_ticks = self.asked = self.rides = 0
        self.ok_s: list[float] = []
        self.phases: dict[str, float] = {}
        self._asks = False
        self._level = simulator.world.level
        self._opened_ns: int | None = None
        self._crossing: dict[str, bool] = {}
        self._crossed: dict[str, int] = {}

    def tick(self, state: TravelState) -> None:
        """Take in a tick."""
        now_ns, level = self._simulator.now_ns, self._simulator.world.level
        journey = state.journey
        assert journey is not None
        self.phases[str(journey.phase)] = self.phases.get(str(journey.phase), 0.0) + TICK_NS * 1e-9
        driving = state.chair.verdict.computer_drives
        self.wrong_ticks += driving and state.storey != level
        self.rides += level != self._level
        self._level = level
        asks = bool(state.order.ask)
        self.asked += asks and not self._asks
        self._asks = asks
        if journey.phase is JourneyPhase.RIDE:
            self._opened_ns = None
        elif journey.phase is JourneyPhase.WHICH and self._opened_ns is None:
            self._opened_ns = state.door.open_since_ns
        elif journey.phase is JourneyPhase.LEAVE and self._opened_ns is not None:
            self.ok_s.append((now_ns - self._opened_ns) * 1e-9)
            self._opened_ns = None
        self._cross(level, now_ns, driving)

    def _cross(self, level: str, now_ns: int, driving: bool) -> None:
        """Count crossings of a sill, driven by the computer, within 2 s of a motion of its leaves."""
        corners = _corners(self._simulator)
        for site in self._sites:
            if site.storey != level:
                continue
            inside = site.door.inverse()
            x = [(inside @ Pose2(px, py)).x for px, py in corners]
            y = [(inside @ Pose2(px, py)).y for px, py in corners]
            across = min(x) < 0.0 < max(x) and min(abs(each) for each in y) < site.door_width
            begins = across and not self._crossing.get(site.lift, False)
            self._crossing[site.lift] = across
            moved_ns = self._lifts.view(site.lift).leaf_moved_ns
            if begins and driving:
                self._crossed[site.lift] = now_ns
                self.near_leaf += now_ns - moved_ns < QUIET_NS
            elif across and site.lift in self._crossed and moved_ns > self._crossed[site.lift]:
                self.near_leaf += 1  # a leaf moved while the chair was between
                self._crossed.pop(site.lift)
            elif not across:
                self._crossed.pop(site.lift, None)


def _corners(simulator: Simulator) -> FloatArray:
    return transform_points(simulator.truth(), simulator.body.outline())


def _place(worlds: Mapping[str, World], level: str, name: str) -> Place:
    if level not in worlds:
        raise UnknownPlace(f"there is no level '{level}': take one of {', '.join(worlds)}")
    for place in worlds[level].places:
        if place.name == name:
            return place
    known = ", ".join(place.name for place in worlds[level].places)
    raise UnknownPlace(f"there is no place '{name}' on '{level}': take one of {known}")
