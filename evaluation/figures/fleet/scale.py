"""Many chairs in one building: how much faster than real time their orders are kept, on one core; queues at the lifts.

`FLEET_SCALE_S=120` simulates fewer seconds than 1,800 and 300. `graph_bwh` is the hospital of `WAYCHAIR_DATA`.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from evaluation.fleet.hospital_traffic import hospital_traffic
from waychair.planning.fleet.waits import Audit
from waychair.trials.fleet.fleet_ordered import chairs_on
from waychair.trials.fleet.fleet_sources import graph_from_source
from waychair.trials.fleet.fleet_storeys import FleetStoreys
from waychair.types import Json

SIZES = ((4, 100, 200.0, 1800), (10, 1000, 20.0, 300))
"""Storeys, chairs, the least times real time, and the simulated seconds."""

BWH_CHAIRS, BWH_HOURS = 40, 0.5


def fleet_scale(out: Path) -> Json:
    """Times real time of 100 chairs on 4 storeys, 1,000 on 10, and 40 in `graph_bwh`; the waits and queues at lifts."""
    found: dict[str, Json] = {}
    passed = True
    for storeys, chairs, least, seconds in SIZES:
        seconds = min(seconds, int(os.environ.get("FLEET_SCALE_S", seconds)))
        FleetStoreys(hospital_traffic(2), 3, 0).run(60_000)  # loads the kernels
        world = FleetStoreys(hospital_traffic(storeys), chairs, 0)
        begun = time.thread_time()
        world.run(1000 * seconds)
        times = seconds / (time.thread_time() - begun)
        passed &= times >= least and world.done.arrivals > 0
        waits = [wait for each in world.done.lift_waits_s.values() for wait in each]
        found[f"{chairs} chairs, {storeys} storeys"] = {
            "times_real_time": round(times, 1),
            "least": least,
            "simulated_s": seconds,
            "arrivals": world.done.arrivals,
            "mean_task_s": round(float(np.mean(world.done.took_s)), 1),
            "rides": len(waits),
            "mean_wait_for_lift_s": round(float(np.mean(waits)), 1) if waits else None,
            "longest_queue": dict(world.done.longest_queue),
            "without_way": world.done.without_way,
        }
    folder = Path(os.environ.get("WAYCHAIR_DATA", "")) / "graph_bwh"
    if folder.is_dir():
        found["graph_bwh"] = _bwh(folder)
        passed &= not found["graph_bwh"]["locked_up"]
    return {"passed": passed, **found}


def _bwh(folder: Path) -> Json:
    """Return the figures of 40 chairs in the hospital, by the whole coordinator; all ways are taken as single file."""
    graph = graph_from_source(str(folder))
    audit = Audit()
    world = chairs_on(graph, BWH_CHAIRS, 0, rounds=3, audit=audit)
    begun = time.thread_time()
    going = world.run(round(BWH_HOURS * 3.6e6))
    took_s = time.thread_time() - begun
    lifts = {lift.name: 0.0 for lift in graph.lifts}
    for each in audit.ended:
        if each["place"] in lifts:
            lifts[each["place"]] += each["real_s"]
    return {
        "chairs": BWH_CHAIRS,
        "times_real_time": round(world.now_ms / 1e3 / took_s, 1),
        "tasks": len(world.done),
        "mean_delay_s": round(float(np.mean([task.delay_s for task in world.done])), 1) if world.done else None,
        "waited_for_lift_s": {name: round(seconds, 1) for name, seconds in lifts.items() if seconds > 0},
        "waiting": len(world.order.waiting),
        "locked_up": not going,
    }
