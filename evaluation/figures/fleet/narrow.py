"""Chairs that cannot pass each other at nodes, by the coordinator's order: without and with stops as people cause them.

`FLEET_HOURS=0.5`, `FLEET_SEEDS=1` and `FLEET_TASKS=5` take a sample of the simulated hours, seeds and single tasks of each plan.
"""

from __future__ import annotations

import math
import os
import statistics
import time
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from evaluation.fleet.narrow_plans import OneTask, cell_traffic, one_task
from evaluation.runs.kept_runs import figure_pool
from waychair.planning.fleet.waits import Audit, jain
from waychair.planning.fleet.warden import ROUNDS
from waychair.planning.fleet.ways import ways_of
from waychair.trials.fleet.fleet_ordered import SPEED, Stops, chairs_on
from waychair.trials.fleet.fleet_report import delay_per_way
from waychair.types import Json

PLANS = ("Rectangle", "I", "T", "2bconR", "3tie", "4cross", "9cube", "2d-grid")
MOST_DELAY_S = {(3, False): 3.5, (5, False): 7.0, (3, True): 1.8, (5, True): 4.2}
"""Mean delay of a task [s], by the number of chairs and whether rooms are bays."""

MOST_DELAY_ON_T_S = {3: 20.0, 5: 40.0}
STOPS = Stops(share=0.03)
"""3 % of the entered cells begin a stop of 15 s in the mean."""

HOURS_OF_EIGHT = 1.0
"""Hours of 8 chairs at most, whose delays are stated only."""

LEAST_JAIN, LEAST_FORESEEN = 0.9, 0.8


class _Run(NamedTuple):
    """The figures of one run."""

    tasks: int
    delay_s: float
    plan_ms: tuple[float, ...]
    jain: float
    foreseen: float | None
    most_overtaken: int
    locked_up: bool
    cpu_s: float


def fleet_narrow(out: Path) -> Json:
    """Nobody can pass at nodes, a new task on each arrival: no lock-up; mean delay 3.5 / 7.0 s, 1.8 / 4.2 s with bays."""
    hours, seeds = _sample("4")
    kinds = list(product((3, 5, 8), (False, True)))
    hours_of = {3: hours, 5: hours, 8: min(hours, HOURS_OF_EIGHT)}
    work = [
        (plan, bays, chairs, seed, hours_of[chairs], False)
        for chairs, bays in kinds
        for plan in PLANS
        for seed in range(seeds)
    ]
    count = int(os.environ.get("FLEET_TASKS", "100"))
    with figure_pool() as pool:
        gaps = {
            f"one task, {chairs} chairs": _one_task(
                list(pool.map(_tasks, PLANS, [chairs] * len(PLANS), [count] * len(PLANS)))
            )
            for chairs in (3, 5)
        }
        runs = dict(zip(work, pool.map(_run, *zip(*work, strict=True)), strict=True))
    found: dict[str, Json] = {}
    passed = all(gap["granted_over_best"] <= 1.02 for gap in gaps.values())
    for chairs, bays in kinds:
        means = {
            plan: _mean_delay([run for key, run in runs.items() if key[:3] == (plan, bays, chairs)]) for plan in PLANS
        }
        mean = statistics.fmean(means.values())
        passed &= mean <= MOST_DELAY_S.get((chairs, bays), mean)
        named = {plan: round(value, 2) for plan, value in means.items()}
        found[f"{chairs} chairs{', bays' if bays else ''}"] = {"mean_s": round(mean, 2), **named}
    lockups = sum(run.locked_up for run in runs.values())
    plan_ms = [each for key, run in runs.items() if key[2] < 8 for each in run.plan_ms]
    return {
        "passed": passed and lockups == 0,
        "means_s": {name: figures["mean_s"] for name, figures in found.items()},
        "plan_ms_p50_p99": [round(float(np.percentile(plan_ms, share)), 2) for share in (50, 99)],
        **gaps,
        "seeds": list(range(seeds)),
        **_lockups(lockups, sum(key[2] * key[4] for key in runs)),
        "cpu_s": round(sum(run.cpu_s for run in runs.values()), 1),
        **found,
    }


def fleet_delays(out: Path) -> Json:
    """Stops as people cause them: no lock-up, nobody overtaken thrice, 20 / 40 s on T, fair, and waits foreseen."""
    hours, seeds = _sample("16")
    work = [(plan, False, chairs, seed, hours, True) for chairs in (3, 5) for plan in PLANS for seed in range(seeds)]
    with figure_pool() as pool:
        runs = dict(zip(work, pool.map(_run, *zip(*work, strict=True)), strict=True))
    found: dict[str, Json] = {}
    passed = True
    for chairs, plan in product((3, 5), PLANS):
        own = [run for key, run in runs.items() if key[:3] == (plan, False, chairs)]
        mean, fair = _mean_delay(own), statistics.fmean(run.jain for run in own)
        passed &= fair >= LEAST_JAIN and (plan != "T" or mean <= MOST_DELAY_ON_T_S[chairs])
        found[f"{plan} {chairs}"] = {"mean_s": round(mean, 2), "jain": round(fair, 3)}
    lockups, overtaken = sum(run.locked_up for run in runs.values()), max(run.most_overtaken for run in runs.values())
    share = statistics.fmean(run.foreseen for run in runs.values() if run.foreseen is not None)
    return {
        "passed": passed and lockups == 0 and overtaken <= 2 and share >= LEAST_FORESEEN,
        "on_T_s": {chairs: found[f"T {chairs}"]["mean_s"] for chairs in (3, 5)},
        "least_jain": min(figures["jain"] for figures in found.values()),
        "seeds": list(range(seeds)),
        **_lockups(lockups, sum(key[2] * hours for key in runs)),
        "most_overtaken": overtaken,
        "foreseen_right": round(share, 3),
        "cpu_s": round(sum(run.cpu_s for run in runs.values()), 1),
        **found,
    }


def _sample(hours: str) -> tuple[float, int]:
    return float(os.environ.get("FLEET_HOURS", hours)), int(os.environ.get("FLEET_SEEDS", "10"))


def _run(plan: str, bays: bool, chairs: int, seed: int, hours: float, stops: bool) -> _Run:
    begun = time.process_time()
    audit = Audit() if stops else None
    world = chairs_on(
        cell_traffic(plan, bays), chairs, seed, stops=STOPS if stops else Stops(), audit=audit, rounds=ROUNDS
    )
    going = world.run(round(hours * 3_600_000))
    return _Run(
        len(world.done),
        statistics.fmean(task.delay_s for task in world.done),
        tuple(world.plan_ms),
        jain([delay_per_way(world, chair) for chair in world.order.chains]),
        None if audit is None else audit.foreseen_right(),
        world.most_overtaken,
        not going,
        time.process_time() - begun,
    )


def _mean_delay(runs: list[_Run]) -> float:
    """Return the mean delay [s] of all tasks of some runs."""
    return sum(run.tasks * run.delay_s for run in runs) / sum(run.tasks for run in runs)


def _tasks(plan: str, chairs: int, count: int) -> list[OneTask]:
    ways = ways_of(cell_traffic(plan, False), SPEED)
    return [one_task(ways, chairs, seed) for seed in range(count)]


def _one_task(by_plan: list[list[OneTask]]) -> Json:
    """Return the mean delays of one task each, all plans, and the ratios where the best ways are proven."""
    tasks = [task for each in by_plan for task in each if math.isfinite(task.rounds_s + task.granted_s)]
    proven = [(task.best_s, task) for task in tasks if task.best_s is not None]
    best = sum(best_s for best_s, _ in proven)
    return {
        "tasks": len(tasks),
        "proven": len(proven),
        "delay_s": round(statistics.fmean(task.granted_s for task in tasks), 2),
        "best_s": round(best / max(len(proven), 1), 2),
        "granted_over_best": round(sum(task.granted_s for _, task in proven) / best, 4) if best else 1.0,
        "rounds_over_best": round(sum(task.rounds_s for _, task in proven) / best, 4) if best else 1.0,
    }


def _lockups(count: int, chair_hours: float) -> Json:
    """Return the lock-ups, and the rate that 95 % confidence leaves when there was none (rule of three)."""
    bound = None if count else 3.0 / chair_hours
    return {"lockups": count, "chair_hours": chair_hours, "lockups_an_hour_below_95": bound}
