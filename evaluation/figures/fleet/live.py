"""Three chairs in processes of their own, over Zenoh in real time, with processes that are killed and a network that is gone for
a while; and the cost of peers.

`FLEET_LIVE_S=60` takes less of the undisturbed run, `FLEET_LIVE_KILLS=2` fewer kills of each kind, `FLEET_LIVE_KINDS=world` some
kinds, `FLEET_LIVE_PARTED=1` fewer runs with the network gone, `FLEET_LIVE_PEERS=4` fewer peers without chairs, `FLEET_LIVE_SEED=1`
another sample. Times hold for an idle computer of two cores: where the chairs' time passes slower than real time, the figure says
so, and does not pass.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from evaluation.fleet.live_runs import (
    GOES_ON_S,
    KINDS,
    LiveRun,
    PartedRun,
    kill_run,
    parted_run,
    quiet_run,
    weighed_peers,
)
from waychair.types import Json

CHAIRS = 3
ANSWER_P50_MS, ANSWER_P99_MS, AGE_P99_MS = 15.0, 80.0, 350.0
OVER_LINE_M = 0.05
ALONE_S, TOGETHER_S = 10.0, 5.0
REAL_TIME = 0.97
MOST_CORES, MOST_MB = 1.0, 60.0
WEIGHED_S = 10.0


def fleet_live(out: Path) -> Json:
    """Answers and States come in time; nobody passes a stop line whatever is killed; and peers without chairs are light."""
    samples = (("SEED", 0), ("KILLS", 20), ("PARTED", 3), ("PEERS", 30))
    seed, kills, parted, peers = (int(os.environ.get(f"FLEET_LIVE_{name}", value)) for name, value in samples)
    seconds = float(os.environ.get("FLEET_LIVE_S", "300"))
    kinds = [each for each in os.environ.get("FLEET_LIVE_KINDS", ",".join(KINDS)).split(",") if each]
    with tempfile.TemporaryDirectory() as folder:
        quiet = quiet_run(Path(folder) / "quiet", CHAIRS, seed, seconds) if seconds else LiveRun()
        runs = {kind: kill_run(Path(folder) / kind, CHAIRS, seed + k, kind, kills) for k, kind in enumerate(kinds)}
        apart = [parted_run(Path(folder) / f"parted{k}", CHAIRS, seed + k) for k in range(parted)]
        weighed = weighed_peers(Path(folder) / "peers", peers, WEIGHED_S) if peers else None
    answers, ages = _percentiles(quiet.answers_ms), _percentiles(quiet.ages_ms)
    every = [quiet, *runs.values(), *apart]
    over = max(run.over_line_m for run in every)
    back = [each for run in runs.values() for each in (*run.ordered_s, *run.moved_s)]
    in_time = bool(answers and ages) and answers[0] <= ANSWER_P50_MS and answers[1] <= ANSWER_P99_MS
    in_time = in_time and ages[1] <= AGE_P99_MS and quiet.factor >= REAL_TIME
    light = weighed is None or (weighed.cores <= MOST_CORES and weighed.megabytes <= MOST_MB)
    contacts = sum(run.contacts for run in every)
    safe = over <= OVER_LINE_M and contacts == 0
    goes_on = max(back, default=0) <= GOES_ON_S and all(map(_copes, apart)) and not any(run.ended for run in every)
    goes_on = goes_on and all(len(run.ordered_s) == kills for run in runs.values())
    return {
        "passed": in_time and light and safe and goes_on,
        "real_time_factor": round(quiet.factor, 3) if seconds else None,
        "answers": len(quiet.answers_ms),
        "answer_ms_p50_p99": answers,
        "state_age_ms_p50_p99": ages,
        "contacts": contacts,
        "over_stop_line_m": round(over, 3),
        "kills": {
            kind: {
                "kills": len(run.ordered_s),
                "in_order_after_s_p50_max": _middle_and_most(run.ordered_s),
                "moves_after_s_p50_max": _middle_and_most(run.moved_s),
                "moves_late": sum(each > GOES_ON_S for each in run.moved_s),
                "told_when_late": run.told_late,
                "over_stop_line_m": round(run.over_line_m, 3),
                "contacts": run.contacts,
                "goals_reached": run.reached,
                "real_time_factor": round(run.factor, 3),
                "ended": run.ended,
            }
            for kind, run in runs.items()
        },
        "parted": [
            {
                "alone_after_s": _middle_and_most([run.alone_s])[0],
                "together_after_s": _middle_and_most([run.together_s])[0],
                "backed_out": list(run.backed_out),
                "contacts": run.contacts,
                "goals_reached": run.reached,
            }
            for run in apart
        ],
        "peers": None
        if weighed is None
        else {
            "count": weighed.peers,
            "cores": round(weighed.cores, 2),
            "megabytes_each": round(weighed.megabytes, 1),
        },
    }


def _copes(run: PartedRun) -> bool:
    """Return whether the chairs of a run coped with a network that was gone."""
    return run.alone_s <= ALONE_S and run.together_s <= TOGETHER_S and max(run.backed_out, default=0) <= 1


def _percentiles(values: list[float]) -> list[float]:
    """Return the median and the 99th percentile; nothing for no values."""
    return [round(float(each), 1) for each in np.percentile(values, (50, 99))] if values else []


def _middle_and_most(values: list[float]) -> list[float | None]:
    """Return the median and the greatest value; None stands for never."""
    if not values:
        return []
    return [round(each, 1) if np.isfinite(each) else None for each in (float(np.median(values)), max(values))]
