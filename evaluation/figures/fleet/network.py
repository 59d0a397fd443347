"""Chairs whose peers keep the order over a network that loses, parts and forgets.

`FLEET_NETWORK_SEEDS=10` takes a sample of the seeds, `FLEET_NETWORK_FIRST=100` begins at another one,
`FLEET_NETWORK_MUTANT_SEEDS=4` gives each deliberate bug fewer seeds, 0 none.
"""

from __future__ import annotations

import os
import statistics
from pathlib import Path

from evaluation.fleet.network_runs import MUTANTS, killed_by, network_run, situations_run, storm_run, warden_killed
from evaluation.runs.kept_runs import figure_pool
from waychair.types import Json

STORMS_EVERY = 5
"""Seeds for each of which there is a run in which the links change every few seconds, beside the others."""

SITUATIONS_EVERY = 2
"""Seeds for each of which there is one of each situation of `trials/fleet/fleet_situations.py`."""

LONGEST_S = 4.0
"""s from the end of a warden until another one orders."""


def fleet_network(out: Path) -> Json:
    """No rule is ever broken, everybody arrives, the same seed gives the same bytes, and every deliberate bug is found."""
    first, count = (
        int(os.environ.get(f"FLEET_NETWORK_{name}", value)) for name, value in (("FIRST", 0), ("SEEDS", 500))
    )
    tries = int(os.environ.get("FLEET_NETWORK_MUTANT_SEEDS", "20"))
    with figure_pool() as pool:
        runs = list(pool.map(network_run, range(first, first + count)))
        runs += pool.map(storm_run, range(first, first + count // STORMS_EVERY))
        situations = list(pool.map(situations_run, range(first, first + count // SITUATIONS_EVERY)))
        again = pool.submit(network_run, first).result()
        mutants = [pool.submit(_killed, k, tries) for k in range(len(MUTANTS) if tries else 0)]
        killed = {MUTANTS[k].rule: each.result() for k, each in enumerate(mutants)}
        kills = list(pool.map(warden_killed, range(first, first + count)))
    faults = {run.seed: run.faults for run in runs if run.faults}
    return {
        "passed": not faults
        and not any(situations)
        and again.digest == runs[0].digest
        and None not in killed.values()
        and max(kills) <= LONGEST_S,
        "runs": len(runs),
        "faulty": len(faults),
        "situations": len(situations),
        "situations_faults": [said for each in situations for said in each][:20],
        "same_bytes": again.digest == runs[0].digest,
        "mutants_killed": f"{sum(each is not None for each in killed.values())} of {len(killed)}",
        "warden_killed": len(kills),
        "orders_go_on_s_p50_max": [round(statistics.median(kills), 1), round(max(kills), 1)],
        "arrivals": sum(run.arrivals for run in runs),
        "without_warden_s": round(sum(run.without_warden_s for run in runs) / len(runs), 1),
        "killed_by_seed": killed,
        "faults": dict(list(faults.items())[:20]),
        "cpu_s": round(sum(run.cpu_s for run in runs), 1),
    }


def _killed(k: int, tries: int) -> int | None:
    return killed_by(MUTANTS[k], range(tries))
