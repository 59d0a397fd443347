"""Many seeded journeys between random places on different storeys, and their counts."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial

import numpy as np

from waychair.errors import WorldError
from waychair.simulation.plan.world import World, load_levels
from waychair.trials.travel.journeys import JourneyRecord, journey
from waychair.types import Json

PASSENGERS = 3
"""People who travel by the lifts all the time."""


def random_ends(levels: Sequence[World], seed: int) -> tuple[tuple[str, str], tuple[str, str]]:
    """Return a start and a goal, as level and place, on two storeys; places in front of lifts are none.

    Raises:
        WorldError: the world has fewer than two levels with places.
    """
    rng = np.random.default_rng(seed)
    places = {}
    for world in levels:
        lifts = {f"lift {lift.name}" for lift in world.lifts} | {lift.name for lift in world.lifts}
        places[world.level] = [place.name for place in world.places if place.name not in lifts]
    known = [level for level, names in places.items() if names]
    if len(known) < 2:
        raise WorldError("a journey needs two levels with places: take a world of several levels, such as hospital")
    ends = [known[int(k)] for k in rng.choice(len(known), 2, replace=False)]
    start, goal = ((level, str(rng.choice(places[level]))) for level in ends)
    return start, goal


def seeded_journey(world: str, seed: int, passengers: int = PASSENGERS, imu: bool = True) -> JourneyRecord:
    """Return the record of a seed's journey; raises as `journey` and `random_ends`."""
    levels = load_levels(world)
    start, goal = random_ends(levels, seed)
    return journey(levels, start, goal, seed, passengers, imu=imu)


def run_journeys(
    world: str,
    seeds: Sequence[int],
    passengers: int = PASSENGERS,
    imu: bool = True,
    jobs: int | None = None,
    progress: Callable[[int, JourneyRecord], None] = lambda done, record: None,
) -> list[JourneyRecord]:
    """Return the records of the journeys of these seeds, in their order; `jobs` processes, by default one a core."""
    random_ends(load_levels(world), 0)  # a wrong world is told at once
    one = partial(seeded_journey, world, passengers=passengers, imu=imu)
    records = []
    if (jobs or os.cpu_count() or 1) == 1:
        for seed in seeds:
            records.append(one(seed))
            progress(len(records), records[-1])
        return records
    with ProcessPoolExecutor(jobs) as pool:
        for record in pool.map(one, seeds):
            records.append(record)
            progress(len(records), record)
    return records


def summary(records: Sequence[JourneyRecord], seeds: Sequence[int]) -> Json:
    """Return the counts of journeys; `contact_below` bounds their share with 95 % confidence."""
    from scipy.stats import beta

    runs = len(records)
    touched = sum(record.contacts > 0 for record in records)
    ok = [each for record in records for each in record.ok_s]
    return {
        "runs": runs,
        "arrived": sum(record.arrived for record in records),
        "contacts": sum(record.contacts for record in records),
        "contact_below": 1.0 if touched >= runs else round(float(beta.ppf(0.95, touched + 1, runs - touched)), 4),
        "near_a_moving_leaf": sum(record.near_leaf for record in records),
        "drives_on_a_wrong_map": sum(record.wrong_map_s > 0.0 for record in records),
        "asked": sum(record.asked for record in records),
        "rides": sum(record.rides for record in records),
        "open_door_to_ok_s": round(float(np.median(ok)), 2) if ok else None,
        "seconds": round(float(np.median([record.seconds for record in records])), 1) if records else None,
        "journeys": [
            {"seed": seed, **asdict(record), "ok_s": list(record.ok_s)}
            for seed, record in zip(seeds, records, strict=True)
        ],
    }
