"""How a chair drove a way: stops that nobody caused, turns back and forth, slow stretches, and the time against the best.

All figures come from the true motion, sampled every 10 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.trials.ride import TrueMotion, ride_of
from waychair.types import BoolArray, FloatArray, Pose2

STANDING, LONG_S = 0.02, 0.3
"""[m/s], [s] The chair stands when it is slower than the first for longer than the second."""

AWAY_M, NEAR_PERSON_M = 0.5, 2.0
"""[m] A stop counts farther than the first from start and goal, and with nobody nearer than the second."""

SLOW = 0.3
"""[m/s] Below this the chair is slow."""

_TURNING = 0.05
"""[rad/s] Below this a turn is the wobble of a chair that drives straight on, or the end of a turn."""


@dataclass(frozen=True, slots=True)
class WayManners:
    """The manners of one drive.

    `stops`: stops on the way with nobody near. `swings`: changes of the sense of turning within one stand.
    `turned` [rad]: the sum of all turning. `slow_share`: part of the time below 0.3 m/s. `jerk` [m/s^3]: the largest.
    """

    stops: int
    swings: int
    turned: float
    slow_share: float
    jerk: float


def manners_of(motion: TrueMotion, start: Pose2, goal: Pose2) -> WayManners:
    """Return the manners of a true motion between two poses in its frame; all are 0 for a drive that was refused at once."""
    if not len(motion.stamps_ns):
        return WayManners(stops=0, swings=0, turned=0.0, slow_share=0.0, jerk=0.0)
    stamps_s = (motion.stamps_ns - motion.stamps_ns[0]) * 1e-9
    v, omega = motion.twists.T
    stands = np.abs(v) < STANDING
    away = np.minimum(*(np.hypot(*(motion.poses[:, :2] - (at.x, at.y)).T) for at in (start, goal))) > AWAY_M
    faultless = away & (motion.people > NEAR_PERSON_M)
    standing = _stretches(stands)
    stops = sum(
        bool(stamps_s[last] - stamps_s[first] > LONG_S and faultless[first : last + 1].all())
        for first, last in standing
    )
    senses = np.sign(omega) * (np.abs(omega) > _TURNING)
    swings = sum(_changes(senses[first : last + 1]) for first, last in standing)
    seconds = np.diff(stamps_s, append=stamps_s[-1])
    return WayManners(
        stops=stops,
        swings=swings,
        turned=float((np.abs(omega) * (np.abs(omega) > _TURNING) * seconds).sum()),
        slow_share=float((np.abs(v) < SLOW).mean()),
        jerk=ride_of(motion).jerk,
    )


def _changes(senses: FloatArray) -> int:
    """Return how often the sense changes between 1 and -1; zeros in between do not count."""
    return int(np.count_nonzero(np.diff(senses[senses != 0.0])))


def _stretches(mask: BoolArray) -> list[tuple[int, int]]:
    """Return the first and last index of each run of set values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]
