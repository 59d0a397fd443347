"""Best drives that are stored by everything that determines them, as a planner's changes do not alter them."""

from __future__ import annotations

import hashlib
import pickle
from functools import cache
from pathlib import Path

import numpy as np

from evaluation.best_time.comfort import Comfort
from evaluation.best_time.fastest import NoBestTime, best_drive
from evaluation.best_time.gaps import surroundings
from evaluation.best_time.motion import BestDrive
from waychair.calibration.chair_body import ChairBody
from waychair.errors import NoPath, PlanningError
from waychair.files import write_bytes
from waychair.simulation.scene.contact import SolidBoxes
from waychair.types import Pose2

KEPT = Path("out") / "acceptance" / "best_times"


def kept_best_drive(
    solid: SolidBoxes, body: ChairBody, start: Pose2, goal: Pose2, comfort: Comfort, folder: Path = KEPT
) -> BestDrive | PlanningError:
    """Return `best_drive` between two poses, computed once; where there is none, the error that says why."""
    what = repr((_code(), body, start, goal, comfort)).encode() + np.ascontiguousarray(solid.boxes).tobytes()
    path = folder / f"{hashlib.sha256(what).hexdigest()[:24]}.pickle"
    if path.exists():
        known: BestDrive | PlanningError = pickle.loads(path.read_bytes())
        return known
    found: BestDrive | PlanningError
    try:
        found = best_drive(surroundings(solid, body), start, goal, comfort)
    except (NoPath, NoBestTime) as error:
        found = error
    write_bytes(path, pickle.dumps(found))
    return found


@cache
def _code() -> str:
    """Return a hash of the code that computes best drives."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
