"""Doors by touch: simulated drivers who cannot see, led by the glove through doors of two widths from four directions.

The whole simulated chair with lidar noise and localiser, the C of board and glove, and the board's guard.
`BLIND_DOORS_RUNS=1` takes so many runs of each direction instead of 25; `BLIND_DOORS_ONLY="A 0.9"` takes one chair and width,
`BLIND_DOORS_BASELINES=0` leaves out the comparisons.
"""

from __future__ import annotations

import os
import statistics
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.tight_places import APPROACHES, door_scene, map_of, run_scene
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.trials.barn import upper_bound
from waychair.trials.guiding.guided import GuidedSetup, guided_drive
from waychair.types import HelpLevel, Json

RUNS = int(os.environ.get("BLIND_DOORS_RUNS", "25"))
ONLY = os.environ.get("BLIND_DOORS_ONLY", "")
BASELINES = os.environ.get("BLIND_DOORS_BASELINES", "1") == "1"


@dataclass(frozen=True, slots=True)
class DoorBar:
    """A chair at a door, the least share of successes, the longest median [s] and the time limit [s]."""

    body: ChairBody
    width: float
    share: float
    median_s: float = 45.0
    limit_s: float = 180.0

    @property
    def name(self) -> str:
        """The row's name."""
        return f"{self.body.chair_id} {self.width:g}"


BARS = (
    DoorBar(CHAIR_A, 0.90, 0.98),
    DoorBar(CHAIR_A, 0.80, 0.97),
    DoorBar(CHAIR_B, 0.90, 0.95),
    DoorBar(CHAIR_B, 0.80, 0.85, 90.0, 300.0),
)


@dataclass(frozen=True, slots=True)
class DoorRun:
    """One run at a door."""

    reached: bool
    reason: str
    seconds: float
    contact_speeds: tuple[float, ...]
    symbols: int
    plans: int


def blind_doors(out: Path) -> Json:
    """Successes, times and contacts at each chair and width, beside advice without caps and full autonomy."""
    bars = [bar for bar in BARS if not ONLY or bar.name == ONLY]
    rows = [_row(bar, "guide") for bar in bars]
    passed = all(row["passed"] for row in rows)
    if BASELINES:
        rows += [_row(bar, how) for bar in bars for how in ("inform", "autonomy")]
    guided = [row for row in rows if row["how"] == "guide"]
    contacts, runs = sum(row["contacts"] for row in guided), sum(row["runs"] for row in guided)
    return {
        "passed": passed,
        "runs": runs,
        "contacts": contacts,
        "contact_rate_bound_95": round(upper_bound(contacts, runs), 4),
        "rows": rows,
    }


def run_at_door(bar: DoorBar, how: str, seed: int) -> DoorRun:
    """Drive one chair of this seed through the door, from the direction that the seed stands for."""
    scene = door_scene(bar.width, APPROACHES[seed % len(APPROACHES)], bar.body, seed)
    if how == "autonomy":
        alone = run_scene(scene, seed, bar.limit_s)
        return DoorRun(alone.reached, alone.reason, alone.seconds, (0.0,) * alone.contacts, 0, alone.plans)
    setup = GuidedSetup(scene.world, map_of(scene.world), bar.body, level=HelpLevel(how), seed=seed)
    drive = guided_drive(setup, scene.goal, bar.limit_s)
    return DoorRun(
        drive.reached, drive.reason, drive.seconds, drive.contact_speeds, len(drive.told), drive.plans
    )  # fmt: skip


def _row(bar: DoorBar, how: str) -> Json:
    found = over_seeds(f"blind door {bar.name} {how}", partial(run_at_door, bar, how), RUNS * len(APPROACHES))
    through = [each for each in found if each.reached]
    contacts = sum(len(each.contact_speeds) for each in found)
    median = statistics.median(each.seconds for each in through) if through else None
    share = len(through) / len(found)
    row = {
        "scene": bar.name,
        "how": how,
        "runs": len(found),
        "reached": len(through),
        "median_s": median if median is None else round(median, 1),
        "contacts": contacts,
        "fastest_contact": round(max((speed for each in found for speed in each.contact_speeds), default=0.0), 3),
        "symbols_per_s": round(sum(each.symbols for each in found) / max(sum(each.seconds for each in found), 1e-9), 2),
        "failures": {seed: each.reason for seed, each in enumerate(found) if not each.reached},
    }
    if how == "guide":
        row["passed"] = share >= bar.share and median is not None and median <= bar.median_s and contacts == 0
    print(f"  {row}", flush=True)
    return row
