"""The paper's planners and the coordinator beside the proven optimum: one task each, all at once, in the paper's own model.

`FLEET_GAP_INSTANCES=10` takes fewer than 100 instances a plan.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from evaluation.fleet.optimum import least_mean_delay
from evaluation.fleet.paper_tables import HUMANS_FIRST
from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.maps.traffic.indexed_traffic import indexed_traffic
from waychair.planning.fleet.paper.baselines import PaperPreset
from waychair.planning.fleet.section_plans import SectionPlanner
from waychair.trials.fleet.fleet_graph import free_times
from waychair.trials.fleet.fleet_tasks import (
    PAPER_SPEED,
    TasksDone,
    coordinated_tasks,
    do_tasks,
    random_instance,
    tasks_as_json,
)
from waychair.types import Json

INSTANCES = 100
CHAIRS = (3, 5, 8)
MOST_OVER_OPTIMUM = {3: 1.01, 5: 1.01, 8: 1.03}
"""The coordinator's mean delay over the proven optimum, by the number of chairs."""

P50_MS, P99_MS = 2.0, 50.0
COORDINATOR = "coordinator"


def fleet_gap(out: Path) -> Json:
    """Mean delay, messages, work and planning time of the coordinator, of each of the paper's planners, and the optimum.

    Ratios are over the instances whose optimum is proved; T holds 8 nodes, so that 8 chairs start and end everywhere.
    """
    instances = int(os.environ.get("FLEET_GAP_INSTANCES", INSTANCES))
    tables = {str(chairs): _table(chairs, instances) for chairs in CHAIRS}
    plans = [row for table in tables.values() for row in table["planners"].values()]
    quick = all(row["plan_ms_p50"] <= P50_MS and row["plan_ms_p99"] <= P99_MS for row in plans)
    never_below = all(row["over_optimum"] >= 1.0 - 1e-4 for row in plans)
    ours = {chairs: tables[str(chairs)]["planners"][COORDINATOR]["over_optimum"] for chairs in CHAIRS}
    near = all(ours[chairs] <= most for chairs, most in MOST_OVER_OPTIMUM.items())
    return {
        "passed": quick and never_below and near,
        "coordinator_over_optimum": ours,
        "instances_a_plan": instances,
        "chairs": tables,
    }


def _table(chairs: int, instances: int) -> Json:
    done: dict[PaperPreset, list[TasksDone]] = {preset: [] for preset in PaperPreset}
    ours: list[TasksDone] = []
    best: list[float] = []
    proved = 0
    for plan in HUMANS_FIRST:
        graph = corridor_graph(load_corridors(plan))
        indexed = indexed_traffic(graph)
        planner = SectionPlanner(indexed, PAPER_SPEED, free_times(indexed, PAPER_SPEED))
        for seed in range(instances):
            instance = random_instance(graph, chairs, seed)
            least = least_mean_delay(graph, instance.starts, instance.goals)
            if least is None:
                continue
            proved += 1
            best.append(least)
            for preset in PaperPreset:
                done[preset].append(do_tasks(graph, instance, preset, seed))
            ours.append(coordinated_tasks(graph, planner, instance))
    optimum = float(np.mean(best))
    rows = {COORDINATOR: _row(ours, optimum)} | {preset.value: _row(done[preset], optimum) for preset in PaperPreset}
    return {
        "instances": instances * len(HUMANS_FIRST),
        "proved": proved,
        "optimum_s": round(optimum, 3),
        "planners": rows,
    }


def _row(done: list[TasksDone], optimum: float) -> Json:
    values = {key: round(value, 3) for key, value in tasks_as_json(done).items() if key != "instances"}
    return {**values, "over_optimum": round(values["mean_delay_s"] / optimum, 3)}
