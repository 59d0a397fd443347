"""Doors by touch: simulated drivers without sight, led by the glove through doors of two widths from four directions.

The whole simulated chair with lidar noise and localiser, the C of board and glove, and the board's guard.
`BLIND_DOORS_RUNS=1` takes so many runs of each direction instead of 25; `BLIND_DOORS_ONLY="A 0.9"` takes one chair and width,
`BLIND_DOORS_BASELINES=0` leaves out the comparisons.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.guided_drives import GuidedBars, GuidedRun, autonomous_run, guided_row, guided_runs, unled_run
from evaluation.scenes.tight_places import APPROACHES, WALL, TightScene, door_scene, map_of
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.control.haptics.learning import RiderValues
from waychair.control.haptics.patterns import TouchVocabulary
from waychair.trials.barn import upper_bound
from waychair.trials.guiding.guided import GuidedSetup, RiderTold
from waychair.types import HelpLevel, Json, Pose2

RUNS = int(os.environ.get("BLIND_DOORS_RUNS", "25"))
ONLY = os.environ.get("BLIND_DOORS_ONLY", "")
BASELINES = os.environ.get("BLIND_DOORS_BASELINES", "1") == "1"


@dataclass(frozen=True, slots=True)
class BlindDoor:
    """A chair at a door, what its row has to reach, and the time limit [s]."""

    body: ChairBody
    width: float
    bars: GuidedBars
    limit_s: float = 180.0

    @property
    def name(self) -> str:
        """The row's name."""
        return f"{self.body.chair_id} {self.width:g}"


DOORS = (
    BlindDoor(CHAIR_A, 0.90, GuidedBars(0.98, 45.0)),
    BlindDoor(CHAIR_A, 0.80, GuidedBars(0.97, 45.0)),
    BlindDoor(CHAIR_B, 0.90, GuidedBars(0.95, 45.0)),
    BlindDoor(CHAIR_B, 0.80, GuidedBars(0.85, 90.0), 300.0),
)


UNLED = {"nobody": RiderTold.NOTHING, "paper": RiderTold.PAPER}
"""Comparisons in which nobody leads the driver to a place."""

LEVELS = {"autonomy": HelpLevel.INFORM, **dict.fromkeys(UNLED, HelpLevel.GUARD)}
"""Levels of help of the comparisons."""


def blind_doors(out: Path) -> Json:
    """Successes, times and contacts at each chair and width, beside a driver on their own, the paper's signals, advice without
    caps, and full autonomy."""
    doors = [door for door in DOORS if not ONLY or door.name == ONLY]
    rows = [_row(door, "guide") for door in doors]
    passed = all(row["passed"] for row in rows)
    contacts, runs = sum(row["contacts"] for row in rows), sum(row["runs"] for row in rows)
    if BASELINES:
        rows += [_row(door, how) for door in doors for how in (*UNLED, "inform", "autonomy")]
    return {
        "passed": passed,
        "runs": runs,
        "contacts": contacts,
        "contact_rate_bound_95": round(upper_bound(contacts, runs), 4),
        "rows": rows,
    }


def run_at_door(
    door: BlindDoor,
    how: str,
    seed: int,
    driver: str = "default",
    known: RiderValues | None = None,
    layout: str = "glove_3x3",
    words: TouchVocabulary | None = None,
) -> GuidedRun:
    """Drive one chair of this seed through the door, from the direction that the seed stands for.

    `how`: a level of help, "autonomy", or, with the guard, "nobody" who leads or "paper", the paper's own signals. `known`
    was learnt of the driver before.
    """
    scene = door_scene(door.width, APPROACHES[seed % len(APPROACHES)], door.body, seed)
    level = LEVELS.get(how) or HelpLevel(how)
    setup = GuidedSetup(
        scene.world,
        map_of(scene.world),
        door.body,
        driver,
        level,
        layout,
        seed,
        known=known or {},
        words=words,
    )
    if how == "autonomy":
        return autonomous_run(setup, scene.goal, door.limit_s)
    if how in UNLED:
        return unled_run(replace(setup, told=UNLED[how]), _behind(door, scene), door.limit_s, wants_door=True)
    return guided_runs(setup, [scene.goal], door.limit_s)[0]


def _behind(door: BlindDoor, scene: TightScene) -> Callable[[Pose2], bool]:
    """Return whether the whole chair is behind the door."""
    assert scene.door is not None
    behind = scene.door.x + WALL / 2 + door.body.rear
    return lambda pose: pose.x > behind


def _row(door: BlindDoor, how: str) -> Json:
    found = over_seeds(f"blind door {door.name} {how}", partial(run_at_door, door, how), RUNS * len(APPROACHES))
    return guided_row(door.name, how, found, door.bars if how == "guide" else None)
