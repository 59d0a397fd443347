"""A working shift: one chair, switched on once, drives from place to place for hours, among walking people.

A shift has a building, people, a door that is closed although the map shows it open, and random places. It shows
failures that single drives do not show: slow growth and rare events.
"""

from __future__ import annotations

import math
import resource
from collections import Counter
from dataclasses import dataclass

import numpy as np

from evaluation.scenes.hazards import ContactCause, contact_cause, least_to_people
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import PlanningError
from waychair.maps.grid.cells import points_from_cells
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.global_planner import plan
from waychair.simulation.plan.world import World, load_world
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveRecord, DriveSetup, drive_to_place, simulated_chair
from waychair.trials.navigate import with_walkers
from waychair.trials.ride import RecordingSimulator
from waychair.types import Place, Pose2

BUILDINGS = ("small_clinic", "second_floor", "basement")
PLACES = 8
"""The number of random places besides the building's named ones."""

_PLACE_DISTANCE = 0.6  # [m] from a random place to anything solid
_PLACE_CLEARANCE = 0.05  # [m] clearance of the footprint there
_MOST_FAILURES = 3
"""The shift ends after so many failed drives in a row."""


@dataclass(frozen=True, slots=True)
class Shift:
    """The result of a shift: simulated time [s], distance driven [m], drives, and contacts by kind.

    `failures`: place and reason of each failed drive. `person_m` [m]: least distance to a person while the chair moved.
    `tick_ms`: 99th percentile of the control step in the first and the last tenth of the ticks. `grown_mb`: growth of
    the program's memory after the first drive.
    """

    building: str
    seed: int
    shut: str
    seconds: float
    way_m: float
    drives: int
    reached: int
    failures: tuple[str, ...]
    struck: dict[str, int]
    person_m: float
    tick_ms: tuple[float, float]
    grown_mb: float

    @property
    def at_fault(self) -> int:
        """The number of contacts that the chair caused."""
        return sum(count for what, count in self.struck.items() if what != ContactCause.BUMPED.value)


def run_shift(building: str, seed: int, seconds: float, people: int = 3) -> Shift:
    """Run a shift of `seconds` of simulated time; the drive under way at the end is finished.

    Raises:
        WorldError: the building does not exist, or it has no space for so many people.
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    rng = np.random.default_rng(seed)
    whole = load_world(building)
    shut, world = _with_closed_door(whole, rng)
    places = _places(whole, costmap_from_grid(world.grid, CHAIR_A), rng)
    simulator = RecordingSimulator(with_walkers(world, people, seed), CHAIR_A, randomised_settings(seed), seed)
    setup = DriveSetup(whole.grid, places, CHAIR_A, DEFAULT)
    legs: list[DriveRecord] = []
    hits: Counter[str] = Counter()
    nearest, grown_from, began_ns, in_vain = math.inf, 0.0, simulator.now_ns, 0
    with simulated_chair(setup, simulator) as chair:
        at = ""
        while simulator.now_ns - began_ns < seconds * 1e9 and in_vain < _MOST_FAILURES:
            at = str(rng.choice([name for name in places if name != at]))
            reports = len(simulator.contact_reports)
            leg = drive_to_place(setup, simulator, chair, at)
            motion = simulator.motion()
            hits.update(
                contact_cause(contact, simulator.world, CHAIR_A, motion).value
                for contact in simulator.contact_reports[reports:]
            )
            nearest = min(nearest, least_to_people(motion))
            simulator.clear_motion()
            in_vain = 0 if leg.reached else in_vain + 1
            legs.append(leg)
            grown_from = grown_from or _memory_mb()
    ticks = np.concatenate([leg.tick_ms for leg in legs])
    tenth = max(1, len(ticks) // 10)
    first, last = (float(np.percentile(part, 99)) for part in (ticks[:tenth], ticks[-tenth:]))
    return Shift(
        building=building,
        seed=seed,
        shut=shut,
        seconds=(simulator.now_ns - began_ns) * 1e-9,
        way_m=sum(leg.distance_m for leg in legs),
        drives=len(legs),
        reached=sum(leg.reached for leg in legs),
        failures=tuple(f"{leg.place}: {leg.reason}" for leg in legs if not leg.reached),
        struck=dict(hits),
        person_m=nearest,
        tick_ms=(first, last),
        grown_mb=_memory_mb() - grown_from,
    )


def _with_closed_door(world: World, rng: np.random.Generator) -> tuple[str, World]:
    """Return the world with a closed door that leaves all places reachable, and its name; empty if there is none."""
    for name in rng.permutation([door.name for door in world.doors]).tolist():
        shut = world.with_closed([name])
        ground = costmap_from_grid(shut.grid, CHAIR_A)
        if all(_has_path(ground, world.start, place.pose) for place in world.places):
            return name, shut
    return "", world


def _places(world: World, ground: Costmap, rng: np.random.Generator) -> dict[str, Place]:
    """Return the building's places and random ones where the chair fits and that it can reach from its start."""
    places = {place.name: place for place in world.places}
    roomy = points_from_cells(world.grid, np.argwhere((ground.clearance > _PLACE_DISTANCE) & (world.grid.cells >= 0)))
    while len(places) < len(world.places) + PLACES:
        x, y = roomy[rng.integers(len(roomy))].tolist()
        pose = Pose2(x, y, float(rng.uniform(-math.pi, math.pi)))
        if fits(CHAIR_A, _PLACE_CLEARANCE, ground.field, pose) and _has_path(ground, world.start, pose):
            name = f"spot {len(places) - len(world.places) + 1}"
            places[name] = Place(name, pose)
    return places


def _has_path(ground: Costmap, start: Pose2, goal: Pose2) -> bool:
    try:
        plan(ground, start, goal)
    except PlanningError:
        return False
    return True


def _memory_mb() -> float:
    """Return the program's peak memory [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
