"""Many seeded journeys between random places on different storeys, and their counts."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from waychair.errors import OutputError, WorldError
from waychair.simulation.plan.world import World, load_levels
from waychair.trials.travel.journeys import JourneyRecord, journey
from waychair.trials.worker_pool import worker_pool
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
    progress: Callable[[int, JourneyRecord], None] = lambda seed, record: None,
) -> list[JourneyRecord]:
    """Return the records of the journeys of these seeds, in their order; `jobs` processes, by default one a core.

    `progress` is called with each seed and its record as its journey ends.

    Raises:
        WorkerLost: a process was killed from outside.
        WorldError: as `random_ends`.
    """
    random_ends(load_levels(world), 0)  # a wrong world is told at once
    one = partial(seeded_journey, world, passengers=passengers, imu=imu)
    records: dict[int, JourneyRecord] = {}
    if (jobs or os.cpu_count() or 1) == 1:
        for seed in seeds:
            records[seed] = one(seed)
            progress(seed, records[seed])
    else:
        with worker_pool(jobs) as pool:
            running = {pool.submit(one, seed): seed for seed in seeds}
            try:
                for ended in as_completed(running):
                    records[running[ended]] = ended.result()
                    progress(running[ended], ended.result())
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    return [records[seed] for seed in seeds]


def kept_records(path: Path, world: str, passengers: int, imu: bool) -> dict[int, JourneyRecord]:
    """Return the records of a file of `keep_record` by their seeds, those of the same world, passengers and IMU only.

    A last line that was cut off does not count.

    Raises:
        OutputError: the file holds something else, or cannot be read.
    """
    found: dict[int, JourneyRecord] = {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    except (OSError, UnicodeDecodeError) as error:
        raise OutputError(f"cannot read {path} ({error}): name another file for the journeys") from error
    for number, line in enumerate(lines, 1):
        if not line.endswith("\n"):
            break
        try:
            row = json.loads(line)
            kind, seed = (row.pop("world"), row.pop("passengers"), row.pop("imu")), int(row.pop("seed"))
            record = JourneyRecord(**{**row, "ok_s": tuple(row["ok_s"])})
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise OutputError(f"{path}:{number} is no journey ({error}): name another file for the journeys") from error
        if kind == (world, passengers, imu):
            found[seed] = record
    return found


def keep_record(path: Path, world: str, passengers: int, imu: bool, seed: int, record: JourneyRecord) -> None:
    """Add a journey to a file, a line of JSON each, after a line that was cut off, if any.

    Raises:
        OutputError: the file cannot be written.
    """
    row = {"world": world, "passengers": passengers, "imu": imu, **row_of(seed, record)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab+") as file:
            size = file.seek(0, os.SEEK_END)
            if size:
                whole = _up_to_the_last_line(path)
                file.truncate(whole)
            file.write((json.dumps(row, allow_nan=False) + "\n").encode())
            file.flush()
    except OSError as error:
        raise OutputError(f"cannot write {path} ({error}): make room, or name another file") from error


def _up_to_the_last_line(path: Path) -> int:
    """Return the size [bytes] of a file up to the end of its last whole line."""
    return path.read_bytes().rfind(b"\n") + 1


def row_of(seed: int, record: JourneyRecord) -> Json:
    """Return a journey as JSON."""
    return {"seed": seed, **asdict(record), "ok_s": list(record.ok_s), "phases": dict(record.phases)}


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
        "journeys": [row_of(seed, record) for seed, record in zip(seeds, records, strict=True)],
    }
