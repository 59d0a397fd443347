"""Whole chairs that share a building, with the firmware in the loop: every scene of `trials/fleet/fleet_scenes.py`, and the
lift shared by three, by seeds.

`FLEET_DRIVE_SEEDS=2` takes fewer than 15 seeds, `FLEET_DRIVE_SCENES=l_way,crossing` some of the scenes.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from evaluation.runs.kept_runs import figure_pool
from waychair.maps.traffic.corridors import load_corridors
from waychair.trials.fleet.fleet_drive import FleetRun, drive_fleet
from waychair.trials.fleet.fleet_lift import share_lift
from waychair.trials.fleet.fleet_scenes import SCENARIOS, rooms_scene
from waychair.types import Json

SEEDS = 15
SUCCESS, OVER_LINE_M, L_WAY_M = 0.97, 0.05, 0.03
OTHER_WAY_S = 5.0
"""s; a chair before seated persons turns to the other way within so long after it has come to rest."""

LIFT_SCENE = "lift_for_three"

STANDS_S, MOVES = 1.0, 2e-3
"""s; a shorter rest is none. m or rad from step to step; a chair that moves less rests."""

MOST_COST = 3.3
COST_OVER_S = 20.0
"""s of the chairs' time over which the processor time of three chairs is compared with that of one."""


def fleet_drive(out: Path) -> Json:
    """Goals reached, contacts, distances beyond stop lines, waits and times of each scene; zeros with their 95 % bound."""
    seeds = range(int(os.environ.get("FLEET_DRIVE_SEEDS", SEEDS)))
    names = os.environ.get("FLEET_DRIVE_SCENES", ",".join((*SCENARIOS, LIFT_SCENE))).split(",")
    rows: dict[str, Json] = {}
    with figure_pool() as pool:
        running = {name: [pool.submit(_run, name, seed) for seed in seeds] for name in names}
        for name, own in running.items():
            rows[name] = _row([each.result() for each in own])
            print(name, rows[name], flush=True)
    ratio = lockstep_ratio()
    runs = len(names) * len(seeds)
    contacts = sum(row["contacts"] for row in rows.values())
    passed = (
        contacts == 0
        and ratio <= MOST_COST
        and all(row["success"] >= SUCCESS for row in rows.values())
        and all(row["over_line_m"] <= OVER_LINE_M for row in rows.values())
        and rows.get("l_way", {"end_error_m": 0.0})["end_error_m"] <= L_WAY_M
        and rows.get("seated_persons", {"first_rest_s": 0.0})["first_rest_s"] <= OTHER_WAY_S
    )
    return {
        "passed": passed,
        "seeds": list(seeds),
        "contacts": contacts,
        "cost_of_three_over_one": round(ratio, 2),
        "contact_share_below_95": round(min(1.0, 3.0 / runs), 4) if contacts == 0 else None,
        "scenes": rows,
    }


def lockstep_ratio() -> float:
    """Return the processor time of three whole chairs in lockstep over that of one, all of them driving."""
    three = replace(rooms_scene(load_corridors("T"), 3, 1, 0), time_limit_s=COST_OVER_S)
    one = replace(three, starts=three.starts[:1], goals=three.goals[:1])
    seconds = []
    for scene in (one, one, three):  # the first run loads the kernels
        began = time.process_time()
        drive_fleet(scene)
        seconds.append(time.process_time() - began)
    return seconds[2] / seconds[1]


def _run(name: str, seed: int) -> tuple[frozenset[int], FleetRun]:
    """Return the chairs of a scene that may fail, and its run."""
    if name == LIFT_SCENE:
        return frozenset(), share_lift(seed)
    scenario = SCENARIOS[name](seed)
    return scenario.may_fail, drive_fleet(scenario.scene, events=scenario.events)


def _row(runs: list[tuple[frozenset[int], FleetRun]]) -> Json:
    """Return a scene's figures over its seeds."""
    needed = [
        chair.reached == chair.goals
        for may_fail, run in runs
        for k, chair in enumerate(run.chairs)
        if k not in may_fail
    ]
    ends = [chair.end_error for _, run in runs for chair in run.chairs if chair.end_error is not None]
    took = [each for _, run in runs for chair in run.chairs for each in chair.took_s]
    return {
        "success": round(sum(needed) / len(needed), 4) if needed else 1.0,
        "contacts": sum(run.contacts for _, run in runs),
        "lockups": sum(run.lockups for _, run in runs),
        "lines_across": sum(chair.lines_across for _, run in runs for chair in run.chairs),
        "over_line_m": round(max(chair.over_line for _, run in runs for chair in run.chairs), 4),
        "nearest_chairs_m": _finite(min(run.nearest for _, run in runs)),
        "nearest_person_m": _finite(min(chair.person_m for _, run in runs for chair in run.chairs)),
        "end_error_m": round(max(ends), 4) if ends else 0.0,
        "first_rest_s": max((first_rest_s(chair.track) for _, run in runs for chair in run.chairs), default=0.0),
        "mean_s": round(sum(took) / len(took), 2) if took else None,
        "waited_s": round(sum(chair.waited_s for _, run in runs for chair in run.chairs) / len(runs), 2),
        "ends": sorted({end for _, run in runs for chair in run.chairs for end in chair.ends}),
    }


def first_rest_s(track: Sequence[tuple[float, float, float, float]]) -> float:
    """Return how long [s] a chair rested first, after it had set off; 0 if it did not rest, or until its track's end.

    `track` has rows of time [s], x, y [m], heading [rad].
    """
    rows = np.array(track).reshape(-1, 4)
    steps = np.abs(np.diff(rows[:, 1:], axis=0))
    steps[:, 2] = np.minimum(steps[:, 2], math.tau - steps[:, 2])
    moves = np.flatnonzero((steps > MOVES).any(axis=1))
    rests = np.diff(rows[moves, 0])
    long = rests[rests > STANDS_S]
    return round(float(long[0]), 2) if len(long) else 0.0


def _finite(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
