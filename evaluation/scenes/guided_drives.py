"""Drives of simulated drivers without sight, as the figures of guidance count them, and the row of a table for some of them.

Contacts are those that the chair's own motion caused; a person who walks into the chair is counted apart.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from evaluation.scenes.hazards import ContactCause, contact_cause
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.haptics.learning import RiderValues, rider_from_values
from waychair.control.haptics.symbols import Symbol
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.barn import upper_bound
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveSetup, drive_to_places
from waychair.trials.guiding.guided import GuidedRecord, GuidedSetup, GuidedTrial, guided_trial
from waychair.trials.ride import RecordingSimulator
from waychair.types import Json, Place, Pose2

NEAR_MISS = 0.10
"""m; a person so near to a chair that moves faster than `NEAR_SPEED` was nearly hit."""

NEAR_SPEED = 0.15
"""m/s"""

FREE_M, TAKES_EFFECT_S = 0.1, 1.0
"""m; a driver who is told to drive ahead or back has so much room there, else it was wrong to say so. s from a symbol until it is
obeyed: one that ends a turn is said ahead, for the heading that the chair has then."""


@dataclass(frozen=True, slots=True)
class GuidedRun:
    """One drive: whether the chair truly arrived, why it ended, times [s], ways [m], and the speeds [m/s] of contacts it caused.

    `bumped`: people who walked into the chair. `near_misses`: moments in which a person was nearly hit. `wrongly_free`: symbols that
    sent the driver on where there was no room. `announced`: sentences besides the symbols. `remembered`: what was learnt
    of the rider.
    """

    reached: bool
    reason: str
    seconds: float
    distance_m: float
    planned_m: float
    contact_speeds: tuple[float, ...]
    bumped: int = 0
    near_misses: int = 0
    wrongly_free: int = 0
    symbols: int = 0
    plans: int = 0
    announced: tuple[str, ...] = ()
    remembered: RiderValues = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class GuidedBars:
    """What a row has to reach: the least share of arrivals, and the greatest of medians, ratios and rates; None: not asked."""

    share: float
    median_s: float | None = None
    s_per_m: float | None = None
    m_per_m: float | None = None
    symbols_per_s: float | None = None


def guided_runs(
    setup: GuidedSetup, goals: Sequence[Place], time_limit_s: float, until_s: float = math.inf
) -> tuple[GuidedRun, ...]:
    """Drive to places one after the other, on one chair and with one rider; after `until_s` no drive begins any more.

    Raises as `guided_trial`.
    """
    found: list[GuidedRun] = []
    with guided_trial(setup) as trial:
        for goal in goals:
            if trial.simulator.now_ns * 1e-9 >= until_s:
                break
            found.append(judged_run(trial, setup, partial(trial.drive_to, goal, time_limit_s)))
    return tuple(found)


def unled_run(
    setup: GuidedSetup, there: Callable[[Pose2], bool], time_limit_s: float, wants_door: bool = False
) -> GuidedRun:
    """Let a driver whom nobody leads to a place try until the chair is `there`; raises as `guided_trial`."""
    with guided_trial(setup) as trial:
        trial.chair.want_door(wants_door)
        return judged_run(trial, setup, lambda: trial.drive_unled(time_limit_s, there))


def autonomous_run(setup: GuidedSetup, goal: Place, time_limit_s: float) -> GuidedRun:
    """Let the same chair drive by itself to a place, for comparison."""
    settings: SimulatorSettings = setup.simulator or randomised_settings(setup.seed)
    simulator = RecordingSimulator(setup.world, setup.body, settings, setup.seed)
    drive = DriveSetup(setup.grid, {goal.name: goal}, setup.body, DEFAULT, zones=setup.zones)
    leg = drive_to_places(drive, simulator, [goal.name], time_limit_s)[0]
    speeds, bumped = _contacts(simulator, setup, 0)
    planned_m = float(np.hypot(*np.diff(leg.planned[:, :2], axis=0).T).sum()) if len(leg.planned) > 1 else 0.0
    return GuidedRun(
        leg.reached, leg.reason, leg.duration_s, leg.distance_m, planned_m, speeds, bumped, plans=leg.plans
    )


def guided_row(name: str, how: str, found: Sequence[GuidedRun], bars: GuidedBars | None = None) -> Json:
    """Return the row of a table, and print it; with bars it has passed if it reaches them without a contact."""
    through = [each for each in found if each.reached]
    seconds, planned = (sum(getattr(each, name) for each in through) for name in ("seconds", "planned_m"))
    speeds = [speed for each in found for speed in each.contact_speeds]
    touched = sum(bool(each.contact_speeds) for each in found)
    driven_s = sum(each.seconds for each in found)
    row: Json = {
        "scene": name,
        "how": how,
        "runs": len(found),
        "reached": len(through),
        "median_s": round(statistics.median(each.seconds for each in through), 1) if through else None,
        "s_per_m": round(seconds / planned, 2) if planned else None,
        "m_per_m": round(sum(each.distance_m for each in through) / planned, 3) if planned else None,
        "symbols_per_s": round(sum(each.symbols for each in found) / max(driven_s, 1e-9), 2),
        "contacts": len(speeds),
        "fastest_contact": round(max(speeds, default=0.0), 3),
        "touched": touched,
        "touched_bound_95": round(upper_bound(touched, len(found)), 4),
        "bumped_by_people": sum(each.bumped for each in found),
        "near_misses": sum(each.near_misses for each in found),
        "wrongly_free": sum(each.wrongly_free for each in found),
        "failures": {number: each.reason for number, each in enumerate(found) if not each.reached},
    }
    if bars is not None:
        row["passed"] = not speeds and len(through) >= bars.share * len(found) and _within(row, bars)
    print(f"  {row}", flush=True)
    return row


def learnt_figures(remembered: RiderValues) -> Json:
    """Return what was learnt of a rider as plain numbers."""
    return {name: round(value, 4) for name, value in rider_from_values(remembered).figures().items()}


def _within(row: Mapping[str, Json], bars: GuidedBars) -> bool:
    """Whether each figure that is asked for has been measured and is within its bar."""
    for name in ("median_s", "s_per_m", "m_per_m", "symbols_per_s"):
        most, measured = getattr(bars, name), row[name]
        if most is not None and (measured is None or measured > most):
            return False
    return True


def _arrived_s(record: GuidedRecord) -> float | None:
    return record.seconds if record.reached else None


def judged_run(
    trial: GuidedTrial,
    setup: GuidedSetup,
    drive: Callable[[], GuidedRecord],
    done_s: Callable[[GuidedRecord], float | None] = _arrived_s,
) -> GuidedRun:
    """Let a trial drive, and return the run; `done_s` tells when [s] its aim was reached, None: never; by default it is the arrival."""
    simulator, began_ns = trial.simulator, trial.simulator.now_ns
    contacts = simulator.contacts
    record = drive()
    seconds = done_s(record)
    speeds, bumped = _contacts(simulator, setup, contacts)
    return GuidedRun(
        reached=seconds is not None,
        reason=record.reason,
        seconds=record.seconds if seconds is None else seconds,
        distance_m=record.distance_m,
        planned_m=record.planned_m,
        contact_speeds=speeds,
        bumped=bumped,
        near_misses=_near_misses(simulator, began_ns),
        wrongly_free=wrongly_free(record, setup),
        symbols=len(record.told),
        plans=record.plans,
        announced=record.announced,
        remembered=record.remembered,
    )


def _contacts(simulator: RecordingSimulator, setup: GuidedSetup, before: int) -> tuple[tuple[float, ...], int]:
    """Return the speeds of the contacts that the chair's motion caused, but for the first so many, and those of people."""
    reports, motion = simulator.contact_reports[before:], simulator.motion()
    causes = [contact_cause(contact, setup.world, setup.body, motion) for contact in reports]
    speeds = tuple(c.speed for c, cause in zip(reports, causes, strict=True) if cause is not ContactCause.BUMPED)
    return speeds, len(reports) - len(speeds)


def _near_misses(simulator: RecordingSimulator, began_ns: int) -> int:
    """Return how often a person came within `NEAR_MISS` of a chair that moved."""
    motion = simulator.motion().since(began_ns)
    near = (motion.people < NEAR_MISS) & (np.abs(motion.twists[:, 0]) > NEAR_SPEED)
    return int(np.count_nonzero(near[1:] & ~near[:-1]) + near[:1].sum())


def wrongly_free(record: GuidedRecord, setup: GuidedSetup) -> int:
    """Return how many symbols told the driver to go ahead or back where the world has less than `FREE_M` of room `TAKES_EFFECT_S` later."""
    ways = {Symbol.FORWARD.value: FREE_M, Symbol.BACK.value: -FREE_M}
    solid, wrong = solid_from_blocks(setup.world.blocks), 0
    for told in record.told:
        if told.symbol in ways:
            row = min(
                int(np.searchsorted(record.times_s, told.stamp_ns * 1e-9 + TAKES_EFFECT_S)), len(record.truth) - 1
            )
            pose = Pose2(*record.truth[row].tolist())
            wrong += in_contact(solid, setup.body, pose @ Pose2(ways[told.symbol]))
    return wrong
