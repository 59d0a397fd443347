"""Places by touch: simulated drivers without sight, led through buildings among people, to a door that is shut, and round one.

`BLIND_PLACES_RUNS=2` takes so many drives of each route instead of 20; `BLIND_PLACES_ONLY="ward to bath"` takes the routes whose
names hold this, `BLIND_PLACES_BASELINES=0` leaves out full autonomy.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.guided_drives import GuidedBars, GuidedRun, autonomous_run, guided_row, guided_runs
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.grid.distance_field import distance_field
from waychair.runtime.haptics.haptic_guide import OTHER_STEPS
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan
from waychair.trials.guiding.guided import GuidedSetup
from waychair.trials.navigate import world_with_people
from waychair.types import Json, Pose2

RUNS = int(os.environ.get("BLIND_PLACES_RUNS", "20"))
ONLY = os.environ.get("BLIND_PLACES_ONLY", "")
BASELINES = os.environ.get("BLIND_PLACES_BASELINES", "1") == "1"

BARS = GuidedBars(0.97, s_per_m=4.5, m_per_m=1.10, symbols_per_s=1.2)


@dataclass(frozen=True, slots=True)
class BlindRoute:
    """A drive from place to place of a world ("": from its start), with so many people, and a door that is `shut`, if any.

    `leads_round`: there is another way than through that door. `stands`: a door in which somebody stands for `STANDS_S`, goes aside
    for as long, and comes back.
    """

    world: str
    start: str
    goal: str
    people: int = 0
    shut: str = ""
    leads_round: bool = False
    stands: str = ""
    limit_s: float = 300.0

    @property
    def name(self) -> str:
        """The row's name."""
        beside = f", {self.people} people" if self.people else ""
        at_door = f", {self.shut} shut" if self.shut else f", somebody in the door {self.stands}" if self.stands else ""
        return f"{self.world}: {self.start or 'start'} to {self.goal}{beside}{at_door}"


def _both(world: str, start: str, goal: str, people: int, limit_s: float = 300.0) -> tuple[BlindRoute, BlindRoute]:
    return BlindRoute(world, start, goal, limit_s=limit_s), BlindRoute(world, start, goal, people, limit_s=limit_s)


ROUTES = (
    *_both("small_clinic", "entrance", "reception", 4),
    *_both("small_clinic", "reception", "ward", 4),
    *_both("small_clinic", "ward", "bath", 4),
    *_both("apartment", "", "kitchen", 1),
    *_both("apartment", "kitchen", "bath", 1),
    *_both("apartment", "bath", "bedroom", 1),
    *_both("apartment", "bedroom", "living_room", 1),
    *_both("second_floor", "classroom", "lift", 6, 420.0),
    BlindRoute("small_clinic", "ward", "bath", shut="bath"),
    BlindRoute("apartment", "bath", "bedroom", shut="bedroom", leads_round=True),
    BlindRoute("small_clinic", "ward", "bath", stands="bath"),
)


def blind_places(out: Path) -> Json:
    """Arrivals, contacts, times and ways of each route, beside full autonomy.

    At a door that is shut, or in which somebody stands, each driver is told that it is so, and waits or is led round.
    """
    routes = [route for route in ROUTES if ONLY in route.name]
    rows = [_row(route, "guide") for route in routes]
    passed = all(row["passed"] for row in rows)
    if BASELINES:
        rows += [_row(route, "autonomy") for route in routes]
    return {"passed": passed, "rows": rows}


def drive_route(route: BlindRoute, how: str, seed: int) -> GuidedRun:
    """Drive one chair of this seed along a route; the map shows all doors open."""
    plan = load_world(route.world)
    places = {place.name: place for place in plan.places}
    start = places[route.start].pose if route.start else plan.start
    world = world_with_people(plan, start, route.people, seed)
    world = world.with_closed([route.shut]) if route.shut else world
    world = with_somebody_in(world, route.stands, places[route.goal].pose) if route.stands else world
    setup = GuidedSetup(world, plan.grid, CHAIR_A, seed=seed)
    if how == "autonomy":
        return autonomous_run(setup, places[route.goal], route.limit_s)
    return guided_runs(setup, [places[route.goal]], route.limit_s)[0]


STANDS_S, ASIDE_M = 105.0, 1.6
"""s for which somebody stands in a door, some 20 s longer than a driver needs to come to it, and m from it to the place aside."""


def with_somebody_in(world: World, name: str, goal: Pose2) -> World:
    """Return a world with somebody who steps into a door, stands there, and goes back later.

    The place aside is on the goal's side of the door, and off its axis.
    """
    door = next(each for each in world.doors if each.name == name)
    middle = np.array([door.middle.x, door.middle.y])
    beyond = (door.middle.inverse() @ goal).y > 0.0
    off_wall = door.middle.theta + np.radians([55.0, 125.0] if beyond else [235.0, 305.0])
    places = middle + ASIDE_M * np.column_stack([np.cos(off_wall), np.sin(off_wall)])
    rows, columns = cells_from_points(world.grid, places).T
    aside = places[np.argmax(distance_field(world.grid).metres[rows, columns])]
    person = PersonPlan(PersonBehaviour.PATH, np.array([aside, middle]), speed=0.8, rest=STANDS_S)
    return replace(world, people=(*world.people, person))


def _row(route: BlindRoute, how: str) -> Json:
    found = over_seeds(f"blind place {route.name} {how}", partial(drive_route, route, how), RUNS)
    if how == "autonomy":
        return guided_row(route.name, how, found)
    if not (route.shut or route.stands):
        return guided_row(route.name, how, found, BARS)
    arrives = not route.shut or route.leads_round
    row = guided_row(route.name, how, found, GuidedBars(BARS.share) if arrives else None)
    row["told_why"] = sum(any(_tells_why(sentence, route) for sentence in each.announced) for each in found)
    held = row["passed"] if arrives else not row["contacts"] and not row["reached"]
    row["passed"] = held and row["told_why"] == len(found)
    return row


def _tells_why(sentence: str, route: BlindRoute) -> bool:
    """Return whether a sentence says that the rider has to wait for the door, or, where a way leads round, that other steps do."""
    return (sentence.startswith("Wait: ") and "door" in sentence) or (
        route.leads_round and sentence.endswith(OTHER_STEPS)
    )
